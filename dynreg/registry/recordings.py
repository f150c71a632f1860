"""Recordings: what a robot did, stored under the hash of its numbers and under names."""

import re
from pathlib import Path

from sqlalchemy import Connection, Row, select

import dynreg.registry.tables as tables
from dynreg.data.recording import Recording
from dynreg.errors import CorruptError, RegistryError, UsageError
from dynreg.registry.directory import Directory
from dynreg.registry.files import StoredFile, content_name, unreadable
from dynreg.registry.infos import RecordingInfo
from dynreg.registry.robots import require_robot
from dynreg.registry.rows import require, row_of
from dynreg.registry.server import persistent
from dynreg.registry.writing import Writing

_IS_HASH = re.compile(r"[0-9a-f]{64}")


def put_recording(
    directory: Directory, recording: Recording, robot_hash: str, name: str | None = None
) -> str:
    """Store a recording with a registered robot, which becomes its usual one, and return its id; it becomes `@last`.

    A recording may have several names; one that is stored already keeps its first provenance. A name moves here from
    another recording of the same log files. Each of the other names keeps its robot, of which it follows the version.

    Raises
    ------
    RegistryError : the name is that of a recording of other log files.
    UsageError : the name cannot be one.
    NoMatchError : the robot is unknown.
    """
    check_name(name)
    file, data = recording_file(recording, robot_hash)
    table = tables.recordings
    with directory.catalog.read() as connection:
        require_robot(connection, robot_hash)
        known = _known(connection, recording.id)
        holder = _holder(connection, name)
    if holder is not None and not _may_take(directory, recording, holder):
        raise _taken(name, holder)
    if not _is_sound(directory, known):
        directory.stage(file, data)
    with directory.catalog.write() as writing:
        require_robot(writing.connection, robot_hash)
        now = _holder(writing.connection, name)
        if now not in (holder, recording.id, None):
            raise _taken(name, now)
        known = _known(writing.connection, recording.id)
        sound = _is_sound(directory, known)
        if not sound:
            directory.register(writing, file, data)
        path = known.path if sound else file.path
        row = {"id": recording.id, "robot_hash": robot_hash, "path": path}
        writing.put(table, row | {"ordinal": writing.last_ordinal(table, recording.id)})
        if known is not None and known.path != path:  # its own was damaged
            writing.remove(tables.files, (known.path,))
        if name is not None:
            _give(writing, name, recording.id, now)
        _keep_robots(writing, recording.id, name, robot_hash, known)
    return recording.id


@persistent
def add_name(directory: Directory, recording_id: str, name: str, robot_hash: str) -> None:
    """Call a stored recording by a further name, where no recording has it; else nothing changes.

    Its usual robot, the name that it got last and its place in the order stay. robot_hash : of the robot under this
    name. Raises as `put_recording`.
    """
    check_name(name)
    called, latest = tables.recording_names, tables.latest_names
    with directory.catalog.write() as writing:
        row = require(writing.connection, tables.recordings, recording_id, "recording")
        robot = require_robot(writing.connection, robot_hash).name
        if _holder(writing.connection, name) is not None:
            return
        of = select(called.c.name).where(called.c.recording_id == recording_id)
        first = min(writing.connection.execute(of).scalars(), default=name)
        writing.put(called, {"name": name, "recording_id": recording_id})
        if row_of(writing.connection, latest, recording_id) is None:
            writing.put(latest, {"recording_id": recording_id, "name": first})
        if require_robot(writing.connection, row.robot_hash).name != robot:
            writing.put(tables.robots_of_names, {"name": name, "robot_hash": robot_hash})


def recording_file(recording: Recording, robot_hash: str) -> tuple[StoredFile, bytes]:
    """The file of a recording that was ingested with a robot."""
    from dynreg.data.table import to_parquet

    data = to_parquet(recording)
    # Both hashes in the name let a lost catalogue row be written again.
    return content_name("recordings", f"{recording.id[:16]}-{robot_hash[:16]}", data, "parquet"), data


def name_holder(directory: Directory, name: str) -> str | None:
    """The id of the recording that has this name; None where none has."""
    with directory.catalog.read() as connection:
        return _holder(connection, name)


def recordings_of_names(directory: Directory) -> dict[str, str]:
    """{name: id of the recording that has it}."""
    table = tables.recording_names
    with directory.catalog.read() as connection:
        return dict(
            connection.execute(select(table.c.name, table.c.recording_id).order_by(table.c.name)).all()
        )


def may_be_called(directory: Directory, recording: Recording, name: str) -> bool:
    """Whether no recording of other log files has this name."""
    return _may_take(directory, recording, name_holder(directory, name))


def get_recording(directory: Directory, recording_id: str) -> Recording:
    """A stored recording; NoMatchError when unknown, CorruptError when its file is damaged."""
    from dynreg.data.table import read_parquet

    path = recording_path(directory, recording_id)
    try:
        recording = read_parquet(path)
    except Exception as error:  # whatever a damaged file makes the reader raise
        raise unreadable(path, error) from error
    if recording.id != recording_id:
        raise unreadable(path, "its numbers are not those that were stored")
    return recording


def recording_path(directory: Directory, recording_id: str) -> Path:
    """Where a recording's file lies, compared with its hash; raises as `get_recording`."""
    with directory.catalog.read() as connection:
        relative = require(connection, tables.recordings, recording_id, "recording").path
    return directory.checked(relative)[0]


def list_recordings(directory: Directory, recording_id: str | None = None) -> tuple[RecordingInfo, ...]:
    """All recordings, in the order of their last ingestion; or the one of this id, if there is one."""
    table, named, latest = tables.recordings, tables.recording_names, tables.latest_names
    told = tables.robots_of_names
    query = select(table.c.id, table.c.robot_hash, named.c.name, told.c.robot_hash.label("own"))
    joined = table.outerjoin(named).outerjoin(latest, latest.c.name == named.c.name)
    query = query.select_from(joined.outerjoin(told, told.c.name == named.c.name))
    if recording_id is not None:
        query = query.where(table.c.id == recording_id)
    names: dict[tuple[str, str], dict[str, str]] = {}
    with directory.catalog.read() as connection:
        order = (table.c.ordinal, latest.c.name.is_(None), named.c.name)
        for row in connection.execute(query.order_by(*order)):
            held = names.setdefault((row.id, row.robot_hash), {})
            held |= {} if row.name is None else {row.name: row.own or row.robot_hash}
    return tuple(RecordingInfo(*key, tuple(held), tuple(held.values())) for key, held in names.items())


def _known(connection: Connection, recording_id: str) -> Row | None:
    table = tables.recordings
    joined = select(table, tables.files.c.sha256, tables.files.c.size).outerjoin(tables.files)
    return connection.execute(joined.where(table.c.id == recording_id)).first()


def _is_sound(directory: Directory, known: Row | None) -> bool:
    return known is not None and directory.holds(StoredFile(known.path, known.sha256, known.size))


def _holder(connection: Connection, name: str | None) -> str | None:
    table = tables.recording_names
    return connection.execute(select(table.c.recording_id).where(table.c.name == name)).scalar()


def _may_take(directory: Directory, recording: Recording, holder: str | None) -> bool:
    """Whether a recording may take over the name that `holder` has: that one is of the same log files."""
    if holder is None or holder == recording.id:
        return True
    try:
        others = _logs(get_recording(directory, holder))
    except CorruptError:
        return False
    return bool(others) and others == _logs(recording)


def _logs(recording: Recording) -> set[str]:
    """sha256 of the log files that a recording was read from; none where it was made otherwise."""
    files = recording.provenance.get("files", [])
    return {file["sha256"] for file in files if isinstance(file, dict) and "sha256" in file}


def _taken(name: str | None, holder: str) -> RegistryError:
    return RegistryError(
        f"the name {name!r} is in use for recording {holder[:12]}, which was made from other log files",
        expected="a name that is free",
        do=f"give another --name, or remove that one with `dynreg rm {holder[:12]}`",
    )


def _give(writing: Writing, name: str, recording_id: str, holder: str | None) -> None:
    """Give a recording a name, which is its latest; the recording that had it is called by what else it is called."""
    latest = tables.latest_names
    if holder not in (None, recording_id):
        row = row_of(writing.connection, latest, holder)
        if row is not None and row.name == name:
            writing.remove(latest, (holder,))
    writing.put(tables.recording_names, {"name": name, "recording_id": recording_id})
    writing.put(latest, {"recording_id": recording_id, "name": name})


def _keep_robots(
    writing: Writing, recording_id: str, given: str | None, robot_hash: str, before: Row | None
) -> None:
    """Write down the robots of a recording's names after it was put with a robot, which the name `given` gets.

    before : its row until now. A name has a row of its own only where its robot is another than the recording's.
    """
    connection, told = writing.connection, tables.robots_of_names
    called = tables.recording_names
    of = select(called.c.name, told.c.robot_hash).outerjoin(told).where(called.c.recording_id == recording_id)
    robot = require_robot(connection, robot_hash).name
    for name, own in connection.execute(of).all():
        held = robot_hash if name == given or before is None else own or before.robot_hash
        if require_robot(connection, held).name == robot:  # this one, or another version of it
            writing.remove(told, (name,))
        else:
            writing.put(told, {"name": name, "robot_hash": held})


def check_name(name: str | None) -> None:
    """UsageError for what cannot be a recording's name."""
    if name is None:
        return
    plain = name and name == name.strip() and name.isprintable()
    if not plain or name.startswith(("@", "-")) or _IS_HASH.fullmatch(name):
        raise UsageError(
            f"{name!r} cannot be a recording's name",
            expected="printable text that does not begin with '@' or '-' and is no 64-digit hash",
            do="give another --name",
        )
