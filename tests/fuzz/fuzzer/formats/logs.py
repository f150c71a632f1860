"""What every log goes through once it is read: the doctor's checks, a map, episodes, the grid of the robot."""

import zlib
from pathlib import Path

from dynreg.data.checks import check_clocks, check_episode, check_numbers, errors
from dynreg.data.episodes import raw_episodes
from dynreg.data.logfile import LogFile
from dynreg.data.maps import LogMap
from dynreg.data.readers import ReadOptions, read_log
from dynreg.data.resample import resample
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import RawLog

_KINDS = ("state", "action", "input")
_MESSAGES = (".mcap", ".bag", ".db3")


def read_and_use(data: bytes, name: str) -> None:
    """Read a log called `name` that holds `data`, and do with it what ingestion does."""
    use(read_log(LogFile(Path(name), data), options_for(data, name.endswith(_MESSAGES))), data)


def options_for(data: bytes, messages: bool) -> ReadOptions:
    """Mostly the usual options; which, the data's own checksum decides."""
    which = zlib.crc32(data) % 16
    if which < 2 and messages:
        return ReadOptions(time="log", time_unit="ns")
    if which == 2:
        return ReadOptions(time_unit="ns")
    return ReadOptions(sources=("/a.x", "/a.header.stamp.sec")) if which == 3 else ReadOptions()


def use(log: RawLog, data: bytes) -> None:
    """The doctor's checks, then the first three signals as the channels of a robot."""
    for _ in check_clocks(log.sources, log.path.name, 0.5):
        pass
    for name, series in log.sources.items():
        for _ in check_numbers(series, f"{log.path.name}, {name}"):
            pass
    if not log.sources:
        return
    log_map, spec = _posed(log, zlib.crc32(data))
    for episode in raw_episodes(log, log_map, spec):
        if not errors(check_episode(episode, spec, 0.5)):
            resample(episode, spec)


def _posed(log: RawLog, which: int) -> tuple[LogMap, RecordingSpec]:
    sources = list(log.sources)[:3]
    names = [f"joint{i}/{'position' if i != 1 else 'velocity'}" for i in range(len(sources))]
    channels = tuple(ChannelSpec(n, "rad", kind) for n, kind in zip(names, _KINDS, strict=False))
    document: dict = {"channels": {n: {"source": s} for n, s in zip(names, sources, strict=True)}}
    if which % 5 == 1:
        document["episodes"] = {"by": "gaps"}
    elif which % 5 == 2:
        document["episodes"] = {"by": "column", "column": [*log.sources, *log.labels][-1]}
    elif which % 5 == 3:
        document["channels"][names[0]] |= {"unwrap": True, "delay": 0.01}
    other = [*log.metadata, *log.sources]
    if which % 3 == 0:
        document["settings"] = {"kp": {"metadata": other[which % len(other)]}}
    rate = None if which % 7 == 0 else 100.0
    return LogMap.model_validate(document), RecordingSpec("any", channels, ("kp",), rate)
