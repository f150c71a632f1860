"""Repeatability of runs with the same commands: the noise floor of any model; and a whiteness test of residuals."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.names import quantity_of
from dynreg.data.recording import Episode, Recording
from dynreg.replay.samples import correlation_time
from dynreg.replay.windows import Windows, standing
from dynreg.sim.robot import Robot

# What counts as a run of the same commands. On the real XL330 such runs differ by up to 0.0065 in their commands, by
# 0.024 of the spread where they start; others by 0.9 and more in their commands.
LONGEST_SHIFT = 0.5  # s by which the commands of two runs may lie apart in their episodes
SHORTEST = 0.5  # s that two runs must have in common
ALIKE = 0.01  # mean difference of the commands of two runs, in standard deviations of each over the recording
START = 0.25  # of a channel's spread: further apart at the start, two runs are not the same experiment
SIGMA = 6.0  # or as many standard deviations of its noise, where that is more: three of either start
RATES = 0.01  # by which the rates of two runs may differ: more, and rows do not lie beside each other
GLANCE, ROUGHLY = 64, 5  # rows at which shifts are sorted out first, where they miss `ALIKE` by so many times
LAGS, LEAST = 20, 8  # of a test for whiteness, at most a fifth of the rows: as is usual; samples it takes
WORLD = ("x", "y", "z", "yaw")  # of a base: where it happens to stand
MANY = 2000  # pairs of windows: enough to know what repeats, few enough that a log at rest costs nothing


@dataclass(frozen=True)
class Repeatability:
    """The floor of one channel, in its unit.

    spread : standard deviation of the difference of repeated runs over sqrt(2); None where nothing repeats.
    stated : standard deviation by the channel's stated noise and quantum; 0 where none is stated.
    pairs, samples : pairs of runs compared and rows in them. independent : samples among these rows that do not just
    repeat the one before; what differs between two runs often does so for long.
    """

    channel: str
    unit: str
    spread: float | None
    stated: float
    pairs: int
    samples: int
    independent: float = 0.0


def repeatability(robot: Robot, recording: Recording) -> tuple[Repeatability, ...]:
    """The run-to-run spread of every channel of the robot, in their order.

    Two episodes repeat each other where their settings are equal, their commands and enable flags agree within
    `ALIKE` (mean size of the difference, in standard deviations of each command over the recording) at one
    shift of at most 0.5 s, and they start alike there. A constant offset between two runs is not counted; of a planar
    base, the offset with which they start.
    """
    stated = robot.sensor_noise
    pairs = repeated(robot, recording)
    out = []
    for c, channel in enumerate(robot.file.channels):
        squares, freedom, used, samples, independent = 0.0, 0, 0, 0, 0.0
        column = recording.names.index(channel.name) if channel.name in recording.names else None
        for a, b in pairs if column is not None else ():
            difference = a[:, column] - b[:, column]
            known = np.flatnonzero(np.isfinite(difference))
            if len(known) < 2:
                continue
            # what a base did wrong it never makes good: there runs part from where they stood at first
            still = _standing(robot, recording, a) if robot.planar else len(difference)
            first = known[known < still] if known[0] < still else known[:1]
            apart = difference[known] - difference[first].mean()
            squares += float(np.sum(apart**2))
            freedom, used, samples = freedom + len(known) - 1, used + 1, samples + len(known)
            independent += max(len(known) / correlation_time(apart) - 1.0, 0.0) if apart.any() else 0.0
        spread = float(np.sqrt(squares / freedom / 2)) if freedom else None
        told = channel.name, channel.unit, spread, float(stated[c]), used, samples, independent
        out.append(Repeatability(*told))
    return tuple(out)


def repeated(robot: Robot, recording: Recording) -> list[tuple[np.ndarray, np.ndarray]]:
    """Every pair of runs of the same commands, as rows (T, C) each that begin at the same command."""
    enables = robot.inputs[len(robot.file.inputs) :]
    told = [name for name in (*robot.actions, *enables) if name in recording.names]
    if not told:
        return []
    commands = recording.columns(told)
    everything = np.concatenate([e.values for e in recording.episodes])
    spread = _spread(everything)
    noise = dict(zip(robot.channels, robot.sensor_noise, strict=True))
    # columns of the state in which two starts are compared: not where a base stands in the world
    starts = [
        c
        for c, name in enumerate(recording.names)
        if name in noise and quantity_of(name) not in WORLD and np.isfinite(spread[c])
    ]
    allowed = np.maximum(START * spread[starts], [SIGMA * noise[recording.names[c]] for c in starts])
    out = []
    for i, first in enumerate(recording.episodes):
        for second in recording.episodes[i + 1 :]:
            a, b = first.settings, second.settings
            if a.keys() != b.keys() or not all(np.isclose(a[k], b[k]) for k in a):
                continue
            cut = _aligned(first, second, commands, spread[commands])
            if cut is not None:
                apart = np.abs(cut[0][0, starts] - cut[1][0, starts])
                if np.all(~np.isfinite(apart) | (apart <= allowed)):
                    out.append(cut)
    return out


def repeated_windows(robot: Robot, windows: Windows) -> np.ndarray:
    """(R, 2) pairs of windows that are runs of the same commands, as in `repeatability`, but at no other shift.

    At most `MANY`, the first.
    """
    run, noise = windows.run, robot.sensor_noise
    enables = run.inputs[..., len(robot.file.inputs) :] if run.inputs is not None else run.actions[..., :0]
    commands = np.concatenate([run.actions, enables], axis=2)
    if not commands.shape[2] or len(commands) < 2:
        return np.zeros((0, 2), dtype=int)
    spread = _spread(commands.reshape(-1, commands.shape[2]))
    # means that lie apart are enough to tell two runs apart; most pairs are sorted out by them
    first, second = np.triu_indices(len(commands), 1)
    means = commands.mean(axis=1)
    alike = _apart(means[first][:, None], means[second][:, None], spread) <= ALIKE
    alike &= np.isclose(run.settings[first], run.settings[second]).all(axis=1)
    starts = [c for c, name in enumerate(robot.channels) if quantity_of(name) not in WORLD]
    allowed = np.maximum(START * windows.spread[starts], SIGMA * noise[starts])
    apart = np.abs(run.initial[first][:, starts] - run.initial[second][:, starts])
    alike &= np.all(~np.isfinite(apart) | (apart <= allowed), axis=1)
    near = np.flatnonzero(alike)[:MANY]
    same = _apart(commands[first[near]], commands[second[near]], spread) <= ALIKE
    return np.stack([first[near], second[near]], axis=1)[same]


def whiteness(series: np.ndarray) -> float | None:
    """The chance that white noise shows at least the autocorrelation of a residual (T,) or (W, T): Ljung-Box test.

    NaN are gaps. Products reach across neither gaps nor rows; one mean is taken off all. Lags go up to 20 samples or a
    fifth of a row's length. None where the series is too short (under 8 samples) or constant.
    """
    from scipy.stats import chi2

    rows = np.atleast_2d(np.asarray(series, dtype=float))
    known, steps = np.isfinite(rows), rows.shape[1]
    samples, longest = int(known.sum()), int(known.sum(axis=1).max(initial=0))
    if samples < LEAST or np.ptp(rows[known]) <= 1e-12 * np.abs(rows[known]).max():
        return None
    x = np.where(known, rows - rows[known].mean(), 0.0)
    by_lag = lambda a: np.fft.irfft(np.abs(np.fft.rfft(a, 2 * steps)) ** 2, 2 * steps)[:, :steps].sum(axis=0)  # noqa: E731
    products, counts = by_lag(x), np.round(by_lag(known.astype(float)))
    correlation = products / products[0]
    at = np.arange(1, min(max(1, min(LAGS, longest // 5)), steps - 1) + 1)
    at = at[counts[at] > 0]
    statistic = float(samples * (samples + 2) * np.sum(correlation[at] ** 2 / counts[at]))
    return float(chi2.sf(statistic, len(at)))


def _standing(robot: Robot, recording: Recording, rows: np.ndarray) -> int:
    """How many rows (T, C) at the start a planar base stands still."""
    actions, states = (rows[None][..., recording.columns(names)] for names in (robot.actions, robot.channels))
    return int(standing(robot, actions[:, :-1], states)[0])


def _aligned(
    first: Episode, second: Episode, commands: np.ndarray, spread: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """The rows that two episodes share at the shift where their commands agree best; None where they do not.

    spread : (A,) of the commands.
    """
    if len(first.time) < 2 or len(second.time) < 2:
        return None
    period = float(np.median(np.diff(first.time)))
    if abs(float(np.median(np.diff(second.time))) - period) > RATES * period:
        return None
    shorter = min(len(first.time), len(second.time))
    if shorter < max(round(SHORTEST / period), 2):
        return None
    most = min(round(LONGEST_SHIFT / period), shorter // 5)
    # small shifts first; most pairs have none at which the commands agree roughly in at most 64 rows
    rows = np.unique(np.linspace(most, shorter - most - 1, GLANCE).astype(int))
    shifts = np.array(sorted(range(-most, most + 1), key=abs))
    a, b = first.values[:, commands], second.values[:, commands]
    near = _apart(a[rows], b[rows - shifts[:, None]], spread)
    best, found = ALIKE, None
    for shift in shifts[near <= ROUGHLY * ALIKE]:
        a, b = first.values[max(shift, 0) :], second.values[max(-shift, 0) :]
        rows = min(len(a), len(b))
        apart = _apart(a[:rows, commands], b[:rows, commands], spread)
        if apart < best or (found is None and apart <= best):
            best, found = apart, (a[:rows], b[:rows])
        if apart == 0:
            break
    return found


def _apart(a: np.ndarray, b: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """(...) largest over the commands (..., T, A) of the mean size of their difference, in units of spread (A,)."""
    difference = np.abs(a - b)
    # a command that one of two runs lacks is a difference; one that both lack is none
    difference = np.where(np.isnan(a) & np.isnan(b), 0.0, np.where(np.isnan(difference), np.inf, difference))
    scale = np.where(np.isfinite(spread) & (spread > 0), spread, 1.0)
    return np.max(difference.mean(axis=-2) / scale, axis=-1)


def _spread(values: np.ndarray) -> np.ndarray:
    """(C,) standard deviation of each column; NaN where it was never measured."""
    known = np.isfinite(values)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, values, 0.0).sum(axis=0) / count
    square = np.where(known, (values - mean) ** 2, 0.0).sum(axis=0) / count
    return np.where(known.any(axis=0), np.sqrt(square), np.nan)
