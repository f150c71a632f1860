"""A recording cut into windows of equal length, each from a measured state."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import LogError
from dynreg.replay.holes import Hole, hit, holes
from dynreg.replay.rows import Rows, rows_of
from dynreg.replay.standing_place import begins_anywhere, from_the_start
from dynreg.replay.timed import held
from dynreg.replay.velocity import SPAN, base_velocities, pose_columns
from dynreg.replay.windows import Windows, scales, starts
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

LONGEST = 10.0  # s of a rollout if the robot states no horizon; packaged robots state 0.5 to 10 s
BEFORE = 3.0  # s of commands before a window: longer than bases remember
LATE = 1.0  # s of them where no base remembers: longer than any delay, most lags and most profiles
ENOUGH = 4  # poses that tell a velocity better than commands do
Cut = tuple[int, int, int]  # episode, first row, one past the last row


def usual_horizon(robot: Robot, asked: float | None = None) -> float:
    """Longest rollout [s] of a diagnosis or a comparison: as asked for, else the robot's horizon, else `LONGEST`."""
    return asked or robot.file.replay.horizon or LONGEST


def unbroken(
    robot: Robot, recording: Recording, horizon: float, lost: Sequence[Hole] | None = None
) -> Windows:
    """The recording's windows of at most `horizon` [s] without gaps. lost : its `holes`, where they are known.

    Raises as `windows`.
    """
    cut = windows(robot, recording, horizon=horizon)
    lost = holes(robot, recording) if lost is None else lost
    return cut.take(np.flatnonzero(~hit(robot, recording, cut, lost)))


def windows(robot: Robot, recording: Recording, rest: bool = False, horizon: float | None = None) -> Windows:
    """Cut a recording for replay, each window from a measured state; at most `horizon` [s] long.

    horizon : by default the robot's `replay.horizon`, else infinite: then a window is a whole episode.
    Where a robot on feet stands at first is taken out: see `standing_place`.
    rest : whether what is left at the end of an episode is a shorter window; errors are judged in whole ones alone.
    Of robots with control = "timed" on the grid of `timed.on_grid`, to which the windows' `rows` then belong.
    Raises LogError where the recording lacks the commands to replay or has no rows.
    """
    rows = rows_of(robot, recording)
    horizon = horizon or robot.file.replay.horizon or np.inf
    cuts = [cut for number in range(len(rows)) for cut in _cuts(robot, rows, number, rest, horizon)]
    if not cuts:
        raise LogError(
            "no episode has two measured rows in a row",
            expected="commands and the states after them",
            do="record longer",
        )
    actions, inputs, measured = _filled(robot, rows, cuts)
    measured = from_the_start(robot, measured)
    velocity, before = _come_from(robot, rows, cuts)
    numbers, spans = np.array(cuts)[:, 0], np.array(cuts)[:, 1:]
    run = Run(
        actions,
        inputs=inputs,
        settings=rows.settings[numbers],
        velocity=velocity,
        before=before,
        period=rows.period,
        begin=np.array([rows.begin[n] + rows.time[n][first] - rows.time[n][0] for n, first, _ in cuts]),
    )
    run = replace(run, initial=starts(robot, actions, measured, run.rolling))
    spread, weight = scales(robot, measured, actions)
    return Windows(run, measured, spread, weight, numbers, spans, run.period)


def _cuts(robot: Robot, rows: Rows, number: int, rest: bool, horizon: float) -> list[Cut]:
    """The windows of one episode in which there is motion to see: the first alone of a base that no log places."""
    states, startable = rows.states[number], rows.startable[number]
    length = int(min(len(states), np.round(horizon / rows.period) + 1))
    weighted = [i for i, c in enumerate(robot.file.channels) if c.weight > 0]
    most = len(states) - (1 if rest else length - 1)
    out = []
    for begin in range(0, most if begins_anywhere(robot) else min(most, 1), max(length - 1, 1)):
        stop = min(begin + length, len(states))
        first = begin + np.flatnonzero(startable[begin:stop])
        if len(first) and np.isfinite(states[first[0] + 1 : stop, weighted]).any():
            out.append((number, int(first[0]), stop))
    return out


def _filled(robot: Robot, rows: Rows, cuts: list[Cut]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Commands (W, T, A) and inputs (W, T, I), held from row to row of the episode, and measured states (W, T+1, S).

    A shorter window's last commands go on to the end; its states are NaN there.
    """
    steps = max(stop - start for _, start, stop in cuts) - 1
    told = [held(every, np.zeros(len(robot.actions))) for every in rows.actions]
    given = [held(every, robot.input_defaults) for every in rows.inputs]
    actions = np.empty((len(cuts), steps, len(robot.actions)))
    inputs = np.empty((len(cuts), steps, len(robot.inputs)))
    measured = np.full((len(cuts), steps + 1, len(robot.channels)), np.nan)
    for w, (number, start, stop) in enumerate(cuts):
        at = start + np.minimum(np.arange(steps), stop - start - 2)
        actions[w], inputs[w] = told[number][at], given[number][at]
        measured[w, : stop - start] = rows.states[number][start:stop]
    return actions, inputs, measured


def _come_from(robot: Robot, rows: Rows, cuts: list[Cut]) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Velocities (W, 2) of a planar base at the first row of each window, None of all else; and what robots were told
    before (W, L, A), NaN before an episode, None where every window begins one.

    Velocities are those of the poses around that row, those before it included. NaN where they are too rare: there
    commands say more. So they do where control is timed and another command begins, for poses may stand there alone;
    and such an episode starts from standstill, unless several poses show otherwise.
    """
    posed = pose_columns(robot) is not None
    told = [held(actions, np.zeros(len(robot.actions))) for actions in rows.actions]
    timed, reach = robot.file.robot.control == "timed", max(round(SPAN / rows.period), 1)
    velocity = np.empty((len(cuts), 2))
    most = max(round((BEFORE if posed else LATE) / rows.period), 1)
    before = np.full((len(cuts), most, len(robot.actions)), np.nan)
    for w, (number, start, _) in enumerate(cuts):
        some = told[number][max(start - most, 0) : start]
        before[w, most - len(some) :] = some
        if not posed:
            continue
        states, near = rows.states[number], told[number][max(start - reach, 0) : start + reach]
        velocity[w] = base_velocities(robot, states, np.array([start]), rows.period)[0]
        few = np.isfinite(states[start : start + reach + 1]).all(axis=1).sum() < ENOUGH
        if timed and ((near != near[0]).any() or (start < reach and few)):
            velocity[w] = np.nan
    return velocity if posed else None, before if np.isfinite(before).any() else None
