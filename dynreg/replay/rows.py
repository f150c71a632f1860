"""A recording as rows of its robot: where a replay looks channels up by their names, once."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynreg.data.clocks import begins
from dynreg.data.recording import Recording
from dynreg.errors import LogError, quoted
from dynreg.replay.timed import on_grid
from dynreg.sim.robot import Robot


@dataclass(frozen=True, eq=False)
class Rows:
    """What a recording holds of a robot, episode by episode; NaN where nothing was measured or told.

    time : (T,) [s]. states : (T, S). actions : (T, A). inputs : (T, I). settings : (E, K).
    """

    time: tuple[np.ndarray, ...]
    states: tuple[np.ndarray, ...]
    actions: tuple[np.ndarray, ...]
    inputs: tuple[np.ndarray, ...]
    settings: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def period(self) -> float:
        """Median time between two rows [s]; LogError where every episode has a single one."""
        gaps = np.concatenate([np.diff(time) for time in self.time if len(time) > 1] or [[0.0]])
        period = float(np.median(gaps))
        if not period > 0:
            raise LogError(
                "the recording has one row an episode",
                expected="commands and the states after them",
                do="record longer",
            )
        return period

    @cached_property
    def startable(self) -> tuple[np.ndarray, ...]:
        """(T,) of each episode: rows at which all is known that was ever measured; a replay can start there."""
        finite = [np.isfinite(states) for states in self.states]
        known = np.any([f.any(axis=0) for f in finite], axis=0)
        rows = tuple(f[:, known].all(axis=1) for f in finite)
        # channels that are never measured together: the engine fills in what is missing at the start
        return rows if any(r.any() for r in rows) else tuple(f.any(axis=1) for f in finite)

    def spans(self, episode: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(W, 2) first and last stamp [s], on their episodes' clocks, of stretches (W, 2) of rows; as in `Windows`."""
        stamps = [
            (self.time[e][first], self.time[e][stop - 1])
            for e, (first, stop) in zip(episode, rows, strict=True)
        ]
        return np.array(stamps, dtype=float).reshape(-1, 2)

    @cached_property
    def begin(self) -> np.ndarray:
        """(E,) seconds from the begin of the first episode to that of each; see `clocks.begins`."""
        return begins(*(np.array([time[at] for time in self.time]) for at in (0, -1)))


def rows_of(robot: Robot, recording: Recording) -> Rows:
    """The rows of a recording; of robots with control = "timed" on the grid of `timed.on_grid`.

    Raises LogError where the recording lacks a state or the commands to replay.
    """
    missing = [name for name in robot.actions if name not in recording.names]
    if missing or not robot.actions:
        raise LogError(
            f"the recording has no commands ({missing[0] if missing else 'the robot has no actions'})",
            expected=f"the channels {quoted(robot.actions)}",
            do="record the commands too: without them nothing can be replayed or compared",
        )
    recording = on_grid(robot, recording)
    state, action = recording.columns(robot.channels), recording.columns(robot.actions)
    logged = [i for i, name in enumerate(robot.inputs) if name in recording.names]
    source = recording.columns([robot.inputs[i] for i in logged])
    inputs = [np.full((len(e.time), len(robot.inputs)), np.nan) for e in recording.episodes]
    for filled, e in zip(inputs, recording.episodes, strict=True):
        filled[:, logged] = e.values[:, source]
    nominal = {s.name: s.nominal for s in robot.file.settings}
    settings = [[e.settings.get(name, nominal[name]) for name in robot.settings] for e in recording.episodes]
    return Rows(
        tuple(e.time for e in recording.episodes),
        tuple(e.values[:, state] for e in recording.episodes),
        tuple(e.values[:, action] for e in recording.episodes),
        tuple(inputs),
        np.array(settings).reshape(len(recording.episodes), len(robot.settings)),
    )
