"""Identifiability: the parameters that a recording does not determine, alone or in a common scale.

The likelihood alone judges: in place of the nameplate's prior every parameter gets a uniform one over its range. A
tight nameplate may hold a parameter that the recording tells well enough; that is told as such.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.evidence.hypothesis import FLAT, Coordinates
from dynreg.evidence.point import Point

# Definitions of "not identified".
ALONE = 0.9  # ratio of a parameter's standard deviation to that of its range, from which it is not identified
HELD = 0.9  # the same to that of its nameplate, from which the value is that of the nameplate
TOGETHER = 0.6  # the same along a direction of several parameters
SAME = 0.99  # correlation of slopes: from here on an error of 14 % (sin of the angle) is all that tells two apart
SHARE = 0.5  # a parameter belongs to a direction from this share of the largest change on


@dataclass(frozen=True)
class Unidentified:
    """Names of parameters that the recording does not identify.

    alone : their own values. together : groups with a common scale, as (those that rise, those that fall with it), the
    least identified first. held : those that it identifies less exactly than the nameplate, and how many times.
    """

    alone: tuple[str, ...]
    together: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]
    held: tuple[tuple[str, float], ...] = ()


def unidentified(coordinates: Coordinates, covariance: np.ndarray) -> Unidentified:
    """The parameters whose values come from robot.toml rather than from the recording.

    covariance : (P' + K, P' + K) of the fit coordinates, in which every parameter's prior has variance 1. Directions
    are searched among the parameters that are identified alone.
    """
    free = [coordinates.robot.space.parameters[i] for i in coordinates.free]
    count = len(free)
    width = FLAT * np.ptp(coordinates.nominal_bounds, axis=1)  # of a uniform prior, in the nameplate's sigma
    by_data = np.linalg.pinv(covariance)
    by_data[np.arange(count), np.arange(count)] += 1.0 / width**2 - 1.0
    block = np.linalg.pinv(by_data)[:count, :count] / np.outer(width, width)
    deviation = np.sqrt(np.maximum(np.diag(block), 0.0))
    alone = deviation >= ALONE
    others, together = np.flatnonzero(~alone), []
    variances, directions = np.linalg.eigh(block[np.ix_(others, others)])
    for variance, direction in zip(variances[::-1], directions.T[::-1], strict=True):
        if np.sqrt(max(variance, 0.0)) < TOGETHER:
            break
        members = _members(coordinates, others, direction)
        if len(members) > 1:
            lead = np.sign(direction[np.argmax(np.abs(direction))])
            together.append(
                tuple(
                    tuple(free[others[i]].name for i in members if way * direction[i] > 0)
                    for way in (lead, -lead)
                )
            )
    with_prior = np.sqrt(np.maximum(np.diag(covariance)[:count], 0.0))
    together_named = {name for group in together for names in group for name in names}
    held = [i for i in np.flatnonzero((with_prior >= HELD) & ~alone) if free[i].name not in together_named]
    return Unidentified(
        tuple(p.name for p, wide in zip(free, alone, strict=True) if wide),
        tuple(together),
        tuple((free[i].name, float(deviation[i] * width[i])) for i in held),
    )


def same_as_parameters(
    point: Point, names: Sequence[str], curvature: np.ndarray
) -> tuple[tuple[str, str], ...]:
    """(key of an accepted effect, name of a parameter) that do the same to the recording: their slopes are parallel.

    names : (P',) of the free parameters. curvature : (P' + K, P' + K) of the log posterior at the settled fit. The
    prior is taken out of it: a tolerance gives a parameter a value beside the effect's, and tells nothing of the robot.
    """
    data = curvature - np.diag(point.prior)
    size = np.sqrt(np.maximum(np.diag(data), 1e-12))
    alike = np.abs(data / np.outer(size, size))
    terms, given = point.hypothesis.terms, point.hypothesis.given
    keys = [(term.key, number >= given) for number, term in enumerate(terms) for _ in term.effect.parameters]
    found = (
        (key, name)
        for k, (key, accepted) in enumerate(keys, start=len(names))
        for i, name in enumerate(names)
        if accepted and data[i, i] >= 1 and alike[i, k] >= SAME  # 1: the recording tells as much as the prior
    )
    return tuple(dict.fromkeys(found))


def _members(coordinates: Coordinates, others: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The parameters that a direction moves, relative to their priors or by a factor as large as the leading one."""
    numbers = coordinates.free[others]
    centre = np.abs(coordinates.centre[numbers])
    width = FLAT * np.ptp(coordinates.nominal_bounds, axis=1)[others] * coordinates.sigma[numbers]
    relative = width / np.where(coordinates.log[numbers] | (centre == 0), 1.0, centre)
    scales = np.array([coordinates.robot.space.parameters[i].scale == "log" for i in numbers])
    factor = np.where(scales, np.abs(direction) * relative, 0.0)
    size = np.abs(direction)
    lead = int(np.argmax(size))
    alike = (factor >= SHARE * factor[lead]) & (factor[lead] > 0)
    return np.flatnonzero((size >= SHARE * size[lead]) | alike)
