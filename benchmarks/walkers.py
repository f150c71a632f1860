"""Hidden quadrupeds that are to walk: what they are, and what the real robot's logs tell of them.

Half of them are in the family: parameters drawn from its ranges. The others are drawn alike and have, besides, what
no simulator of the family has (`OUTSIDE`). Two thirds of the draws cannot walk (their motors are too weak for their
weight): a draw that the hand-written trot does not bring `ABLE` metres ahead in its own simulator, with what it hides
and without a fall, is drawn again. All take 36 commands a second, and each comes with its nameplate: its parts as
scales and rulers told them (`measured_quadruped.KNOWN`). Only the diagnosis reads that.
"""

from dataclasses import dataclass, replace

import numpy as np
from measured_quadruped import KNOWN, measured
from quadruped_trials import plan_of

from dynreg.data.recording import Recording
from dynreg.diagnose.account import simulator
from dynreg.diagnose.diagnose import Diagnosed, search
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import planned
from dynreg.diagnose.threshold import Threshold, known
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.lockstep import Search, run
from dynreg.gait.tasks import Task, fitness, kinds, task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import Terms, term
from dynreg.sim.excitation import excitation
from dynreg.sim.real import Budget, SimulatedRobot, Spent
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.space import ParameterSpace

TUNE = 61  # the seed of the development
RATE = 36.0  # Hz
OFF_CENTRE = 0.08  # m from the middle of the torso, ahead, where the payload sits
SHARE = 0.15  # of the torso's mass
TORSO = 2.0  # kg
ABLE = 0.1  # m in 10 s
BATCH, DRAWS = 8, 200  # draws of a robot until one can walk
CAUSES = 2  # that a diagnosis may name
# kind: {effect: values in its units}, two robots of each; the ground rises by 4 degrees where it says slope
OUTSIDE: dict[str, dict[str, tuple[float, ...]]] = {
    "payload": {"payload": (SHARE * TORSO,), "com_offset": (SHARE / (1 + SHARE) * OFF_CENTRE,)},
    "weak joint": {"torque_limit[JOINT]": (0.40,)},
    "late commands": {"command_delay": (0.030,)},
    "slope": {},
    "soft ground": {"contact_compliance": (3.0,)},
    "slippery side": {"second_friction_material": (0.5,)},
    "backlash": {"backlash[JOINT]": (np.radians(3.0),)},
}
COMMON = ("payload", "weak joint", "late commands", "slope", "backlash")
KINDS = (*COMMON, "soft ground", *COMMON, "slippery side")
FAMILY, NULL = "family", "null"  # the latter hide nothing either: their logs say what scores chance reaches


@dataclass(frozen=True, eq=False)
class Walker:
    """A hidden robot: its name and kind, true parameters (P,) and effects, the ground's angle [rad], its seed.

    nameplate : (P,) what its maker says its parameters are.
    """

    name: str
    kind: str
    robot: Robot
    parameters: np.ndarray
    effects: Terms | None
    slope: float
    seed: int
    nameplate: np.ndarray

    def real(self, budget: Budget, spent: Spent | None = None) -> SimulatedRobot:
        """The door to it."""
        terms = self.effects.terms if self.effects else ()
        values = tuple(v[0] for v in self.effects.values) if self.effects else ()
        return SimulatedRobot(
            self.robot,
            self.parameters,
            terms,
            values,
            seed=self.seed,
            budget=budget,
            slope=self.slope,
            threads=1,
            spent=spent or Spent(),
        )

    @property
    def truth(self) -> Simulators:
        """The simulator with its secrets, for the oracle."""
        return Simulators(self.parameters[None], self.effects)

    @property
    def task(self) -> Task:
        """The robot's own task, on its own ground."""
        table = self.robot.file.tasks[0]
        if not self.slope:
            return task_of(self.robot)
        return kinds()["slope"](table.model_copy(update={"kind": "slope", "values": {"angle": self.slope}}))


def names(many: int) -> list[str]:
    """Of `many` robots of each half, one of the family and one of the others in turn: kind and number."""
    return [f"{kind} {i}" for i in range(many) for kind in (FAMILY, KINDS[i % len(KINDS)])]


def walker_of(name: str, seed: int) -> Walker:
    """The robot of this name."""
    robot, (kind, _, number) = load_robot("quadruped"), name.rpartition(" ")
    own = stream_seed(seed, "walker", kind, number) % 2**31
    rng = stream(own, "secrets")
    joint = rng.choice([a.split("/")[0] for a in robot.actions])
    told = {k.replace("JOINT", joint): v for k, v in OUTSIDE.get(kind, {}).items()}
    effects = Terms(tuple(map(term, told)), tuple(np.array([v]) for v in told.values())) if told else None
    made = Walker(
        name,
        kind,
        robot,
        robot.space.nominal,
        effects,
        np.radians(4.0) if kind == "slope" else 0.0,
        own,
        robot.space.nominal,
    )
    made = replace(made, parameters=_able(made))
    scatter = np.array([KNOWN.get(name, 0.0) for name in robot.space.names])
    plate = made.parameters * (1 + scatter * np.clip(rng.standard_normal(len(scatter)), -2.5, 2.5))
    known = np.where(scatter > 0, np.clip(plate, *robot.space.bounds.T), robot.space.nominal)
    return replace(made, nameplate=known)


def _able(walker: Walker) -> np.ndarray:
    """(P,) the first draw that can walk, with what it hides."""
    robot, rate = walker.robot, walker.robot.space.names.index("action_rate")
    draws = robot.space.sample(0, DRAWS, walker.seed)
    draws[:, rate] = RATE
    for first in range(0, DRAWS, BATCH):
        values = draws[first : first + BATCH]
        terms = walker.effects
        if terms:
            terms = terms.tiled(len(values))
        trials = Trials(robot, walker.task, Simulators(values, terms), rate=RATE, seed=walker.seed, threads=1)
        trot = trials.space.feasible(trials.space.from_unit(trials.space.starts[:1]))
        able = np.flatnonzero(fitness(trials.grades(trot)[0]) >= ABLE)
        if len(able):
            return values[able[0]]
    raise RuntimeError(f"no draw of {walker.name} can walk")


def excited(walker: Walker) -> tuple[Recording, Spent]:
    """The log that the query reads: the robot's own excitation, each episode a trial from rest."""
    run = excitation(walker.robot, seed=walker.seed, name="own")
    return _recorded(walker, run.actions, [f"query_{e}" for e in range(run.episodes)], run.actions.shape[1])


def stood_and_trotted(walker: Walker) -> tuple[Recording, Spent]:
    """The log that the diagnosis reads: standing and trotting, as in the naming benchmark."""
    plan = plan_of(measured(walker.robot))
    return _recorded(walker, plan.run.actions, list(plan.names), plan.run.steps + 1)


def _recorded(walker: Walker, actions: np.ndarray, names: list[str], apart: int) -> tuple[Recording, Spent]:
    """Episodes (E, T, A), each a trial that costs what it lasts; they begin `apart` commands after each other."""
    real = walker.real(Budget(trials=len(actions), seconds=actions.shape[0] * actions.shape[1] / RATE))
    logs = [real.run(a, RATE, name).recording for a, name in zip(actions, names, strict=True)]
    episodes = [
        replace(log.episodes[0], time=log.episodes[0].time + e * apart / RATE) for e, log in enumerate(logs)
    ]
    return replace(logs[0], episodes=tuple(episodes)), real.spent


@dataclass(frozen=True, eq=False)
class Named:
    """What a diagnosis came to: its verdict, the causes by key, the simulator with them and the one without any.

    nats : score of the best cause of each round, whether or not it passed.
    """

    verdict: str
    nats: tuple[float, ...]
    causes: tuple[str, ...]
    extended: Simulators
    calibrated: Simulators


def named(walker: Walker, log: Recording, needed: float, effects: tuple[str, ...] = ()) -> Named:
    """The diagnosis from the nameplate on; a cause needs `needed` nats.

    effects : that may be named, () for all.
    """
    robot = measured(walker.robot)
    space = zip(robot.space.parameters, walker.nameplate, strict=True)
    robot = replace(robot, space=ParameterSpace(tuple(replace(p, nominal=float(v)) for p, v in space)))
    tests = ",".join(e.name for e in log.episodes if e.name.startswith("test"))
    settings = DiagnosisOptions(hold_out=tests, max_causes=CAUSES, effects=effects or None, threads=1)
    model, data = pose(robot, log, settings)

    def diagnosed() -> Search[Diagnosed]:
        problem = yield from planned(model, data, single_terms(robot, effects))
        return (yield from search(problem, log, known(Threshold(needed, ())), settings))

    made = run(diagnosed(), threads=1)
    found, simulators = made.found, []
    for point in (found.current, found.base):
        values, own = simulator(model, data, point, settings)
        simulators.append(Simulators(values[None], own))
    nats = tuple(r.chosen.nats if r.chosen else 0.0 for r in found.rounds)
    return Named(made.verdict, nats, tuple(t.key for t in found.current.hypothesis.terms), *simulators)
