"""Replay: a recording's own commands in candidate simulators, compared with what the robot did."""

from dataclasses import dataclass, field, replace

import numpy as np

from dynreg.errors import LogError, one_of
from dynreg.replay.residual import by_weight, scaled
from dynreg.replay.velocity import pose_columns
from dynreg.sim.engines import rollout
from dynreg.sim.ports import nominal_ports, takes_positions
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

# rad, standard deviation of a heading that may be any: turns do not add to it
ANYWHERE = np.pi / np.sqrt(3.0)
STILL = 5.0  # times its noise that a channel of a base that stands still may move
MOVES = 3.0  # standard deviations of its noise that a channel must move to be scored: less may be noise


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
        spread, weight = scales(robot, self.measured[chosen], self.run.actions[chosen])
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

    def until(self, steps: int) -> "Windows":
        """The same windows, of `steps` commands at most."""
        rows = self.rows.copy()
        rows[:, 1] = np.minimum(rows[:, 1], rows[:, 0] + steps + 1)
        return replace(self, run=self.run.until(steps), measured=self.measured[:, : steps + 1], rows=rows)


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

    def states(self, values: np.ndarray, chosen: np.ndarray, initial: np.ndarray | None = None) -> np.ndarray:
        """(n, W, T+1, S) what simulators (n, P) do in the chosen windows, without motor noise.

        initial : (W, S) where they start, None for where it was measured.
        """
        self.rollouts += len(values)
        run = self.windows.run.take(chosen)
        run = run if initial is None else replace(run, initial=initial)
        return rollout(self.robot, values, run, threads=self.threads).states

    def residuals(
        self, values: np.ndarray, chosen: np.ndarray, initial: np.ndarray | None = None
    ) -> np.ndarray:
        """(n, W, T, S') normalised and weighted residuals: their mean size in a window is its replay error.

        Channels without weight are left out; see `residual.scaled` and `residual.by_weight`. initial : as in `states`.
        """
        return self.against(self.states(values, chosen, initial), self.windows.measured[chosen])

    def residuals_from(self, values: np.ndarray, chosen: np.ndarray, initial: np.ndarray) -> np.ndarray:
        """(n, W, T, S') the same of one simulator (P,), from other start states (n, W, S) of the chosen windows."""
        many, windows, channels = initial.shape
        run = replace(
            self.windows.run.take(np.tile(chosen, many)), initial=initial.reshape(many * windows, channels)
        )
        self.rollouts += many
        states = rollout(self.robot, values[None], run, threads=self.threads).states[0]
        states = states.reshape(many, windows, *states.shape[1:])
        return self.against(states, self.windows.measured[chosen])

    def against(self, states: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """(n, W, T, S') residuals, as `residuals`, of states (n, W, T+1, S) held against rows (W, T+1, S)."""
        use, weight = self._scored
        rows, spread = measured[:, 1:, use], self.windows.spread[use]
        return scaled(states[..., 1:, use], rows, spread) * by_weight(rows, weight)[:, None]

    @property
    def residual_noise(self) -> np.ndarray:
        """(S',) standard deviation of the residuals of a perfect simulator, by the noise that the robot states."""
        use, weight = self._scored
        rows = self.windows.measured[:, 1:, use].reshape(-1, len(use))
        return self.robot.sensor_noise[use] / self.windows.spread[use] * by_weight(rows, weight)

    @property
    def _scored(self) -> tuple[np.ndarray, np.ndarray]:
        """The channels (S',) that have a weight, and these."""
        use = np.flatnonzero(self.windows.weight > 0)
        return use, self.windows.weight[use]


def errors(residuals: np.ndarray) -> np.ndarray:
    """(n, W) replay error of each window: mean absolute normalised residual, 1 = the size of the motion."""
    return np.nanmean(np.abs(residuals), axis=(2, 3))


def scales(robot: Robot, measured: np.ndarray, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spread (S,) of measured rows (W, T+1, S), never below the noise, and the weights (S,) of channels in them.

    That of a base's yaw is never above `ANYWHERE`. A channel weighs nothing that has no value after the start of a
    window, nor one that is still (`moves`) while others move: its unit would be its noise, and drown theirs. But a
    joint that was told to move by commands (W, T, A), and is `stuck`, has the spread of its commands. Raises LogError
    where no channel with a weight was measured.
    """
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a channel that was never measured
        spread = np.nanstd(measured, axis=(0, 1))
    if (pose := pose_columns(robot)) is not None:
        spread[pose[2]] = min(spread[pose[2]], ANYWHERE)
    spread = np.maximum(np.nan_to_num(spread), _floor(robot))
    weight = np.array([c.weight for c in robot.file.channels]) * np.isfinite(measured[:, 1:]).any(axis=(0, 1))
    if (weight * moves(robot, spread)).any():
        told = stuck(robot, measured, actions)
        spread[list(told)] = list(told.values())
        weight = weight * moves(robot, spread)
    if not weight.sum() > 0:
        raise LogError(
            "no channel with a weight was measured",
            expected=one_of(c.name for c in robot.file.channels if c.weight > 0),
            do="add it to the map, or give another channel a weight in robot.toml",
        )
    return spread, weight / weight.sum()


def follows(robot: Robot) -> list[tuple[int, int]]:
    """(action, channel) of each joint whose drive is told positions, and whose position is a channel."""
    columns = {name: c for c, name in enumerate(robot.channels)}
    held = zip(robot.joints, takes_positions(nominal_ports(robot, 1)), strict=True)
    pairs = [(action, columns.get(f"{joint}/position")) for action, (joint, told) in enumerate(held) if told]
    return [(action, column) for action, column in pairs if column is not None]


def stuck(robot: Robot, measured: np.ndarray, actions: np.ndarray) -> dict[int, float]:
    """Of each measured position that holds still in rows (W, T+1, S) while its joint was told to move by actions
    (W, T, A): its channel, and the standard deviation of those commands within the joint's range.
    """
    floor, out = MOVES * _floor(robot), {}
    for action, column in follows(robot):
        rows = measured[..., column]
        told = float(np.clip(actions[..., action], *robot.action_ranges[action]).std())
        if np.isfinite(rows).any() and np.nanstd(rows) <= floor[column] < told:
            out[column] = told
    return out


def moves(robot: Robot, spread: np.ndarray) -> np.ndarray:
    """(S,) whether channels with this spread (S,) move by more than their noise could."""
    return spread > MOVES * _floor(robot)


def _floor(robot: Robot) -> np.ndarray:
    return np.array([max(c.noise, c.quantum, 1e-9) for c in robot.file.channels])
