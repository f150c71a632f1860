"""A folder in which dynreg and the program that moves a robot meet: commands go out, logs come in."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dynreg.errors import UsageError
from dynreg.verbs.gaits import gait_of
from dynreg.verbs.subjects import read_log
from dynreg.verbs.written import write_new

if TYPE_CHECKING:
    from dynreg.data.recording import Recording
    from dynreg.registry import Registry
    from dynreg.results.gait import Gait
    from dynreg.sim.robot import Robot

EVERY = 0.5  # s between two looks; a log is whole when two of them find it alike


@dataclass(frozen=True)
class TrialFolder:
    """The trials of one recording: `trial_N.csv` is to be played, `trial_N_log.*` is its log.

    `gait_N.json` is the gait's document. With it, a second start goes on where the first ended: a trial whose log is
    there is not played again. say : tells the user what to do.
    """

    path: Path
    registry: "Registry"
    robot: "Robot"
    log_map: str | Path | None = None
    say: Callable[[str], None] = print

    def kept(self, number: int, sought: "Callable[[], Gait]") -> "Gait":
        """The gait of a trial: that of an earlier start, else the one sought now."""
        path = self.path / f"gait_{number}.json"
        if not path.exists():
            write_new(path, (sought().to_json(1) + "\n").encode())
        return gait_of(self.registry, path)

    def played(self, actions: np.ndarray, rate: float, name: str) -> "Recording":
        """The log of a trial: commands (T, A) are written for the robot, and its log is waited for.

        Raises UsageError where the folder has another trial of this name, LogError and MapError for a log that cannot
        be read: a mended one serves at the next start.
        """
        path, data = self.path / f"{name}.csv", _table(self.robot, actions, rate)
        if not path.exists():
            write_new(path, data)
        elif path.read_bytes() != data:
            raise UsageError(
                f"{str(path)!r} holds other commands than the gait of this trial",
                expected="the commands that were written there",
                do="name a new folder, or remove this one",
            )
        log = self._log(name)
        if log is None:
            self.say(
                f"play {path} on the robot ({len(actions) / rate:.3g} s), and put its log there as {name}_log.mcap "
                "(or .csv, .bag, ...). Ctrl-C ends the wait, and the same command goes on with it"
            )
            log = self._arrived(name)
        return read_log(log, self.robot, self.log_map)

    def _log(self, name: str) -> Path | None:
        return next(iter(sorted(self.path.glob(f"{name}_log*"))), None)

    def _arrived(self, name: str) -> Path:
        """The log, once two looks find it alike."""
        before = None
        while True:
            time.sleep(EVERY)
            log = self._log(name)
            now = log and [(f.stat().st_size, f.stat().st_mtime_ns) for f in sorted([log, *log.rglob("*")])]
            if log is not None and now == before:
                return log
            before = now


def folder_of(
    path: str | Path,
    registry: "Registry",
    robot: "Robot",
    log_map: str | Path | None,
    say: Callable[[str], None],
) -> TrialFolder:
    """The folder at `path`, made where it is new; UsageError where it cannot be."""
    folder = Path(path)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"no folder for trials at {str(path)!r}: {error.strerror}",
            expected="a folder, or a new name in one that may be written",
            do="name another one",
        ) from None
    return TrialFolder(folder, registry, robot, log_map, say)


def _table(robot: "Robot", actions: np.ndarray, rate: float) -> bytes:
    """A table of times [s] and commands."""
    lines = [",".join(["time", *robot.actions])]
    lines += [
        ",".join([f"{i / rate:.6f}", *(f"{value:.6f}" for value in row)]) for i, row in enumerate(actions)
    ]
    return ("\n".join(lines) + "\n").encode()
