"""The hidden robots that every method is asked about: what they hide, and their logs.

The servo and the wheels are simulated by code that shares nothing with the library, the robots on feet by the library's
own with a finer time step. The quadruped's parts are known as well as scales and rulers tell
(`measured_quadruped`); it stands and trots in its log, in episodes of 1.7 s. The AIBO's elbows are of another
material where it is outside of the family; its log holds walks of 5 s.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import aibo
from independent_rows import rows_of
from measured_quadruped import measured_quadruped
from naming import seeds
from quadruped_trials import plan_of

from dynreg.data.recording import Recording
from dynreg.diagnose.trial import Trial, Trials, hidden_log
from dynreg.evidence.truth import Hidden, protocol
from dynreg.rng import stream
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot
from dynreg.truths.table import KINDS

HIDDEN = ("in the family", "outside")
PLANS = {  # of `staged`: the drives first, then all
    "servo_pendulum": (("*_friction", "torque_constant", "resistance"), ("*",)),
    "quadruped": (("torque", "joint_speed"), ("*",)),
    "diffdrive": (("*",),),
    "aibo": (("*_speed", "*_torque"), ("*",)),
}
FEET = ("quadruped", "aibo")  # in turn: a log is told in trials, and not in seconds
WALKERS = ("load_friction", "payload", "command_lag", "torque_limit", "backlash", "ground_friction")
SIZE = "medium"
HELD = 6  # stands of a quadruped, and trots, to test
AIBO = {"fit": 6, "test": 3}  # walks of an AIBO


@dataclass(frozen=True)
class Secret:
    """A hidden robot: what of, which kind, its number in it, the seconds of its log, and what it hides.

    episodes : how many of its log may shape an answer; None for all. All are held against the same ones.
    """

    robot: str
    hidden: str
    number: int
    seconds: float
    cause: str | None
    seed: int
    episodes: int | None = None

    @property
    def key(self) -> dict:
        """What tells it from others."""
        key = {"robot": self.robot, "hidden": self.hidden, "number": self.number, "seconds": self.seconds}
        return key if self.episodes is None else key | {"episodes": self.episodes}

    @property
    def name(self) -> str:
        """Of its recording."""
        return "_".join(map(str, self.key.values())).replace(" ", "_")

    def log(self) -> tuple[Hidden, Recording]:
        """What it hides, and what it wrote."""
        hidden, log = self._whole()
        if self.episodes is None:
            return hidden, log
        return hidden, replace(log, episodes=tuple(first(log.episodes, self.episodes)))

    def _whole(self) -> tuple[Hidden, Recording]:
        robot = described(self.robot)
        if self.robot == "aibo":
            return walked(robot, self.cause is not None, self.seed)
        if self.robot == "quadruped":
            plan = plan_of(robot, HELD)
        else:
            plan = protocol(robot, seed=self.seed, seconds=self.seconds)
        if self.robot in KINDS:
            trial = Trial((), SIZE if self.cause else None, self.seed, cause=self.cause)
            return hidden_log(Trials(robot, plan, truth="independent"), trial)
        terms = () if self.cause is None else (term(self.cause),)
        return hidden_log(Trials(robot, plan), Trial(terms, SIZE if terms else None, self.seed))


def first(episodes: tuple, many: int) -> Iterator:
    """So many of those to fit and to select, in turn of both, and all of those to test; in their own order."""
    parts = [[e.name for e in episodes if e.name.startswith(p)] for p in ("fit", "select")]
    turns = [name for pair in zip(*parts, strict=True) for name in pair][:many]
    return (e for e in episodes if e.name in turns or e.name.startswith("test"))


@cache
def described(name: str) -> Robot:
    """What the library is told of a robot."""
    return measured_quadruped() if name == "quadruped" else load_robot(name)


def walked(robot: Robot, material: bool, seed: int) -> tuple[Hidden, Recording]:
    """An AIBO and its walks."""
    one = aibo.hidden(seed, material=material)
    terms, values = one.effects(robot)
    run = {}
    for part, many in AIBO.items():
        way = seed + (1_000_000 if part == "test" else 0)
        run |= {f"{part}_{i}": w for i, w in enumerate(aibo.walks(robot, many, way))}
    log = aibo.logged(one, robot, run, threads=1)
    return Hidden(terms, values, one.values(robot.space), seed, SIZE if terms else None), log


def secrets(robot: str, given: argparse.Namespace, seed: int) -> Iterator[Secret]:
    """The robots of a table; every cause has its turn before one has a second, in an order that is drawn."""
    turns = stream(seed, "methods", robot, "causes").permutation(causes(robot))
    for hidden in HIDDEN:
        for number, one in enumerate(seeds(seed, "methods", robot, hidden, n=given.robots)):
            cause = str(turns[number % len(turns)]) if hidden == "outside" else None
            for seconds in [0.0] if robot in FEET else given.seconds:
                for episodes in getattr(given, "episodes", None) or [None]:
                    yield Secret(robot, hidden, number, seconds, cause, one, episodes)


def causes(robot: str) -> tuple[str, ...]:
    """What robots of a kind may hide."""
    if robot == "aibo":
        return ("second_friction_material[elbow]",)
    if robot not in KINDS:
        return WALKERS
    rows = rows_of(load_robot(robot))
    return (*rows.same, *rows.other)


def plan(folder: Path, robot: str) -> Path:
    """The file of a plan: the first stage for single joints where there are any, the last for whole replays."""
    space = load_robot(robot).space.names
    stages = []
    for number, patterns in enumerate(PLANS[robot]):
        own = [p for p in patterns if "*" in p or p in space]
        loss = "joint" if number == 0 and len(PLANS[robot]) > 1 else "replay"
        stages.append(
            f'[[stages]]\nname = "s{number}"\nparameters = {json.dumps(own)}\nloss = "{loss}"\ngenerations = 10\n'
        )
    path = folder / f"{robot}.toml"
    path.write_text("\n".join(stages), encoding="utf-8")
    return path
