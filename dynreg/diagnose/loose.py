"""What a recording leaves open: parameters that it does not tell, alone or together."""

from dataclasses import dataclass

import numpy as np

from dynreg.evidence.hypothesis import Coordinates

# What "not told" means, by definition.
ALONE = 0.9  # of its prior's standard deviation that a parameter keeps where the recording does not tell it
TOGETHER = 0.6  # of the prior's, along a direction of several parameters
SHARE = 0.5  # of the change of the parameter that leads a direction, from which another belongs to it


@dataclass(frozen=True)
class Loose:
    """Names of parameters. alone : whose value the recording does not tell. together : whose common scale it hardly
    tells, those that go up with those that go down meanwhile; the loosest first."""

    alone: tuple[str, ...]
    together: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]


def loose_ends(coordinates: Coordinates, covariance: np.ndarray) -> Loose:
    """The parameters whose values come from robot.toml rather than from the recording.

    covariance : (P' + K, P' + K) of the fit coordinates, in which every parameter's prior has variance 1. Directions
    are sought among the parameters that are not loose alone.
    """
    free = [coordinates.robot.space.parameters[i] for i in coordinates.free]
    block = covariance[: len(free), : len(free)]
    alone = np.sqrt(np.maximum(np.diag(block), 0.0)) >= ALONE
    rest, together = np.flatnonzero(~alone), []
    variances, directions = np.linalg.eigh(block[np.ix_(rest, rest)])
    for variance, direction in zip(variances[::-1], directions.T[::-1], strict=True):
        if np.sqrt(max(variance, 0.0)) < TOGETHER:
            break
        members = _members(coordinates, rest, direction)
        if len(members) > 1:
            lead = np.sign(direction[np.argmax(np.abs(direction))])
            together.append(
                tuple(
                    tuple(free[rest[i]].name for i in members if way * direction[i] > 0)
                    for way in (lead, -lead)
                )
            )
    return Loose(tuple(p.name for p, wide in zip(free, alone, strict=True) if wide), tuple(together))


def _members(coordinates: Coordinates, rest: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Which parameters a direction moves: against their priors, or by as large a factor as the one that leads."""
    numbers = coordinates.free[rest]
    centre = np.abs(coordinates.centre[numbers])
    relative = coordinates.sigma[numbers] / np.where(coordinates.log[numbers] | (centre == 0), 1.0, centre)
    scales = np.array([coordinates.robot.space.parameters[i].scale == "log" for i in numbers])
    factor = np.where(scales, np.abs(direction) * relative, 0.0)
    size = np.abs(direction)
    lead = int(np.argmax(size))
    alike = (factor >= SHARE * factor[lead]) & (factor[lead] > 0)
    return np.flatnonzero((size >= SHARE * size[lead]) | alike)
