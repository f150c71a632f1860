"""Which unit a signal is in, and how often it comes: of what the log states, of names and of numbers."""

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from dynreg.data.checks.counts import ASKED, PAST_DEGREES, WHOLE, past_degrees, usual, whole
from dynreg.data.checks.motion import velocity_slope
from dynreg.data.checks.numbers import BEYOND
from dynreg.data.drafting.offers import Offer
from dynreg.data.names import joint_of, quantity_of
from dynreg.data.schema import ChannelSpec
from dynreg.data.series import Series
from dynreg.data.units import conversion
from dynreg.data.words import UNIT_WORDS
from dynreg.errors import MapError

FILTER_HZ = 20.0  # cut-off of a derivative's filter
FILTER_SHARE = 0.2  # its most, as a share of the sampling rate
# Times that an angle in deg goes as far as one of the same joint in rad, at least: the units differ by 57.
APART = 20.0
BEYOND_LIMITS = "reaches {:.4g}, far beyond the joint's limits in rad: taken for degrees"
AS_OTHERS = "other angles of the log are in degrees: taken for degrees too, check it"
KINDS = {  # of a unit, what it measures
    "rad": "position",
    "m": "position",
    "rad/s": "velocity",
    "m/s": "velocity",
    "N*m": "torque",
    "N": "torque",
    "V": "voltage",
    "A": "current",
}


def unit_of(offer: Offer, channel: ChannelSpec) -> str | None:
    """The unit that the log states, else that which the name says, else that of the channel; None for another kind."""
    kind = KINDS.get(channel.unit, "")
    named = next((UNIT_WORDS[w][kind] for w in offer.words if kind in UNIT_WORDS.get(w, {})), None)
    unit = offer.series.unit or named or channel.unit
    try:
        conversion(unit, channel.unit)
    except MapError:
        return None
    return unit


def bare(offer: Offer) -> str:
    """What a signal measures whose name tells a joint and no quantity: what its unit tells, else a position."""
    named = [kind for w in offer.words for kind in UNIT_WORDS.get(w, ())]
    for unit, kind in KINDS.items() if offer.series.unit else ():
        with suppress(MapError):
            conversion(offer.series.unit, unit)
            return kind
    return "position" if "position" in named or not named else named[0]


def degrees(
    chosen: Mapping[str, Offer], units: Mapping[str, str], channels: Sequence[ChannelSpec]
) -> dict[str, tuple[str, str]]:
    """{channel: "deg" or "deg/s", and why, which may be ""} of those whose numbers say that they are in degrees.

    An angle is taken for degrees where it goes far beyond the joint's limits, and a velocity where it is the rate of a
    position in degrees. What has no limits may turn for ever (a wheel, a heading), and ROS has angles in rad (REP 103).
    Where one angle goes so far and is no glitch, the others of the table are in degrees too, however small. But where
    another angle of its own joint is far smaller, and moves, angles of that kind are in rad: targets, say. So is a
    position that is as large as its joint's target in rad. What would go too far in degrees too, or has whole numbers,
    is asked about: such angles stay as they are.
    chosen : {channel: offer} of the channels that have one. units : theirs.
    """
    reach = _reach(channels)
    doubted = {
        name: offer.series
        for name, offer in chosen.items()
        if not offer.ros and offer.series.unit is None and units[name] in ("rad", "rad/s")
    }
    angles = {name: series for name, series in doubted.items() if units[name] == "rad"}
    most = {name: BEYOND * reach.get(joint_of(name), np.inf) for name in angles}
    far = {name: largest(series) for name, series in angles.items() if largest(series) > most[name]}
    counted = _counted({name: angles[name] for name in far}, reach)
    out = {name: (units[name], why) for name, why in counted.items()}
    far = {name: size for name, size in far.items() if name not in counted}
    as_others = any(usual(angles[name].values) > most[name] for name in far)
    out |= {name: ("deg", BEYOND_LIMITS.format(size)) for name, size in far.items()}
    near = {name: largest(series) for name, series in angles.items() if name not in far}
    small = {name for name, size in near.items() if _beside(name, far) > APART * size}
    # degrees are 57 times as large as radians; what stands still is smaller than that, and tells nothing
    moving = [name for name in small if _beside(name, far) < 10 * APART * near[name]]
    kinds = {quantity_of(name) for name in moving}
    for name in [n for n in near if as_others and n not in {*out, *small}]:
        alike = {n: size for n, size in near.items() if quantity_of(n) in kinds and APART * size > near[name]}
        if not _beside(name, alike):  # none of its joint that is in rad is as large, itself among them
            out[name] = ("deg", AS_OTHERS)
    told = {**units, **{name: unit for name, (unit, _) in out.items()}}
    for name, velocity in doubted.items():
        position = f"{joint_of(name)}/position"
        if units[name] != "rad/s" or position in chosen and told.get(position) != "deg":
            continue
        slope = velocity_slope(chosen[position].series, velocity) if position in chosen else None
        if slope is not None and _alike(slope):
            out[name] = ("deg/s", "")
        elif as_others and not (slope is not None and _alike(np.degrees(slope))):
            out[name] = ("deg/s", AS_OTHERS)
    return out


def _beside(name: str, sizes: Mapping[str, float]) -> float:
    """The largest of the sizes of angles that are of the same joint; 0 where none is."""
    return max((size for other, size in sizes.items() if joint_of(other) == joint_of(name)), default=0.0)


def _counted(far: Mapping[str, Series], reach: Mapping[str, float]) -> dict[str, str]:
    """{angle: what is asked about it} of those of angles far beyond their limits [rad] that may be an encoder's counts.

    Degrees may be whole numbers too, but nothing tells that: all are asked about where all are such numbers.
    """
    every = all(whole(series.values) for series in far.values())
    over = {joint_of(name) for name, s in far.items() if past_degrees(s.values, reach[joint_of(name)])}
    out = {}
    for name, series in far.items():
        told = PAST_DEGREES if joint_of(name) in over else WHOLE if every else None
        if told is not None:
            out[name] = f"reaches {largest(series):.4g}, {told.why}: {ASKED} {told.do}"
    return out


def _alike(slope: float) -> bool:
    """Whether a velocity on the rate of its position is in the same unit."""
    return 0.7 < slope < 1.4


def _reach(channels: Sequence[ChannelSpec]) -> dict[str, float]:
    """{joint: how far from 0 its angles may go [rad]}: to its channels' limits on both sides, else to its stops."""
    stated: dict[str, float] = {}
    stops: dict[str, float] = {}
    for c in channels:
        ends = [abs(end) for end in (c.low, c.high) if end is not None and np.isfinite(end)]
        if c.unit != "rad" or quantity_of(c.name) == "yaw":
            continue
        if len(ends) == 2 and max(ends) > 0:
            stated[joint_of(c.name)] = max(stated.get(joint_of(c.name), 0.0), *ends)
        if c.stops is not None:
            stops[joint_of(c.name)] = max(map(abs, c.stops))
    return stops | stated


def largest(series: Series) -> float:
    """The largest size of a signal; 0 where it holds no number."""
    return float(np.max(np.abs(series.values), initial=0.0, where=np.isfinite(series.values)))


def cut_off(series: Series) -> float | None:
    """The cut-off [Hz] with which a signal is differentiated, by the rate of its numbers; None where none is known."""
    steps = np.diff(series.time[np.isfinite(series.values)])
    steps = steps[steps > 0]
    rate = 1.0 / float(np.median(steps)) if len(steps) else 0.0
    return float(f"{min(FILTER_HZ, FILTER_SHARE * rate):.3g}") if rate > 0 else None
