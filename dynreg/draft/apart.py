"""A draft made in a process of its own, whose memory and time are limited: MuJoCo may end on a stranger's model."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.data.series import RawLog, Series
from dynreg.draft.entry import Drafted, DraftOptions, Notes
from dynreg.draft.source import Source, read_source
from dynreg.folder import Folder
from dynreg.sim.child import in_child
from dynreg.sim.robot import robot_of

WORK = "dynreg.draft.apart:drafted"  # what the process does
_MODEL, _LOG = "model/", "log/"  # where the files of a model and the arrays of a log are handed over


def draft_apart(
    path: Path, name: str, options: DraftOptions, log: RawLog | None = None, root: Path | None = None
) -> Drafted:
    """A robot folder from the MJCF or URDF at `path`, and what a log of the robot tells.

    root : the folder that holds all files which the model names; see `source.read_source`.
    Raises RobotError where the model cannot be read, names a file elsewhere, ends MuJoCo, or has nothing to drive;
    LogError for a log whose clock tells no rate; NotTried past the limits `check_seconds` and `robot_memory`.
    """
    notes = Notes()
    source = read_source(path, root, notes)
    files = {_MODEL + at: data for at, data in source.files.items()}
    told: dict[str, Any] = {"name": name, "source": source.name, "model": source.model, "notes": notes.lines}
    told["options"] = asdict(options)
    if log is not None:
        told["log"] = _packed(log, files)
    made = in_child(WORK, files, json.dumps(told), limit="check_seconds")
    whole = {at: text.encode() for at, text in made.pop("texts").items()}
    whole |= {at: source.files[kept] for at, kept in made.pop("assets").items()}
    lists = {key: tuple(made.pop(key)) for key in ("joints", "notes", "missing")}
    return Drafted(robot_of(Folder(whole), Path()), whole, **lists, **made)


def drafted(files: Mapping[str, bytes], text: str) -> dict[str, Any]:
    """What the process does: `draft.draft_robot` of what it was handed, as plain data."""
    from dynreg.draft.draft import draft_robot

    told = json.loads(text)
    model = {at.removeprefix(_MODEL): data for at, data in files.items() if at.startswith(_MODEL)}
    source = Source(told["source"], told["model"], model)
    log = _unpacked(told["log"], files) if "log" in told else None
    notes = Notes(told["notes"])
    made = draft_robot(source, told["name"], DraftOptions(**told["options"]), log, notes)
    kept = {data: at for at, data in model.items()}
    assets = {at: kept[data] for at, data in made.files.items() if data in kept}
    texts = {at: data.decode() for at, data in made.files.items() if at not in assets}
    return {
        "texts": texts,
        "assets": assets,
        "joints": made.joints,
        "base": made.base,
        "notes": made.notes,
        "map": made.map,
        "missing": made.missing,
    }


def _packed(log: RawLog, files: dict[str, bytes]) -> dict[str, Any]:
    """A log as plain data, its arrays among `files`; clocks that signals share go once."""
    places: dict[int, str] = {}

    def place(values: np.ndarray) -> str:
        if id(values) not in places:
            places[id(values)] = f"{_LOG}{len(places)}"
            files[places[id(values)]] = values.tobytes()
        return places[id(values)]

    return {
        "path": str(log.path),
        "sources": {name: (place(s.time), place(s.values), s.unit) for name, s in log.sources.items()},
        "metadata": {key: value for key, value in log.metadata.items() if _sayable(value)},
        "labels": {name: [str(text) for text in texts] for name, texts in log.labels.items()},
        "names": log.names,
    }


def _sayable(value: Any) -> bool:
    """Whether JSON can say a value of a log's metadata: a reader that others wrote may put anything there."""
    try:
        json.dumps(value)
    except (TypeError, ValueError, RecursionError):
        return False
    return True


def _unpacked(told: Mapping[str, Any], files: Mapping[str, bytes]) -> RawLog:
    return RawLog(
        Path(told["path"]),
        {name: Series(*_arrays(files, at), unit) for name, (*at, unit) in told["sources"].items()},
        told["metadata"],
        {name: np.array(texts, dtype=object) for name, texts in told["labels"].items()},
        names=tuple(told["names"]),
    )


def _arrays(files: Mapping[str, bytes], places: list[str]) -> Iterator[np.ndarray]:
    return (np.frombuffer(files[place], dtype=np.float64) for place in places)
