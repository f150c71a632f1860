"""A file that lets an interrupted search go on: JSON lines of what was asked and found.

Searches draw from named seeds alone, so asking and telling again what the journal holds brings one back to the
very state in which it was left, its random numbers included, without evaluating anything.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.errors import CorruptError, RegistryError, UsageError

SCHEMA = "dynreg/search/1"


class Journal:
    """The journal of one search at `path`; `key` is what makes it this search (plain JSON).

    Every line carries a checksum of its own; in a journal that was written before there were any, no line does.
    resume : go on with what is there; else begin anew. A last line that was not written to its end is left out.
    Raises UsageError where the file is of another search, CorruptError where it does not read as it was written, and
    RegistryError where it cannot be written.
    """

    def __init__(self, path: Path, key: Mapping[str, Any], *, resume: bool):
        self.path = path
        self._key = json.loads(json.dumps(dict(key)))
        self._held = self._read() if resume and path.is_file() else []
        self._next = 0
        lines = [{"schema": SCHEMA, "search": self._key}, *self._held]
        with _written(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            _replace(path, "".join(map(_line, lines)))

    def shaped(self, *by: np.ndarray) -> None:
        """Forget what is held where other arrays `by` shaped the grades; called once, before anything is asked.

        Two searches may ask for the same and be graded by something else, such as by what came before them.
        """
        told = _digest(np.concatenate([np.ravel(one) for one in by]))
        if self._held and self._held[0]["asked"] == told:
            self._next = 1
            return
        self._held, self._next = [], 0
        first = {"asked": told, "grades": [[]]}
        with _written(self.path):
            _replace(self.path, "".join(map(_line, [{"schema": SCHEMA, "search": self._key}, first])))

    def next(self, asked: np.ndarray) -> np.ndarray | None:
        """(n, k) what the journal holds for the candidates (n, P) asked next; None at its end."""
        if self._next >= len(self._held):
            return None
        line = self._held[self._next]
        self._next += 1
        grades = np.array(line["grades"], dtype=float)
        if line["asked"] != _digest(asked) or len(grades) != len(asked):
            raise CorruptError(
                f"{str(self.path)!r} does not belong to this search: step {self._next} asked something else",
                expected="a journal written by these versions of dynreg and its libraries",
                do="begin anew without --resume, or with another --seed",
            )
        return grades

    def add(self, asked: np.ndarray, grades: np.ndarray) -> None:
        """Keep what was found; on disk when this returns."""
        line = _line({"asked": _digest(asked), "grades": grades.tolist()})
        with _written(self.path), open(self.path, "a", encoding="utf-8") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())

    def _read(self) -> list[dict[str, Any]]:
        """The steps that are held; a line that was not written to its end is none."""
        first, *lines = self.path.read_bytes().split(b"\n")[:-1] or [b""]
        head = _checked(first) or {}
        known = head.keys() == {"schema", "search"} and head["schema"] == SCHEMA
        if not known or not isinstance(head["search"], dict):
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
        steps = [_step(line) for line in lines]
        if None in steps:
            raise CorruptError(
                f"line {2 + steps.index(None)} of {str(self.path)!r} is damaged",
                expected="every line as it was written",
                do="delete that line and all behind it to go on from there, or begin anew without --resume",
            )
        return steps


def head(path: Path) -> dict[str, Any] | None:
    """What makes the journal at `path` its search; None where its first line does not tell."""
    with open(path, "rb") as file:
        told = (_checked(file.readline()) or {}).get("search")
    return told if isinstance(told, dict) else None


def damage(path: Path) -> str:
    """What shows that a journal is not as it was written, "" where nothing does; a torn last line is none."""
    if path.is_symlink() or not path.is_file():
        return "no regular file"
    first, *lines = path.read_bytes().split(b"\n")[:-1] or [b""]
    if not {"schema", "search"} <= (_checked(first) or {}).keys():
        return "its first line is damaged"
    return next((f"line {n} is damaged" for n, line in enumerate(lines, 2) if _step(line) is None), "")


def _line(document: Mapping[str, Any]) -> str:
    """A line of the journal, with the checksum of the rest at its end."""
    return json.dumps({**document, "check": _check(document)}) + "\n"


def _check(document: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(document).encode()).hexdigest()[:16]


def _checked(line: bytes) -> dict[str, Any] | None:
    """What a line holds, without its checksum; None where that is another, or the line is no JSON object."""
    try:
        document = json.loads(line)
        check = document.pop("check", None)
    except (ValueError, AttributeError, TypeError, RecursionError):
        return None
    return document if check is None or check == _check(document) else None


def _step(line: bytes) -> dict[str, Any] | None:
    """What was asked and found, where a line tells of both and of nothing else."""
    document = _checked(line)
    if document is None or document.keys() != {"asked", "grades"}:
        return None
    try:
        return document if np.array(document["grades"], dtype=float).ndim == 2 else None
    except (ValueError, TypeError, OverflowError):
        return None


def _replace(path: Path, text: str) -> None:
    """Put a text in a file's place: a reader or a power cut sees all of it, or what was there before."""
    temporary = path.with_suffix(".writing")
    with open(temporary, "w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)
    if os.name == "nt":  # Windows opens no folder; it keeps a log of such changes itself
        return
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


@contextmanager
def _written(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RegistryError(
            f"cannot write {str(path)!r}: {error.strerror or error}",
            expected="a folder that may be written, with room left",
            do="free some space or mend its permissions, then go on with --resume",
        ) from error


def _digest(asked: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(asked, dtype="<f8").tobytes()).hexdigest()[:32]
