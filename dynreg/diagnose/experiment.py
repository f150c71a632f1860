"""From chosen episodes to what the user gets: the commands as a recording, and what is said about them."""

import numpy as np

from dynreg.data.names import parts_of
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.diagnose.candidates import Limits, Pool, joint_range
from dynreg.results import Experiment, LimitKept
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

PAUSE = 1.0  # s between episodes


def recording(robot: Robot, pool: Pool, between: tuple[str, str], seed: int) -> Recording:
    """The commands as a log without states, and the enable channels where drives are switched off."""
    run, first = pool.run, len(robot.file.inputs)
    enables = [i for i in range(first, len(robot.inputs)) if (run.inputs[..., i] != 1.0).any()]
    channels = [Channel(a.name, a.unit) for a in robot.file.actions]
    channels += [Channel(robot.inputs[i], "1") for i in enables]
    values = np.concatenate([run.actions, run.inputs[..., enables]], axis=2)
    time = np.arange(run.steps) * run.period
    episodes = tuple(
        Episode(
            f"excite_{e}",
            e * (run.steps * run.period + PAUSE) + time,
            values[e],
            dict(zip(robot.settings, run.settings[e], strict=True)),
        )
        for e in range(run.episodes)
    )
    source = {"made_by": "excite", "robot": robot.name, "between": list(between), "seed": seed}
    return Recording(tuple(channels), episodes, False, source | {"patterns": list(pool.names)})


def experiment(
    robot: Robot,
    between: tuple[str, str],
    limits: Limits,
    pool: Pool,
    reached: np.ndarray,
    *,
    nats: float,
    usual: float | None,
    silent: list[str],
) -> Experiment:
    """What the commands are expected to tell, and the limits that they keep.

    reached : (E, 2, S) lowest and highest states. silent : the cases that count in neither number.
    """
    return Experiment(
        robot=robot.name,
        between=between,
        seconds=pool.run.episodes * pool.run.steps * pool.run.period,
        separation=nats,
        usual=usual,
        limits=(*_commanded(robot, limits, pool.run), *_moved(robot, reached)),
        note=_note(robot, pool, silent),
    )


def _commanded(robot: Robot, limits: Limits, run: Run) -> list[LimitKept]:
    """The limits of every command and of its rate of change."""
    out = []
    speed = np.abs(np.diff(run.actions, axis=1)) / run.period
    for a, table in enumerate(robot.file.actions):
        low, high, rate = (_finite(x[a]) for x in (limits.low, limits.high, limits.rate))
        used = run.actions[..., a]
        out.append(_kept(table.name, table.unit, low, high, used.min(), used.max()))
        if rate is not None:
            fastest = speed[..., a].max(initial=0.0)
            out.append(_kept(f"{table.name} rate", f"{table.unit}/s", -rate, rate, -fastest, fastest))
    return out


def _moved(robot: Robot, reached: np.ndarray) -> list[LimitKept]:
    """The range of every driven joint's position, and where it is expected to go."""
    out = []
    for column, table in enumerate(robot.file.channels):
        owner, quantity = parts_of(table.name)
        if owner in robot.driven and quantity == "position":
            low, high = (_finite(x) for x in joint_range(robot, table.name))
            least, most = reached[:, 0, column].min(), reached[:, 1, column].max()
            out.append(_kept(f"{table.name} (expected)", table.unit, low, high, least, most))
    return out


def _kept(
    name: str, unit: str, low: float | None, high: float | None, least: float, most: float
) -> LimitKept:
    return LimitKept(name=name, unit=unit, low=low, high=high, least=float(least), most=float(most))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _note(robot: Robot, pool: Pool, silent: list[str]) -> str:
    """What to do: the patterns and the settings of each episode, and what the number stands for."""
    run = pool.run
    parts = [f"{run.episodes} episodes of {run.steps * run.period:g} s, each begun at rest in the reset pose"]
    parts.append("; ".join(f"{e}: {name}" for e, name in enumerate(pool.names)))
    for k, table in enumerate(robot.file.settings):
        column = run.settings[:, k]
        unit = "" if table.unit == "1" else f" {table.unit}"
        for value in np.unique(column[column != table.nominal]):
            where = ", ".join(map(str, np.flatnonzero(column == value)))
            parts.append(f"set {table.name} = {value:g}{unit} in {where}")
    if silent:
        parts.append(f"no evidence is to be expected where {' or '.join(silent)} is true: it is not counted")
    return ". ".join(parts)
