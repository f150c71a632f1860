"""A folder of trials that a task scores: a person or a log answers each of them."""

import codecs
import inspect
import json
import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynreg.adapt.tried import ROULETTE
from dynreg.data.recording import Recording
from dynreg.data.units import suffix
from dynreg.errors import LogError, MapError, UsageError
from dynreg.gait.logged import trial_of
from dynreg.gait.tasks import Task
from dynreg.methods.scored import FELL, score_of
from dynreg.verbs.subjects import read_log
from dynreg.verbs.trial_folder import TrialFolder, state
from dynreg.verbs.written import write_new

UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
QUESTION = "trials.json"  # what the trials of a folder are of
NAMED = re.compile(r"(trial_(\d+))(_score\.txt|_log.*|\.csv)")
GO_ON = "the same command with --resume goes on"


@dataclass(frozen=True, kw_only=True)
class ScoredFolder(TrialFolder):
    """The trials of one calibration: `trial_N.csv` is to be played, and `trial_N_score.txt` or `trial_N_log.*` answers.

    The file of a score has one line: the score in the task's unit, or `fell`. `trials.json` says which robot, task,
    method, seed, goal and search the trials are of. most : trials that there may be. hinted : has something once it was
    said what to measure.
    """

    goes_on: ClassVar[str] = GO_ON
    answers: ClassVar[str] = f"{{name}}_score.txt or {TrialFolder.answers}"

    task: Task
    method: str
    seed: int
    goal: float | None
    search: str
    most: int
    hinted: list[str] = field(default_factory=list)

    def begin(self, resume: bool) -> None:
        """See that the folder is of this question, before time is spent on a gait.

        Raises UsageError where it is of another one, has an answer to commands that were never written, or has answers
        and is not resumed.
        """
        names = {found[1] for path in self.path.iterdir() if (found := NAMED.fullmatch(path.name))}
        written = [name for name in names if (self.path / f"{name}.csv").exists()]
        for name in sorted(names - {*written}):
            self._require_played(name)
        self._require_mine(bool(written))
        many = sum(self._answer(name) is not None for name in written)
        if many and not resume:
            raise UsageError(
                f"{str(self.path)!r} has answers already, to {_many(many)}",
                expected="a new folder, or to go on with these",
                do="give --resume to take them, or name a new folder",
            )
        if many:
            self.say(f"{_many(many)} taken from {self.path}, and not played again")

    def __call__(self, actions: np.ndarray, rate: float, name: str) -> Recording | float | None:
        """`told`."""
        return self.told(actions, rate, name)

    def require_same(self, name: str, score: float | None) -> None:
        """UsageError where the file of a score says something else than what a run has gone on with."""
        path = self.path / f"{name}_score.txt"
        if not path.exists() or (now := read_score(path, self.task.unit)) == score:
            return
        was, now = (FELL if one is None else f"{one:.6g}" for one in (score, now))
        raise UsageError(
            f"{str(path)!r} says {now}, and the trials behind it were chosen when it said {was}",
            expected="the answer that the run has gone on with",
            do=f"write {was} there again, or begin anew in a new folder",
        )

    def told(self, actions: np.ndarray, rate: float, name: str) -> Recording | float | None:
        """What a trial of commands (T, A) came to: its log, or the score that a person wrote, None for a fall.

        An answer that cannot be read is told, and waited for until it is corrected. Raises UsageError where the folder
        has other commands by this name, or an answer from before they were written.
        """
        if not (self.path / QUESTION).exists():
            write_new(self.path / QUESTION, (json.dumps(self._question) + "\n").encode())
        self._write(actions, rate, name)
        if self._answer(name) is None:
            self._ask(len(actions) / rate, name)
        refused = None
        while True:
            found = self._arrived(name, refused)
            refused = state(found)
            try:
                answer, score = self._read(found, actions, rate)
            except FileNotFoundError:  # an editor puts another one there
                continue
            except (LogError, MapError) as problem:
                self.say(
                    f"{problem.problem}; expected {problem.expected}; correct {found.name}: it is waited for"
                )
                continue
            read = FELL if score is None else f"{score:.6g}{suffix(self.task.unit)}"
            self.say(f"trial {_number(name)}: {read}, by {found.name}")
            return answer

    @property
    def _question(self) -> dict[str, str | float | None]:
        return {
            "robot": self.robot.name,
            "model": self.robot.hash[:12],
            "task": self.task.name,
            "method": self.method,
            "seed": self.seed,
            "goal": self.goal,
            "search": self.search,
        }

    def _require_mine(self, written: bool) -> None:
        """UsageError where the trials are of another question, or nothing says of which."""
        path, other = self.path / QUESTION, "name a new folder"
        if not path.exists():
            if written:
                raise UsageError(
                    f"{str(self.path)!r} has trials, and no {QUESTION} that says of which task",
                    expected="a new folder, or one that an earlier start of this calibration made",
                    do=other,
                )
            return
        try:
            told = dict(json.loads(path.read_bytes()))
        except (ValueError, TypeError):
            told = {}
        told.setdefault("search", ROULETTE)  # folders from before there was another
        for name, value in self._question.items():
            if told.get(name) != value:
                was, now = (f"no {name}" if v is None else f"{name} {v!r}" for v in (told.get(name), value))
                raise UsageError(
                    f"the trials in {str(self.path)!r} are of {was}, as {QUESTION} there says",
                    expected=f"trials of {now}, which is asked about now",
                    do=f"{other}, or ask with {was} again",
                )

    def _answer(self, name: str) -> Path | None:
        score = self.path / f"{name}_score.txt"
        return score if score.exists() else self._log(name)

    def _ask(self, seconds: float, name: str) -> None:
        """Ask for a trial; before the first one, say what to measure and how to answer."""
        unit = suffix(self.task.unit)
        if not self.hinted:
            self.hinted.append(name)
            self.say(f"task {self.task.name!r}: {_measure(self.task)}")
            self.say(
                f"After each trial write one number{unit and f' [{unit[1:]}]'} into trial_N_score.txt, or the word "
                f"{FELL}: a robot that does not stand at the end of the trial fell. Or put its log there, as "
                "trial_N_log.mcap (or .csv, .bag, ...)"
            )
            self.say(f"Ctrl-C ends the wait: {GO_ON}")
        gait, again = self._repeats(_number(name))
        self.say(
            f"trial {_number(name)} of {self.most} (gait {gait}, try {again}): play {self.path / name}.csv on the "
            f"robot ({seconds:.3g} s), and answer with {name}_score.txt"
        )

    def _repeats(self, number: int) -> tuple[int, int]:
        """Which gait a trial is of, from 1, and which of its trials, which follow each other, it is."""
        gait, again, before = 0, 0, None
        for one in range(1, number + 1):
            path = self.path / f"trial_{one}.csv"
            played = path.read_bytes() if path.exists() else None
            gait, again = (gait, again + 1) if gait and played == before else (gait + 1, 1)
            before = played
        return gait, again

    def _read(
        self, path: Path, actions: np.ndarray, rate: float
    ) -> tuple[Recording | float | None, float | None]:
        """An answer and the score that it tells, None for a fall. Raises LogError or MapError."""
        if path.name.endswith("_score.txt"):
            score = read_score(path, self.task.unit)
            return score, score
        log = read_log(path, self.robot, self.log_map)
        return log, score_of(self.task, trial_of(self.robot, log, actions, rate))


def read_score(path: Path, unit: str = "") -> float | None:
    """The score in a file of one line, None where it says `fell`; LogError for any other line.

    The file is UTF-8, or UTF-16 with the mark that Windows programs write at its beginning. unit : may follow the
    number.
    """
    data = path.read_bytes()
    text = data.decode("utf-16" if data[:2] in UTF16 else "utf-8-sig", errors="replace").strip()
    if text.lower() == FELL:
        return None
    number = text.removesuffix(unit) if unit.isalpha() else text
    try:
        score = math.nan if "_" in text else float(number)  # Python reads 0_82 as 82
    except ValueError:
        score = math.nan
    if not math.isfinite(score):
        raise LogError(
            f"{str(path)!r} says {text[:40]!r}",
            expected=f"one line: a number with a decimal point, such as 0.82, or the word {FELL}",
            do="correct it",
        )
    return score


def _measure(task: Task) -> str:
    """What a task scores, in the words of its kind, with its numbers."""
    said = " ".join((inspect.getdoc(type(task)) or "the score that you give").partition("\n\n")[0].split())
    told = {name: value for name, value in task.values.items() if not math.isnan(value)}
    numbers = ", ".join(f"{name} = {value:.6g}" for name, value in told.items())
    return f"{said} ({numbers})" if numbers else said


def _many(trials: int) -> str:
    return f"{trials} trial{'s' * (trials != 1)}"


def _number(name: str) -> int:
    return int(name.rpartition("_")[2])
