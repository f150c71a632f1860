"""A file that lets an interrupted search go on: JSON lines of what was asked and found.

Searches draw from named seeds alone, so asking and telling again what the journal holds brings one back to the
very state in which it was left, its random numbers included, without evaluating anything.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.errors import CorruptError, UsageError

SCHEMA = "dynreg/search/1"


class Journal:
    """The journal of one search at `path`; `key` is what makes it this search (plain JSON).

    resume : go on with what is there; else begin anew. A last line that was not written to its end is left out.
    Raises UsageError where the file is of another search, CorruptError where it does not read.
    """

    def __init__(self, path: Path, key: Mapping[str, Any], *, resume: bool):
        self.path = path
        self._key = json.loads(json.dumps(dict(key)))
        self._held = self._read() if resume and path.is_file() else []
        self._next = 0
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(".writing")
        lines = [{"schema": SCHEMA, "search": self._key}, *self._held]
        temporary.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
        os.replace(temporary, path)

    def next(self, asked: np.ndarray) -> np.ndarray | None:
        """(n, k) what the journal holds for the candidates (n, P) asked next; None at its end."""
        if self._next >= len(self._held):
            return None
        line = self._held[self._next]
        self._next += 1
        if line["asked"] != _digest(asked):
            raise CorruptError(
                f"{str(self.path)!r} does not belong to this search: step {self._next} asked something else",
                expected="a journal written by these versions of dynreg and its libraries",
                do="begin anew without --resume",
            )
        return np.array(line["grades"], dtype=float)

    def add(self, asked: np.ndarray, grades: np.ndarray) -> None:
        """Keep what was found; on disk when this returns."""
        line = json.dumps({"asked": _digest(asked), "grades": grades.tolist()})
        with open(self.path, "a", encoding="utf-8") as file:
            file.write(line + "\n")
            file.flush()
            os.fsync(file.fileno())

    def _read(self) -> list[dict[str, Any]]:
        whole, _, _ = self.path.read_text(encoding="utf-8").rpartition("\n")
        try:
            head, *lines = [json.loads(line) for line in whole.splitlines()]
            known = head["schema"] == SCHEMA and all({"asked", "grades"} <= set(line) for line in lines)
        except (ValueError, KeyError, TypeError):
            known = False
        if not known:
            raise CorruptError(
                f"{str(self.path)!r} is no journal of a search",
                expected=f"lines of JSON, the first with schema {SCHEMA!r}",
                do="begin anew without --resume",
            )
        if head["search"] != self._key:
            differs = [k for k in self._key if head["search"].get(k) != self._key[k]]
            raise UsageError(
                f"{str(self.path)!r} is the journal of another search ({', '.join(differs)} differ)",
                expected="the settings that it was begun with",
                do="give those, or begin anew without --resume",
            )
        return lines


def _digest(asked: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(asked, dtype="<f8").tobytes()).hexdigest()[:32]
