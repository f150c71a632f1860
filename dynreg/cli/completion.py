"""What a shell offers after TAB for robots, recordings and the other names in a registry."""

import re
from collections.abc import Callable, Collection
from pathlib import Path

from dynreg.session import place

MOST_OFFERED = 1000  # names: more help nobody to choose
_PLAIN = re.compile(r"[\w@%+=:,./-]+")
KINDS = ("population", "recording", "measured", "simulator", "result", "robot")


def robot_names(incomplete: str) -> list[str]:
    """Packaged robots; folders are left to the shell."""
    from importlib import resources

    root = Path(str(resources.files("dynreg") / "robots"))
    names = sorted(p.name for p in root.iterdir() if (p / "robot.toml").is_file())
    return [name for name in names if name.startswith(incomplete)]


def one_of(choices: Collection[str]) -> Callable[[str], list[str]]:
    """Offers these; behind a comma, the next one of a list."""

    def offered(incomplete: str) -> list[str]:
        end = incomplete.rfind(",") + 1
        return [incomplete[:end] + name for name in choices if name.startswith(incomplete[end:])]

    return offered


def recording_names(incomplete: str) -> list[str]:
    """Names of the recordings in the registry; nothing where it cannot be read."""
    return _names("recording", incomplete)


def stored_names(incomplete: str) -> list[str]:
    """Names of recordings and populations in the registry; nothing where it cannot be read."""
    return _names("recording", incomplete) + _names("population", incomplete)


def _names(kind: str, incomplete: str) -> list[str]:
    """Stored names that begin so and that a shell takes as they are: what it offers, it may also run."""
    import sqlite3

    table = {"recording": "recording_names", "population": "populations"}[kind]
    catalog = place(None) / "catalog.sqlite"
    if not catalog.is_file():
        return []
    try:
        connection = sqlite3.connect(f"{catalog.absolute().as_uri()}?mode=ro", uri=True, timeout=0.2)
        try:
            rows = connection.execute(f"SELECT DISTINCT name FROM {table} ORDER BY name LIMIT {MOST_OFFERED}")
            names = [row[0] for row in rows]
        finally:
            connection.close()
    except sqlite3.Error:
        return []
    return [n for n in names if isinstance(n, str) and n.startswith(incomplete) and _PLAIN.fullmatch(n)]


def effect_names(incomplete: str) -> list[str]:
    """Effects of the library; behind a comma or a plus, the next one of a list."""
    from dynreg.sim.effects import effects

    end = max(incomplete.rfind(mark) for mark in ",+") + 1
    before, begun = incomplete[:end], incomplete[end:]
    return [before + name for name in effects() if name.startswith(begun)]
