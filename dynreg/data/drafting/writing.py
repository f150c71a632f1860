"""A drafted map, and its text."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from dynreg.data.checks.clock import doubted, likely_units, quickest, usual_step
from dynreg.data.drafting.offers import EPISODE_COLUMNS, offers_of
from dynreg.data.drafting.source import Source, used
from dynreg.data.maps import DEFAULT_GAP, LogMap, parse_map
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import RawLog
from dynreg.tomlfile import literal

PATIENT = 3.0  # usual steps of a slow log that are no gap


@dataclass(frozen=True, eq=False)
class Draft:
    """A drafted map of a log to the channels of `spec`, which is that of a robot or proposed.

    sources : {channel: Source} of the channels that were found.
    """

    log: RawLog
    spec: RecordingSpec
    sources: Mapping[str, Source] = field(default_factory=dict)

    @property
    def missing(self) -> tuple[str, ...]:
        """Channels that the robot needs and for which nothing was found; with any, the map is not complete."""
        return tuple(c.name for c in self.spec.channels if not c.optional and c.name not in self.sources)

    @property
    def settings(self) -> tuple[str, ...]:
        """The settings that the robot needs and the log does not tell."""
        return tuple(n for n in self.spec.settings if not self._holds(n) and n not in self.spec.usual)

    @property
    def text(self) -> str:
        """The TOML of the map. What is missing or ambiguous is a comment in it."""
        lines = [*_head(self.log, self.spec.robot), "", *([] if self.sources else ["[channels]", ""])]
        for channel in self.spec.channels:
            lines += [*_table(channel, self.sources.get(channel.name)), ""]
        for name in self.spec.settings:
            lines += [*_setting(name, self._holds(name), name in self.settings), ""]
        return "\n".join([*lines, *_episodes(self.log), *_unused(self)]) + "\n"

    @property
    def log_map(self) -> LogMap:
        """The map itself."""
        return parse_map(self.text)

    def changed(self, channel: str, *notes: str, **keys: object) -> "Draft":
        """The draft with other keys in a channel's table, where it has one, and with notes on them."""
        source = self.sources.get(channel)
        if source is None:
            return self
        return replace(self, sources={**self.sources, channel: source.told(*notes, **keys)})

    def _holds(self, setting: str) -> bool:
        return setting in self.log.metadata or setting in self.log.sources


def _head(log: RawLog, robot: str) -> list[str]:
    lines = [f"# Drafted from {' '.join(log.path.name.split())}: check every line.", "[map]"]
    lines.append(f"robot = {literal(robot)}" if robot else '# robot = "..."    # the name in robot.toml')
    if log.counting is not None:
        lines += [f"time = {literal(log.counting.column)}", _unit(log)]
    return lines


def _unit(log: RawLog) -> str:
    """The line of the clock's unit: a comment where neither the log's names nor its steps tell one that can be."""
    doubt = doubted(quickest(log), log.counting)
    if doubt is not None and not doubt.rates and log.counting is not None:
        return f"# time_unit = {literal(log.counting.unit)}    # {doubt.said}; {doubt.do}"
    likely, *others = map(literal, likely_units(log))
    if others:
        return f"# time_unit = {likely}    # or {' or '.join(others)}: its steps do not tell which"
    return f"time_unit = {likely}" + "    # by its steps: check it" * (log.counting.told == "steps")


def _table(channel: ChannelSpec, source: Source | None) -> list[str]:
    header = f"[channels.{literal(channel.name)}]"
    if source is None:
        need = "optional" if channel.optional else "MISSING"
        return [
            f"# {header}",
            f'# source = "..."    # {need}: nothing in the log looks like it [{channel.unit}]',
        ]
    keys = [f"{key} = {literal(value)}" for key, value in source.keys.items() if value is not None]
    return [header, *keys, *(f"# {note}" for note in source.notes)]


def _setting(name: str, held: bool, needed: bool) -> list[str]:
    header = f"[settings.{literal(name)}]"
    if held:
        return [header, f"metadata = {literal(name)}"]
    need = "the log does not tell it" if needed else "optional: it is nominal where it is not told"
    return [f"# {header}", f"# value = 0.0    # {need}"]


def _episodes(log: RawLog) -> list[str]:
    every = {**log.labels, **log.sources}
    column = next((name for name in EPISODE_COLUMNS if name in every), None)
    if column is not None:
        return ["[episodes]", 'by = "column"', f"column = {literal(column)}"]
    step = usual_step(quickest(log))
    slow = step > DEFAULT_GAP and len(likely_units(log)) < 2
    gap = [f"gap = {literal(PATIENT * step, 3)}    # its rows come every {step:.3g} s"] if slow else []
    return ["[episodes]", 'by = "file"', 'name = "{stem}"', *gap]


def _unused(draft: Draft) -> list[str]:
    """What else the log holds, one line a group."""
    taken = {*EPISODE_COLUMNS, *used(draft.sources)}
    groups: dict[str, list[str]] = {}
    for offer in offers_of(draft.log):
        if offer.source not in taken and not offer.header:
            groups.setdefault(offer.topic or offer.source, []).append(offer.source)
    if not groups:
        return []
    lines = ["", "# Not used:"]
    for names in groups.values():
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        lines.append(f"#   {', '.join(' '.join(n.split()) for n in names[:3])}{more}")
    return lines
