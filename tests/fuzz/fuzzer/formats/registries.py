"""What a registry from elsewhere holds: shards, arrays, recordings, results, pages of its ledger, its catalogue.

A stranger's registry may be whole by all its own hashes, so the readers are tried behind them: what is changed here
is sealed and named anew by what it holds.
"""

import hashlib
import json
import random
import sqlite3
import struct
from pathlib import Path
from typing import Any

from sqlalchemy import create_engine, select
from sqlalchemy import text as sql
from sqlalchemy.pool import NullPool

from dynreg.data.table import read_parquet
from dynreg.errors import DynregError
from dynreg.registry import Registry, tables, verify
from dynreg.registry.catalog import FILE
from dynreg.registry.codec import arrays_of, canonical_json, decode_arrays
from dynreg.registry.files import LEDGER, content_name
from dynreg.registry.seal import Seal, write_seals
from dynreg.registry.shards import read_shard, read_states_header
from fuzzer.formats import small
from fuzzer.formats.tables import changed, odd_table
from fuzzer.mutate import ODD_TEXT, ODD_WHOLE, lines, raw, text, tree
from fuzzer.scratch import held
from fuzzer.target import Target


def make_states(rng: random.Random) -> bytes:
    """The Parquet file of a shard."""
    return changed(rng, small.states()) if rng.random() < 0.8 else odd_table(rng)


def check_states(data: bytes) -> None:
    """Read a shard, the other file of which is sound."""
    held("shard/rest.safetensors", small.rest())
    path = held("shard/states.parquet", data)
    read_states_header(path)
    read_shard(path, held("shard/rest.safetensors", None))


def make_arrays(rng: random.Random) -> bytes:
    """A safetensors file: its header changed as a tree or as bytes, or its numbers."""
    return _changed_arrays(rng, small.rest())


def _changed_arrays(rng: random.Random, data: bytes) -> bytes:
    if rng.random() < 0.3:
        return raw(rng, data)
    (length,) = struct.unpack_from("<Q", data)
    head = json.loads(data[8 : 8 + length])
    if rng.random() < 0.6:
        head["__metadata__"] = {
            "dynreg": canonical_json(tree(rng, json.loads(head["__metadata__"]["dynreg"])))
        }
    else:
        head = tree(rng, head)
    packed = json.dumps(head).encode("utf-8", "surrogatepass")
    size = len(packed) if rng.random() < 0.9 else rng.choice(ODD_WHOLE) % 2**64
    return struct.pack("<Q", size) + packed + data[8 + length :]


def check_arrays(data: bytes) -> None:
    """Read arrays from a file, from bytes, and as the other file of a sound shard."""
    held("arrays/states.parquet", small.states())
    path = held("arrays/rest.safetensors", data)
    problems = []
    for read in (
        lambda: arrays_of(path, data),
        lambda: decode_arrays(path),
        lambda: decode_arrays(path, skip="w"),
    ):
        try:
            read()
        except DynregError as error:
            problems.append(error)
    if problems:
        raise problems[0]
    _, shard = read_shard(held("arrays/states.parquet", None), path)
    shard.entry_ids(small.POPULATION)


def make_recording(rng: random.Random) -> bytes:
    """A stored recording."""
    return changed(rng, small.recording()) if rng.random() < 0.7 else odd_table(rng)


def make_page(rng: random.Random) -> bytes:
    """A page of a ledger that follows the last one."""
    number, document = small.last_page()
    document = tree(rng, document | {"number": number + 1})
    line = canonical_json(document)
    if rng.random() < 0.1:
        line = text(rng, line)
    data = line.encode("utf-8", "surrogatepass")
    return raw(rng, data) if rng.random() < 0.1 else data


def check_page(data: bytes) -> None:
    """Open a registry to whose ledger a page was added, ask it everything, and verify it."""
    number, _ = small.last_page()
    with small.copied() as folder:
        name = content_name(LEDGER, f"{number + 1:08d}", data, "json").path
        (folder / name).write_bytes(data)
        ask(folder)


def make_catalog(rng: random.Random) -> bytes:
    """Statements that change a catalogue, one a line."""
    chosen = [rng.choice(_STATEMENTS) for _ in range(rng.choice((1, 1, 2, 3)))]
    for at, line in enumerate(chosen):
        value = rng.choice(
            (*ODD_WHOLE[:40], "NULL", "2e9", "1.5", "x'00ff'", *(repr(t) for t in _PLAIN_TEXT))
        )
        chosen[at] = line.replace("?", str(value))
    script = "\n".join(chosen)
    return (lines(rng, script, _STATEMENTS) if rng.random() < 0.1 else script).encode("utf-8", "replace")


def check_catalog(data: bytes) -> None:
    """Open a registry whose catalogue was changed and sealed anew, ask it everything, and verify it."""
    with small.copied() as folder:
        _change(folder, data.decode("utf-8", "replace").split("\n"))
        ask(folder)


def make_file(rng: random.Random) -> bytes:
    """The name of one of the files of a registry, and what it holds from now on."""
    name, data = rng.choice(small.files())
    if name.endswith(".parquet"):
        data = changed(rng, data) if rng.random() < 0.8 else odd_table(rng)
    elif name.endswith(".safetensors"):
        data = _changed_arrays(rng, data)
    else:
        data = json.dumps(tree(rng, json.loads(data))).encode("utf-8", "surrogatepass")
    return name.encode() + b"\n" + data


def check_file(data: bytes) -> None:
    """Open a registry one file of which holds something else, by its own hash; ask it everything, and verify it."""
    name, _, content = data.partition(b"\n")
    told = name.decode("utf-8", "replace")
    with small.copied() as folder:
        if told not in dict(small.files()):
            return
        (folder / told).write_bytes(content)
        sha256 = hashlib.sha256(content).hexdigest()
        _change(
            folder, [f"UPDATE files SET sha256 = '{sha256}', size = {len(content)} WHERE path = '{told}'"]
        )
        ask(folder)


def _change(folder: Path, statements: list[str]) -> None:
    """Run statements on a catalogue, as far as SQLite takes them, and seal it anew."""
    engine = create_engine(f"sqlite:///{folder / FILE}", poolclass=NullPool)
    try:
        for line in statements:
            with engine.begin() as connection:
                connection.execute(sql("PRAGMA writable_schema=ON"))
                connection.exec_driver_sql(line)
        with engine.begin() as connection:
            rows = {t.name: map(tuple, connection.execute(select(t))) for t in tables.SEALED}
            write_seals(connection, {name: Seal().with_rows(held) for name, held in rows.items()})
    except Exception as error:  # no statement of SQLite's, or one that it refuses
        if not isinstance(getattr(error, "orig", error), sqlite3.Error | sqlite3.Warning | ValueError):
            raise
    finally:
        engine.dispose()


def ask(folder: Path) -> None:
    """Everything that can be asked of a registry; a question that is refused keeps none after it from being asked."""
    problems: list[DynregError] = []

    def one(question: Any) -> None:
        try:
            question()
        except DynregError as error:
            problems.append(error)

    with Registry.open(folder) as registry:
        one(registry.robots)
        one(registry.populations)
        one(registry.recordings)
        one(lambda: registry.load("bench"))
        one(lambda: registry.missing_spans("bench"))
        one(lambda: registry.count("bench"))
        one(lambda: registry.resolve("@last"))
        one(registry.latest)
        one(registry.content_hash)
        one(lambda: registry.load_entry(registry.load("bench").ids[1]))
        one(lambda: [part.read() for part in registry.parts("bench")])
        one(lambda: [registry.measured(entry) for entry in registry.measured_in("bench").values()])
        one(lambda: registry.robot_folder("arm"))
        one(lambda: registry.index("bench", "landmarks"))
        for info in registry.recordings() if not problems else ():
            one(lambda info=info: registry.recording(info.id))
        for kind, fetch in (("result", registry.result), ("simulator", registry.simulator)):
            one(lambda kind=kind, fetch=fetch: [fetch(identity) for identity in registry.ids(kind)[:3]])
    one(lambda: verify(folder))
    if problems:
        raise problems[0]


_PLAIN_TEXT = [t for t in ODD_TEXT if t.isprintable()]
_STATEMENTS = tuple(
    f"UPDATE {table} SET {column} = ?"
    for table, columns in (
        ("shards", ("start", "stop", "states_path", "arrays_path", "population_id")),
        ("entries", ("number", "id", "population_id")),
        ("files", ("path", "sha256", "size")),
        (
            "populations",
            ("id", "name", "size", "shard_size", "layout", "spec", "channels", "parameters", "robot_hash"),
        ),
        ("robots", ("hash", "name", "manifest")),
        ("recordings", ("id", "ordinal", "path", "robot_hash")),
        ("recording_names", ("name", "recording_id")),
        ("results", ("id", "kind", "recording_id", "path", "ordinal")),
        ("measured", ("id", "population_id", "recording_id", "path")),
        ("simulators", ("id", "path")),
        ("pages", ("number", "sha256")),
        ("seals", ("rows", "digest", "name")),
    )
    for column in columns
)
_STATEMENTS += (
    "ALTER TABLE shards RENAME TO kept", "CREATE VIEW shards AS SELECT * FROM kept", "DROP TABLE entries",
    "CREATE VIEW entries AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id FROM n",
    "CREATE TRIGGER t AFTER INSERT ON files BEGIN DELETE FROM files; END", "PRAGMA user_version = ?",
    "DELETE FROM files", "PRAGMA journal_mode = DELETE", "ALTER TABLE files ADD COLUMN more",
    "ALTER TABLE results DROP COLUMN ordinal", "UPDATE sqlite_master SET sql = ? WHERE name = 'files'",
    "DELETE FROM migrations", "INSERT INTO migrations SELECT '999_new', 1",
    "DELETE FROM entries WHERE number = 1", "UPDATE entries SET number = number + ?", "DELETE FROM shards",
    "DELETE FROM robots", "CREATE TABLE more (a)", "CREATE INDEX i ON files (size)", "DELETE FROM pages",
    "DELETE FROM seals",
    "INSERT INTO shards SELECT population_id, start + 2, ?, states_path, arrays_path FROM shards",
    "UPDATE files SET size = 1 WHERE path LIKE 'results%'",
)  # fmt: skip


TARGETS = (
    Target("shard-states", make_states, check_states),
    Target("shard-arrays", make_arrays, check_arrays),
    Target("recording", make_recording, lambda data: read_parquet(held("recording.parquet", data)).id),
    Target("ledger-page", make_page, check_page),
    Target("catalog", make_catalog, check_catalog),
    Target("registry-file", make_file, check_file),
)
