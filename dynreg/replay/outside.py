"""Held-out motions beside those that were fitted: beyond them an error tells how a simulator extrapolates."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.names import joint_of, quantity_of
from dynreg.replay.parts import Parts
from dynreg.replay.windows import Windows
from dynreg.sim.robot import Robot

REACH = 0.98  # quantile of a motion that counts as how far it goes: spikes of a sensor do not
# Parts of one protocol of random levels differ by chance, by up to 1.33 among the small logs of the golden tests: more
# is another motion.
FURTHER = 1.5
LESS = 0.5  # of the fitted reach of every signal, below which a held-out part tests small motions alone


@dataclass(frozen=True)
class Reached:
    """How far a signal goes from the middle of what was fitted, in `unit`, in both parts.

    signal : "arm/position", or "speed of arm" where no measured speed of it has a weight.
    """

    signal: str
    unit: str
    fitted: float
    held_out: float

    @property
    def ratio(self) -> float:
        """Of the held-out part over what was fitted."""
        return self.held_out / self.fitted


def reached(robot: Robot, windows: Windows, parts: Parts) -> tuple[Reached, ...]:
    """Of every weighted signal that moves; () without a held-out part.

    Of a robot on wheels the pose itself goes anywhere: its speeds are compared.
    """
    test, own = np.flatnonzero(parts.test), parts.chosen
    if not len(test) or not len(own):
        return ()
    out, channels = [], robot.file.channels
    weighted = np.flatnonzero(windows.weight > 0)
    named = [channels[column].name for column in weighted]
    speeds = {joint_of(name) for name in named if quantity_of(name) == "velocity"}
    for column in weighted:
        one, values = channels[column], windows.measured[..., column]
        if not robot.planar:
            out.append(_reached(one.name, one.unit, values[own], values[test]))
        if robot.planar or (quantity_of(one.name) == "position" and joint_of(one.name) not in speeds):
            rate = np.diff(values, axis=1) / windows.period
            out.append(_reached(f"speed of {joint_of(one.name)}", f"{one.unit}/s", rate[own], rate[test]))
    return tuple(one for one in out if one is not None)


def beyond(found: tuple[Reached, ...]) -> tuple[Reached, ...]:
    """Signals that go further in the held-out part than in what was fitted, the one that does most first."""
    return tuple(sorted((one for one in found if one.ratio > FURTHER), key=lambda one: -one.ratio))


def small(found: tuple[Reached, ...]) -> bool:
    """Whether the held-out part tests small and slow motions alone."""
    return bool(found) and all(one.ratio < LESS for one in found)


def _reached(signal: str, unit: str, fitted: np.ndarray, held_out: np.ndarray) -> Reached | None:
    """None where either part did not measure it, or it did not move."""
    fitted, held_out = (part[np.isfinite(part)] for part in (fitted, held_out))
    if not len(fitted) or not len(held_out):
        return None
    middle = np.median(fitted)
    own, other = (float(np.quantile(np.abs(part - middle), REACH)) for part in (fitted, held_out))
    return Reached(signal, unit, own, other) if own > 0 else None
