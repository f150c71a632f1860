"""The document of an experiment: the limits that its commands keep, and the instructions for each episode."""

import numpy as np

from dynreg.data.names import parts_of
from dynreg.data.units import suffix
from dynreg.excite.excite import Chosen
from dynreg.excite.limits import Limits, joint_range
from dynreg.excite.playing import closed
from dynreg.results.experiment import Experiment, LimitKept
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run
from dynreg.verbs.cautions import beginning, cautions, ending, largest_steps

TRAVEL = ("x", "y", "z", "yaw")  # quantities of a base that tell how far it goes


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
        note=_note(chosen, silent),
    )


def commanded(robot: Robot, limits: Limits, run: Run) -> list[LimitKept]:
    """The limits of every command and of its rate, with the values used, the closing rows included."""
    out, actions, speed = [], closed(robot, run.actions), largest_steps(robot, run) / run.period
    for a, table in enumerate(robot.file.actions):
        used, rate = actions[..., a], limits.rate[a]
        out.append(_kept(table.name, table.unit, limits.low[a], limits.high[a], used.min(), used.max()))
        unit = f"{table.unit}^2" if table.unit.endswith("/s") else f"{table.unit}/s"
        out.append(_kept(f"{table.name} rate", unit, -rate, rate, 0.0 - speed[a], speed[a]))
    return out


def _moved(robot: Robot, reached: np.ndarray) -> list[LimitKept]:
    """The range of every driven joint's position and of where the base goes, with the expected extremes."""
    out = []
    for column, table in enumerate(robot.file.channels):
        owner, quantity = parts_of(table.name)
        own = owner not in robot.file.robot.tracked
        if (owner in robot.driven and quantity == "position") or (own and quantity in TRAVEL):
            least, most = reached[:, 0, column].min(), reached[:, 1, column].max()
            ends = joint_range(robot, table.name)
            out.append(_kept(f"{table.name} (expected)", table.unit, *ends, least, most))
    return out


def _kept(name: str, unit: str, low: float, high: float, least: float, most: float) -> LimitKept:
    low, high = (float(end) if np.isfinite(end) else None for end in (low, high))
    return LimitKept(name=name, unit=unit, low=low, high=high, least=float(least), most=float(most))


def _note(chosen: Chosen, silent: list[str]) -> str:
    """Instructions: the pattern and settings of each episode, what no limit bounds, what evidence is not expected."""
    robot, pool, run = chosen.pair.robot, chosen.pool, chosen.pool.run
    length = f"{run.episodes} episodes of {run.steps * run.period:g} s"
    parts = [f"{length}; begin each {beginning(robot)}; {ending(robot)}"]
    parts.append("; ".join(f"{e}: {name}" for e, name in enumerate(pool.names)))
    for k, table in enumerate(robot.file.settings):
        column = run.settings[:, k]
        unit = suffix(table.unit)
        for value in np.unique(column[column != table.nominal]):
            where = ", ".join(map(str, np.flatnonzero(column == value)))
            parts.append(f"set {table.name} = {value:g}{unit} in {where}")
    parts += cautions(robot, chosen.limits, run, chosen.reached)
    if silent:
        parts.append(
            f"no evidence is expected if {' or '.join(silent)} is the true cause: that case is not counted"
        )
    return ". ".join(parts)
