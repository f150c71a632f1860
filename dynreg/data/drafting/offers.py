"""What a log offers: its signals, each with the words of its name."""

import re
from dataclasses import dataclass

from dynreg.data.series import RawLog, Series
from dynreg.data.words import COMMANDS, words


@dataclass(frozen=True)
class Offer:
    """One signal of a log, and what its name tells.

    topic : "" in tables. path : the rest of the name without what stands in brackets at its end, which is `item`. ros :
    it is of a ROS message.
    """

    source: str
    topic: str
    path: str
    item: str
    series: Series
    ros: bool = False

    @property
    def words(self) -> tuple[str, ...]:
        """Of the name below its topic; an index is none."""
        return words(f"{self.path} {'' if self.item.isdigit() else self.item}")

    @property
    def group(self) -> str:
        """What items of one list have in common."""
        return self.topic + self.path

    @property
    def command(self) -> bool:
        """Whether the name says that this is what was asked for, not what was measured."""
        return not COMMANDS.isdisjoint((*words(self.topic), *words(self.path), *self.words))

    @property
    def moves(self) -> bool:
        """Whether the signal ever changes."""
        values = self.series.values
        return bool(len(values)) and bool((values != values[0]).any())


def offers_of(log: RawLog) -> tuple[Offer, ...]:
    """Every signal of a log. A list whose items have names is offered by name alone."""
    types = log.metadata.get("types") or {}
    out = []
    for source, series in log.sources.items():
        topic = log.topic_of(source)
        path, item = source[len(topic) :], ""
        if found := re.fullmatch(r"(.+)\[([^\]]*)\]", path):
            path, item = found.groups()
        ros = "/" in types.get(topic.partition("[")[0], "")
        out.append(Offer(source, topic, path, item, series, ros))
    named = {offer.group for offer in out if offer.item and not offer.item.isdigit()}
    return tuple(o for o in out if not (o.item.isdigit() and o.group in named))
