"""The parts of a recording: fit and select choose the answer, test is read once, at the end."""

from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.names import fits, piece_of
from dynreg.data.recording import Episode, Recording
from dynreg.errors import UsageError
from dynreg.replay.timed import on_grid
from dynreg.replay.windows import Windows
from dynreg.rng import stream
from dynreg.sim.robot import Robot

CUT = (
    "give [replay] of robot.toml a horizon of at most a quarter of the episode (it cuts none of a robot on feet"
    ' with base = "keyframe")'
)  # what to do where one rollout cannot be parted


@dataclass(frozen=True)
class Parts:
    """Masks (W,) over the windows of a recording; a window is in one of them at most."""

    fit: np.ndarray
    select: np.ndarray
    test: np.ndarray

    @property
    def chosen(self) -> np.ndarray:
        """Numbers of the windows that the query may look at."""
        return np.flatnonzero(self.fit | self.select)

    @property
    def train(self) -> np.ndarray:
        """Numbers of the windows that are not held out, those in no part among them."""
        return np.flatnonzero(~self.test)


def parts(
    recording: Recording,
    windows: Windows,
    hold_out: str | None,
    seed: int = 0,
    selected: float = 0.25,
    paired: bool = False,
) -> Parts:
    """Split by trajectory; by blocks of windows where there are fewer than four episodes.

    hold_out : the test part: "SETTING=VALUE" (such as kp=400), names of episodes separated by commas, or a
    share of the episodes such as 0.25. None holds out a fifth, and none of fewer than three; "0" none at all.
    selected : share of the rest that is to select by. paired : instead of it, trajectories alike make pairs, and one
    of each pair is to select by: what shows in one kind of motion alone is then seen by fit and select.
    Raises UsageError where the test part is empty, everything, or not understood.
    """
    groups = windows.episode
    if len(np.unique(groups)) < 4 and len(windows) >= 4:
        groups = np.arange(len(windows))
    numbers = np.unique(groups)
    test = _test_groups(recording, windows, groups, numbers, hold_out, seed)
    rest = np.setdiff1d(numbers, test)
    if not len(rest):
        less = "hold out less" if len(numbers) > 1 else CUT
        raise UsageError(
            f"hold-out {hold_out!r} leaves nothing to choose by",
            expected="a part of the episodes",
            do=f"{less}, or record more episodes",
        )
    rng = stream(seed, "parts")
    mixed = rng.permutation(rest)
    select = _one_of_each_pair(windows, groups, mixed) if paired else mixed[: int(selected * len(rest))]
    is_test, is_select = np.isin(groups, test), np.isin(groups, select)
    return Parts(~is_test & ~is_select, is_select, is_test)


def thinned(split: Parts, episode: np.ndarray, most: int, seed: int = 0) -> Parts:
    """At most so many windows in fit and in select; those left out are in no part.

    Both are drawn over all episodes that are not held out, in turn: where each episode is a motion of its own kind, a
    part that lacks one could not tell what only this one shows. episode : (W,) number of each window's episode.
    """
    mixed = stream(seed, "windows").permutation(split.chosen)
    if len(np.unique(episode[mixed])) == len(mixed):  # every window is an episode of its own: parted already
        fit, select = (mixed[part[mixed]][:most] for part in (split.fit, split.select))
    else:
        turn = np.array([int(np.sum(episode[mixed[:i]] == episode[w])) for i, w in enumerate(mixed)])
        mixed = mixed[np.lexsort((episode[mixed], turn))]
        turn = np.sort(turn)
        fit, select = mixed[turn % 2 == 0][:most], mixed[turn % 2 == 1][:most]
    number = np.arange(len(split.fit))
    return Parts(np.isin(number, fit), np.isin(number, select), split.test)


def names(recording: Recording, windows: Windows, mask: np.ndarray) -> tuple[str, ...]:
    """The episodes that a part is cut from, with the window's start [s] where an episode has several."""
    out = []
    for w in np.flatnonzero(mask):
        number = windows.episode[w]
        same = np.flatnonzero(windows.episode == number)
        name = recording.episodes[number].name
        out.append(name if len(same) == 1 else piece_of(name, int(np.flatnonzero(same == w)[0])))
    return tuple(out)


def seen(recording: Recording, windows: Windows, chosen: np.ndarray) -> Recording:
    """The recording with the rows of the windows `chosen` (numbers) alone; windows in a row stay one episode."""
    runs: list[tuple[int, int, int]] = []
    for w in np.sort(chosen):
        number, (start, stop) = int(windows.episode[w]), windows.rows[w]
        if runs and runs[-1][0] == number and runs[-1][2] == start + 1:
            runs[-1] = (number, runs[-1][1], int(stop))
        else:
            runs.append((number, int(start), int(stop)))
    episodes = []
    for number, start, stop in runs:
        e = recording.episodes[number]
        whole = sum(run[0] == number for run in runs) == 1
        name = e.name if whole else f"{e.name}[{start}:{stop}]"
        episodes.append(Episode(name, e.time[start:stop], e.values[start:stop], e.settings))
    return Recording(recording.channels, tuple(episodes), recording.measured, recording.provenance)


def train_part(robot: Robot, recording: Recording, windows: Windows, parts: Parts) -> Recording:
    """The recording without the test part: episodes of which nothing is held out, of others the windows left.

    Such pieces have the rows of `timed.on_grid`.
    """
    held = np.unique(windows.episode[parts.test])
    whole = [e for number, e in enumerate(recording.episodes) if number not in held]
    others = parts.train[np.isin(windows.episode[parts.train], held)]
    pieces = seen(on_grid(robot, recording), windows, others).episodes if len(others) else ()
    return replace(recording, episodes=(*whole, *pieces))


def _one_of_each_pair(windows: Windows, groups: np.ndarray, mixed: np.ndarray) -> np.ndarray:
    """Of the trajectories `mixed` (numbers in random order), the second of every pair of the closest."""
    features = []
    known = np.isfinite(windows.measured).any(axis=(0, 1))
    for number in mixed:
        mine = groups == number
        actions, settings = windows.run.actions[mine], windows.run.settings
        states = np.nan_to_num(windows.measured[mine][..., known] / windows.spread[known])
        rows = [
            actions.mean(axis=(0, 1)),
            actions.std(axis=(0, 1)),
            np.abs(np.diff(actions, axis=1)).sum(axis=(0, 1)) / actions[..., 0].size,
        ]
        rows += [states.mean(axis=(0, 1)), states.std(axis=(0, 1))]
        features.append(
            np.concatenate([*rows, np.zeros(0) if settings is None else settings[mine].mean(axis=0)])
        )
    table = np.nan_to_num(np.array(features))  # windows of one row have no changes
    table = table / np.where(table.std(axis=0) > 0, table.std(axis=0), 1.0)
    apart = np.linalg.norm(table[:, None] - table[None], axis=2)
    apart[np.tril_indices(len(mixed))] = np.inf
    select = []
    for flat in np.argsort(apart, axis=None, kind="stable"):
        first, second = np.unravel_index(flat, apart.shape)
        if not np.isfinite(apart[first, second]):
            continue
        apart[[first, second]] = apart[:, [first, second]] = np.inf
        select.append(mixed[second])
    return np.array(select, dtype=int)


def _test_groups(
    recording: Recording,
    windows: Windows,
    groups: np.ndarray,
    numbers: np.ndarray,
    hold_out: str | None,
    seed: int,
) -> np.ndarray:
    if hold_out is None:
        hold_out = "0.2" if len(numbers) >= 3 else "0"
    share = _as_share(hold_out)
    if share is not None:
        count = 0 if share == 0 else max(1, round(share * len(numbers)))
        return np.sort(stream(seed, "hold out").permutation(numbers)[:count])
    chosen = [i for i, episode in enumerate(recording.episodes) if _matches(episode, hold_out)]
    asked = [] if "=" in hold_out else [name.strip() for name in hold_out.split(",")]
    if not chosen or not all(any(_called(e.name, one) for e in recording.episodes) for one in asked):
        known = sorted({f"{k}={v:g}" for e in recording.episodes for k, v in e.settings.items()})
        raise UsageError(
            f"hold-out {hold_out!r} names what is no episode"
            if chosen
            else f"hold-out {hold_out!r} fits no episode",
            expected=f"a setting ({', '.join(known) or 'none here'}), episode names "
            f"({', '.join(e.name for e in recording.episodes[:6])}, ...) or a share such as 0.25",
            do="correct it, or leave it out to hold out a fifth of the episodes",
        )
    found = np.unique(groups[np.isin(windows.episode, chosen)])
    if not len(found):
        raise UsageError(
            f"hold-out {hold_out!r} has no rollout to test on",
            expected="an episode with measured rows enough",
            do="hold out another",
        )
    return found


def _as_share(hold_out: str) -> float | None:
    try:
        share = float(hold_out)
    except ValueError:
        return None
    if not 0 <= share < 1:
        raise UsageError(
            f"hold-out share {share:g}", expected="0 to below 1", do="hold out less, such as 0.25"
        )
    return share


def _called(episode: str, asked: str) -> bool:
    """Whether an episode has a name, or one of a pattern, or is one of the joined recording of that name.

    >>> _called("air/e1", "air"), _called("air/e1", "air/*"), _called("air/e1", "e1")
    (True, True, False)
    """
    return fits(episode, asked) or episode.startswith(f"{asked}/")


def _matches(episode, hold_out: str) -> bool:
    setting, equals, value = hold_out.partition("=")
    if not equals:
        return any(_called(episode.name, name.strip()) for name in hold_out.split(","))
    try:
        wanted = [float(v) for v in value.split(",")]
    except ValueError:
        return False
    return any(np.isclose(episode.settings.get(setting.strip(), np.nan), v) for v in wanted)
