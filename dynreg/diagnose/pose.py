"""Pose: a recording as an estimation problem, or the error that says why it cannot be one."""

from dataclasses import replace

import numpy as np

from dynreg.data.names import quantity_of
from dynreg.data.recording import Recording
from dynreg.diagnose.joints import fixed_unseen, only_joints
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.starts import changes, from_other_starts
from dynreg.errors import LogError, UsageError
from dynreg.evidence.accuracy import usual
from dynreg.evidence.data import Data
from dynreg.evidence.hypothesis import Coordinates
from dynreg.evidence.model import Model
from dynreg.replay.cut import unbroken, usual_horizon
from dynreg.replay.holes import holes, sentence, without_start
from dynreg.replay.known import known_values
from dynreg.replay.parts import Parts, parts, thinned
from dynreg.replay.windows import Windows, moves
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.effects.contact import can_touch
from dynreg.sim.engine import ENGINES
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, require_commands

FEWEST = 50  # measured rows in each of fit and select, by contract: fewer samples identify no cause
PIECES = 6  # of an episode: one to test, and some to fit and to select by
LOOKED_AT = 16  # windows that tell what the noise of starts leaves, with `starts.STARTS` of each to a tenth
STANDS = 0.05  # rad (m) by which joints may differ from the settled reset pose: more is another pose


def pose(
    robot: Robot, recording: Recording, options: DiagnosisOptions, start: SimConfig | None = None
) -> tuple[Model, Data]:
    """The model that begins at the simulator `start`, and the recording in windows and parts.

    start : by default the nominal simulator; its effects act from the beginning. Windows with a gap in a command, an
    input or a weighted channel are left out.
    Raises LogError if the recording is too short, without motion, without commands, or has only one window; UsageError
    if the options do not fit the robot or the recording.
    """
    require_commands(robot, recording)
    if options.joints:
        robot = only_joints(robot, options.joints)
    cut, why = _cut(robot, recording, options)
    split = parts(recording, cut, options.hold_out, paired=True)
    if not split.select.any():
        raise LogError(
            f"no rollout remains for the select part{why}",
            expected="at least two episodes, or pieces of one, besides those that are held out",
            do=f"hold out fewer, or {_more_rollouts(robot, recording)}",
        )
    _check_length(robot, cut, split, why)
    if options.windows:
        split = thinned(split, cut.episode, options.windows, options.seed)
    cut = _settled(robot, cut.scaled_by(robot, split.chosen), options)
    cut = replace(cut, run=replace(cut.run, joints=options.joints))
    _check_motion(robot, cut, split)
    begun = None if start is None or not start.effects else terms_of(start, robot)
    centre = None if start is None else robot.space.from_dict(dict(start.values))
    coordinates = Coordinates(robot, known_values(robot, recording), centre, options.tolerance)
    if options.joints:
        known = fixed_unseen(coordinates, cut.take(split.chosen), options.engine, begun)
        coordinates = Coordinates(robot, known, centre, options.tolerance)
    accuracy = usual(robot, options.engine)
    model = Model(robot, coordinates, options.engine, begun, accuracy)
    values = robot.space.nominal if centre is None else centre
    noise = _noise(robot, cut.take(split.chosen), options, values)
    return model, Data.of(robot, cut, split, accuracy.segment, noise)


def _cut(robot: Robot, recording: Recording, options: DiagnosisOptions) -> tuple[Windows, str]:
    """The recording's windows without gaps, and what to say of gaps and of whole episodes left out ("" without)."""
    horizon = usual_horizon(robot, options.horizon)
    rate = robot.file.robot.control_rate
    if rate is not None and horizon * rate < 2:
        raise UsageError(
            f"horizon {horizon:g} s",
            expected=f"at least two commands, {2 / rate:g} s",
            do="give a longer horizon",
        )
    lost = holes(robot, recording)
    cut = unbroken(robot, recording, horizon, lost)
    told = [sentence(recording, lost)] if lost else []
    told += filter(None, [without_start(robot, recording)])
    why = f": {'; '.join(told)}" if told else ""
    if len(cut) < 2:
        raise LogError(
            f"the recording makes {len(cut)} rollout of {horizon:g} s{why}",
            expected="at least two, one to fit and one to select by; a third tests the result",
            do=_more_rollouts(robot, recording),
        )
    return cut, why


def _more_rollouts(robot: Robot, recording: Recording) -> str:
    """How to get more rollouts: by a horizon that cuts the longest episode in six, or else by a longer log."""
    longest = max((float(np.ptp(e.time)) for e in recording.episodes if len(e.time)), default=0.0)
    rate, horizon = robot.file.robot.control_rate, float(f"{longest / PIECES:.2g}")
    if rate is not None and horizon * rate < 2:
        return "record longer, or more episodes"
    return f"cut them with --horizon {horizon:g} (the longest episode lasts {longest:.3g} s), or record more episodes"


def _check_length(robot: Robot, cut: Windows, split: Parts, why: str) -> None:
    """Raises LogError if the fit or select part has too few measured rows; `why` is added to its text."""
    weighted = [i for i, c in enumerate(robot.file.channels) if c.weight > 0]
    known = np.isfinite(cut.measured[:, 1:, weighted]).any(axis=2).sum(axis=1)
    for part in ("fit", "select"):
        rows = int(known[getattr(split, part)].sum())
        if rows < FEWEST:
            raise LogError(
                f"the {part} part has {rows} measured rows{why}",
                expected=f"at least {FEWEST}",
                do="record longer, or more episodes",
            )


def _settled(robot: Robot, cut: Windows, options: DiagnosisOptions) -> Windows:
    """Windows of a floating base that begin near its settled reset pose, with exactly this pose as their start.

    Measured joint angles with noise would lift feet off the ground, and the robot would turn as it lands. A base that
    begins where the log has it is not moved: legs stand alike wherever it has gone to, tilted or in motion.
    """
    if robot.file.reset.settle <= 0 or not robot.floating:
        return cut
    run = cut.run
    inputs = None if run.inputs is None else run.inputs[:, :1]
    first = replace(run, actions=run.actions[:, :1], inputs=inputs, initial=None)
    stands = rollout(robot, robot.space.nominal[None], first, engine=options.engine, threads=options.threads)
    stands = stands.states[0][:, 0]
    joints = [i for i, name in enumerate(robot.channels) if quantity_of(name) == "position"]
    apart = np.nan_to_num(np.abs(cut.measured[:, 0, joints] - stands[:, joints])).max(axis=1, initial=0.0)
    settled = (apart < STANDS) & ~placed(robot, run.initial)
    return replace(cut, run=replace(run, initial=np.where(settled[:, None], np.nan, run.initial)))


def _noise(robot: Robot, cut: Windows, options: DiagnosisOptions, values: np.ndarray) -> np.ndarray:
    """(S,) 1 sigma of every channel: its sensor's, or what the noise of the starts leaves where that is more.

    A joint that no servo holds never forgets how it set out. The simulator with `values` (P,) tells how much that is,
    in the middle one of some windows: one in which a joint tips over must not count for all. `verdict.lefts` tells it
    of bases. With contacts, where feet slip and stick, it has not been tried.
    """
    if (
        robot.floating
        or robot.planar
        or (ENGINES[robot.running(options.engine)].contacts and can_touch(robot))
    ):
        return robot.sensor_noise
    some = np.unique(np.linspace(0, len(cut) - 1, LOOKED_AT).round().astype(int))
    run = from_other_starts(cut.run, some, robot.sensor_noise)
    states = rollout(robot, values[None], run, engine=options.engine, threads=options.threads).states[0]
    squares = np.square(changes(states, cut.spread))
    known = np.isfinite(squares) & np.isfinite(cut.measured[some])[None, :, 1:]
    each = np.where(known, squares, 0.0).sum(axis=(0, 2)) / np.maximum(known.sum(axis=(0, 2)), 1)
    return np.maximum(robot.sensor_noise, np.sqrt(np.median(each, axis=0)) * cut.spread)


def placed(robot: Robot, initial: np.ndarray) -> np.ndarray:
    """(W,) whether a floating base begins where it was measured, in start states (W, S); see `layout.place_base`."""
    tilt = [i for i, name in enumerate(robot.channels) if quantity_of(name) in ("roll", "pitch")]
    known = np.isfinite(initial[:, tilt]).sum(axis=1) == 2
    return known & (robot.file.reset.base == "measured")


def _check_motion(robot: Robot, cut: Windows, split: Parts) -> None:
    """Raises LogError if commands never change, or no weighted channel moves beyond its noise."""
    actions = cut.run.actions[split.chosen]
    if not (np.ptp(actions, axis=1) > 0).any():
        raise LogError(
            "the commands never change",
            expected="a recording with motion",
            do="record one, for example with the commands that `dynreg excite` writes",
        )
    use = np.flatnonzero(cut.weight > 0)
    if not moves(robot, cut.spread)[use].any():
        raise LogError(
            f"no measured channel moves by more than its noise (for example {robot.channels[use[0]]!r})",
            expected="motion",
            do="record larger motions, or correct the noise in robot.toml",
        )
