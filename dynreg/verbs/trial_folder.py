"""A folder in which dynreg and the program that moves a robot meet: commands go out, logs come in."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from dynreg.data.readers import formats
from dynreg.errors import UsageError
from dynreg.gait.play import csv_of
from dynreg.verbs.gaits import gait_of
from dynreg.verbs.subjects import read_log
from dynreg.verbs.written import write_new

if TYPE_CHECKING:
    from dynreg.data.maps import LogMap
    from dynreg.data.recording import Recording
    from dynreg.registry import Registry
    from dynreg.results.gait import Gait
    from dynreg.sim.robot import Robot

EVERY = 0.5  # s between two looks at a folder
QUIET = 3.0  # s for which a log must stay as it is before it is read: by contract
PATIENCE = 10.0  # s after which a log that is not whole is told
MCAP_END = b"\x89MCAP0\r\n"  # the last bytes of a whole one
ALIKE = 3e-4  # rad, between commands of one gait: older versions wrote sines, which now have corners
UNDER_WAY = (".part", ".tmp", ".swp", ".crdownload")
State = list[tuple[str, int, int]]  # names, sizes and times of files

_PLAY = (
    "play {path} on the robot ({seconds:.3g} s), and move its log there as {answer}. "
    "Ctrl-C ends the wait, and the same command goes on with it"
)


@dataclass(frozen=True)
class TrialFolder:
    """The trials of one recording: `trial_N.csv` is to be played, `trial_N_log.*` is its log.

    `gait_N.json` is the gait's document. With it, a second start goes on where the first ended: a trial whose log is
    there is not played again. say : tells the user what to do.
    """

    keeps: ClassVar[bool] = True  # see `ScoredRobot`: a trial of a name is not played again
    goes_on: ClassVar[str] = "the same command goes on"
    answers: ClassVar[str] = "{name}_log.mcap (or .csv, .bag, ...)"

    path: Path
    registry: "Registry"
    robot: "Robot"
    log_map: "str | Path | LogMap | None" = None
    say: Callable[[str], None] = print

    def kept(self, number: int, sought: "Callable[[], Gait]") -> "Gait":
        """The gait of a trial: that of an earlier start, else the one sought now; raises as `gaits.gait_of`."""
        path = self.path / f"gait_{number}.json"
        if not path.exists():
            write_new(path, (sought().to_json(1) + "\n").encode())
        return gait_of(self.registry, path)

    def played(self, actions: np.ndarray, rate: float, name: str) -> "Recording":
        """The log of a trial: commands (T, A) are written for the robot, and its log is waited for.

        Raises UsageError where the folder has another trial of this name, or a log of it before its commands, or where
        it is moved or deleted meanwhile; LogError and MapError for a log that cannot be read: a mended one serves at
        the next start.
        """
        self._write(actions, rate, name)
        if self._log(name) is None:
            answer = self.answers.format(name=name)
            self.say(_PLAY.format(path=self.path / f"{name}.csv", seconds=len(actions) / rate, answer=answer))
        return read_log(self._arrived(name), self.robot, self.log_map)

    def _write(self, actions: np.ndarray, rate: float, name: str) -> None:
        """Write the commands (T, A) of a trial; UsageError where the folder has others by this name, or an answer to
        them already."""
        path = self.path / f"{name}.csv"
        if not path.exists():
            self._require_played(name)
            write_new(path, csv_of(self.robot.actions, np.arange(len(actions)) / rate, actions))
        elif not _holds(path, actions):
            raise UsageError(
                f"{str(path)!r} holds other commands than the gait of this trial",
                expected="the commands that were written there",
                do="name a new folder, or remove this one",
            )

    def _answer(self, name: str) -> Path | None:
        """What answers a trial, whole or not."""
        return self._log(name)

    def _require_played(self, name: str) -> None:
        """UsageError for an answer to commands that were never written: no robot has played them."""
        if (found := self._answer(name)) is not None:
            begun = any(self.path.glob("trial_*[0-9].csv"))  # whose answers a new folder would lose
            raise UsageError(
                f"{str(found)!r} answers {name}.csv, which was never written",
                expected="an answer after the robot has played the trial",
                do=f"remove it; then {self.goes_on}" if begun else "remove it, or name a new folder",
            )

    def _log(self, name: str) -> Path | None:
        """The log of a trial, whole or not; the first of several."""
        return next(iter(self._logs(name)), None)

    def _logs(self, name: str) -> list[Path]:
        """All that may be the log of a trial: files of a format that can be read, and folders."""
        known = {suffix for one in formats().values() for suffix in one.suffixes}
        there = sorted(self.path.glob(f"{name}_log*"))
        return [path for path in there if path.suffix.lower() in known or path.is_dir()]

    def _arrived(self, name: str, refused: State | None = None) -> Path:
        """The answer to a trial once it is whole: its format's end is there, and it has stayed as it is for `QUIET`
        seconds. One in the state `refused` is not taken: it is waited until it changes."""
        before, since, told, many = None, time.monotonic(), False, 1
        there = self._names()
        while True:
            log, logs = self._answer(name), self._logs(name)
            if log in logs and len(logs) > 1:
                if len(logs) != many:
                    names = ", ".join(path.name for path in logs)
                    self.say(f"{names} would all be the log of {name}: leave one of them")
                log = None
            many = len(logs)
            strange = self._names() - there - {path.name for path in logs}
            for other in sorted(strange) if log is None else ():
                there.add(other)
                self.say(f"{other} is not read: {self.answers.format(name=name)} is waited for")
            now = None if log is None else state(log)
            if now is None or now != before or now == refused:
                before, since = now, time.monotonic()
            elif _ended(log) and time.monotonic() - since >= QUIET:
                return log
            elif not told and time.monotonic() - since >= PATIENCE:
                self.say(
                    f"{log} is there, but its end is not written yet: close the log, or put a whole one there"
                )
                told = True
            time.sleep(EVERY)

    def _names(self) -> set[str]:
        """Names of the files in the folder, but those that are hidden or under way to a name: a copy, an editor's.

        Raises UsageError where the folder is gone.
        """
        try:
            there = [*self.path.iterdir()]
        except OSError as error:
            raise UsageError(
                f"the folder for trials {str(self.path)!r} cannot be read any more: {error.strerror}",
                expected="the folder where it was, until the trials end",
                do=f"put it back; then {self.goes_on}",
            ) from None
        return {path.name for path in there if path.name[0] != "." and path.suffix not in UNDER_WAY}


def state(log: Path) -> State | None:
    """Names, sizes and times of the files of a log; None where one went away meanwhile."""
    try:
        files = sorted(log.rglob("*")) if log.is_dir() else [log]
        return [(str(f), f.stat().st_size, f.stat().st_mtime_ns) for f in files]
    except FileNotFoundError:
        return None


def _ended(log: Path) -> bool:
    """Whether a log has what its format ends with, where it ends with something; False where it went away."""
    try:
        if log.is_dir():
            return (log / "metadata.yaml").exists()  # which rosbag2 writes last
        if log.suffix.lower() != ".mcap":
            return log.stat().st_size > 0
        with open(log, "rb") as file:
            file.seek(max(log.stat().st_size - len(MCAP_END), 0))
            return file.read() == MCAP_END
    except FileNotFoundError:
        return False


def _holds(path: Path, actions: np.ndarray) -> bool:
    """Whether a table holds these commands (T, A)."""
    rows = path.read_text(encoding="utf-8", errors="replace").splitlines()[1:]
    try:
        told = np.array([row.split(",")[1:] for row in rows], dtype=float)
    except ValueError:
        return False
    return told.shape == actions.shape and bool(np.abs(told - actions).max() <= ALIKE)


def folder_of(path: str | Path) -> Path:
    """The folder at `path`, made where it is new; UsageError where it cannot be."""
    folder = Path(path)
    try:
        folder.mkdir(exist_ok=True)
        with TemporaryFile(dir=folder):  # found out before time is spent on a gait
            pass
    except OSError as error:
        raise UsageError(
            f"no folder for trials at {str(path)!r}: {error.strerror}",
            expected="a folder, or a new name in one that may be written",
            do="name another one",
        ) from None
    return folder
