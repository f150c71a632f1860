"""A Minari dataset in Arrow: https://minari.farama.org."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from dynreg.data.recording import Channel
from dynreg.data.trajectories import Trajectories, numbers
from dynreg.datasets.export import Export
from dynreg.errors import UsageError

VERSION = "0.5.0"  # of Minari, the first whose data sets have all that is written here
MOST = 20_000  # episodes, a folder each
ROWS = 131_072  # of an episode: Minari takes one batch as one episode, and Arrow reads no longer ones


def check(export: Export) -> None:
    """UsageError for more episodes than a file system likes, or no command, which Minari cannot do without."""
    if export.episodes > MOST:
        raise UsageError(
            f"{export.episodes} episodes as minari, a folder each",
            expected=f"at most {MOST}",
            do="name fewer entries, or choose parquet",
        )
    if not export.dataset.columns.actions:
        raise UsageError("a robot without commands as minari", expected="some actions", do="choose parquet")


def write(export: Export, folder: Path, name: str) -> None:
    """`data/` with metadata.json and a folder for each episode, as Minari's own storage writes them."""
    place, steps, episodes = folder / "data", 0, 0
    place.mkdir()
    for one in export.dataset.trajectories():
        for i, entry in enumerate(one.entries):
            for e, episode in enumerate(one.episodes):
                here = place / str(episodes)
                here.mkdir()
                batch = _batch(one, i, e)
                if len(batch) > ROWS:
                    raise UsageError(
                        f"an episode of {len(batch)} rows as minari",
                        expected=f"at most {ROWS}",
                        do="choose parquet",
                    )
                with pa.ipc.new_file(here / "part-0.arrow", batch.schema) as file:
                    file.write_batch(batch)
                about = {
                    "id": episodes,
                    "total_steps": len(batch) - 1,
                    "entry": entry,
                    "episode": str(episode),
                }
                _json(here / "metadata.json", about)
                steps, episodes = steps + len(batch) - 1, episodes + 1
    size = sum(file.stat().st_size for file in place.rglob("*.arrow"))
    about = {
        "total_episodes": episodes,
        "total_steps": steps,
        "data_format": "arrow",
        "jpeg_encoding": False,
        "observation_space": _space(export.dataset.columns.states),
        "action_space": _space(export.dataset.columns.actions),
        "dataset_id": f"{export.dataset.robot}-v0",
        "minari_version": VERSION,
        "dataset_size": round(size / 1e6, 1),
        "description": f"Dynamics of {export.dataset.robot}, written by dynreg. There is no task: rewards are 0.",
        "observation_names": [[c.name, c.unit] for c in export.dataset.columns.states],
        "action_names": [[c.name, c.unit] for c in export.dataset.columns.actions],
    }
    _json(place / "metadata.json", about)


def _batch(one: Trajectories, entry: int, episode: int) -> pa.RecordBatch:
    """An episode: T+1 rows of which the last has no action, reward or end; Minari leaves those out again."""
    states, actions = one.states[entry, episode], one.actions[episode].copy()
    rows = len(states)
    actions[-1] = np.where(np.isnan(actions[-1]), 0.0, actions[-1])
    ended = np.zeros(rows, bool)
    ended[-2:-1] = True  # the last step; the row after it is padding
    infos = {c.name: v for c, v in zip(one.columns.context, one.context[episode].T, strict=True)}
    if one.time is not None:
        infos = {"time": one.time[entry, episode]} | infos
    columns = {
        "observations": _vectors(states),
        "actions": _vectors(actions),
        "rewards": pa.array(np.zeros(rows)),
        "terminations": pa.array(np.zeros(rows, bool)),
        "truncations": pa.array(ended),
    }
    if infos:
        told = [numbers(np.ascontiguousarray(values)) for values in infos.values()]
        columns["infos"] = pa.StructArray.from_arrays(told, list(infos))
    return pa.RecordBatch.from_pydict(columns)


def _vectors(rows: np.ndarray) -> pa.Array:
    flat = numbers(np.ascontiguousarray(rows, np.float32).ravel())
    return pa.FixedSizeListArray.from_arrays(flat, rows.shape[1])


def _space(columns: tuple[Channel, ...]) -> str:
    """A Gymnasium Box as Minari writes it, which is JSON in JSON; bounds are not told, so it has none."""
    many = len(columns)
    box: dict[str, Any] = {"type": "Box", "dtype": "float32", "shape": [many]}
    return json.dumps(box | {"low": [-np.inf] * many, "high": [np.inf] * many})


def _json(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document, ensure_ascii=False), encoding="utf-8")
