"""What a simulator does under commands that a robot was told and, beside it, what the robot did."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dynreg.data.names import joint_of
from dynreg.data.recording import Episode, Recording
from dynreg.data.topics import Motion, Topic, in_order, joint_states, topics
from dynreg.errors import LogError
from dynreg.gait.trials import Trials
from dynreg.replay.timed import held
from dynreg.sim.layout import BASE, layout_of
from dynreg.sim.robot import Robot, require_commands

SIMULATED, MEASURED, COMMANDS = "simulated", "measured", "/joint_commands"
SAME = 1e-4  # relative: two rates that differ by what stamps are rounded to
ATTITUDE = ("yaw", "pitch", "roll")  # about axes that turn with the body, in this order


def rerun(trials: Trials, simulator: int, actions: np.ndarray) -> list[Topic]:
    """Joint commands (T, A), and what a simulator (its number) does under them."""
    told = joint_states(COMMANDS, trials.robot.joints, trials.times, actions)
    return [told, *topics(SIMULATED, _names(trials.robot), _simulated(trials, simulator, actions))]


def rate_of(episode: Episode, usual: float) -> float:
    """Rows a second [Hz] of an episode; `usual` where it differs by no more than stamps are rounded to."""
    rate = 1.0 / float(np.median(np.diff(episode.time - episode.time[0])))
    return usual if np.isclose(rate, usual, rtol=SAME) else rate


def beside(trials: Trials, simulator: int, recording: Recording, episode: Episode) -> list[Topic]:
    """An episode's commands, its joints and base, and a simulator (its number) under just these commands.

    Both begin at the same place. Raises LogError where the recording holds no commands.
    """
    robot = trials.robot
    actions = commands_of(robot, recording, episode)[:-1]
    begin = float(episode.time[0] - recording.episodes[0].time[0])
    simulated = _simulated(trials, simulator, actions)
    logged = measured(robot, recording, episode, simulated)
    times = episode.time[:-1] - episode.time[0] + begin
    out = [joint_states(COMMANDS, robot.joints, times, actions)]
    for name, motion in ((SIMULATED, simulated), (MEASURED, logged)):
        out += topics(name, _names(robot), replace(motion, times=motion.times + begin))
    return out


def joined(parts: list[Topic]) -> list[Topic]:
    """Topics of one name as one, in the order of time: episodes may each begin at 0."""
    named: dict[str, list[Topic]] = {}
    for part in parts:
        named.setdefault(part.name, []).append(part)
    return [replace(some[0], messages=in_order(*(part.messages for part in some))) for some in named.values()]


def _names(robot: Robot) -> list[str]:
    """The joints whose position the robot's channels hold."""
    return [joint_of(robot.channels[c]) for c in layout_of(robot).position[0]]


def commands_of(robot: Robot, recording: Recording, episode: Episode) -> np.ndarray:
    """(T, A) commands of an episode without gaps: each holds until the next, the first one known from the start on.

    Raises LogError where the recording holds no commands.
    """
    require_commands(robot, recording)
    actions = episode.values[:, recording.columns(robot.actions)]
    known = np.isfinite(actions)
    if not known.any(axis=0).all():
        raise LogError(
            f"episode {episode.name!r} holds no commands of some joints",
            expected="the commands that were played",
            do="log them too and map them",
        )
    return held(actions, np.take_along_axis(actions, known.argmax(axis=0)[None], axis=0)[0])


def _simulated(trials: Trials, simulator: int, actions: np.ndarray) -> Motion:
    """What a simulator does under joint commands (T, A); NaN from a divergence on."""
    layout = layout_of(trials.robot)
    _, poses = trials.poses(actions, simulator)
    base = poses[:, layout.base_qpos : layout.base_qpos + 7]
    attitude = np.roll(base[:, 3:], -1, axis=1)  # MuJoCo's begin with w
    return Motion(np.arange(len(poses)) / trials.rate, poses[:, layout.position[1]], base[:, :3], attitude)


def base_of(robot: Robot) -> str:
    """The free joint whose motion the robot's channels tell; "" where none does."""
    return next((joint_of(robot.channels[c]) for c in layout_of(robot).base[0]), "")


def measured(robot: Robot, recording: Recording, episode: Episode, start: Motion) -> Motion:
    """The robot's joints and base, from where `start` begins and looking the same way; NaN where that is not known.

    Where the base's place is not measured, it is reckoned from its velocity, and its height stays.
    """
    columns = {name: i for i, name in enumerate(recording.names)}
    lost = np.full(len(episode.time), np.nan)
    channel = lambda name: episode.values[:, columns[name]] if name in columns else lost  # noqa: E731
    owner = base_of(robot)
    of = lambda *names: np.stack([channel(f"{owner}/{name}") for name in names], axis=1)  # noqa: E731
    joints = np.stack([channel(f"{name}/position") for name in _names(robot)], axis=1)
    angles = of(*ATTITUDE)
    known = np.isfinite(angles).all(axis=1)
    position, attitude = np.full((len(lost), 3), np.nan), np.full((len(lost), 4), np.nan)
    times = episode.time - episode.time[0]
    if known.any():
        turned = Rotation.from_quat(start.attitude[0]).as_euler("ZYX")[0] - angles[known][0, 0]
        angles[:, 0] += turned
        rotation = Rotation.from_euler("ZYX", angles[known])
        attitude[known] = rotation.as_quat()
        places, height = of(*BASE[:2]), of(BASE[2])
        seen = np.isfinite(places).all(axis=1)
        if seen.any():
            ahead = np.where(seen[:, None], places - places[seen][0], np.nan)
            ahead = Rotation.from_euler("Z", turned).apply(np.column_stack([ahead, np.zeros(len(ahead))]))
        else:
            ahead = np.full((len(lost), 3), np.nan)
            ahead[known] = _reckoned(times[known], rotation, of("vx", "vy", "vz")[known])
        risen = height - height[np.isfinite(height)][:1] if np.isfinite(height).any() else 0.0
        position = start.position[0] + np.column_stack([ahead[:, :2], np.broadcast_to(risen, (len(lost), 1))])
    return Motion(times, joints, position, attitude)


def _reckoned(times: np.ndarray, rotation: Rotation, velocity: np.ndarray) -> np.ndarray:
    """(T, 3) way [m] by velocities (T, 3) [m/s] in the body's frame, those between known ones interpolated."""
    filled = np.zeros_like(velocity)  # a velocity that is never measured adds nothing
    for column, values in enumerate(velocity.T):
        known = np.isfinite(values)
        if known.any():
            filled[:, column] = np.interp(times, times[known], values[known])
    return np.cumsum(rotation.apply(filled) * np.diff(times, prepend=times[:1])[:, None], axis=0)
