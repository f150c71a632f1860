"""Which signal of a log is which channel of a joint: by the joint's name, by place in a list, by what it measures."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence

from dynreg.data.drafting.offers import Offer
from dynreg.data.drafting.source import Source, best
from dynreg.data.drafting.units import KINDS, bare
from dynreg.data.names import joint_of, quantity_of
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.words import core, quantity, strange, without, words

LETTERS = {"p": "position", "v": "velocity"}  # that say what a joint's servo is told
Named = Sequence[tuple[Offer, tuple[str, ...]]]  # offers that name a joint, and the words beside its name
Owned = Mapping[str, list[tuple[Offer, tuple[str, ...]]]]


def joints_of(spec: RecordingSpec) -> tuple[str, ...]:
    """The joints, and bases, of which a robot's channels are."""
    return tuple(dict.fromkeys(joint_of(c.name) for c in spec.channels if quantity_of(c.name)))


def owned(offers: Sequence[Offer], joints: Sequence[str]) -> Owned:
    """{joint: offers that name it, and the words beside its name}; the longest joint that fits has the offer."""
    out = named_by(offers, joints)
    if len(joints) == 1 and not out[joints[0]]:  # one joint need not be named
        out[joints[0]] = [(offer, offer.words) for offer in offers]
    return out


def called(offers: Sequence[Offer], mine: Owned, names: Mapping[str, str]) -> Owned:
    """{joint: offers that give it another of its `names`, and the words beside it}, of those that no joint has.

    A name of which nothing is left but a number, such as "motor_1", tells no joint: others count too.
    """
    taken = {offer.source for each in mine.values() for offer, _ in each}
    telling = {joint: name for joint, name in names.items() if not all(word.isdigit() for word in core(name))}
    free = [offer for offer in offers if offer.source not in taken]
    found = named_by(free, [*dict.fromkeys(telling.values())])
    return {joint: found[name] for joint, name in telling.items()}


def named_by(
    offers: Sequence[Offer], joints: Sequence[str]
) -> dict[str, list[tuple[Offer, tuple[str, ...]]]]:
    """{joint: offers with its name in theirs, and the words beside it}; the longest name that fits has the offer."""
    out: dict[str, list[tuple[Offer, tuple[str, ...]]]] = {joint: [] for joint in joints}
    left = []
    for offer in offers:
        fits = [(j, _named(offer, j)) for j in joints]
        fits = [(j, rest) for j, rest in fits if rest is not None]
        if fits:
            most = max(len(core(j)) for j, _ in fits)
            for joint, rest in fits:
                if len(core(joint)) == most:
                    out[joint].append((offer, rest))
        elif offer.item and not offer.item.isdigit():
            left.append(offer)
    for offer in left:  # the log's name is the shorter: "elbow" of "left_elbow_joint", where no other fits
        fits = [j for j in joints if without(core(j), core(offer.item)) is not None]
        if len(fits) == 1 and not any(o.group == offer.group for o, _ in out[fits[0]]):
            out[fits[0]].append((offer, words(offer.path)))
    return out


def _named(offer: Offer, joint: str) -> tuple[str, ...] | None:
    """The words beside a joint's name in an offer that names it; the name may lie in the topic of a JSON message."""
    if offer.item == joint:
        return words(offer.path)
    part = core(joint)
    rest = without(core(offer.item), part) if offer.item and not offer.item.isdigit() else None
    if rest is not None:
        return (*words(offer.path), *rest)
    rest = without(offer.words, part)
    if rest is None and offer.topic and not offer.item:
        inside = without(words(offer.topic), part)
        rest = None if inside is None else (*offer.words, *inside)
    return rest


def unread(offers: Sequence[Offer], chosen: Mapping[str, Offer], also: Mapping[str, str]) -> dict[str, str]:
    """{channel: what its column has in brackets} where that is no unit, no index and no name of its joint.

    Of columns that differ in their brackets alone, what these hold are names.
    """
    alike = Counter(offer.group for offer in offers)
    return {
        name: offer.item
        for name, offer in chosen.items()
        if alike[offer.group] == 1
        and not (offer.topic or offer.item.isdigit() or not offer.item)
        and all(
            without(core(joint), core(offer.item)) is None and without(core(offer.item), core(joint)) is None
            for joint in {joint_of(name), also.get(joint_of(name), joint_of(name))}
        )
    }


def of_joint(named: Named, channel: ChannelSpec, *notes: str) -> Source | None:
    """The signal of those that name the channel's joint which measures, or commands, the same; with notes on it.

    A name that tells the joint alone is that of its position, unless its unit is another quantity's.
    """
    what = quantity_of(channel.name)
    wanted = quantity(words(what)) if channel.kind != "action" else None
    wanted = wanted or KINDS.get(channel.unit)
    rated = []
    for offer, every in named:
        told, rest = _said(every, offer.topic, wanted if offer.command else None)
        measured_command = channel.kind == "action" and not offer.command
        if offer.command and channel.kind in ("state", "input"):
            continue
        if measured_command and not (told == wanted and wanted in ("torque", "voltage", "current")):
            continue
        if told not in (None, wanted) or told is None and (channel.kind == "enable" or strange(rest)):
            continue
        if told is None and not offer.command and bare(offer) != (wanted or "position"):
            continue
        cost = strange(rest) + 2 * measured_command + (told is None and channel.kind != "action")
        rated.append((cost, offer))
    if channel.kind == "enable":
        rated = [(c, o) for c, o in rated if quantity(o.words, o.topic) == "enable"]
    return best(rated, channel, *notes)


def _said(told: tuple[str, ...], topic: str, wanted: str | None) -> tuple[str | None, tuple[str, ...]]:
    """What the words beside a joint's name say is measured, and the words without a letter that says it.

    A letter says it of a command, where a position or a velocity is `wanted`: else "v" is the unit of a voltage.

    >>> _said(("p", "cmd"), "", "position"), _said(("v", "cmd"), "", "position"), _said(("v", "cmd"), "", "voltage")
    (('position', ('cmd',)), ('velocity', ('cmd',)), (None, ('v', 'cmd')))
    """
    found = quantity(told, topic)
    letters = [LETTERS[word] for word in told if word in LETTERS]
    if found is not None or not letters or wanted not in LETTERS.values():
        return found, told
    return letters[-1], tuple(word for word in told if word not in LETTERS)


def nameless(offers: Sequence[Offer], mine: Owned) -> Named:
    """Columns that tell a quantity or a command, and no joint: they are those of the joint of a robot with one."""
    taken = {offer.source for named in mine.values() for offer, _ in named}
    return [
        (offer, offer.words)
        for offer in offers
        if len(mine) == 1
        and not (offer.topic or offer.item or offer.source in taken or strange(offer.words))
        and (offer.asked or quantity(offer.words) is not None)
    ]


def by_index(offers: Sequence[Offer], channel: ChannelSpec, spec: RecordingSpec) -> Source | None:
    """An item of a list without names (Float64MultiArray) with as many as the robot has of the kind, in its order."""
    what = quantity(words(quantity_of(channel.name))) or KINDS.get(channel.unit)
    if channel.kind not in ("action", "state") or what is None:
        return None
    alike = [
        c.name
        for c in spec.channels
        if c.kind == channel.kind
        and (channel.kind == "action" or quantity_of(c.name) == quantity_of(channel.name))
    ]
    rated = []
    for items in _lists(offers, channel.kind == "action").values():
        told = quantity(words(items[0].path), items[0].topic)
        if len(items) == len(alike) and (told == what or told is None and channel.kind == "action"):
            cost = strange(words(items[0].path.rstrip("0123456789"))) + (told is None)
            rated.append((cost, items[alike.index(channel.name)]))
    return best(rated, channel, "by its place in the list: the log names no joints there; check the order")


def _lists(offers: Sequence[Offer], commands: bool) -> dict[str, list[Offer]]:
    """Items of one list in their order, and columns that differ in the number at their end, such as q1 and q2."""
    lists: dict[str, list[Offer]] = {}
    for offer in offers:
        if offer.command == commands and offer.item.isdecimal():
            lists.setdefault(offer.group, []).append(offer)
        elif offer.command == commands and not offer.item and offer.path[-1:].isdigit():
            lists.setdefault(offer.topic + offer.path.rstrip("0123456789"), []).append(offer)
    return {name: sorted(items, key=_number) for name, items in lists.items()}


def _number(offer: Offer) -> int:
    return int(re.findall(r"\d+", offer.item or offer.path)[-1])


def by_words(offers: Sequence[Offer], channel: ChannelSpec) -> Source | None:
    """A signal that is named like the channel, or that says what an input is, such as "supply", or enable."""
    same = [(0, o) for o in offers if o.source == channel.name]
    if not same and channel.kind in ("input", "enable"):
        same = [(strange(o.words), o) for o in offers if not o.command and _says(o, channel)]
    return best(same, channel)


def _says(offer: Offer, channel: ChannelSpec) -> bool:
    """Whether words say what an input or a flag is; its joint's name does not: all signals of the joint have that."""
    if channel.kind == "enable":
        return quantity(offer.words, offer.topic) == "enable"
    wanted = {*words(quantity_of(channel.name) or channel.name)}
    same = wanted <= {*offer.words, *words(offer.topic)}
    return same or KINDS.get(channel.unit) == "voltage" == quantity(offer.words)
