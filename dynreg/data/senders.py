"""Which signals of a log tell its clocks: several drivers may send on one topic, each with a clock of its own."""

from collections.abc import Iterator, Sequence

import numpy as np

from dynreg.data.drafting.offers import Offer, offers_of
from dynreg.data.series import Finding, RawLog

NAMED = 3  # items of one sender that a finding names one by one


def signals_of(log: RawLog) -> tuple[Offer, ...]:
    """Every signal that can be a channel: a list whose items have names by these alone, and nothing of headers."""
    return tuple(offer for offer in offers_of(log) if not offer.header)


def clocked(signals: Sequence[Offer]) -> tuple[str, ...]:
    """The signals that tell a clock: of a topic whose items have names, these."""
    named = {offer.topic for offer in signals if _named(offer)}
    return tuple(o.source for o in signals if _named(o) or o.topic not in named)


def shared(log: RawLog, signals: Sequence[Offer]) -> Iterator[Finding]:
    """Topics on which several send by turns, so that their stamps run back, and whose items are whose."""
    for topic in dict.fromkeys(offer.topic for offer in signals if _named(offer)):
        every = [series for name, series in log.sources.items() if log.topic_of(name) == topic]
        back = int((np.diff(max(every, key=len).time) < 0).sum())
        if not back:
            continue
        longest: dict[str, Offer] = {}
        for offer in signals:
            if offer.topic == topic and _named(offer):
                longest[offer.item] = max(longest.get(offer.item, offer), offer, key=lambda o: len(o.series))
        senders: dict[bytes, list[str]] = {}
        for item, offer in longest.items():
            senders.setdefault(offer.series.time.tobytes(), []).append(item)
        if len(senders) > 1:
            text = (
                f"the stamps of this topic run back {back} times, for {len(senders)} senders share it, each with its "
                f"own stamps: {' and '.join(map(_listed, senders.values()))}"
            )
            yield Finding("info", "clock", f"{log.path.name}, {topic}", text, "in a map, name the items")


def _named(offer: Offer) -> bool:
    """Whether it is an item with a name, of a list in a message; the columns of a table have one clock."""
    return bool(offer.topic and offer.item) and not offer.item.isdigit()


def _listed(items: Sequence[str]) -> str:
    more = f" and {len(items) - NAMED} more" if len(items) > NAMED else ""
    return f"[{', '.join(items[:NAMED])}{more}]"
