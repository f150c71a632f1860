"""A map drafted from what a log holds: the sources that look like a robot's channels, to be read and corrected."""

from collections.abc import Mapping, Set

from dynreg.data.checks.clock import likely_units
from dynreg.data.clock_names import UNITS_OF_TIME
from dynreg.data.drafting.bases import of_base
from dynreg.data.drafting.joints import (
    Named,
    by_index,
    by_words,
    called,
    joints_of,
    nameless,
    of_joint,
    owned,
    unread,
)
from dynreg.data.drafting.left_over import left_over
from dynreg.data.drafting.offers import Offer, offers_of
from dynreg.data.drafting.proposed import proposed
from dynreg.data.drafting.source import Source
from dynreg.data.drafting.units import cut_off, degrees
from dynreg.data.drafting.writing import Draft
from dynreg.data.names import joint_of, position_of
from dynreg.data.schema import RecordingSpec
from dynreg.data.series import RawLog

__all__ = ["Draft", "as_logged", "draft_map"]


def draft_map(log: RawLog, spec: RecordingSpec | None = None, also: Mapping[str, str] | None = None) -> Draft:
    """A map from what a log holds to a robot's channels; without a robot, to channels that it proposes.

    Joints are found by name, commands in arrays by their order, angles of a base in quaternions. A velocity that the
    log does not hold is the derivative of its position. `read_recording` takes the text as it is where nothing is
    missing.

    A clock that counts in another unit than it was read in is taken in the one that its steps tell.

    also : {joint: another name of it}, such as its actuator's, by which a log may call what nothing else is found for.
    """
    log = _by_its_steps(log)
    offers = offers_of(log)
    known = spec or proposed(offers)
    return Draft(log, known, _sources(offers, known, also or {}))


def as_logged(log: RawLog) -> Draft:
    """The map to all that a log says of joints and bases, measured efforts too; nothing is derived."""
    offers = offers_of(log)
    known = proposed(offers, efforts=True)
    sources = {
        name: source for name, source in _sources(offers, known, {}).items() if "source" in source.keys
    }
    return Draft(log, known, sources)


def _by_its_steps(log: RawLog) -> RawLog:
    """The log in the unit in which its clock counts, where its steps tell that it is another than it was read in."""
    counting, units = log.counting, likely_units(log)
    if counting is None or len(units) != 1 or units[0] == counting.unit:
        return log
    return log.counted_in(units[0], UNITS_OF_TIME[units[0]] / UNITS_OF_TIME[counting.unit])


def _sources(offers: tuple[Offer, ...], spec: RecordingSpec, also: Mapping[str, str]) -> dict[str, Source]:
    """{channel: Source} of those that are found."""
    out = _found(offers, spec, also)
    signals = {o.source: o for o in offers}
    chosen = {name: signals[s.keys["source"]] for name, s in out.items() if "unit" in s.keys}
    units = {name: str(out[name].keys["unit"]) for name in chosen}
    for name, (unit, why) in degrees(chosen, units, spec.channels).items():
        out[name] = out[name].told(*([why] if why else []), unit=unit)
    for name, item in unread(offers, chosen, also).items():
        unit = out[name].keys["unit"]
        note = f"[{item}] is no unit that is known: taken for {unit}, correct `unit` or set `scale`"
        out[name] = out[name].told(note)
    return {**out, **_rates(chosen, spec, out)}


def _without(named: Named, gone: Set[object]) -> Named:
    """What names a joint, without the signals that are gone."""
    return [(offer, rest) for offer, rest in named if offer.source not in gone]


def _found(offers: tuple[Offer, ...], spec: RecordingSpec, also: Mapping[str, str]) -> dict[str, Source]:
    """{channel: Source} by names and places. A signal is one state, or one command; inputs and flags may share it."""
    mine, out = owned(offers, joints_of(spec)), {}
    others, unnamed = called(offers, mine, also), nameless(offers, mine)
    taken: set[object] = set()
    for channel in spec.channels:
        joint, single = joint_of(channel.name), channel.kind in ("state", "action")
        gone = taken if single else set()
        told = f"by the name {also.get(joint)!r}, the actuator's; check it"
        source = (
            of_base(offers, channel)
            or of_joint(_without(mine.get(joint, ()), gone), channel)
            or by_index(offers, channel, spec)
            or by_words(offers, channel)
            or of_joint(_without(others.get(joint, ()), gone), channel, told)
            or of_joint(_without(unnamed, gone), channel)
        )
        if source is not None:
            out[channel.name] = source
            if single and not source.measured:
                taken.add(str(source.keys["source"]))
    return {**out, **left_over(offers, spec, out)}


def _rates(chosen: dict[str, Offer], spec: RecordingSpec, found: dict[str, Source]) -> dict[str, Source]:
    """Velocities of which the log holds no more than the positions."""
    out = {}
    for channel in spec.channels:
        position = position_of(channel.name)
        if channel.kind == "state" and channel.name not in found and position in found:
            keys = {"derivative_of": position, "filter_hz": cut_off(chosen[position].series)}
            out[channel.name] = Source(keys, ("the log holds no velocity of it: the rate of its position",))
    return out
