"""Replay: a recording's own commands in candidate simulators, compared with what the robot did."""

from dataclasses import dataclass, field, replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import LogError
from dynreg.replay.timed import held, on_grid
from dynreg.replay.velocity import SPAN, base_velocities, pose_columns
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

# rad, standard deviation of a heading that may be any: turns do not add to it
ANYWHERE = np.pi / np.sqrt(3.0)
BEFORE = 3.0  # s of commands before a window: longer than bases remember
ENOUGH = 4  # poses that tell a velocity better than commands do
STILL = 5.0  # times its noise that a channel of a base that stands still may move


@dataclass(frozen=True)
class Windows:
    """A recording cut into windows of equal length, ready to be replayed.

    run : the commands of W windows, their inputs, settings and measured start.
    measured : (W, T+1, S), NaN after the end of a shorter window.
    spread : (S,) standard deviation of each measured channel: the unit of normalised errors.
    weight : (S,) weight of each channel, summing to 1.
    episode : (W,) number of the recording's episode that each window is cut from.
    rows : (W, 2) first row and one past the last in that episode; windows in a row share the row between them.
    """

    run: Run
    measured: np.ndarray
    spread: np.ndarray
    weight: np.ndarray
    episode: np.ndarray
    rows: np.ndarray
    period: float

    def __len__(self) -> int:
        return len(self.episode)

    def scaled_by(self, robot: Robot, chosen: np.ndarray) -> "Windows":
        """The same windows with the units of their errors taken from the windows `chosen` alone.

        Raises LogError where no channel with a weight was measured in them.
        """
        spread, weight = _scales(robot, self.measured[chosen])
        return replace(self, spread=spread, weight=weight)

    def take(self, windows: np.ndarray) -> "Windows":
        """Only these windows."""
        return replace(
            self,
            run=self.run.take(windows),
            measured=self.measured[windows],
            episode=self.episode[windows],
            rows=self.rows[windows],
        )


def windows(robot: Robot, recording: Recording) -> Windows:
    """Cut a recording for replay, each window from a measured state; at most `replay.horizon` [s] long.

    Of robots with control = "timed" on the grid of `timed.on_grid`, to which the windows' `rows` then belong.
    Raises LogError where the recording lacks the commands to replay or has no rows.
    """
    recording = on_grid(robot, recording)
    state, action = recording.columns(robot.channels), _action_columns(robot, recording)
    startable = _startable(robot, recording)
    cuts = [cut for number in range(len(startable)) for cut in _cuts(robot, recording, number, startable)]
    if not cuts:
        raise LogError(
            "no episode has two measured rows in a row",
            expected="commands and the states after them",
            do="record longer",
        )
    steps = max(stop - start for _, start, stop in cuts) - 1
    shape = (len(cuts), steps)
    actions = np.empty((*shape, len(action)))
    inputs = np.tile(robot.input_defaults, (*shape, 1))
    measured = np.full((len(cuts), steps + 1, len(state)), np.nan)
    for w, (number, start, stop) in enumerate(cuts):
        values = recording.episodes[number].values[start:stop]
        last = np.minimum(np.arange(steps), stop - start - 2)
        actions[w] = held(values[:, action], np.zeros(len(action)))[last]
        measured[w, : stop - start] = values[:, state]
        for i, name in enumerate(robot.inputs):
            if name in recording.names:
                column = values[:, [recording.names.index(name)]]
                inputs[w, :, i] = held(column, robot.input_defaults[[i]])[last, 0]
    velocity, before = _come_from(robot, recording, cuts)
    run = Run(
        actions,
        inputs=inputs,
        settings=_settings(robot, recording)[[c[0] for c in cuts]],
        initial=starts(robot, actions, measured, before),
        velocity=velocity,
        before=before,
        period=_period(recording),
        begin=_begins(recording, cuts),
    )
    spread, weight = _scales(robot, measured)
    numbers, rows = np.array(cuts)[:, 0], np.array(cuts)[:, 1:]
    return Windows(run, measured, spread, weight, numbers, rows, run.period)


def starts(
    robot: Robot, actions: np.ndarray, measured: np.ndarray, before: np.ndarray | None = None
) -> np.ndarray:
    """(W, S) measured states that windows begin with, from commands (W, T, A) and rows (W, T+1, S); see `standing`.

    A planar base never forgets where it started, and one noisy row would turn its whole path: where it stands still
    at first, its start is the mean of those rows.
    """
    out = measured[:, 0].copy()
    for w, rows in enumerate(standing(robot, actions, measured, before)):
        known = np.isfinite(out[w])
        out[w, known] = np.nanmean(measured[w, :rows, known], axis=1)
    return out


def standing(
    robot: Robot, actions: np.ndarray, measured: np.ndarray, before: np.ndarray | None = None
) -> np.ndarray:
    """(W,) rows at the start of each window in which a planar base stands still; 1 for all else.

    before : (W, L, A) commands before, where known: a base that was told to move may still roll between rare poses.
    """
    rows = np.ones(len(measured), dtype=int)
    if not robot.planar:
        return rows
    noise = np.array([max(c.noise, c.quantum) for c in robot.file.channels])
    moves = (actions != 0).any(axis=2)
    first = np.where(moves.any(axis=1), moves.argmax(axis=1), moves.shape[1])
    for w, many in enumerate(first + 1):
        if before is not None and before[w].any():
            continue
        known = measured[w, :many, np.isfinite(measured[w, 0])]
        apart = np.abs(known - np.nanmean(known, axis=1, keepdims=True)).T
        if many > 1 and not (apart > STILL * noise[np.isfinite(measured[w, 0])]).any():
            rows[w] = many
    return rows


@dataclass
class Replayer:
    """Replays candidates through the windows of a recording and counts what it simulates.

    `rollouts` counts simulators run through all the windows of a call.
    """

    robot: Robot
    windows: Windows
    threads: int = 0
    rollouts: int = field(default=0)

    def states(self, values: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """(n, W, T+1, S) what simulators (n, P) do in the chosen windows, without motor noise."""
        self.rollouts += len(values)
        return rollout(self.robot, values, self.windows.run.take(chosen), threads=self.threads).states

    def residuals(self, values: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """(n, W, T, S') normalised and weighted residuals: their mean size is the replay error.

        Channels without weight are left out; NaN stands where nothing was measured; a diverged simulation
        counts as ten times the motion.
        """
        use = np.flatnonzero(self.windows.weight > 0)
        difference = self.states(values, chosen)[..., 1:, use] - self.windows.measured[chosen][:, 1:, use]
        scaled = difference / self.windows.spread[use]
        lost = np.isnan(scaled) & ~np.isnan(self.windows.measured[chosen][:, 1:, use])
        scaled = np.clip(np.where(lost, 10.0, scaled), -10.0, 10.0)
        return scaled * (self.windows.weight[use] * len(use))


def errors(residuals: np.ndarray) -> np.ndarray:
    """(n, W) replay error of each window: mean absolute normalised residual, 1 = the size of the motion."""
    return np.nanmean(np.abs(residuals), axis=(2, 3))


def _come_from(
    robot: Robot, recording: Recording, cuts: list[tuple[int, int, int]]
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Velocities (W, 2) of a planar base at the first row of each window, and what it was told before (W, L, A).

    From the poses around that row, those before it included. NaN where they are too rare: there commands say more. So
    they do where control is timed and another command begins, for poses may stand there alone; and such an episode
    starts from standstill, unless several poses show otherwise.
    """
    state, period = recording.columns(robot.channels), _period(recording)
    if pose_columns(robot) is None:
        return None, None
    actions = _action_columns(robot, recording)
    told = [held(e.values[:, actions], np.zeros(len(actions))) for e in recording.episodes]
    timed, reach = robot.file.robot.control == "timed", max(round(SPAN / period), 1)
    velocity = np.empty((len(cuts), 2))
    before = np.zeros((len(cuts), max(round(BEFORE / period), 1), len(actions)))
    for w, (number, start, _) in enumerate(cuts):
        values, near = recording.episodes[number].values, told[number][max(start - reach, 0) : start + reach]
        velocity[w] = base_velocities(robot, values[:, state], np.array([start]), period)[0]
        some = told[number][max(start - before.shape[1], 0) : start]
        before[w, before.shape[1] - len(some) :] = some
        few = np.isfinite(values[start : start + reach + 1][:, state]).all(axis=1).sum() < ENOUGH
        if timed and ((near != near[0]).any() or (start < reach and few)):
            velocity[w] = np.nan
    return velocity, before if np.isnan(velocity).any() else None


def _action_columns(robot: Robot, recording: Recording) -> np.ndarray:
    missing = [name for name in robot.actions if name not in recording.names]
    if missing or not robot.actions:
        raise LogError(
            f"the recording has no commands ({missing[0] if missing else 'the robot has no actions'})",
            expected=f"the channels {list(robot.actions)}",
            do="record the commands too: without them nothing can be replayed or compared",
        )
    return recording.columns(robot.actions)


def _startable(robot: Robot, recording: Recording) -> list[np.ndarray]:
    """(T,) of each episode: rows at which all is known that was ever measured; a replay can start there."""
    state = recording.columns(robot.channels)
    finite = [np.isfinite(e.values[:, state]) for e in recording.episodes]
    known = np.any([f.any(axis=0) for f in finite], axis=0)
    rows = [f[:, known].all(axis=1) for f in finite]
    # channels that are never measured together: the engine fills in what is missing at the start
    return rows if any(r.any() for r in rows) else [f.any(axis=1) for f in finite]


def _cuts(
    robot: Robot, recording: Recording, number: int, startable: list[np.ndarray]
) -> list[tuple[int, int, int]]:
    """(episode, first row, one past the last row) of the windows of one episode in which there is motion to see."""
    episode = recording.episodes[number]
    rows = len(episode.time)
    horizon = robot.file.replay.horizon
    length = rows if horizon is None else min(rows, int(round(horizon / _period(recording))) + 1)
    weighted = recording.columns([c.name for c in robot.file.channels if c.weight > 0])
    out = []
    for begin in range(0, rows - length + 1, max(length - 1, 1)):
        stop = begin + length
        starts = begin + np.flatnonzero(startable[number][begin:stop])
        if len(starts) and np.isfinite(episode.values[starts[0] + 1 : stop, weighted]).any():
            out.append((number, int(starts[0]), stop))
    return out


def _period(recording: Recording) -> float:
    gaps = np.concatenate([np.diff(e.time) for e in recording.episodes if len(e.time) > 1] or [[0.0]])
    period = float(np.median(gaps))
    if not period > 0:
        raise LogError(
            "the recording has one row an episode",
            expected="commands and the states after them",
            do="record longer",
        )
    return period


def _begins(recording: Recording, cuts: list[tuple[int, int, int]]) -> np.ndarray:
    """(W,) seconds from the start of the log to that of each window.

    Episodes whose clocks all start anew are taken to follow each other.
    """
    first = np.array([e.time[0] for e in recording.episodes])
    lasted = np.array([e.time[-1] - e.time[0] for e in recording.episodes])
    if len(first) > 1 and not (np.diff(first) > 0).all():
        first = np.concatenate([[0.0], np.cumsum(lasted)[:-1]])
    starts = first - first[0]
    return np.array(
        [starts[n] + recording.episodes[n].time[a] - recording.episodes[n].time[0] for n, a, _ in cuts]
    )


def _settings(robot: Robot, recording: Recording) -> np.ndarray:
    nominal = {s.name: s.nominal for s in robot.file.settings}
    return np.array(
        [[e.settings.get(name, nominal[name]) for name in robot.settings] for e in recording.episodes]
    ).reshape(len(recording.episodes), len(robot.settings))


def _scales(robot: Robot, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spread of each channel, never below its noise, and the weights of the channels that were measured.

    That of a base's yaw is never above `ANYWHERE`.
    """
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a channel that was never measured
        spread = np.nanstd(measured, axis=(0, 1))
    if (pose := pose_columns(robot)) is not None:
        spread[pose[2]] = min(spread[pose[2]], ANYWHERE)
    floor = np.array([max(c.noise, c.quantum, 1e-9) for c in robot.file.channels])
    weight = np.array([c.weight for c in robot.file.channels]) * np.isfinite(measured).any(axis=(0, 1))
    if not weight.sum() > 0:
        raise LogError(
            "no channel with a weight was measured",
            expected=f"one of {[c.name for c in robot.file.channels if c.weight > 0]}",
            do="add it to the map, or give another channel a weight in robot.toml",
        )
    return np.maximum(np.nan_to_num(spread), floor), weight / weight.sum()
