"""Several logs on one clock: parts of a split recording, or files that make one episode."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dynreg.data.series import RawLog, Series


def join(path: Path, logs: Sequence[RawLog]) -> RawLog:
    """Parts of one recording, one after the other: series of the same name are strung together."""
    start = min(log.start for log in logs)
    pieces: dict[str, list[Series]] = {}
    for log in logs:
        shift = log.start - start
        for name, series in log.sources.items():
            pieces.setdefault(name, []).append(Series(series.time + shift, series.values, series.unit))
    sources = {
        name: Series(np.concatenate([s.time for s in p]), np.concatenate([s.values for s in p]), p[0].unit)
        for name, p in pieces.items()
    }
    metadata = {k: v for log in reversed(logs) for k, v in log.metadata.items()} | {"start": start}
    for count in ("messages_read", "messages_lost"):
        parts = [log.metadata.get(count) for log in logs]
        metadata[count] = None if None in parts else sum(parts)
    counts = [Counter(log.metadata.get("messages") or {}) for log in logs]
    metadata["messages"] = dict(sum(counts, Counter()))
    metadata["types"] = {k: v for log in reversed(logs) for k, v in (log.metadata.get("types") or {}).items()}
    names = tuple(dict.fromkeys(name for log in logs for name in log.names))
    return RawLog(
        path, sources, metadata, findings=tuple(f for log in logs for f in log.findings), names=names
    )


def side_by_side(path: Path, logs: Mapping[str, RawLog]) -> RawLog:
    """Files that tell of the same run: the source "position" of member "desired" is "desired.position".

    path : what their names share, without a suffix.
    """
    start = min(log.start for log in logs.values())
    sources, labels, metadata = {}, {}, {}
    for member, log in logs.items():
        shift = log.start - start
        for name, series in log.sources.items():
            sources[f"{member}.{name}"] = Series(series.time + shift, series.values, series.unit)
        labels.update({f"{member}.{name}": texts for name, texts in log.labels.items()})
        metadata.update(log.metadata)
    findings = tuple(f for log in logs.values() for f in log.findings)
    names = tuple(f"{member}.{name}" for member, log in logs.items() for name in log.names)
    return RawLog(path, sources, metadata | {"start": start}, labels, findings, names, stem=path.name)
