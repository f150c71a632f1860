"""Hidden robots for the benchmarks: secret parameters, their logs with sensor noise, unseen test commands."""

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from journal import Journal

import dynreg
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.rng import stream, stream_seed
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run, motor_noise
from dynreg.sim.space import Parameter, ParameterSpace

# What the outsiders have and no simulator of the family: gains, friction, centre of mass, contact.
OUTSIDE = (
    Parameter("servo_gain", "1", 1.0, 0.5, 1.5, "linear", np.inf, ("port.drive.gain[*] *=",)),
    Parameter("joint_friction", "N*m", 0.05, 0.02, 0.15, "linear", np.inf, ("port.friction.coulomb[*] =",)),
    Parameter("com_forward", "m", 0.0, -0.03, 0.03, "linear", np.inf, ("mj.body_ipos[torso][0] +=",)),
    Parameter("com_left", "m", 0.0, -0.02, 0.02, "linear", np.inf, ("mj.body_ipos[torso][1] +=",)),
    Parameter(
        "contact_time", "s", 0.02, 0.012, 0.04, "linear", np.inf, ("mj.geom_solref[*_foot,ground][0] =",)
    ),
)


def rows_of(
    name: str, seed: int, many: int, simulators: int, journal: Journal, row: Callable[..., dict]
) -> list[dict]:
    """`row(session, robot, seed, population)` of each hidden robot, those in the journal left as they are.

    They are asked about in a population of so many `simulators`, made where a row is missing.
    """
    robot = load_robot(name)
    seeds = [stream_seed(seed, name, number) % 2**31 for number in range(many)]
    done = {one["seed"]: one for one in journal.lines()}
    if set(seeds) - set(done):
        with tempfile.TemporaryDirectory() as place, dynreg.open(place) as session:
            population = session.populate(name, simulators, seed=seed, threads=1).population
            for one in (one for one in seeds if one not in done):
                done[one] = journal.add(row(session, robot, one, population))
                print(json.dumps(done[one]), flush=True)
    return [done[one] for one in seeds if one in done]


@dataclass(frozen=True)
class Hidden:
    """One hidden robot: `robot` is the simulator it really is, `values` (P,) its secret, `rate` its commands' [Hz]."""

    robot: Robot
    values: np.ndarray
    rate: float
    number: int
    seed: int
    sensor_noise: float

    def log(self, commands: Run, name: str) -> Recording:
        """What its logger writes when it runs `commands`: sensor noise on every channel."""
        states = self.run(commands, "log")
        noise = np.array([c.noise for c in self.robot.file.channels]) * self.sensor_noise
        rng = stream(self.seed, "sensor", self.number, name)
        states = states + noise * rng.standard_normal(states.shape)
        channels = [Channel(c.name, c.unit) for c in self.robot.file.channels]
        channels += [Channel(a.name, a.unit) for a in self.robot.file.actions]
        episodes = []
        for e, (s, a) in enumerate(zip(states, commands.actions, strict=True)):
            values = np.concatenate([s, np.concatenate([a, a[-1:]])], axis=1)
            episodes.append(Episode(f"{name}_{e}", np.arange(len(s)) / self.rate, values))
        return Recording(tuple(channels), tuple(episodes), measured=False)

    def run(self, commands: Run, name: str) -> np.ndarray:
        """(E, T+1, S) true states, with motor noise of their own for every `name`."""
        seeds = np.array([stream_seed(self.seed, "motor", self.number, name) % 2**62])
        noise = motor_noise(seeds, *commands.actions.shape)
        return rollout(
            self.robot, self.values[None], Run(commands.actions, period=1 / self.rate, noise=noise)
        ).states[0]


def hidden_robots(robot: Robot, n: int, seed: int, *, outside: bool = False) -> list[Hidden]:
    """n robots drawn from the family's ranges; `outside` adds what the family lacks and five times the noise."""
    space = robot.space
    truth = robot
    if outside:
        space = ParameterSpace(space.parameters + OUTSIDE)
        truth = replace(robot, space=space)
    values, noise = space.sample(0, n, seed), 5.0 if outside else 1.0
    if "action_rate" not in robot.space.names:
        return [Hidden(truth, v, robot.rate, i, seed, noise) for i, v in enumerate(values)]
    rate = list(robot.space.names).index("action_rate")
    return [Hidden(truth, v, float(v[rate]), i, seed, noise) for i, v in enumerate(values)]


def unseen_commands(robot: Robot, hidden: Hidden, *, episodes: int = 8, seconds: float = 1.0) -> Run:
    """Commands that neither the population nor the log ran: `episodes` of one second at the robot's rate."""
    steps = int(round(seconds * hidden.rate))
    return excitation(
        robot,
        seed=stream_seed(hidden.seed, "test", hidden.number) % 2**31,
        name="unseen",
        episodes=episodes,
        steps=steps,
    )


def errors_of(population, hidden: Hidden, chosen: dict[str, np.ndarray]) -> dict[str, float]:
    """Rollout error of each that was `chosen`, parameters (n, P), and of the robot itself, on unseen commands."""
    robot = population.shared.robot
    commands = unseen_commands(robot, hidden)
    truth = hidden.run(commands, "test")
    weight = np.array([c.weight for c in robot.file.channels])
    use = np.flatnonzero(weight)
    spread = population.entries.states.reshape(-1, len(weight)).std(axis=0)
    run = Run(commands.actions, period=1 / hidden.rate)
    itself = chosen.pop("itself")
    values = np.concatenate(list(chosen.values()))
    states = [rollout(robot, values, run).states, rollout(hidden.robot, hidden.values[None], run).states]
    miss = np.concatenate(
        [np.abs(np.nan_to_num(s, nan=1e3) - truth)[..., 1:, use] / spread[use] for s in states]
    )
    error = np.minimum(miss, 10.0).mean(axis=(1, 2, 3))
    chosen["itself"] = itself
    cuts = np.cumsum([len(v) for k, v in chosen.items()])[:-1]
    return {k: float(part.mean()) for k, part in zip(chosen, np.split(error, cuts), strict=True)}
