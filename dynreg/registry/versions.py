"""The versions of a robot: those of one name, numbered in the order in which they came."""

from sqlalchemy import Connection, func, select

import dynreg.registry.tables as tables
from dynreg.registry.infos import RobotInfo


def numbered(connection: Connection, without: str | None = None) -> tuple[RobotInfo, ...]:
    """All robots by name and version, but the one of the hash `without`.

    Those that came before versions were kept get the numbers that are free, in the order in which recordings were
    ingested with them, then by hash.
    """
    used, last = tables.recordings, func.max(tables.recordings.c.ordinal)
    ordinals = dict(connection.execute(select(used.c.robot_hash, last).group_by(used.c.robot_hash)).all())
    table, told = tables.robots, tables.robot_versions
    query = select(table.c.hash, table.c.name, told.c.version).outerjoin(told)
    query = query if without is None else query.where(table.c.hash != without)
    rows = sorted(connection.execute(query), key=lambda row: (ordinals.get(row.hash, 0), row.hash))
    taken = {(row.name, row.version) for row in rows if row.version is not None}
    found = []
    for row in rows:
        version = row.version or _free(taken, row.name)
        taken.add((row.name, version))
        found.append(RobotInfo(row.hash, row.name, version))
    return tuple(sorted(found, key=lambda info: (info.name, info.version, info.hash)))


def newest(connection: Connection, name: str) -> RobotInfo | None:
    """The newest version of the robots of this name; None where there is none."""
    return next((info for info in reversed(numbered(connection)) if info.name == name), None)


def _free(taken: set[tuple[str, int | None]], name: str) -> int:
    return next(number for number in range(1, len(taken) + 2) if (name, number) not in taken)
