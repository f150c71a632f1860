"""The document of an experiment: the limits that its commands keep, and the instructions for each episode."""

import numpy as np

from dynreg.data.names import parts_of
from dynreg.excite.candidates import Limits, Pool, joint_range
from dynreg.excite.excite import Chosen
from dynreg.results.experiment import Experiment, LimitKept
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run


def experiment(chosen: Chosen) -> Experiment:
    """The expected evidence of the commands, and the limits that they keep."""
    pair, pool = chosen.pair, chosen.pool
    silent = []  # names of the true effects without expected evidence, with their sign where they have one
    for (which, z), counts in zip(pair.truths, chosen.counts, strict=True):
        signed = pair.hypotheses[which].parameters[0].signed
        sign = (" (positive)" if z[len(pair.coordinates)] > 0 else " (negative)") if signed else ""
        silent += [] if counts else [pair.terms[which].key + sign]
    return Experiment(
        robot=pair.robot.name,
        between=chosen.between,
        seconds=pool.run.episodes * pool.run.steps * pool.run.period,
        separation=chosen.nats,
        usual=chosen.usual,
        limits=(*commanded(pair.robot, chosen.limits, pool.run), *_moved(pair.robot, chosen.reached)),
        note=_note(pair.robot, pool, silent),
    )


def commanded(robot: Robot, limits: Limits, run: Run) -> list[LimitKept]:
    """The limits of every command and of its rate, with the values used."""
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
    """The range of every driven joint's position, with the expected extremes."""
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
    """Instructions: the pattern and the settings of each episode, and the limits of the expected evidence."""
    run = pool.run
    parts = [f"{run.episodes} episodes of {run.steps * run.period:g} s; begin each at rest in the reset pose"]
    parts.append("; ".join(f"{e}: {name}" for e, name in enumerate(pool.names)))
    for k, table in enumerate(robot.file.settings):
        column = run.settings[:, k]
        unit = "" if table.unit == "1" else f" {table.unit}"
        for value in np.unique(column[column != table.nominal]):
            where = ", ".join(map(str, np.flatnonzero(column == value)))
            parts.append(f"set {table.name} = {value:g}{unit} in {where}")
    if silent:
        parts.append(
            f"no evidence is expected if {' or '.join(silent)} is the true cause: that case is not counted"
        )
    return ". ".join(parts)
