"""Which unit a signal is in, and how often it comes: of what the log states, of names and of numbers."""

from collections.abc import Mapping, Sequence

import numpy as np

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


def degrees(
    chosen: Mapping[str, Offer], units: Mapping[str, str], channels: Sequence[ChannelSpec]
) -> dict[str, str]:
    """{channel: "deg" or "deg/s"} of those whose numbers say that they are in degrees.

    An angle is taken for degrees where it goes far beyond the joint's limits, and a velocity where it is the rate of a
    position in degrees. What has no limits may turn for ever (a wheel, a heading), and ROS has angles in rad (REP 103).
    chosen : {channel: offer} of the channels that have one. units : theirs.
    """
    reach = _reach(channels)
    doubted = {
        name: offer.series
        for name, offer in chosen.items()
        if not offer.ros and offer.series.unit is None and units[name] in ("rad", "rad/s")
    }
    far = {
        name: "deg"
        for name, series in doubted.items()
        if units[name] == "rad" and largest(series) > BEYOND * reach.get(joint_of(name), np.inf)
    }
    told = {**units, **far}
    for name, velocity in doubted.items():
        position = f"{joint_of(name)}/position"
        if quantity_of(name) == "velocity" and told.get(position) == "deg":
            slope = velocity_slope(chosen[position].series, velocity)
            if slope is not None and 0.7 < slope < 1.4:
                far[name] = "deg/s"
    return far


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
    """The cut-off [Hz] with which a signal is differentiated, by its rate; None where that is not known."""
    steps = np.diff(series.time)
    steps = steps[steps > 0]
    rate = 1.0 / float(np.median(steps)) if len(steps) else 0.0
    return float(f"{min(FILTER_HZ, FILTER_SHARE * rate):.3g}") if rate > 0 else None
