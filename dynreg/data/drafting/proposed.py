"""The channels of a robot that does not exist yet, as a log tells of them."""

from collections.abc import Sequence
from dataclasses import replace

from dynreg.data.attitude import ANGLES
from dynreg.data.drafting.bases import of_base
from dynreg.data.drafting.offers import Offer
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.words import core, quantity, spelled, strange, words

_SI = {"position": "rad", "velocity": "rad/s", "torque": "N*m", "voltage": "V", "current": "A", "enable": "1"}


def proposed(offers: Sequence[Offer], efforts: bool = False) -> RecordingSpec:
    """Channels for the joints that messages name, for columns that name a quantity, and for a base that is seen.

    efforts : with the measured torques of drives that are told something else, which no simulator needs.
    """
    channels: dict[str, ChannelSpec] = {}
    measured: list[str] = []
    for offer in offers:
        named = bool(offer.item) and not offer.item.isdigit()
        told = quantity(words(offer.path) if named else offer.words, offer.topic)
        joint = core(offer.item) if named else tuple(w for w in offer.words if strange((w,)) or w.isdigit())
        if (
            (not joint and not efforts)
            or (told is None and not offer.command)
            or told in ("acceleration", "temperature", "error")
        ):
            continue
        if offer.topic and not named:
            continue  # fields of messages that are not of joints
        owner = offer.item if named and "." not in offer.item else spelled(offer.item or offer.path, joint)
        owner = f"joint_{owner}" if owner.isdecimal() else owner or "joint"
        kind = "action" if offer.command else "state"
        what = {"position": "target"}.get(told or "position", told) if kind == "action" else told
        unit = _SI.get(told or "position", "1")
        if kind == "state" and told == "torque":
            kind = "action"  # what a drive gave, where the log tells no command; dropped below where it does
            measured.append(f"{owner}/{what}")
        channels.setdefault(f"{owner}/{what}", ChannelSpec(f"{owner}/{what}", unit, kind))
    if efforts:
        channels |= {name: replace(channels[name], kind="state", optional=True) for name in measured}
    elif any(c.kind == "action" and c.name not in measured for c in channels.values()):
        channels = {name: c for name, c in channels.items() if name not in measured}
    listed = sorted(channels.values(), key=lambda c: c.kind == "action")
    base = [
        ChannelSpec(f"base/{what}", unit, "state")
        for what, unit in (
            *((a, "m") for a in "xyz"),
            *((a, "rad") for a in ANGLES),
            *((f"v{a}", "m/s") for a in "xyz"),
            *((f"w{a}", "rad/s") for a in "xyz"),
        )
    ]
    seen = [c for c in base if of_base(offers, c) is not None]
    return RecordingSpec("", (*listed, *seen), (), None)
