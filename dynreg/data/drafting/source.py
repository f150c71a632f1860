"""Where a channel of a drafted map comes from: of the offers that fit, the one that fits best."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dynreg.data.drafting.offers import Offer
from dynreg.data.drafting.units import unit_of
from dynreg.data.schema import ChannelSpec


@dataclass(frozen=True)
class Source:
    """Where a channel of a drafted map comes from.

    keys : what its table in the map says, in order. notes : comments to it; `ambiguous` where another source fits as
    well. measured : it is a command, and the log has only what was measured of it. guessed : it is a command that only
    nothing else in the log could be.
    """

    keys: Mapping[str, object]
    notes: tuple[str, ...] = ()
    ambiguous: bool = False
    measured: bool = False
    guessed: bool = False

    def told(self, *notes: str, **keys: object) -> "Source":
        """The source with other keys, and with more notes."""
        return replace(self, keys={**self.keys, **keys}, notes=(*self.notes, *notes))


def used(found: Mapping[str, Source]) -> set[object]:
    """The names of the signals that channels are taken from."""
    out: set[object] = set()
    for source in found.values():
        names = source.keys.get("source")
        out |= {*names} if isinstance(names, list) else {names, *(f"{names}.{part}" for part in "wxyz")}
    return out


def best(rated: Sequence[tuple[int, Offer]], channel: ChannelSpec, *notes: str) -> Source | None:
    """The offer of the least cost whose unit fits; the others that cost as much are noted.

    Of commands one that is called so itself goes before what else a topic of commands holds.
    """
    fitting = [(cost, offer) for cost, offer in rated if unit_of(offer, channel) is not None]
    if not fitting:
        return None
    least = min(cost for cost, _ in fitting)
    chosen, *others = sorted(
        (o for c, o in fitting if c == least),
        key=lambda o: (not o.moves, o.command and not o.asked, len(o.group)),
    )
    told = [*notes]
    measured = channel.kind == "action" and not chosen.command
    if measured:
        told.append("measured: the log holds no command of this kind")
    if others:
        told.append(f"ambiguous: {', '.join(json.dumps(o.source) for o in others[:3])} would fit as well")
    keys = {"source": chosen.source, "unit": unit_of(chosen, channel)}
    return Source(keys, tuple(told), bool(others), measured)
