"""Hidden robots for trials: a truth that is not the model itself, with one effect hidden in it, or none.

The truth has errors of its nameplate, a finer time step than the model, a torque disturbance, sensor noise and
quantisation; where the robot's engines allow, it runs on another engine than the diagnosis.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.errors import UsageError
from dynreg.evidence.hypothesis import FACTOR, Coordinates, Hypothesis
from dynreg.evidence.lockstep import Ask, Search, ask
from dynreg.evidence.lockstep import run as answered
from dynreg.replay.known import nominal_known
from dynreg.rng import stream
from dynreg.sim.effects import Term, Terms
from dynreg.sim.engines import Case
from dynreg.sim.excitation import excitation
from dynreg.sim.real import disturbance, disturbed, finer, sensed
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

# What a trial is: the tables of the naming benches were made with these, others would be other trials.
FIT, TEST = 0.4, 0.2  # of the seconds; as much to select by as to fit
SHORTEST = 20  # commands of an episode: fewer hold no reversal
SIZES = (0.7, 1.3)  # of the episodes: none so gentle that it says nothing
REACH = 0.7  # of the bank's excitation: a robot that topples or whirls says less about causes than one that follows
REST = 0.5  # s that a planar base stands still before each episode: so long the log sees where it stands
TILES = 2.5  # nameplate errors are drawn within so many sigma


@dataclass(frozen=True)
class Hidden:
    """What a trial hides: terms with their values [units of the effects], and the robot's true parameters (P,).

    cause : id of what a truth by other code hides; its terms are then those of the library's effect of the same
    physics, or none, with NaN for values that the effect does not state alike. answers : terms each of which is a right
    name for that cause; none where it lies outside the library.
    """

    terms: tuple[Term, ...]
    values: tuple[np.ndarray, ...]
    parameters: np.ndarray
    seed: int
    size: str | None = None
    cause: str | None = None
    answers: tuple[Term, ...] = ()

    @property
    def anything(self) -> bool:
        """Whether a cause is hidden."""
        return bool(self.terms) or self.cause is not None

    @property
    def outside(self) -> bool:
        """Whether the library has no name for what is hidden."""
        return self.cause is not None and not self.answers

    @property
    def id(self) -> str | None:
        """Id of the cause, "a+b" of two effects; None where nothing is hidden."""
        return self.cause or "+".join(t.effect.id for t in self.terms) or None

    @property
    def places(self) -> tuple[str, ...]:
        """The joints, or the body, where it sits; () for all joints, or the robot as a whole."""
        return tuple(place for t in self._stated for place in t.at)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints among its places."""
        return tuple(j for t in self._stated for j in t.joints)

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies, tool frames and materials among its places."""
        return tuple(b for t in self._stated for b in t.bodies)

    @property
    def _stated(self) -> tuple[Term, ...]:
        return self.terms or self.answers[:1]

    @property
    def key(self) -> str:
        """The terms' key; "" where nothing is hidden."""
        return Hypothesis(self.terms).key


@dataclass(frozen=True)
class Protocol:
    """The commands of a trial: episodes (E, T, A) that fit, those again to select by, and others to test.

    names : of the episodes, that begin with the part they are for. run : with the time each begins at.
    """

    run: Run
    names: tuple[str, ...]


def protocol(
    robot: Robot, *, seed: int = 0, seconds: float = 50.0, episode: float = 2.5, reach: float = REACH
) -> Protocol:
    """Random levels that saturate, a chirp, slow triangles, a torque-off drop, each twice; others to test.

    A planar base stands still at the start of each. Two fifths of `seconds` to fit, the same commands again to
    select, a fifth of new ones to test. reach : as in `excitation`.
    Raises UsageError where there is no room for two episodes to fit and one to test.
    """
    rate = robot.rate
    steps = round(episode * rate)
    fits, tests = round(FIT * seconds / episode), round(TEST * seconds / episode)
    if fits < 2 or tests < 1 or steps < SHORTEST:
        raise UsageError(
            f"{seconds:g} s in episodes of {episode:g} s",
            expected=f"at least {5 * episode:g} s, two episodes to fit, two to select, one to test",
            do="ask for more seconds or shorter episodes",
        )
    bank = {"reach": reach, "sizes": SIZES}
    first = excitation(robot, seed=seed, name="diagnose", episodes=fits, steps=steps, **bank)
    last = excitation(robot, seed=seed, name="diagnose test", episodes=tests, steps=steps, **bank)
    if robot.planar:
        moves = (np.arange(steps) >= round(REST * rate))[:, None]
        first, last = (replace(run, actions=np.where(moves, run.actions, 0.0)) for run in (first, last))
    join = lambda a: (  # noqa: E731
        None if getattr(first, a) is None else np.concatenate([getattr(first, a)] * 2 + [getattr(last, a)])
    )
    count = 2 * fits + tests
    names = [f"fit_{i}" for i in range(fits)] + [f"select_{i}" for i in range(fits)]
    names += [f"test_{i}" for i in range(tests)]
    run = Run(
        join("actions"),
        inputs=join("inputs"),
        settings=np.concatenate([trial_settings(robot, fits)] * 2 + [trial_settings(robot, tests)]),
        initial=join("initial"),
        period=1.0 / rate,
        begin=np.arange(count) * (steps + 1) / rate,
    )
    return Protocol(run, tuple(names))


def trial_settings(robot: Robot, episodes: int) -> np.ndarray:
    """(E, K) settings of the episodes of a protocol: the `trial` values of robot.toml in turn, else nominal ones."""
    choices = [s.trial or [s.nominal] for s in robot.file.settings]
    return np.array([[c[e % len(c)] for c in choices] for e in range(episodes)]).reshape(
        episodes, len(choices)
    )


def hide(
    robot: Robot,
    terms: tuple[Term, ...],
    size: str | None,
    seed: int,
    *,
    centre: np.ndarray | None = None,
    tolerance: float = 1.0,
) -> Hidden:
    """A robot drawn from its nameplate with `terms` at a size (weak, medium, strong), signs and shapes drawn too.

    centre : (P,) parameters that it is drawn about, but for what every log tells; the nominal ones by default.
    tolerance : factor on the nameplate's tolerances.
    """
    rng = stream(seed, "hidden robot", robot.name)
    coordinates = Coordinates(robot, nominal_known(robot), centre, tolerance)
    z = np.clip(rng.standard_normal(len(coordinates)), -TILES, TILES)
    known = [
        np.isfinite(p.tolerance) for p in np.array(robot.space.parameters, dtype=object)[coordinates.free]
    ]
    parameters = coordinates.values(np.where(known, z, 0.0))
    values = []
    for term in terms:
        row = []
        for p in term.effect.parameters:
            base = coordinates.scale(term, p) / p.medium * p.size(size or "medium")
            if p.shape:
                row.append(base * FACTOR ** rng.uniform(-0.5, 0.5))
            else:
                row.append(base * (rng.choice([-1.0, 1.0]) if p.signed else 1.0))
        values.append(np.array(row))
    return Hidden(terms, tuple(values), parameters, seed, size)


def log_of(robot: Robot, hidden: Hidden, plan: Protocol, *, engine: str | None = None) -> Recording:
    """What the hidden robot's logger writes under the commands of `plan`."""
    return recorded(robot, plan, answered(measured_states(robot, hidden, plan.run, engine=engine)))


def recorded(robot: Robot, plan: Protocol, states: np.ndarray) -> Recording:
    """The log of readings (E, T+1, S) under the commands of `plan`."""
    run = plan.run
    parts = [states, np.concatenate([run.actions, run.actions[:, -1:]], axis=1)]
    channels = [Channel(c.name, c.unit) for c in robot.file.channels]
    channels += [Channel(a.name, a.unit) for a in robot.file.actions]
    if run.inputs is not None and run.inputs.shape[-1]:
        parts.append(np.concatenate([run.inputs, run.inputs[:, -1:]], axis=1))
        units = {i.name: i.unit for i in robot.file.inputs}
        channels += [Channel(name, units.get(name, "1")) for name in robot.inputs]
    values = np.concatenate(parts, axis=2)
    episodes = []
    for e, name in enumerate(plan.names):
        time = run.begin[e] + np.arange(values.shape[1]) * run.period
        settings = {} if run.settings is None else dict(zip(robot.settings, run.settings[e], strict=True))
        episodes.append(Episode(name, time, values[e], settings))
    return Recording(tuple(channels), tuple(episodes), measured=False)


def measured_states(
    robot: Robot, hidden: Hidden, run: Run, *, engine: str | None = None, truth: Robot | None = None
) -> Search[np.ndarray]:
    """(E, T+1, S) what the hidden robot's sensors say in the episodes of `run`: noise and quantisation included.

    truth : the robot with the time step in which it moves; by default that of `finer`.
    """
    truth, limits = truth or _finer(robot), Coordinates(robot, nominal_known(robot)).drive_limits
    active = Terms(hidden.terms, tuple(v[None] for v in hidden.values)) + disturbance(truth, limits)
    whole = replace(run, joints=None)  # the robot moves with all of its joints, whichever are looked at
    whole = disturbed(whole, limits, stream(hidden.seed, "disturbance", robot.name))
    (states,) = yield from ask(Ask(truth, Case(hidden.parameters[None], whole, active), engine))
    return sensed(robot, states, stream(hidden.seed, "sensors", robot.name))


@lru_cache(maxsize=64)  # its model is compiled once for all that are hidden
def _finer(robot: Robot) -> Robot:
    return finer(robot)
