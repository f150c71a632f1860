"""JSON that others computed: synthesised simulators and results."""

import re
from typing import Any

from sqlalchemy import select

import dynreg.registry.tables as tables
from dynreg.errors import NoMatchError, RegistryError
from dynreg.registry.codec import strict_json
from dynreg.registry.directory import Directory
from dynreg.registry.files import StoredFile, content_name
from dynreg.registry.hashes import result_id
from dynreg.registry.infos import ResultRecord
from dynreg.registry.rows import require

KIND = re.compile(r"[a-z][a-z_]*")


def put_simulator(directory: Directory, config: dict[str, Any]) -> str:
    """Store a simulator's configuration; its id is the hash of its canonical JSON."""
    file, data = _encode("simulators", "simulator", config)
    directory.stage(file, data)
    with directory.catalog.write() as writing:
        directory.register(writing, file, data)
        writing.put(tables.simulators, {"id": file.sha256, "path": file.path})
    return file.sha256


def get_simulator(directory: Directory, simulator_id: str) -> dict[str, Any]:
    """A stored configuration; NoMatchError when unknown, CorruptError when its file is damaged."""
    with directory.catalog.read() as connection:
        row = require(connection, tables.simulators, simulator_id, "simulator")
    return directory.read_json(row.path)


def put_result(directory: Directory, kind: str, recording_id: str, document: dict[str, Any]) -> str:
    """Store a result and return its id; it becomes the latest of its kind.

    recording_id : of the recording that it is about; "" where it is about none.
    Raises RegistryError when the kind is no plain word or the document is not plain JSON.
    """
    if not KIND.fullmatch(kind):
        raise RegistryError(
            f"a result of kind {kind!r}", expected="a word such as 'neighbours'", do="rename it"
        )
    file, data = _encode("results", f"{kind}-{recording_id[:16]}", document)
    identity = result_id(kind, recording_id, file.sha256)
    directory.stage(file, data)
    row = {"id": identity, "kind": kind, "recording_id": recording_id, "path": file.path}
    with directory.catalog.write() as writing:
        directory.register(writing, file, data)
        writing.put(tables.results, row | {"ordinal": writing.last_ordinal(tables.results, identity)})
    return identity


def get_result(directory: Directory, identity: str) -> ResultRecord:
    """A stored result; NoMatchError when unknown, CorruptError when its file is damaged."""
    with directory.catalog.read() as connection:
        row = require(connection, tables.results, identity, "result")
    return ResultRecord(row.id, row.kind, row.recording_id, directory.read_json(row.path))


def latest_result(directory: Directory, kind: str | None, recording_id: str | None) -> ResultRecord:
    """The result stored last, of this kind and about this recording where they are given."""
    table = tables.results_of_verbs
    query = select(table.c.id).order_by(table.c.ordinal.desc()).limit(1)
    if kind is not None:
        query = query.where(table.c.kind == kind)
    if recording_id is not None:
        query = query.where(table.c.recording_id == recording_id)
    with directory.catalog.read() as connection:
        identity = connection.execute(query).scalar()
    if identity is None:
        what = f"{kind} result" if kind else "result"
        raise NoMatchError(
            f"there is no {what} about {recording_id[:12]}" if recording_id else f"there is no last {what}",
            expected="a stored result (@last is the last one in `dynreg report`, else the last recording)",
            do="run the command that computes it, such as `dynreg query`",
        )
    return get_result(directory, identity)


def results_about(directory: Directory, kind: str | None, recording_id: str) -> tuple[str, ...]:
    """Ids of the results of a kind (None for all) about a recording, that stored last first."""
    table = tables.results_of_verbs
    query = select(table.c.id).where(table.c.recording_id == recording_id)
    query = query if kind is None else query.where(table.c.kind == kind)
    with directory.catalog.read() as connection:
        return tuple(connection.execute(query.order_by(table.c.ordinal.desc())).scalars())


def _encode(folder: str, stem: str, document: dict[str, Any]) -> tuple[StoredFile, bytes]:
    data = strict_json(document)
    return content_name(folder, stem, data, "json"), data
