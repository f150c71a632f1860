"""Legs in turn: each hangs free while the base is held on a stand, and reverses, slowly and fast.

A leg that carries the robot rests on one side of its play, and the ground bends what it does: neither backlash nor
elasticity shows. Where it hangs free its joints see no contact, and every reversal passes through the play.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import UsageError, quoted
from dynreg.evidence.accuracy import STEP
from dynreg.evidence.hypothesis import Coordinates
from dynreg.excite.candidates import chirp, triangle
from dynreg.excite.limits import Limits, Span, reached_by
from dynreg.excite.playing import played
from dynreg.progress import Progress
from dynreg.replay.known import nominal_known
from dynreg.rng import stream
from dynreg.sim.effects import Term, Terms, applicable, effect
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run
from dynreg.sim.stand import legs_of, on_stand

AIMS = ("backlash", "joint_elasticity")  # what the ground hides
ALL = "all"
EPISODE = 2.5  # s: a slow triangle goes once to and fro
FEWEST = 20  # commands of an episode: fewer hold no reversal
SLOW = 2.0  # s of a slow triangle
# Commands a period of the fast patterns, and their reaches. On the packaged quadruped (36 Hz) a stiff spring shows best
# in sines of 5 Hz, which are 7 commands a period: beyond, the joint no longer follows, below, the spring does not bend.
FAST, REACHES = (18, 12, 9, 7), (0.3, 0.5, 0.7)
TESTS = 2  # episodes to test by, one slow and one fast; of the rest one half is to fit and the same again to select
SECONDS = (
    25.0  # of a leg: with 22 s a spring of medium size shows by 6 to 14 nats in a joint of the quadruped
)


@dataclass(frozen=True, eq=False)
class Hanging:
    """The commands for one leg that hangs free.

    joints : that move; those of the other legs hold the reset pose. patterns : of each episode. nats : (effects,
    joints) evidence [nats] to expect of `AIMS` at medium size in each joint, from what is not to test.
    reached : (E, 2, S) lowest and highest states to expect.
    """

    leg: str
    joints: tuple[str, ...]
    run: Run
    names: tuple[str, ...]
    patterns: tuple[str, ...]
    nats: np.ndarray
    reached: np.ndarray

    @property
    def held_out(self) -> tuple[str, ...]:
        """The episodes to test by."""
        return tuple(name for name in self.names if name.startswith("test"))


@dataclass(frozen=True, eq=False)
class HangingLegs:
    """What to play, leg after leg. robot : on its stand. limits : that the commands keep. aims : of each leg's nats."""

    robot: Robot
    limits: Limits
    aims: tuple[str, ...]
    legs: tuple[Hanging, ...]
    seed: int

    def recording(self, hanging: Hanging) -> Recording:
        """The commands for a leg as a log without states: see `played`."""
        source = {"leg": hanging.leg, "seed": self.seed, "patterns": list(hanging.patterns)}
        return played(self.robot, hanging.run, hanging.names, source)


def hanging_legs(
    robot: Robot,
    legs: Sequence[str] = (ALL,),
    *,
    seconds: float = SECONDS,
    seed: int = 0,
    threads: int = 0,
    progress: Progress | None = None,
) -> HangingLegs:
    """Slow and fast reversals of legs in turn, for a robot whose base is held on a stand.

    All joints of a leg move at once, each at times of its own. Slow and wide, the weight of the links changes sides;
    fast, their inertia does, and a spring bends. The fast patterns are those in which the robot's sensors see most of a
    medium backlash and elasticity, in the joint where they see least of it, once its own parameters have made up for
    what they can. None in which a joint is expected to pass its stops or to hit them, or a simulator diverges.
    legs : of `legs_of`, or ("all",). seconds : of each leg's commands.
    Raises UsageError for a leg that the robot has not, a robot without legs, drives or effects to look for, commands
    that come too seldom, or a leg that cannot follow enough of them; RobotError where its model cannot be put on a
    stand, or rests outside its limits.
    """
    stand = on_stand(robot)
    known = legs_of(stand)
    unlike = [leg for leg in legs if leg not in known and tuple(legs) != (ALL,)]
    if unlike or not legs:
        raise UsageError(
            f"leg {unlike[0]!r} of robot {robot.name!r}" if unlike else "no leg",
            expected=f"{ALL}, or some of {quoted(known)}",
            do="correct the name",
        )
    aims = tuple(name for name in AIMS if name in applicable(stand))
    if not aims:
        raise UsageError(
            f"robot {robot.name!r} can have neither {' nor '.join(AIMS)}",
            expected="drives that turn joints",
            do="see `dynreg effects`",
        )
    steps = round(EPISODE * stand.rate)
    if steps < FEWEST:
        raise UsageError(
            f"{EPISODE:g} s of commands at {stand.rate:g} Hz",
            expected=f"a robot with at least {FEWEST / EPISODE:g} commands a second",
            do="use a robot whose commands come more often",
        )
    each = (round(seconds / EPISODE) - TESTS) // 2
    if not 2 <= each <= len(FAST) * len(REACHES):
        most = EPISODE * (2 * len(FAST) * len(REACHES) + TESTS)
        raise UsageError(
            f"{seconds:g} s for a leg",
            expected=f"{EPISODE * (4 + TESTS):g} to {most:g} s",
            do="ask for more seconds" if each < 2 else "ask for fewer seconds, or play the file twice",
        )
    limits, report, made = Limits.of(stand), progress or (lambda *_: None), []
    chosen = [*known] if tuple(legs) == (ALL,) else list(dict.fromkeys(legs))
    for number, leg in enumerate(chosen):
        report("excite", number, len(chosen))
        made.append(_hanging(stand, limits, aims, leg, known[leg], steps, each, seed, threads))
    report("excite", len(chosen), len(chosen))
    return HangingLegs(stand, limits, aims, tuple(made), seed)


def _hanging(
    robot: Robot,
    limits: Limits,
    aims: tuple[str, ...],
    leg: str,
    joints: tuple[str, ...],
    steps: int,
    each: int,
    seed: int,
    threads: int,
) -> Hanging:
    """The commands for one leg: the slow pattern and the fast ones that tell most, twice; others to test."""
    names, actions = zip(*_patterns(robot, limits, joints, steps, seed), strict=True)
    run = Run(np.array(actions), settings=_nominal(robot, len(actions)), period=1.0 / robot.rate)
    nats, usable, reached = _expected(robot, run, aims, joints, threads)
    slow, fast = (
        [i for i in np.flatnonzero(usable) if names[i].startswith("slow") == kind] for kind in (True, False)
    )
    if len(slow) < TESTS or len(fast) < each:
        raise UsageError(
            f"leg {leg!r} of robot {robot.name!r} hits or passes its stops, or diverges, in {(~usable).sum()} of the"
            f" {len(usable)} patterns that were tried",
            expected=f"{TESTS} slow and {each} fast ones that it can follow",
            do="narrow the limits of its actions in robot.toml, or ask for fewer seconds",
        )
    fast = _picked(nats, fast, each, begun=slow[:1])
    twice, last = [slow[0], *fast[:-1]], [slow[1], fast[-1]]
    order = np.array([*twice, *twice, *last])
    called = [f"{part}_{i}" for part, many in (("fit", twice), ("select", twice)) for i in range(len(many))]
    called += [f"test_{i}" for i in range(len(last))]
    told = 2 * nats[..., twice].sum(axis=-1)
    patterns = tuple(names[i] for i in order)
    return Hanging(leg, joints, run.take(order), tuple(called), patterns, told, reached[order])


def _patterns(
    robot: Robot, limits: Limits, joints: tuple[str, ...], steps: int, seed: int
) -> Iterator[tuple[str, np.ndarray]]:
    """(name, (T, A) commands): two slow triangles, and fast sines and chirps at several reaches."""
    rate = robot.rate
    moving = np.isin(np.arange(len(robot.joints)), robot.drives_of(joints))
    apart = stream(seed, "excite", robot.name, "legs").uniform(0.0, 1.0, len(moving))
    t, duration, span = np.arange(steps)[:, None] / rate, steps / rate, Span.of(robot, moving)

    def kept(shape: np.ndarray, reach: float) -> np.ndarray:
        return span.commands(reach * moving * shape, limits, 1.0 / rate)

    for reach in (0.5, 0.3):
        yield (
            f"slow triangle of {SLOW:g} s, reach {reach:g}",
            kept(triangle(SLOW)(t + SLOW * apart, duration), reach),
        )
    for reach in REACHES:
        for many in FAST:
            hertz = rate / many
            sine = np.sin(2 * np.pi * (hertz * t + apart))
            yield f"sine of {hertz:.3g} Hz, reach {reach:g}", kept(sine, reach)
        low, high = rate / FAST[0], rate / FAST[-2]
        yield (
            f"chirp from {low:.3g} to {high:.3g} Hz, reach {reach:g}",
            kept(chirp(low, high)(t + apart / low, duration), reach),
        )


def _expected(
    robot: Robot, run: Run, aims: tuple[str, ...], joints: tuple[str, ...], threads: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(effects, joints, E) nats by which each effect of medium size in each joint shows in each episode.

    To first order in the robot's parameters, which make up for what they can within their tolerances. And `reached_by`
    of all that is simulated for it; no nats where that cannot be used.
    """
    c = Coordinates(robot, nominal_known(robot))
    steps = np.concatenate([np.zeros((1, len(c))), STEP * np.eye(len(c))])
    values = np.array([c.values(z) for z in steps])
    terms = [Term(effect(name), (joint,)) for name in aims for joint in joints]
    made = [rollout(robot, values, run, threads=threads)]
    for term in terms:
        size = np.array([[c.scale(term, p) for p in term.effect.parameters]])
        made.append(rollout(robot, values[:1], run, threads=threads, terms=Terms((term,), (size,))))
    states, fell = (np.concatenate([getattr(one, k) for one in made]) for k in ("states", "fell"))
    usable, reached = reached_by(robot, states, fell, run.period)
    use = [robot.channels.index(f"{j}/position") for j in joints if f"{j}/position" in robot.channels]
    seen = states[:, usable][..., use] / np.maximum(robot.sensor_noise[use], 1e-12)
    slopes, moved = (seen[1 : len(steps)] - seen[0]) / STEP, seen[len(steps) :]  # (P', E, T+1, C), (N, ...)
    nats = np.zeros((len(terms), run.episodes))
    nats[:, usable] = [
        [_left(one[e] - seen[0, e], slopes[:, e]) for e in range(usable.sum())] for one in moved
    ]
    return nats.reshape(len(aims), len(joints), -1), usable, reached


def _left(change: np.ndarray, slopes: np.ndarray) -> float:
    """Nats of a change (T, C) [sigma of the noise] for which parameters with these slopes (P', T, C) do not make up."""
    a = np.concatenate([slopes.reshape(len(slopes), -1).T, np.eye(len(slopes))])
    y = np.concatenate([change.ravel(), np.zeros(len(slopes))])
    left = y - a @ np.linalg.lstsq(a, y, rcond=None)[0]
    return float(0.5 * left @ left)


def _picked(nats: np.ndarray, among: list[int], many: int, begun: list[int]) -> list[int]:
    """So many episodes, one after the other: each adds most to what shows least of the effects and joints."""
    flat, out = nats.reshape(-1, nats.shape[-1]), []
    total = flat[:, begun].sum(axis=1)
    while len(out) < many:
        best = max((i for i in among if i not in out), key=lambda i: float((total + flat[:, i]).min()))
        out.append(best)
        total = total + flat[:, best]
    return out


def _nominal(robot: Robot, many: int) -> np.ndarray:
    return np.tile([s.nominal for s in robot.file.settings], (many, 1))
