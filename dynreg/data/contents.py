"""What a log holds, topic by topic: types, counts, rates, spans and units, before any robot is known."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.series import RawLog, Series


@dataclass(frozen=True)
class LogTopic:
    """One topic of a log, or a table as a whole.

    topic : "" for a table. type : of its messages, "" where the log does not tell. messages : how many, or rows.
    rate : [Hz] by the median step, None where there is none. begin, end : [s] since the log's first stamp.
    signals : names, without the topic. units : {signal: unit} that the log states.
    """

    log: str
    topic: str
    type: str
    messages: int
    rate: float | None
    begin: float | None
    end: float | None
    signals: tuple[str, ...]
    units: dict[str, str]


def contents(log: RawLog) -> tuple[LogTopic, ...]:
    """The topics of a log in the order in which they are met."""
    groups: dict[str, dict[str, Series]] = {topic: {} for topic in log.metadata.get("topics") or ()}
    for name, series in log.sources.items():
        owner = log.topic_of(name)
        if owner and name.startswith(f"{owner}.point."):  # of a trajectory, each where it is to be reached
            owner = f"{owner}.point"
        groups.setdefault(owner, {})[name[len(owner) :].lstrip(".") if owner else name] = series
    return tuple(_topic(log, topic, signals) for topic, signals in groups.items())


def _topic(log: RawLog, topic: str, signals: dict[str, Series]) -> LogTopic:
    longest = max(signals.values(), key=len, default=None)
    time = longest.time[np.isfinite(longest.time)] if longest is not None else np.empty(0)
    steps = np.diff(time)
    steps = steps[steps > 0]
    counts = log.metadata.get("messages") or {}
    return LogTopic(
        log=log.path.name,
        topic=topic,
        type=(log.metadata.get("types") or {}).get(topic, ""),
        messages=counts.get(topic, len(longest) if longest is not None else 0),
        rate=1.0 / float(np.median(steps)) if len(steps) else None,
        begin=float(time.min()) if len(time) else None,
        end=float(time.max()) if len(time) else None,
        signals=tuple(signals),
        units={name: series.unit for name, series in signals.items() if series.unit is not None},
    )
