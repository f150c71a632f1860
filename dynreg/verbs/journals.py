"""The journals of a calibration's searches, kept by a registry until it ends."""

import hashlib
import json
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dynreg.errors import Assumed, CorruptError, UsageError
from dynreg.registry import Registry
from dynreg.registry.files import LOCKS, try_lock
from dynreg.search.journal import Journal, damage
from dynreg.verbs.accepted import versions


@dataclass(frozen=True)
class Journals:
    """The journals of one calibration: what makes it this question, and how it is run.

    Runs with other seeds or budgets have journals of their own, so that none overwrites another's. elsewhere : whether
    something else than a journal may keep what an interrupted run did, as a folder of trials.
    """

    registry: Registry
    question: Mapping[str, Any]
    how: Mapping[str, Any]
    resume: bool
    elsewhere: bool = False
    paths: list[Path] = field(default_factory=list)

    @property
    def key(self) -> str:
        """What this question, how it is run and what runs it are known by: another version may answer otherwise."""
        return _hash({**self.question, **self.how, "versions": versions()})

    @contextmanager
    def held(self, stage: str) -> Iterator[None]:
        """Keep this stage from other runs of the same calibration for the block; UsageError where one is on it."""
        with try_lock(self.registry.path / LOCKS / f"{self._path(stage).stem}.lock") as mine:
            if not mine:
                raise UsageError(
                    "another run of the same calibration has not ended",
                    expected="one at a time, for each would spoil what the other keeps",
                    do="wait for it, stop it, or give another --seed",
                )
            yield

    def left(self, stage: str) -> list[float] | None:
        """What the last step of a stage found, in the journal that an interrupted run has left; None where none is.

        Raises CorruptError for one with steps that is damaged.
        """
        path = self._path(stage)
        lines = path.read_bytes().split(b"\n")[1:-1] if path.is_file() else []
        if lines and (why := damage(path)):
            raise CorruptError(
                f"the journal of an interrupted run, {str(path)!r}: {why}",
                expected="every line as it was written",
                do="delete that line and all behind it and give --resume, or give another --seed",
            )
        return json.loads(lines[-1])["grades"][0] if lines else None

    def begun(self, stage: str) -> bool:
        """Whether a run that has not ended began with a stage."""
        return self._path(stage).is_file()

    def end(self) -> None:
        """Take the journals away: the calibration has ended."""
        for path in self.paths:
            path.unlink(missing_ok=True)

    def of(self, stage: str) -> Journal:
        """The journal of a stage; it is told where there is none to go on with, and the calibration begins.

        Raises UsageError for one to resume where only runs in other ways have left one.

        Only the first stage tells: an interrupted run may not have come to the later ones.
        """
        path, first = self._path(stage), not self.paths
        begins = path.name.partition("-")[0]
        if first and self.resume and not path.exists() and any(path.parent.glob(f"{begins}-*.jsonl")):
            raise UsageError(
                f"nothing to resume with seed {self.how['seed']} and these settings: what was interrupted had others",
                expected=f"the same {', '.join(self.how)}",
                do="give those, or begin anew without --resume",
            )
        if first and self.resume and not path.exists() and not self.elsewhere:
            warnings.warn("nothing to go on with: the calibration begins", Assumed, 2)
        self.paths.append(path)
        return Journal(path, {**self.question, "stage": stage, **self.how}, resume=self.resume)

    def _path(self, stage: str) -> Path:
        begins, ends = _hash({**self.question, "stage": stage}), _hash(self.how)
        return self.registry.journal_path(f"{begins}-{ends}")


def _hash(told: Mapping[str, Any]) -> str:
    """12 hexadecimal digits of plain JSON."""
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:12]
