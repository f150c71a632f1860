"""Named steps that bring any older catalogue to the present form; each is applied once, in order.

A released step is never edited: the next change of the tables is a new step at the end.
"""

import re

from sqlalchemy import Connection, inspect, text

from dynreg.errors import RegistryError

LEDGER = "0004_ledger_and_seals"  # what a catalogue held before it becomes the first page of the ledger
# Of this step the catalogue only keeps that it is done: it changes files, see `renewing`.
FILES = "0007_files_that_explain_themselves"
STEPS: dict[str, tuple[str, ...]] = {
    "0001_entries": (
        "CREATE TABLE files (path TEXT PRIMARY KEY, sha256 TEXT NOT NULL, size INTEGER NOT NULL)",
        "CREATE TABLE robots (hash TEXT PRIMARY KEY, name TEXT NOT NULL, manifest TEXT NOT NULL)",
        """CREATE TABLE populations (id TEXT PRIMARY KEY, robot_hash TEXT NOT NULL REFERENCES robots (hash),
           name TEXT NOT NULL, size INTEGER NOT NULL, path TEXT NOT NULL REFERENCES files (path),
           layout TEXT)""",
        """CREATE TABLE shards (population_id TEXT NOT NULL REFERENCES populations (id),
           start INTEGER NOT NULL, stop INTEGER NOT NULL, states_path TEXT NOT NULL REFERENCES files (path),
           arrays_path TEXT NOT NULL REFERENCES files (path), PRIMARY KEY (population_id, start))""",
        """CREATE TABLE entries (id TEXT PRIMARY KEY, population_id TEXT NOT NULL REFERENCES populations (id),
           number INTEGER NOT NULL, parameter_values TEXT NOT NULL, own_loss FLOAT, train_loss FLOAT,
           extra TEXT NOT NULL, UNIQUE (population_id, number))""",
        """CREATE TABLE recordings (id TEXT PRIMARY KEY, robot_hash TEXT NOT NULL REFERENCES robots (hash),
           path TEXT NOT NULL REFERENCES files (path), ordinal INTEGER NOT NULL)""",
        """CREATE TABLE recording_names (name TEXT PRIMARY KEY,
           recording_id TEXT NOT NULL REFERENCES recordings (id))""",
    ),
    "0002_simulators_and_results": (
        "CREATE TABLE simulators (id TEXT PRIMARY KEY, path TEXT NOT NULL REFERENCES files (path))",
        """CREATE TABLE results (id TEXT PRIMARY KEY, kind TEXT NOT NULL, recording_id TEXT NOT NULL,
           path TEXT NOT NULL REFERENCES files (path), ordinal INTEGER NOT NULL)""",
    ),
    "0003_indexes": (
        """CREATE TABLE indexes (population_id TEXT NOT NULL REFERENCES populations (id), key TEXT NOT NULL,
           entries_hash TEXT NOT NULL, path TEXT NOT NULL REFERENCES files (path),
           PRIMARY KEY (population_id, key))""",
    ),
    # What is derived from the files goes: indexes tell of themselves, numbers of entries lie in their shards.
    LEDGER: (
        "DROP TABLE indexes",
        "DELETE FROM files WHERE path LIKE 'index/%'",
        """CREATE TABLE plain_entries (id TEXT PRIMARY KEY,
           population_id TEXT NOT NULL REFERENCES populations (id), number INTEGER NOT NULL,
           UNIQUE (population_id, number))""",
        "INSERT INTO plain_entries SELECT id, population_id, number FROM entries",
        "DROP TABLE entries",
        "ALTER TABLE plain_entries RENAME TO entries",
        "CREATE TABLE seals (name TEXT PRIMARY KEY, rows INTEGER NOT NULL, digest TEXT NOT NULL)",
        "CREATE TABLE pages (number INTEGER PRIMARY KEY, sha256 TEXT NOT NULL)",
    ),
    # New tables begin empty: no page of the ledger tells of them, and the seals of the others stay as they are.
    "0005_versions_and_latest_names": (
        """CREATE TABLE robot_versions (hash TEXT PRIMARY KEY REFERENCES robots (hash),
           version INTEGER NOT NULL)""",
        """CREATE TABLE latest_names (recording_id TEXT PRIMARY KEY REFERENCES recordings (id),
           name TEXT NOT NULL REFERENCES recording_names (name))""",
    ),
    "0006_robots_of_names": (
        """CREATE TABLE robots_of_names (name TEXT PRIMARY KEY REFERENCES recording_names (name),
           robot_hash TEXT NOT NULL REFERENCES robots (hash))""",
    ),
    FILES: (),
    "0008_measured": (
        """CREATE TABLE measured (id TEXT PRIMARY KEY,
           population_id TEXT NOT NULL REFERENCES populations (id),
           recording_id TEXT NOT NULL REFERENCES recordings (id),
           path TEXT NOT NULL REFERENCES files (path))""",
    ),
}


def known_tables() -> set[str]:
    """Names of the tables that a catalogue of any age may have."""
    made = re.findall(r"CREATE TABLE (\w+)", " ".join(sum(STEPS.values(), ())))
    return {"migrations", *made}


def pending(connection: Connection) -> list[str]:
    """Names of the steps that this catalogue still lacks.

    Raises RegistryError when the catalogue holds a step that this version does not know.
    """
    applied = []
    if inspect(connection).has_table("migrations"):
        applied = [row.name for row in connection.execute(text("SELECT name FROM migrations"))]
    unknown = sorted(set(applied) - set(STEPS))
    if unknown:
        raise RegistryError(
            f"the catalogue was written by a newer dynreg: it holds the step {unknown[-1]!r}",
            expected=f"steps up to {list(STEPS)[-1]!r}",
            do="upgrade dynreg to the version that wrote it",
        )
    return [name for name in STEPS if name not in applied]


def apply(connection: Connection, names: list[str]) -> None:
    """Run the steps `names` and record them, inside the transaction that the caller holds."""
    connection.execute(text("CREATE TABLE IF NOT EXISTS migrations (name TEXT PRIMARY KEY)"))
    for name in names:
        for statement in STEPS[name]:
            connection.execute(text(statement))
        connection.execute(text("INSERT INTO migrations (name) VALUES (:name)"), {"name": name})
