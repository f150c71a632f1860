"""Files of older registries, written anew so that they explain themselves: populations, shards, recordings.

Each file has a transaction of its own, so a process that is killed leaves some of the old form, with which the next one
goes on. The ids of what is in them stay the same. What is damaged, or whose robot is, stays as it is: files of the old
form can be read, too.
"""

import tomllib
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from sqlalchemy import Table, select

import dynreg.registry.migrations as migrations
import dynreg.registry.tables as tables
from dynreg.data.recording import Channel
from dynreg.data.table import is_old as is_old_recording
from dynreg.errors import CorruptError, DynregError, Renewed
from dynreg.limits import limits
from dynreg.registry.directory import Directory
from dynreg.registry.entries import states_file
from dynreg.registry.files import StoredFile, read_regular
from dynreg.registry.headers import is_old
from dynreg.registry.populations import get_population, population_file
from dynreg.registry.recordings import get_recording, recording_file
from dynreg.registry.records import COMMANDED, PopulationRecord
from dynreg.registry.robots import robot_folder
from dynreg.registry.shards import read_shard, read_states_header
from dynreg.registry.sweeping import remove_files

# A row of a table, the column that names its file, and what makes the new file.
Work = tuple[Table, dict[str, Any], str, Callable[[], tuple[StoredFile, bytes]]]

# What an odd robot.toml, or a file that a stranger wrote, may raise: such a file stays as it is.
_ODD_ROBOT = (AttributeError, LookupError, TypeError, ValueError, ArithmeticError, RecursionError)
_ODD = (DynregError, OSError, *_ODD_ROBOT)


def renew(directory: Directory, aside: bool = False) -> None:
    """Bring the files of a registry to the present form, once; of one that may only be read, none.

    aside : those of one that may only be read, too, in its temporary folder and without a word.

    Where there is no room for them they stay as they are, and the next opening tries again.
    """
    if (directory.read_only and not aside) or not _pending(directory):
        return
    with suppress(DynregError):
        for number, (table, row, column, made) in enumerate(_old(directory)):
            if not number and not aside:
                what = f"the registry {str(directory.path)!r} is of an older form"
                warnings.warn(f"{what}: its files are written anew, once", Renewed, 2)
            with suppress(CorruptError, *_ODD_ROBOT):
                _replace(directory, table, row, column, *made())
        _note_done(directory)


def _old(directory: Directory) -> Iterator[Work]:
    """What is of an older form; shards come after the populations, which tell what is in them."""
    yield from _populations(directory)
    yield from _shards(directory)
    yield from _recordings(directory)


def _replace(
    directory: Directory, table: Table, row: dict[str, Any], column: str, file: StoredFile, data: bytes
) -> None:
    """Put a file in the place of the one that a row names, if it still does."""
    keys = [key.name for key in table.primary_key]
    directory.stage(file, data)
    with directory.catalog.write() as writing:
        query = select(table).where(*(table.c[key] == row[key] for key in keys))
        held = writing.connection.execute(query).first()
        if held is None or held._asdict()[column] != row[column]:
            return  # another process has removed or renewed it
        directory.register(writing, file, data)
        writing.put(table, held._asdict() | {column: file.path})
        writing.remove(tables.files, (row[column],))
    remove_files(directory.home, [row[column]])


def _rows(directory: Directory, table: Table) -> list[dict[str, Any]]:
    with directory.catalog.read() as connection:
        return [row._asdict() for row in connection.execute(select(table).order_by(*table.primary_key))]


def _populations(directory: Directory) -> Iterator[Work]:
    for row in _rows(directory, tables.populations):
        with suppress(*_ODD):
            record = get_population(directory, row["id"])
            told = replace(record, **_told(_robot(directory, record)))
            if told.columns != record.columns and all(
                record.arrays[f"bank.{group}"].shape[-1] == len(getattr(told, group)) for group in COMMANDED
            ):
                yield tables.populations, row, "path", lambda told=told: population_file(told)


def _shards(directory: Directory) -> Iterator[Work]:
    for row in _rows(directory, tables.shards):
        with suppress(*_ODD):
            states, rest = directory.checked(row["states_path"], row["arrays_path"])
            if is_old(read_states_header(states)):
                record = get_population(directory, row["population_id"])
                _, data = read_shard(states, rest)
                data = replace(data, periods=_periods(_robot(directory, record), record, data.values))
                ids = data.entry_ids(record.id)
                yield (
                    tables.shards,
                    row,
                    "states_path",
                    lambda told=(record, row["start"], data, ids): states_file(*told),
                )


def _recordings(directory: Directory) -> Iterator[Work]:
    for row in _rows(directory, tables.recordings):
        with suppress(*_ODD):
            if is_old_recording(*directory.checked(row["path"])):
                recording = get_recording(directory, row["id"])
                made = recording, row["robot_hash"]
                yield tables.recordings, row, "path", lambda made=made: recording_file(*made)


def _robot(directory: Directory, record: PopulationRecord) -> Mapping[str, Any]:
    path = robot_folder(directory, record.robot_hash) / "robot.toml"
    data = read_regular(path, limits().toml_bytes + 1)
    if len(data) > limits().toml_bytes:
        raise ValueError(f"{path.name!r} is too long")
    return tomllib.loads(data.decode())


def _told(robot: Mapping[str, Any]) -> dict[str, Any]:
    """What a record lacks, by a robot.toml as it was when records lacked it."""
    inputs = _units(robot, "inputs")
    enables = dict.fromkeys(drive["enable"] for drive in robot.get("drives", ()) if drive.get("enable"))
    groups = {
        "actions": _units(robot, "actions"),
        "inputs": inputs | dict.fromkeys(enables, "1"),
        "settings": _units(robot, "settings"),
    }
    units = tuple(one["unit"] for one in robot.get("parameters", ()))
    texts = [text for columns in groups.values() for named in columns.items() for text in named]
    if not all(isinstance(text, str) for text in (*texts, *units)):
        raise ValueError("a name or a unit that is no text")
    return {
        group: tuple(Channel(*named) for named in columns.items()) for group, columns in groups.items()
    } | {"parameter_units": units}


def _units(robot: Mapping[str, Any], group: str) -> dict[str, str]:
    return {one["name"]: one["unit"] for one in robot.get(group, ())}


def _periods(robot: Mapping[str, Any], record: PopulationRecord, values: np.ndarray) -> np.ndarray:
    """(n, E) seconds between the rows of entries of parameters (n, P), by a robot.toml of that time."""
    settings = np.asarray(record.arrays["bank.settings"], dtype=np.float64)
    shape = len(values), len(settings)
    if "period" in record.spec:
        return np.full(shape, float(record.spec["period"]))
    rate = np.full(shape, float(robot["robot"]["control_rate"]))
    told = [(one["sets"], values[:, [i]]) for i, one in enumerate(robot.get("parameters", ()))]
    told += [(one["sets"], settings[None, :, i]) for i, one in enumerate(robot.get("settings", ()))]
    for sets, value in told:
        for target, _, op in (text.strip().rpartition(" ") for text in sets):
            if target.strip() == "control.rate":
                rate = {"=": lambda r, v: v + 0 * r, "*=": np.multiply, "+=": np.add}[op](rate, value)
    with np.errstate(all="ignore"):  # a shard takes only periods that are finite and above 0
        return 1.0 / rate


def _pending(directory: Directory) -> bool:
    with directory.catalog.transaction("BEGIN") as connection:
        return migrations.FILES in migrations.pending(connection)


def _note_done(directory: Directory) -> None:
    with directory.catalog.transaction("BEGIN IMMEDIATE") as connection:
        if migrations.FILES in migrations.pending(connection):  # another process may have been quicker
            migrations.apply(connection, [migrations.FILES])
