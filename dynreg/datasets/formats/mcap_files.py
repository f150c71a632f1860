"""Recordings, and entries as recordings of their simulators, as MCAP logs with the maps that read them back."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dynreg.data.maps import LogMap
from dynreg.data.recording import Episode, Recording
from dynreg.data.table import map_for, to_mcap
from dynreg.data.trajectories import Trajectories
from dynreg.datasets.export import Export
from dynreg.errors import UsageError
from dynreg.tomlfile import literal

MOST = 200  # logs, a few MB each: MCAP is for looking at some, not for training on all


def is_file(export: Export) -> bool:
    """Where it is of one entry or recording."""
    return export.count == 1


def as_logs(export: Export) -> bool:
    """Always."""
    return True


def check(export: Export) -> None:
    """UsageError for more logs than anybody looks at."""
    if export.count > MOST:
        raise UsageError(
            f"{export.count} entries and recordings as mcap, a log each",
            expected=f"at most {MOST}",
            do="name some of them, or choose parquet",
        )


def write(export: Export, folder: Path, name: str) -> None:
    """A log and its map, `NAME.toml`; of several things a log and a map each, named by number and id."""
    for i, recording in enumerate(_recordings(export)):
        called = name if is_file(export) else f"{i:03d}-{export.dataset.entries[i][:12]}.mcap"
        (folder / called).write_bytes(to_mcap(recording))
        (folder / f"{called}.toml").write_text(text_of(map_for(recording)), encoding="utf-8")


def _recordings(export: Export) -> Iterator[Recording]:
    recorded = {r.id: r for r in export.recordings}
    if export.populations:
        for one in export.dataset.trajectories():
            if one.numbers is not None:
                for alone in one.split(1):
                    yield _recording(alone)
    for told in recorded.values():
        yield told.read()


def _recording(one: Trajectories) -> Recording:
    """One entry's episodes as a recording; those whose times nobody told have a row a second."""
    columns = one.columns
    steps = one.states.shape[2]
    time = (
        np.broadcast_to(np.arange(steps, dtype=float), one.states.shape[:3]) if one.time is None else one.time
    )
    episodes = [
        Episode(
            str(one.episodes[e]),
            time[0, e],
            np.concatenate([one.states[0, e], one.actions[e], one.inputs[e]], axis=1),
            {
                c.name: float(v)
                for c, v in zip(columns.settings, one.settings[e], strict=True)
                if np.isfinite(v)
            },
        )
        for e in range(len(one.episodes))
    ]
    channels = (*columns.states, *columns.actions, *columns.inputs)
    return Recording(channels, tuple(episodes), measured=False, provenance={"entry": one.entries[0]})


def text_of(log_map: LogMap) -> str:
    """A map as a TOML file."""
    lines = []
    for table, rows in log_map.model_dump(exclude_defaults=True).items():
        nested = all(isinstance(row, dict) for row in rows.values())
        for head, row in (
            [(f"{table}.{literal(k)}", v) for k, v in rows.items()] if nested else [(table, rows)]
        ):
            lines += [f"[{head}]", *(f"{key} = {literal(value)}" for key, value in row.items()), ""]
    return "\n".join(lines)
