"""The library of effects, as a result."""

from collections.abc import Iterable, Mapping
from itertools import product

from dynreg.results.effects import EffectRow, EffectSize, EffectsList
from dynreg.sim.effects import Effect, effects, one_group, placed
from dynreg.sim.robot import Robot


def effects_list(robot: Robot | None = None) -> EffectsList:
    """Every effect, in the order in which they act; for a robot with whether it can have it, and why not."""
    table = effects()
    return EffectsList(
        robot=None if robot is None else robot.name,
        effects=tuple(_row(e, table, robot) for e in table.values()),
    )


def _row(effect: Effect, table: Mapping[str, Effect], robot: Robot | None) -> EffectRow:
    why_not = None if robot is None else effect.why_not(robot)
    places = ((),) if robot is None or why_not else effect.places(robot)
    same = [e.id for e in table.values() if e.id != effect.id and _one_group(robot, effect, e)]
    return EffectRow(
        id=effect.id,
        acts_on=effect.acts_on,
        title=_each(effect.title_at(at) for at in places),
        parameters=tuple(
            EffectSize(
                name=p.name,
                unit=p.unit,
                meaning=_each(effect.meaning_at(p, at) for at in places),
                weak=p.weak,
                medium=p.medium,
                strong=p.strong,
                per=p.per,
            )
            for p in effect.parameters
        ),
        group=tuple(same),
        near=effect.near,
        separate_by=_each(effect.separate_by_at(at) for at in places),
        applies=None if robot is None else why_not is None,
        why_not=why_not,
    )


def _each(said: Iterable[str]) -> str:
    """What is said of each of the places where an effect is looked for, each once."""
    return "; ".join(dict.fromkeys(said))


def _one_group(robot: Robot | None, first: Effect, second: Effect) -> bool:
    """Whether no commands separate the two at the same joint, on any robot that can have both, or on this one."""
    if robot is None or first.why_not(robot) or second.why_not(robot):
        return bool(first.group) and first.group == second.group
    pairs = product(placed(robot, first), placed(robot, second))
    return any(one_group(robot, one, other) for one, other in pairs)
