"""Maps: TOML files that say how a log's sources become a robot's channels."""

import re
import string
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from dynreg.data.names import position_of
from dynreg.data.patterns import search
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import RawLog
from dynreg.data.units import UNITS, conversion
from dynreg.errors import MapError, one_of, quoted
from dynreg.tomlfile import parse_toml, read_toml

DEFAULT_GAP = 0.5  # [s] a longer silence is a gap
SHOWN = 8  # missing columns that are named


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, allow_inf_nan=False)


class ChannelMap(_Strict):
    """[channels."<name>"]: where one channel comes from.

    value = scale * logged + offset in `unit`, converted to the robot's SI unit. A derivative is taken in SI units;
    it has no `unit` of its own.
    """

    source: str | tuple[str, str, str, str] | None = Field(
        default=None,
        description="Where the numbers are: `topic.field[index]`, `topic.field[joint]`, or a column. With `angle`: the "
        "field of a message that holds x, y, z and w, or a list of four signals in the order w, x, y, z.",
    )
    angle: Literal["roll", "pitch", "yaw"] | None = Field(
        default=None,
        description="The source is a quaternion, of which this is an Euler angle [rad]: turns about z, y, then x.",
    )
    derivative_of: str | None = Field(
        default=None, description="Another channel of the map, of which this one is the derivative."
    )
    filter_hz: float | None = Field(
        default=None,
        gt=0,
        description="Cut-off of a zero-phase Butterworth filter before the derivative [Hz].",
    )
    unit: str | None = Field(
        default=None,
        description="The log's unit; it becomes the robot's SI unit. Without it, the log is in SI units.",
    )
    scale: float = Field(default=1.0, description="Factor of the logged number, before the unit.")
    offset: float = Field(default=0.0, description="Added to the scaled number, in the log's unit.")
    delay: float = Field(default=0.0, description="How late the stamps are [s]; it is subtracted from them.")
    unwrap: bool = Field(default=False, description="`true` removes the turns of 2 pi from a wrapped angle.")

    valid: tuple[float, float] | None = Field(
        default=None,
        description="Least and largest value that can be, in the robot's unit; those beyond are dropped.",
    )
    outliers: Literal["drop"] | float | None = Field(
        default=None,
        description='`"drop"` drops the single-sample spikes that `dynreg doctor` finds; a number drops every value '
        "further than this from the median of the five samples about it, in the robot's unit.",
    )
    clip: tuple[float, float] | None = Field(
        default=None, description="Least and largest value, in the robot's unit; those beyond become these."
    )

    @model_validator(mode="after")
    def _ranges(self) -> "ChannelMap":
        for name, told in (("valid", self.valid), ("clip", self.clip)):
            if told is not None and not told[0] < told[1]:
                raise ValueError(
                    f"`{name}` runs from {told[0]:g} to {told[1]:g}; give the lower number first"
                )
        if isinstance(self.outliers, float) and not self.outliers > 0:
            raise ValueError(
                f'`outliers` = {self.outliers:g} would drop all; give a number above 0, or "drop"'
            )
        return self

    @model_validator(mode="after")
    def _one_origin(self) -> "ChannelMap":
        if (self.source is None) == (self.derivative_of is None):
            raise ValueError("give one of `source` and `derivative_of`")
        if self.derivative_of is not None and (self.valid or self.outliers or self.clip):
            raise ValueError(
                "`valid`, `outliers` and `clip` go with a `source`: give them to the channel it is of"
            )
        if self.derivative_of is not None and self.unit is not None:
            raise ValueError("a derivative takes the unit of its channel: leave `unit` out")
        if self.filter_hz is not None and self.derivative_of is None:
            raise ValueError("`filter_hz` goes with `derivative_of`")
        if self.unit is not None and self.unit not in UNITS:
            raise ValueError(f"unknown unit {self.unit!r}; one of {', '.join(UNITS)}")
        if self.angle is None and isinstance(self.source, tuple):
            raise ValueError('four sources are a quaternion: give `angle` = "roll", "pitch" or "yaw"')
        if self.angle is not None and (self.source is None or self.unit not in (None, "rad")):
            raise ValueError("`angle` goes with the `source` of a quaternion and is in rad: leave `unit` out")
        return self

    @property
    def sources(self) -> tuple[str, ...]:
        """Every signal that the channel is made of: one, or the w, x, y, z of a quaternion; none for a derivative."""
        if self.source is None:
            return ()
        if isinstance(self.source, tuple):
            return self.source
        return tuple(f"{self.source}.{part}" for part in "wxyz") if self.angle else (self.source,)


class SettingMap(_Strict):
    """[settings.<name>]: where one setting comes from. Give one of `metadata`, `value` and `filename`."""

    metadata: str | None = Field(
        default=None, description="Key of the log's metadata, or a column, that holds the setting."
    )
    value: float | None = Field(default=None, description="The setting itself, the same in every episode.")
    filename: str | None = Field(
        default=None,
        description="Regular expression with one group, which finds the setting in the name of the file, without its "
        "suffix, or of the folder.",
    )
    scale: float = Field(default=1.0, description="Factor of the number that was found.")
    offset: float = Field(default=0.0, description="Added to the scaled number.")
    default: float | None = Field(default=None, description="Value where the log does not state it.")

    @model_validator(mode="after")
    def _one_origin(self) -> "SettingMap":
        if sum(v is not None for v in (self.metadata, self.value, self.filename)) != 1:
            raise ValueError("give one of `metadata`, `value` and `filename`")
        if self.filename is not None:
            told = search(self.filename, "")
            if told.problem:
                raise ValueError(f"`filename` is not a regular expression: {told.problem}")
            if told.groups != 1:
                raise ValueError(f"`filename` has {told.groups} groups; give it one")
        return self


class EpisodeMap(_Strict):
    """[episodes]: how a log falls into episodes, and their names."""

    by: Literal["file", "column", "gaps"] = Field(
        default="file",
        description="What an episode is: a `file`, the rows with one value of a `column`, or what lies "
        "between `gaps`.",
    )
    column: str | None = Field(
        default=None,
        description="The column that numbers or names the episodes; rows whose cell is empty belong to none.",
    )
    gap: float = Field(
        default=DEFAULT_GAP,
        gt=0,
        allow_inf_nan=True,
        description="Silence that ends an episode, or that is reported where `by` is not `gaps` [s]; `inf`: none.",
    )
    name: str | None = Field(
        default=None,
        description="Name of an episode, such as `kp{kp:g}`: names of settings and metadata in braces.",
    )

    @model_validator(mode="after")
    def _column_given(self) -> "EpisodeMap":
        if (self.by == "column") != (self.column is not None):
            raise ValueError('`column` goes with by = "column"')
        for _, field, spec, convert in string.Formatter().parse(self.name or ""):
            # Plain names only: a format string could otherwise reach into the objects behind them.
            # A width of three digits, or of another field's value, would make names that fill the memory.
            plain = (
                re.fullmatch(r"\w+", field or "") and not convert and not re.search(r"\{|\d{3}", spec or "")
            )
            if field is not None and not plain:
                raise ValueError(f"`name` holds {{{field}}}; use plain names of settings or metadata")
        return self


class HeadMap(_Strict):
    """[map]: the map and the log's clock."""

    robot: str | None = Field(
        default=None, description="The robot that the map is for; other robots are then refused."
    )
    time: str | None = Field(
        default=None,
        description="The column with the time; without it, the usual names are tried. Of a log of messages, `log`: the "
        "recorder's stamps in place of those in headers.",
    )
    time_unit: Literal["s", "ms", "us", "ns"] | None = Field(
        default=None,
        description="Unit of that column; without it, the one that its name states (`time_ms`), or `s`.",
    )
    note: str | None = Field(default=None, description="One line for people.")


class LogMap(_Strict):
    """The whole file."""

    map: HeadMap = Field(default_factory=HeadMap, description="The map and the log's clock.")
    channels: dict[str, ChannelMap] = Field(
        description="Where each channel and each action of the robot comes from, by its name."
    )
    settings: dict[str, SettingMap] = Field(
        default_factory=dict, description="Where each setting comes from, by its name."
    )
    episodes: EpisodeMap = Field(default_factory=EpisodeMap, description="How the log falls into episodes.")
    files: dict[str, str] = Field(
        default_factory=dict,
        description='Members of an episode that lies in several files: `{name = "suffix"}`.',
    )

    @property
    def sources(self) -> tuple[str, ...]:
        """Every name in a log that the map may ask for."""
        names = [name for c in self.channels.values() for name in c.sources]
        names += [s.metadata for s in self.settings.values()]
        return tuple(name for name in (*names, self.episodes.column) if name is not None)


def read_map(path: str | Path) -> LogMap:
    """Read a map file.

    Raises MapError that names the file, the line and the key where it is not a map.
    """
    file = Path(path)
    if file.exists() and not file.is_file():  # a pipe would be waited for
        raise MapError(f"{file.name!r} is no file", expected="a TOML file", do="check the path")
    return read_toml(file, LogMap, MapError)


def parse_map(text: str, name: str = "map") -> LogMap:
    """A map from TOML text; `name` is what its errors call it. Raises MapError as `read_map` does."""
    return parse_toml(text, name, LogMap, MapError)


def read_own_map(path: str | Path) -> LogMap:
    """A map of a robot's own folder, which is for that robot whatever name it says; raises as `read_map`."""
    found = read_map(path)
    return found.model_copy(update={"map": found.map.model_copy(update={"robot": None})})


def own_maps(folder: Path) -> Iterator[tuple[Path, LogMap]]:
    """The maps in a robot's folder, by name, that can be read."""
    for path in sorted((folder / "maps").glob("*.toml")):
        try:
            own = read_own_map(path)
        except MapError:
            continue  # `robots check` tells what is wrong with it
        yield path, own


def check_map(log_map: LogMap, spec: RecordingSpec) -> None:
    """Hold a map against the robot: names it does not know, units that cannot become its own.

    Raises MapError for the first fault.
    """
    if log_map.map.robot is not None and log_map.map.robot != spec.robot:
        raise MapError(
            f"the map is for robot {log_map.map.robot!r}",
            expected=f"a map for {spec.robot!r}",
            do="pass --robot or its map",
        )
    channels = {c.name: c for c in spec.channels}
    for name, entry in log_map.channels.items():
        _known_name(name, "channel", tuple(channels))
        factors(entry, channels[name])
        if entry.derivative_of is not None:
            _known_name(entry.derivative_of, "channel", tuple(n for n in log_map.channels if n != name))
    for name in log_map.settings:
        _known_name(name, "setting", spec.settings)
    missing = [c for c in spec.channels if not c.optional and c.name not in log_map.channels]
    if missing:
        raise _without_source(missing, log_map)


def _without_source(missing: Sequence[ChannelSpec], log_map: LogMap) -> MapError:
    """What is said of all channels that a map lacks, and of a velocity whose position in the map tells it."""
    several, first = len(missing) > 1, missing[0].name
    do = f"add {'them' if several else 'it'} to the map"
    rates = {c.name: position_of(c.name) for c in missing if c.kind == "state"}
    if rate := next((name for name, position in rates.items() if position in log_map.channels), None):
        do += f'. Where the log lacks a velocity, derivative_of = "{rates[rate]}" computes {rate!r}'
    return MapError(
        f"the map gives no source for channel{'s' * several} {quoted(c.name for c in missing)}",
        expected=f'[channels."{first}"] with source = "..."{", and so on" * several}',
        do=do,
    )


def _known_name(name: str, kind: str, known: tuple[str, ...]) -> None:
    if name not in known:
        raise MapError(
            f"the map names {kind} {name!r}, which the robot does not have",
            expected=one_of(known, name),
            do="correct the name",
        )


def factors(entry: ChannelMap, channel: ChannelSpec) -> tuple[float, float]:
    """Factor and offset from the logged number to the channel's SI unit; MapError where units do not meet."""
    try:
        factor, shift = conversion(entry.unit or channel.unit, channel.unit)
    except MapError as error:
        raise MapError(
            f"channel {channel.name!r}: {error.problem}", expected=error.expected, do=error.do
        ) from None
    return factor * entry.scale, factor * entry.offset + shift


def odd_text(texts: Sequence[Any]) -> str:
    """The first text of a column that is no number, its row, and how many there are.

    >>> odd_text(["0.5", "ERR", "1,5"])
    "'ERR' in row 2 (2 of 3 are no numbers)"
    """
    odd = [(row, str(text)) for row, text in enumerate(texts, 1) if not _is_number(text)]
    if not odd:
        return f"{str(texts[0])!r} in row 1 (numbers kept as text)"
    commas = all(re.fullmatch(r"[-+]?\d+,\d+", text) for _, text in odd)
    return f"{odd[0][1]!r} in row {odd[0][0]} ({len(odd)} of {len(texts)} are no numbers)" + (
        ": decimal commas" if commas else ""
    )


def of_text(log: RawLog, column: str) -> MapError:
    """What is said where numbers are asked of a column of text."""
    return MapError(
        f"{log.path.name!r}: column {column!r} holds text: {odd_text(log.labels[column])}",
        expected="numbers with a decimal point, or empty cells, alone",
        do="write the column as numbers, and empty the other cells",
    )


def _is_number(text: Any) -> bool:
    try:
        float(text)
    except (TypeError, ValueError):
        return text is None or not str(text).strip()
    return True


def identity_map(spec: RecordingSpec, log: RawLog) -> LogMap:
    """The map of a table whose columns are named like the robot's channels and settings (and `episode`).

    Raises MapError where a required channel has no column, or a channel's column holds text.
    """
    for channel in spec.channels:
        if channel.name in log.labels and channel.name not in log.sources:
            raise of_text(log, channel.name)
    lost = [c.name for c in spec.channels if not c.optional and c.name not in log.sources]
    if lost:
        more = f" and {len(lost) - SHOWN} more" * (len(lost) > SHOWN)
        raise MapError(
            f"{log.path.name!r}: the log has no column {', '.join(map(repr, lost[:SHOWN]))}{more}",
            expected=f"a column for each of the robot's channels; it has {', '.join(map(repr, [*log.sources][:20]))}",
            do="draft a map with `dynreg doctor LOG --robot ROBOT --draft-map map.toml`, and pass it with --map",
        )
    episodes = {"by": "column", "column": "episode"} if "episode" in {**log.sources, **log.labels} else {}
    return LogMap.model_validate(
        {
            "channels": {c.name: {"source": c.name} for c in spec.channels},
            "settings": {name: {"metadata": name} for name in spec.settings},
            "episodes": episodes,
        }
    )
