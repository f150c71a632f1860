"""The catalogue's tables, as the newest migration leaves them.

Portable SQL only (no SQLite types or functions): the same code stands on PostgreSQL, where texts are compared byte by
byte as SQLite does, and whole numbers are as wide. JSON is stored as text.
"""

import json
import operator
import re
from collections.abc import Mapping
from typing import Any

import sqlalchemy as sql
from sqlalchemy import BigInteger, Column, ForeignKey, MetaData, Table, UniqueConstraint, select

from dynreg.limits import Limits

Text = sql.Text().with_variant(sql.Text(collation="C"), "postgresql")
Integer = sql.Integer().with_variant(BigInteger(), "postgresql")

metadata = MetaData()

migrations = Table("migrations", metadata, Column("name", Text, primary_key=True))

# How many rows each table below has and the sum of their hashes: what is read is compared with it.
seals = Table(
    "seals",
    metadata,
    Column("name", Text, primary_key=True),
    Column("rows", Integer, nullable=False),
    Column("digest", Text, nullable=False),
)

# The pages of the ledger that the other tables follow, each with the sha256 of its file.
pages = Table(
    "pages",
    metadata,
    Column("number", Integer, primary_key=True),
    Column("sha256", Text, nullable=False),
)

files = Table(
    "files",
    metadata,
    Column("path", Text, primary_key=True),
    Column("sha256", Text, nullable=False),
    Column("size", Integer, nullable=False),
)

robots = Table(
    "robots",
    metadata,
    Column("hash", Text, primary_key=True),
    Column("name", Text, nullable=False),
    Column("manifest", Text, nullable=False),  # sha256 of each file of the folder, by its path in it
)

# Which one it is among the robots of its name, from 1 on, in the order in which they came. Robots that came before this
# was kept have no row; see `versions.numbered`.
robot_versions = Table(
    "robot_versions",
    metadata,
    Column("hash", ForeignKey("robots.hash"), primary_key=True),
    Column("version", Integer, nullable=False),
)

populations = Table(
    "populations",
    metadata,
    Column("id", Text, primary_key=True),
    Column("robot_hash", ForeignKey("robots.hash"), nullable=False),
    Column("name", Text, nullable=False),
    Column("size", Integer, nullable=False),
    Column("path", ForeignKey("files.path"), nullable=False),
    Column("layout", Text),  # shapes of one entry, set by the first shard
)

shards = Table(
    "shards",
    metadata,
    Column("population_id", ForeignKey("populations.id"), primary_key=True),
    Column("start", Integer, primary_key=True),
    Column("stop", Integer, nullable=False),
    Column("states_path", ForeignKey("files.path"), nullable=False),
    Column("arrays_path", ForeignKey("files.path"), nullable=False),
)

entries = Table(
    "entries",
    metadata,
    Column("id", Text, primary_key=True),
    Column("population_id", ForeignKey("populations.id"), nullable=False),
    Column("number", Integer, nullable=False),  # index in the population; row group = number - shard's start
    UniqueConstraint("population_id", "number"),
)

recordings = Table(
    "recordings",
    metadata,
    Column("id", Text, primary_key=True),
    Column("robot_hash", ForeignKey("robots.hash"), nullable=False),  # with which it was ingested last
    Column("path", ForeignKey("files.path"), nullable=False),
    Column("ordinal", Integer, nullable=False),  # the highest is the last one ingested
)

recording_names = Table(
    "recording_names",
    metadata,
    Column("name", Text, primary_key=True),
    Column("recording_id", ForeignKey("recordings.id"), nullable=False),
)

# The name that a recording got last, of those that it has; older registries tell none.
latest_names = Table(
    "latest_names",
    metadata,
    Column("recording_id", ForeignKey("recordings.id"), primary_key=True),
    Column("name", ForeignKey("recording_names.name"), nullable=False),
)

# The robot under which a recording was ingested with a name, where that is another than the recording's last one.
robots_of_names = Table(
    "robots_of_names",
    metadata,
    Column("name", ForeignKey("recording_names.name"), primary_key=True),
    Column("robot_hash", ForeignKey("robots.hash"), nullable=False),
)

# Models trained on recordings, as entries of a population beside those that were simulated.
measured = Table(
    "measured",
    metadata,
    Column("id", Text, primary_key=True),
    Column("population_id", ForeignKey("populations.id"), nullable=False),
    Column("recording_id", ForeignKey("recordings.id"), nullable=False),
    Column("path", ForeignKey("files.path"), nullable=False),
)

simulators = Table(
    "simulators",
    metadata,
    Column("id", Text, primary_key=True),
    Column("path", ForeignKey("files.path"), nullable=False),
)

results = Table(
    "results",
    metadata,
    Column("id", Text, primary_key=True),
    Column("kind", Text, nullable=False),
    Column("recording_id", Text, nullable=False),  # no foreign key: a result outlives a lost recording
    Column("path", ForeignKey("files.path"), nullable=False),
    Column("ordinal", Integer, nullable=False),
)

# Thresholds were results once. They are in the cache now; where an older registry holds some, nobody meets them.
results_of_verbs = select(results).where(results.c.kind != "threshold").subquery("results_of_verbs")

SEALED = tuple(t for t in metadata.sorted_tables if t.name not in ("migrations", "seals"))
HELD = tuple(t for t in SEALED if t.name != "pages")  # what the pages of the ledger tell, parents first

AT_ONCE = 500  # keys in one question: SQLite takes at most 32,766 values (999 before version 3.32)

Values = tuple[Any, ...]  # values of one row, in the order of its table's columns
Key = tuple[Any, ...]


def values_of(table: Table, row: Mapping[str, Any]) -> Values:
    """The values of a row in the order of its table's columns, None for one that it does not say."""
    return tuple(_plain(column, row.get(column.name)) for column in table.c)


def _plain(column: Column, value: Any) -> Any:
    if isinstance(column.type, sql.Integer) and hasattr(value, "__index__") and not isinstance(value, bool):
        return operator.index(value)  # numpy has whole numbers, and texts, of its own
    return str(value) if isinstance(value, str) else value


def named(table: Table, values: Values) -> dict[str, Any]:
    """A row's values by the names of its columns."""
    return dict(zip(table.c.keys(), values, strict=True))


def key_of(table: Table, values: Values) -> Key:
    """The primary key of a row."""
    return tuple(value for column, value in zip(table.c, values, strict=True) if column.primary_key)


_MOST = 2**53  # numbers and sizes beyond it are none of dynreg's
MOST_ENTRIES = 10**9  # of one population, whatever limit is set
ROBOT_HASH = re.compile(r"[0-9a-f]{8,128}")


def misfit(table: Table, values: Values) -> str:
    """What shows that dynreg did not write a row (values in the order of the columns); "" where nothing does.

    A stranger's catalogue may be whole by its own seals, and SQLite keeps a text in a column of numbers.
    """
    for column, value in zip(table.c, values, strict=True):
        whole = isinstance(column.type, sql.Integer)
        fits = type(value) is int and 0 <= value < _MOST if whole else _is_text(value)
        if not fits and not (value is None and column.nullable):
            return f"{column.name} = {str(value)[:40]!r} in the table {table.name!r}"
        if column.name in _ODD and _ODD[column.name](value):
            return f"{column.name} of the table {table.name!r} is not one"
    if table is populations and named(table, values)["size"] > MOST_ENTRIES:
        return f"a population of {named(table, values)['size']} entries"
    if table is shards and not 0 < values[2] - values[1] <= Limits.entries:  # whatever is set
        return f"a shard from {values[1]} to {values[2]}"
    return ""


def _is_text(value: Any) -> bool:
    try:
        return isinstance(value, str) and bool(value.encode() or True)
    except UnicodeEncodeError:  # half of a surrogate pair
        return False


def _odd_manifest(value: str) -> bool:
    """Whether a manifest is anything but hashes by paths that stay in the robot's folder."""
    try:
        manifest = json.loads(value)
        return not all(
            isinstance(sha256, str) and not {"", ".", ".."} & set(path.split("/")) and "\0" not in path
            for path, sha256 in manifest.items()
        )
    except (ValueError, AttributeError, RecursionError):
        return True


def _odd_layout(value: str | None) -> bool:
    try:
        return value is not None and not isinstance(json.loads(value), dict)
    except (ValueError, RecursionError):
        return True


def _odd_hash(value: str) -> bool:
    return not ROBOT_HASH.fullmatch(value)


_ODD = {"manifest": _odd_manifest, "layout": _odd_layout, "hash": _odd_hash}
