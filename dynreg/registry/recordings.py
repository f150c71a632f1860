"""Recordings: what a robot did, stored under the hash of its numbers and under names."""

import re

from sqlalchemy import Connection, Row, select

import dynreg.registry.tables as tables
from dynreg.data.recording import Recording
from dynreg.errors import RegistryError
from dynreg.registry.directory import Directory
from dynreg.registry.files import StoredFile, content_name, unreadable
from dynreg.registry.records import RecordingInfo
from dynreg.registry.robots import require_robot
from dynreg.registry.rows import require

_IS_HASH = re.compile(r"[0-9a-f]{64}")


def put_recording(
    directory: Directory, recording: Recording, robot_hash: str, name: str | None = None
) -> str:
    """Store a recording of a registered robot and return its id; it becomes `@last`.

    A recording may have several names; one that is stored already keeps its first provenance.

    Raises
    ------
    RegistryError : the name is taken by another recording or cannot be one; the recording is of another
        robot.
    NoMatchError : the robot is unknown.
    """
    _check_name(name)
    file, data = _encode(recording, robot_hash)
    table = tables.recordings
    with directory.catalog.read() as connection:
        require_robot(connection, robot_hash)
        known = _check_robot(_known(connection, recording.id), robot_hash)
        _check_free(connection, name, recording.id)
    if not _is_sound(directory, known):
        directory.stage(file, data)
    with directory.catalog.write() as writing:
        _check_free(writing.connection, name, recording.id)
        known = _check_robot(_known(writing.connection, recording.id), robot_hash)
        sound = _is_sound(directory, known)
        if not sound:
            directory.register(writing, file, data)
        path = known.path if sound else file.path
        row = {"id": recording.id, "robot_hash": robot_hash, "path": path}
        writing.put(table, row | {"ordinal": writing.last_ordinal(table, recording.id)})
        if known is not None and known.path != path:  # its own was damaged
            writing.remove(tables.files, (known.path,))
        if name is not None:
            writing.put(tables.recording_names, {"name": name, "recording_id": recording.id})
    return recording.id


def get_recording(directory: Directory, recording_id: str) -> Recording:
    """A stored recording; NoMatchError when unknown, CorruptError when its file is damaged."""
    from dynreg.data.table import read_parquet

    with directory.catalog.read() as connection:
        relative = require(connection, tables.recordings, recording_id, "recording").path
    (path,) = directory.checked(relative)
    try:
        recording = read_parquet(path)
    except Exception as error:  # whatever a damaged file makes the reader raise
        raise unreadable(path, error) from error
    if recording.id != recording_id:
        raise unreadable(path, "its numbers are not those that were stored")
    return recording


def list_recordings(directory: Directory, recording_id: str | None = None) -> tuple[RecordingInfo, ...]:
    """All recordings, in the order of their last ingestion; or the one of this id, if there is one."""
    table, named = tables.recordings, tables.recording_names
    query = select(table.c.id, table.c.robot_hash, named.c.name).outerjoin(named)
    if recording_id is not None:
        query = query.where(table.c.id == recording_id)
    names: dict[tuple[str, str], list[str]] = {}
    with directory.catalog.read() as connection:
        for row in connection.execute(query.order_by(table.c.ordinal, named.c.name)):
            names.setdefault((row.id, row.robot_hash), []).extend([row.name] if row.name is not None else [])
    return tuple(RecordingInfo(*key, tuple(held)) for key, held in names.items())


def _encode(recording: Recording, robot_hash: str) -> tuple[StoredFile, bytes]:
    from dynreg.data.table import to_parquet

    data = to_parquet(recording)
    # Both hashes in the name let a lost catalogue row be written again.
    return content_name("recordings", f"{recording.id[:16]}-{robot_hash[:16]}", data, "parquet"), data


def _known(connection: Connection, recording_id: str) -> Row | None:
    table = tables.recordings
    joined = select(table, tables.files.c.sha256, tables.files.c.size).outerjoin(tables.files)
    return connection.execute(joined.where(table.c.id == recording_id)).first()


def _check_robot(known: Row | None, robot_hash: str) -> Row | None:
    if known is not None and known.robot_hash != robot_hash:
        raise RegistryError(
            f"recording {known.id[:12]} is stored as one of robot {known.robot_hash[:12]}",
            expected="one robot for a recording",
            do="check which robot the log was made with",
        )
    return known


def _is_sound(directory: Directory, known: Row | None) -> bool:
    return known is not None and directory.holds(StoredFile(known.path, known.sha256, known.size))


def _check_free(connection: Connection, name: str | None, recording_id: str) -> None:
    table = tables.recording_names
    holder = connection.execute(select(table.c.recording_id).where(table.c.name == name)).scalar()
    if holder is not None and holder != recording_id:
        raise RegistryError(
            f"the name {name!r} is in use for recording {holder[:12]}, which holds other data",
            expected="a name that is free",
            do="give another --name",
        )


def _check_name(name: str | None) -> None:
    if name is None:
        return
    plain = name and name == name.strip() and name.isprintable()
    if not plain or name.startswith(("@", "-")) or _IS_HASH.fullmatch(name):
        raise RegistryError(
            f"{name!r} cannot be a recording's name",
            expected="printable text that does not begin with '@' or '-' and is no 64-digit hash",
            do="give another --name",
        )
