"""What a log offers: its signals, each with the words of its name."""

import re
from dataclasses import dataclass, replace

from dynreg.data.series import RawLog, Series
from dynreg.data.units import unit_called
from dynreg.data.words import COMMANDS, MEASURED, asks, words

EPISODE_COLUMNS = ("episode", "episode_index", "episode_id", "run", "trial")
_BRACKETS = re.compile(r"(.+?)\s*[\[(]([^\[\]()]+)[\])]")


@dataclass(frozen=True)
class Offer:
    """One signal of a log, and what its name tells.

    topic : "" in tables. path : the rest of the name without what stands in brackets at its end, which is `item`, or
    the unit of the series. ros : it is of a ROS message.
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
        """Whether the name says that this is what was asked for, not what was measured.

        A controller tells both in one topic: where the path says that it was measured, the topic's words do not count.
        """
        told = () if not MEASURED.isdisjoint(words(self.path)) else words(self.topic)
        return self.asked or not COMMANDS.isdisjoint(told)

    @property
    def asked(self) -> bool:
        """Whether the name below its topic says so."""
        return asks(words(self.path)) or asks(self.words)

    @property
    def header(self) -> bool:
        """Whether it is of a message's header: a stamp or a number of the message, nothing that a robot does."""
        return ".header." in self.source

    @property
    def moves(self) -> bool:
        """Whether the signal ever changes."""
        values = self.series.values
        return bool(len(values)) and bool((values != values[0]).any())


def offers_of(log: RawLog) -> tuple[Offer, ...]:
    """Every signal of a log. A list whose items have names is offered by name alone."""
    types, units = log.metadata.get("types") or {}, _in_brackets(log)
    out = []
    for source, series in log.sources.items():
        topic = log.topic_of(source)
        path, item = source[len(topic) :], ""
        if source in units:
            path, unit = units[source]
            series = replace(series, unit=series.unit or unit)
        elif found := re.fullmatch(r"(.+)\[([^\]]*)\]", path):
            path, item = found.groups()
        ros = "/" in types.get(topic.partition("[")[0], "")
        out.append(Offer(source, topic, path, item, series, ros))
    named = {offer.group for offer in out if offer.item and not offer.item.isdigit()}
    return tuple(o for o in out if not (o.item.isdigit() and o.group in named))


def _in_brackets(log: RawLog) -> dict[str, tuple[str, str]]:
    """{column: (its name, the unit in brackets behind it)} of a table's columns such as "elbow_pos [rad]".

    Where one of a list is no unit, as of q[A] and q[B], the others are names too.
    """
    columns = [name for name in log.sources if not log.topic_of(name)]
    found = {name: told.groups() for name in columns if (told := _BRACKETS.fullmatch(name))}
    lists = {path for path, item in found.values() if unit_called(item) is None or item.isdigit()}
    return {name: (path, unit_called(item)) for name, (path, item) in found.items() if path not in lists}
