"""Which tables are kept: whole ones alone, so that a small run replaces nothing."""

import argparse
import json
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results"
FREE = ("threads", "journal", "processes", "registry", "resume")  # options that change no figure


def keep(
    path: Path,
    table: dict[str, Any],
    parser: argparse.ArgumentParser,
    given: argparse.Namespace,
    named: tuple[str, ...] = (),
) -> bool:
    """Write a table whose options are all the usual ones, else say why it is not written; whether it was.

    named : options that the path tells, or whose rows the journal gathers from several runs.
    """
    other = [
        name
        for name, value in vars(given).items()
        if name not in (*FREE, *named) and value != parser.get_default(name)
    ]
    if other:
        print(f"{path.name} stays as it is: {', '.join(other)} is not what the kept table has")
        return False
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    return True
