"""The journals of a calibration's searches, kept by a registry until it ends."""

import hashlib
import json
import warnings
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dynreg.errors import Assumed, CorruptError, UsageError
from dynreg.registry import Registry
from dynreg.registry.files import LOCKS, try_lock
from dynreg.search.journal import Journal, damage, head
from dynreg.sim.versions import versions

# of the settings of a calibration and of its rules, those that a command line tells
FLAGS = ("seed", "budget", "hold_out", "start", "trial", "goal", "search")


@dataclass(frozen=True)
class Journals:
    """The journals of one calibration: what makes it this question, and how it is run.

    Runs with other seeds or budgets have journals of their own, so that none overwrites another's. trials : the stage
    whose journal is of trials on the robot, which cannot be had again, and which a folder may keep, too; "" where all
    are of simulations.
    """

    registry: Registry
    question: Mapping[str, Any]
    how: Mapping[str, Any]
    resume: bool
    trials: str = ""
    paths: list[Path] = field(default_factory=list)

    def key_of(self, **limits: Any) -> str:
        """A hash of the question, of how it is run, and of the versions that run it, which may answer otherwise.

        limits : what it may spend, where an interrupted run may go on with more of it.
        """
        return _hash({**self.question, **self.how, **limits, "versions": versions()})

    def held(self, stage: str) -> AbstractContextManager[None]:
        """Keep this stage from other runs of the same calibration for a block; UsageError where one is on it."""
        return held(self.registry, self._path(stage), "calibration")

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
        others = sorted(path.parent.glob(f"{begins}-*.jsonl"))
        if first and self.resume and not path.exists() and others:
            told = [words for path in others if (words := unlike_words(self.how, head(path) or {}))]
            raise UsageError(
                "nothing to resume with these settings: what was interrupted had others",
                expected="; or ".join(told) or f"the same {', '.join(self.how)}",
                do="give those, or begin anew without --resume",
            )
        if first and self.resume and not path.exists() and not self.trials:
            warnings.warn("nothing to go on with: the calibration begins", Assumed, 2)
        self.paths.append(path)
        key = {**self.question, "stage": stage, **self.how}
        if not self.trials:
            key["versions"] = versions()
        return Journal(path, key, resume=self.resume and (stage == self.trials or self._serves(path, stage)))

    def _serves(self, path: Path, stage: str) -> bool:
        """Whether the simulations that an interrupted run left can be used; where not, that is told.

        Those by other versions are run again, unless trials on a robot followed from them. Damaged ones are run again
        where there are such trials; elsewhere an error says so, and all may begin anew.
        """
        if not path.is_file():
            return True
        if self.trials:
            if why := damage(path):
                warnings.warn(f"{str(path)!r}: {why}; the simulations of {stage!r} are run again", Assumed, 3)
            return not why
        return by_these_versions(path, f"simulations of {stage!r}")

    def _path(self, stage: str) -> Path:
        begins, ends = _hash({**self.question, "stage": stage}), _hash(self.how)
        return self.registry.journal_path(f"{begins}-{ends}")


def unlike_words(how: Mapping[str, Any], begun: Mapping[str, Any]) -> str:
    """What an interrupted run `begun` was told otherwise than `how`, as flags; "" where it does not tell.

    Of its rules, which are a table, each that differs is told. Those without a flag are told by their names.

    >>> unlike_words({"budget": None, "rules": {"goal": None}}, {"budget": 5, "rules": {"goal": 2.0}})
    '--budget 5, --goal 2.0'
    >>> unlike_words({"budget": 7, "plan": [1]}, {"budget": None, "plan": [2]})
    'no --budget, another plan'
    """
    words = []
    for name, now in how.items():
        was = begun.get(name, now)
        if isinstance(now, Mapping) and isinstance(was, Mapping):
            words += filter(None, [unlike_words(now, was)])
        elif was != now:
            words.append(_told(name, was))
    return ", ".join(words)


def _told(name: str, value: Any) -> str:
    """One setting of an interrupted run; lists of numbers and stages are not written out."""
    if isinstance(value, list | Mapping):
        return f"another {name}"
    flag = f"--{name.replace('_', '-')}" if name in FLAGS else name
    return f"no {flag}" if value is None else f"{flag} {value}"


@contextmanager
def held(registry: Registry, journal: Path, what: str) -> Iterator[None]:
    """Keep a journal from other runs of the same calibration or search, which is named by `what`, for the block.

    Raises UsageError where one is on it.
    """
    if registry.read_only:
        yield
        return
    path = registry.path / LOCKS / f"{journal.stem}.lock"
    with try_lock(path) as mine:
        if not mine:
            raise UsageError(
                f"another run of the same {what} has not ended",
                expected="one at a time, for each would spoil what the other keeps",
                do="wait for it, stop it, or give another --seed",
            )
        try:
            yield
        finally:
            with suppress(PermissionError):  # Windows removes no file that is open
                path.unlink(missing_ok=True)  # while it is held, so that it is nobody else's


def by_these_versions(journal: Path, what: str) -> bool:
    """Whether what a journal holds (`what`) was run by these versions; where not, a warning says that it is run again.

    Of a damaged first line `Journal` tells.
    """
    begun = head(journal)
    if begun is None or begun.get("versions") == versions():
        return True
    by = ", ".join(f"{name} {version}" for name, version in begun.get("versions", {}).items())
    warnings.warn(f"{what} were run by {by or 'an older version'}: they are run again", Assumed, 2)
    return False


def _hash(told: Mapping[str, Any]) -> str:
    """12 hexadecimal digits of plain JSON."""
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:12]
