"""A run of a gait as a log for Foxglove: what the simulator does and, beside it, what the robot did."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dynreg.data.names import joint_of
from dynreg.data.recording import Episode, Recording
from dynreg.errors import LogError
from dynreg.gait.play import require_new, require_playable, write_new
from dynreg.gait.runs import Motion, Topic, joint_states, mcap, topics
from dynreg.gait.trials import Trials
from dynreg.registry import Registry
from dynreg.results import Gait
from dynreg.sim.layout import BASE, layout_of
from dynreg.sim.robot import Robot, require_commands
from dynreg.walks import gait_of, told, trials_of

SIMULATED, MEASURED, COMMANDS = "simulated", "measured", "/joint_commands"
SAME = 1e-4  # relative: two rates that differ by what stamps are rounded to
ATTITUDE = ("yaw", "pitch", "roll")  # about axes that turn with the body, in this order


def side_by_side(registry: Registry, ref: str | Path | Gait, path: Path) -> Gait:
    """Write a run of a gait to a new MCAP file; the gait.

    ref : a gait, itself, its id, `@last` or the path of its JSON: its own commands, simulated. A recording that was
    ingested as a trial of a gait: the recording's commands, its joints and base, and simulated under just these
    commands. The simulator is the one in which the gait walks least. In every episode both begin at the same place.
    Raises UsageError for a gait that cannot be played and a file that cannot be written, NoMatchError where the
    registry lacks the robot or the simulators, LogError where the recording holds no commands.
    """
    require_new(path)
    gait, recording = _asked(registry, ref)
    require_playable(gait)
    if recording is None:
        trials, least = trials_of(registry, gait, gait.seconds, gait.rate)
        out = _rerun(trials, least, told(trials, gait))
    else:
        out = [topic for e in recording.episodes for topic in _beside(registry, gait, recording, e)]
    write_new(path, mcap(_joined(out)))
    return gait


def _asked(registry: Registry, ref: str | Path | Gait) -> tuple[Gait, Recording | None]:
    """The gait, and the recording that was made as it was played, where `ref` is one."""
    if isinstance(ref, Gait):
        return ref, None
    if ref != "@last" and not Path(ref).is_file():
        kind, identity = registry.resolve(str(ref), ("result", "recording"))
        recording = registry.recording(identity) if kind == "recording" else None
        if recording is not None and "gait" in recording.provenance:
            return gait_of(registry, recording.provenance["gait"]), recording
    return gait_of(registry, ref), None


def _beside(registry: Registry, gait: Gait, recording: Recording, episode: Episode) -> Iterator[Topic]:
    """The topics of one episode."""
    times = episode.time - episode.time[0]
    if len(times) < 2:
        return
    rate = 1.0 / float(np.median(np.diff(times)))
    rate = gait.rate if np.isclose(rate, gait.rate, rtol=SAME) else rate
    trials, least = trials_of(registry, gait, (len(times) - 1) / rate, rate)
    robot = trials.robot
    require_commands(robot, recording)
    actions = _held(episode.values[:-1, recording.columns(robot.actions)], episode.name)
    begin = float(episode.time[0] - recording.episodes[0].time[0])
    simulated = _simulated(trials, least, actions)
    measured = _measured(robot, recording, episode, simulated)
    names = _names(robot)
    commands = joint_states(COMMANDS, robot.joints, times[:-1] + begin, actions)
    yield commands
    for name, motion in ((SIMULATED, simulated), (MEASURED, measured)):
        yield from topics(name, names, replace(motion, times=motion.times + begin))


def _rerun(trials: Trials, simulator: int, actions: np.ndarray) -> list[Topic]:
    commands = joint_states(COMMANDS, trials.robot.joints, trials.times, actions)
    return [commands, *topics(SIMULATED, _names(trials.robot), _simulated(trials, simulator, actions))]


def _joined(parts: list[Topic]) -> list[Topic]:
    """Topics of one name as one."""
    out: dict[str, Topic] = {}
    for part in parts:
        before = list(out[part.name].messages) if part.name in out else []
        out[part.name] = replace(part, messages=[*before, *part.messages])
    return list(out.values())


def _names(robot: Robot) -> list[str]:
    """The joints whose position the robot's channels hold."""
    return [joint_of(robot.channels[c]) for c in layout_of(robot).position[0]]


def _held(actions: np.ndarray, name: str) -> np.ndarray:
    """Commands (T, A) without gaps: each holds until the next, the first one known from the start on."""
    known = np.isfinite(actions)
    if not known.any(axis=0).all():
        raise LogError(
            f"episode {name!r} holds no commands of some joints",
            expected="the commands that were played",
            do="log them too and map them",
        )
    last = np.maximum.accumulate(np.where(known, np.arange(len(actions))[:, None], -1), axis=0)
    return np.take_along_axis(actions, np.where(last < 0, known.argmax(axis=0), last), axis=0)


def _simulated(trials: Trials, simulator: int, actions: np.ndarray) -> Motion:
    """What a simulator does under joint commands (T, A); NaN from a divergence on."""
    layout = layout_of(trials.robot)
    _, poses = trials.poses(actions, simulator)
    base = poses[:, layout.base_qpos : layout.base_qpos + 7]
    attitude = np.roll(base[:, 3:], -1, axis=1)  # MuJoCo's begin with w
    return Motion(np.arange(len(poses)) / trials.rate, poses[:, layout.position[1]], base[:, :3], attitude)


def _measured(robot: Robot, recording: Recording, episode: Episode, simulated: Motion) -> Motion:
    """The robot's joints and base, from where the simulated one begins and looking the same way.

    Where the base's position is not measured, that over the ground is reckoned from its velocity, and its height stays.
    """
    columns = {name: i for i, name in enumerate(recording.names)}
    lost = np.full(len(episode.time), np.nan)
    channel = lambda name: episode.values[:, columns[name]] if name in columns else lost  # noqa: E731
    owner = next((joint_of(robot.channels[c]) for c in layout_of(robot).base[0]), "")
    of = lambda *names: np.stack([channel(f"{owner}/{name}") for name in names], axis=1)  # noqa: E731
    joints = np.stack([channel(f"{name}/position") for name in _names(robot)], axis=1)
    angles = of(*ATTITUDE)
    known = np.isfinite(angles).all(axis=1)
    position, attitude = np.full((len(lost), 3), np.nan), np.full((len(lost), 4), np.nan)
    times = episode.time - episode.time[0]
    if known.any():
        start = Rotation.from_quat(simulated.attitude[0]).as_euler("ZYX")[0]
        turned = start - angles[known][0, 0]
        angles[:, 0] += turned
        rotation = Rotation.from_euler("ZYX", angles[known])
        attitude[known] = rotation.as_quat()
        steps = np.diff(times[known], prepend=times[known][:1])[:, None]
        velocity = rotation.apply(np.nan_to_num(of("vx", "vy", "vz")[known]))
        way = np.cumsum(velocity * steps, axis=0)
        way[:, 2] = 0.0
        there = Rotation.from_euler("Z", turned).apply(of(*BASE[:3])[known] - of(*BASE[:3])[known][0])
        position[known] = simulated.position[0] + np.where(np.isfinite(there), there, way)
    return Motion(times, joints, position, attitude)
