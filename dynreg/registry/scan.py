"""What the files of a registry hold, found without asking the catalogue.

Every file but those of the robots carries the hash of its bytes in its name and says in its header what it
is, so the catalogue can be compared with the files, and written again from them.
"""

import json
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dynreg.errors import CorruptError, DynregError, RegistryError
from dynreg.registry.cache import is_sound
from dynreg.registry.catalog import BESIDE, FILE
from dynreg.registry.codec import decode_arrays
from dynreg.registry.documents import KIND
from dynreg.registry.entries import entry_rows
from dynreg.registry.files import (
    CACHE,
    CONTENTS,
    FOLDERS,
    INDEX,
    LOCKS,
    LOST_AND_FOUND,
    ROBOTS,
    SEARCHES,
    StoredFile,
    is_content,
    is_passed_over,
    is_temporary,
    read_regular,
    sha256_of,
    unreadable,
)
from dynreg.registry.indexes import read_index
from dynreg.registry.measured import measured_of, weights_layout
from dynreg.registry.opening import MARKER
from dynreg.registry.populations import record_of
from dynreg.registry.records import PopulationRecord, ShardData
from dynreg.registry.shards import check_told, read_shard, read_states_header
from dynreg.search.journal import damage

_KNOWN_AT_TOP = {MARKER, FILE, *BESIDE, CACHE, LOCKS, LOST_AND_FOUND, SEARCHES, *FOLDERS}


@dataclass(frozen=True)
class FoundShard:
    """A sound pair of shard files: catalogue row, rows of its entries, layout of an entry."""

    row: dict[str, Any]
    entries: list[dict[str, Any]]
    layout: dict[str, Any]


@dataclass(frozen=True)
class Found:
    """Sound contents by what identifies them, and in `bad` the files that are not, with the reason."""

    files: dict[str, StoredFile] = field(default_factory=dict)
    populations: dict[str, dict[str, Any]] = field(default_factory=dict)
    shards: dict[tuple[str, int], FoundShard] = field(default_factory=dict)
    recordings: dict[str, dict[str, Any]] = field(default_factory=dict)
    measured: dict[str, dict[str, Any]] = field(default_factory=dict)
    simulators: dict[str, dict[str, Any]] = field(default_factory=dict)
    results: dict[str, dict[str, Any]] = field(default_factory=dict)
    models: dict[str, dict[str, Any]] = field(
        default_factory=dict
    )  # layout of the weights of measured entries
    bad: dict[str, str] = field(default_factory=dict)
    hashes: dict[str, str] = field(default_factory=dict)  # sha256 of every file, by its path


@dataclass(frozen=True)
class _Halves:
    """The files of shards by (population, start, stop): those of the states, and those of the rest."""

    states: dict[tuple[str, int, int], str] = field(default_factory=dict)
    rest: dict[tuple[str, int, int], str] = field(default_factory=dict)


def scan(root: Path, registered: set[str], removed: Collection[str] = ()) -> Found:
    """Read every file below `root` and sort it; where two would do, one in `registered` goes first.

    removed : files, and folders with a "/" at the end, that were taken out of the registry: they are passed over.
    """
    found, halves = Found(), _Halves()
    for path in sorted(root.iterdir()):
        if path.name not in _KNOWN_AT_TOP and is_content(path.name):
            found.bad[path.name] = "not a part of a registry"
    names = [name for name in _names(root) if not _is_among(name, removed)]
    for relative in sorted(names, key=lambda name: (name not in registered, name)):
        if (root / relative).is_symlink():
            found.bad[relative] = "a link, which a registry does not hold"
            continue
        try:
            relative.encode()
            file = StoredFile(relative, sha256_of(root / relative), (root / relative).stat().st_size)
            found.hashes[relative] = file.sha256
            if _sort(found, halves, root / relative, file):
                found.files[relative] = file
        except FileNotFoundError:
            continue  # an index that was replaced in the meantime
        except UnicodeEncodeError:
            found.bad[relative] = "its name is not text in UTF-8"
        except OSError as error:
            found.bad[relative] = _damage(unreadable(root / relative, error))
        except (DynregError, KeyError, TypeError, ValueError, RecursionError) as error:
            found.bad[relative] = _damage(error)
    _pair(root, found, halves)
    _compare_models(found)
    found.bad.update(damaged_here(root))
    return found


def damaged_here(root: Path) -> dict[str, str]:
    """What is wrong with files of the cache and with journals of searches, which lie in the folder of any registry."""
    bad = {}
    for path in sorted((root / CACHE).rglob("*.json")):
        if is_content(path.name) and not is_sound(path):
            bad[path.relative_to(root).as_posix()] = "it does not hold what was kept"
    for path in sorted((root / SEARCHES).glob("*.jsonl")):
        if problem := damage(path):
            bad[path.relative_to(root).as_posix()] = problem
    return bad


def _is_among(name: str, removed: Collection[str]) -> bool:
    return name in removed or "/".join(name.split("/")[:2]) + "/" in removed


def _names(root: Path) -> list[str]:
    """All files below the folders of contents, links among them, by their paths in the registry.

    What a file manager left there is passed over, but for names that a robot's own file may have.
    """
    folders = [root / name for name in (*CONTENTS, INDEX)]
    files = (
        path for folder in folders for path in folder.rglob("*") if path.is_symlink() or not path.is_dir()
    )
    names = [path.relative_to(root).as_posix() for path in files if not is_temporary(path.name)]
    return [name for name in names if not is_passed_over(name)]


def _sort(found: Found, halves: _Halves, path: Path, file: StoredFile) -> bool:
    """Enter what a file holds; False for one that no row knows. Raises where it does not hold what its place asks."""
    folder = file.path.split("/")[0]
    if folder == ROBOTS:
        return True
    if not path.stem.endswith(f"-{file.sha256[:16]}"):
        raise unreadable(path, "its bytes do not fit the hash in its name")
    if folder == INDEX:
        read_index(path)
    elif folder == "shards":
        is_states = path.suffix == ".parquet"
        header = read_states_header(path) if is_states else decode_arrays(path, skip="")[0]
        population, start, stop = header["population"], header["start"], header["stop"]
        if not isinstance(population, str) or type(start) is not int or type(stop) is not int or start < 0:
            raise ValueError(f"it says that it is a shard of {population} from {start} to {stop}")
        held = halves.states if is_states else halves.rest
        held.setdefault((population, start, stop), file.path)
    else:
        _READERS[folder](found, path, file)
    return folder != INDEX


def _damage(error: Exception) -> str:
    """What is wrong with a file, for the report; raised where it is the disk's fault, or a right that is missing."""
    if isinstance(error, RegistryError) and not isinstance(error, CorruptError):
        raise error
    return getattr(error, "problem", str(error))


def _pair(root: Path, found: Found, halves: _Halves) -> None:
    """Join the two files of each shard; registered ones come first, later ones must not overlap them."""
    for span, states_path in halves.states.items():
        if span not in halves.rest:
            continue
        population, start, stop = span
        rest_path = halves.rest[span]
        try:
            header, data = read_shard(root / states_path, root / rest_path)
            if population in found.populations:
                record = found.populations[population]["record"]
                _check_fits(record, header, data)
                check_told(header, data, record)
        except (DynregError, KeyError, TypeError, ValueError, OverflowError) as error:
            found.bad[states_path] = found.bad[rest_path] = _damage(error)
            continue
        taken = [s.row for (owner, _), s in found.shards.items() if owner == population]
        if len(data) != stop - start or any(start < row["stop"] and row["start"] < stop for row in taken):
            found.bad[states_path] = found.bad[rest_path] = "its entries are in another shard"
            continue
        row = {"population_id": population, "start": start, "stop": stop}
        row |= {"states_path": states_path, "arrays_path": rest_path}
        entries = entry_rows(population, start, data.entry_ids(population))
        found.shards[population, start] = FoundShard(row, entries, data.layout)


def _check_fits(record: PopulationRecord, header: dict[str, Any], data: ShardData) -> None:
    """Raise ValueError where the entries of a shard are none of this population's."""
    if header["states"] != [channel.name for channel in record.channels] or not record.fits(header["shape"]):
        raise ValueError("its states are not those of its population")
    if data.values.shape[1] != len(record.parameters):
        raise ValueError("its parameters are not those of its population")


def _read_population(found: Found, path: Path, file: StoredFile) -> None:
    header, arrays = decode_arrays(path)
    bank = {name: array for name, array in arrays.items() if name.startswith("bank.")}
    record = record_of(path, (header, bank), size=1)  # kept for its shards, without the large arrays
    found.populations[header["id"]] = {"header": header, "path": file.path, "record": record}


def _read_recording(found: Found, path: Path, file: StoredFile) -> None:
    from dynreg.data.table import read_parquet

    try:
        recording_id = read_parquet(path).id
    except Exception as error:  # whatever a damaged file makes the reader raise
        raise unreadable(path, error) from error
    found.recordings.setdefault(recording_id, {"robot": path.stem.split("-")[1], "path": file.path})


def _read_measured(found: Found, path: Path, file: StoredFile) -> None:
    entry = measured_of(path, decode_arrays(path))
    row = {"id": entry.id, "population_id": entry.population_id, "recording_id": entry.recording_id}
    found.measured[entry.id] = row | {"path": file.path}
    found.models[entry.id] = weights_layout(entry)


def _compare_models(found: Found) -> None:
    """Put aside measured entries whose models are not of the kind of those of their population."""
    layouts: dict[str, dict[str, Any]] = {}
    for (population, _), shard in sorted(found.shards.items(), key=lambda held: held[0]):
        layouts.setdefault(population, shard.layout["weights"])
    for identity, model in found.models.items():
        row = found.measured[identity]
        if layouts.get(row["population_id"], model) != model:
            found.bad[row["path"]] = "its model has other weights than the models of its population"
            del found.measured[identity]


def _read_simulator(found: Found, path: Path, file: StoredFile) -> None:
    _json_object(path)
    found.simulators[file.sha256] = {"id": file.sha256, "path": file.path}


def _read_result(found: Found, path: Path, file: StoredFile) -> None:
    kind, recording, _ = path.stem.split("-")
    _json_object(path)
    if not KIND.fullmatch(kind):
        raise ValueError(f"{kind!r} is no kind of result")
    found.results[file.path] = {
        "kind": kind,
        "recording": recording,
        "path": file.path,
        "sha256": file.sha256,
    }


def _json_object(path: Path) -> None:
    if not isinstance(json.loads(read_regular(path)), dict):
        raise ValueError("it is no JSON object")


_READERS = {
    "populations": _read_population,
    "recordings": _read_recording,
    "measured": _read_measured,
    "simulators": _read_simulator,
    "results": _read_result,
}
