"""Recordings: what a robot did, stored under the hash of its numbers and under names."""

import re
from pathlib import Path

from sqlalchemy import Connection, Row, Table, delete, func, insert, select, update

import dynreg.registry.tables as tables
from dynreg.data.recording import Recording
from dynreg.errors import RegistryError
from dynreg.registry.directory import Directory
from dynreg.registry.files import StoredFile, content_name, temporary_name, unreadable
from dynreg.registry.records import RecordingInfo
from dynreg.registry.robots import require_robot
from dynreg.registry.rows import require, row_of

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
    directory.catalog.check_writable()
    _check_name(name)
    file, data = _encode(directory, recording, robot_hash)
    recording_id, table = recording.id, tables.recordings
    mine = table.c.id == recording_id
    with directory.catalog.read() as connection:
        require_robot(connection, robot_hash)
        known = _check_robot(_known(connection, recording_id), robot_hash)
        _check_free(connection, name, recording_id)
    if not _is_sound(directory, known):
        directory.stage(file, data)
    with directory.catalog.write() as connection:
        _check_free(connection, name, recording_id)
        known = _check_robot(_known(connection, recording_id), robot_hash)
        if not _is_sound(directory, known):
            directory.register(connection, file, data)
            row = {"id": recording_id, "robot_hash": robot_hash, "path": file.path, "ordinal": 0}
            if known is None:
                connection.execute(insert(table).values(**row))
            elif known.path != file.path:  # its own was damaged
                connection.execute(update(table).where(mine).values(path=file.path))
                connection.execute(delete(tables.files).where(tables.files.c.path == known.path))
        connection.execute(update(table).where(mine).values(ordinal=next_ordinal(connection, table)))
        if name is not None and row_of(connection, tables.recording_names, name) is None:
            row = {"name": name, "recording_id": recording_id}
            connection.execute(insert(tables.recording_names).values(**row))
    return recording_id


def get_recording(directory: Directory, recording_id: str) -> Recording:
    """A stored recording; NoMatchError when unknown, CorruptError when its file is damaged."""
    from dynreg.data.table import read_parquet

    with directory.catalog.read() as connection:
        path = directory.locate(require(connection, tables.recordings, recording_id, "recording").path)
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


def next_ordinal(connection: Connection, table: Table) -> int:
    """One more than the highest ordinal of a table."""
    return (connection.execute(select(func.max(table.c.ordinal))).scalar() or 0) + 1


def _encode(directory: Directory, recording: Recording, robot_hash: str) -> tuple[StoredFile, bytes]:
    from dynreg.data.table import write_parquet

    temporary = temporary_name(directory.path / "recordings" / "recording")
    try:
        write_parquet(recording, temporary)
        data = Path(temporary).read_bytes()
    finally:
        temporary.unlink(missing_ok=True)
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
    if not plain or name.startswith("@") or _IS_HASH.fullmatch(name):
        raise RegistryError(
            f"{name!r} cannot be a recording's name",
            expected="printable text that does not begin with '@' and is no 64-digit hash",
            do="give another --name",
        )
