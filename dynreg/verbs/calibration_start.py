"""The simulator that a calibration begins with: found, held against the robot, and against what is held out."""

import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from dynreg.data.names import episode_of
from dynreg.errors import Assumed, UsageError
from dynreg.methods.calibrator import ROUNDED
from dynreg.registry import Registry
from dynreg.sim.robot import Robot
from dynreg.verbs.several import parted
from dynreg.verbs.shaped import shaped
from dynreg.verbs.simulator import NOMINAL, Simulator
from dynreg.verbs.simulators import simulator
from dynreg.verbs.subjects import Recorded


def begun_with(
    registry: Registry, start: str, robot: Robot, recording: str | None = None
) -> Simulator | None:
    """The simulator to begin from, None for the nominal one. recording : id of that which is asked about, if any.

    Warns of parameters that lie outside their ranges, where no search looks. Raises UsageError for one that has
    effects, which a search would leave out, or none of the robot's parameters.
    """
    if start == NOMINAL:
        return None
    found = simulator(registry, start, robot, recording)
    if found.config.effects:
        raise UsageError(
            f"simulator {found.name!r} has effects ({', '.join(found.config.effects)})",
            expected="one without: a calibration fits parameters",
            do="write them into a robot with `dynreg export`, or begin with another simulator",
        )
    if not shared_values(found, robot):
        raise UsageError(
            f"simulator {found.name!r} has none of the parameters of {robot.name!r}",
            expected=f"some of {', '.join(robot.space.names)}",
            do="begin with another",
        )
    unit = robot.space.to_unit(values_of(found, robot))
    inside = (unit >= -ROUNDED) & (unit <= 1.0 + ROUNDED)
    if outside := [name for name, kept in zip(robot.space.names, inside, strict=True) if not kept]:
        warnings.warn(
            f"simulator {found.name!r} has {', '.join(outside)} outside the ranges of {robot.name!r}: "
            "the calibration begins at their bounds, with another simulator",
            Assumed,
            2,
        )
    return found


def values_of(begin: Simulator | None, robot: Robot) -> np.ndarray | None:
    """(P,) parameters to begin from, in their units: those of a simulator, and nominal ones that it lacks."""
    if begin is None:
        return None
    space = robot.space
    return space.from_dict(space.as_dict(space.nominal) | shared_values(begin, robot))


def shared_values(begin: Simulator, robot: Robot) -> dict[str, float]:
    """{parameter: value} of a simulator that the robot has, too."""
    return {name: value for name, value in begin.config.values.items() if name in robot.space.names}


def shaped_by(asked: Recorded, begin: Simulator, named: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Of what is held out, the episodes that shaped the simulator to begin with.

    named : the parts of the recording: episodes, or "episode[3]" of one that was cut into windows. Windows are compared
    where the start's result has all the same ones, for others of these names may be other rows.
    """
    held_out, parts = named["test"], begin.parts or {}
    if _names_in(parts) == _names_in(named):
        own = {*held_out} & {*parts.get("fit", ()), *parts.get("select", ())}
        inherited = begin.inherited & {episode_of(name) for name in held_out}
        return tuple(sorted(own | inherited))
    whole = {episode_of(name) for name in held_out}
    known = [shaped(asked.registry, begin, one.recording.id) for one in asked.each or (asked,)]
    return tuple(name for name in sorted(whole) if _is_in(name, asked, known))


def _names_in(parts: Mapping[str, Sequence[str]]) -> set[str]:
    return {name for part in parts.values() for name in part}


def tell_seen(how: str, names: Sequence[str]) -> None:
    """Warn that the test error is too low, for what is held out was seen."""
    warnings.warn(f"{how} {', '.join(names)}, which is held out: the test error is too low", Assumed, 2)


def _is_in(name: str, asked: Recorded, known: Sequence[frozenset[str] | None]) -> bool:
    """Whether an episode is among those of its recording that are `known` to have shaped something; None: all."""
    one, own = parted(name, asked.each) if asked.each else (asked, name)
    mine = known[[each.recording.id for each in asked.each or (asked,)].index(one.recording.id)]
    return mine is None or own in mine
