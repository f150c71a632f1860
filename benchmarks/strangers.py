"""Logs of models that others wrote: one parameter altered, simulated by MuJoCo alone, written as a ROS 2 bag.

Nothing here comes from dynreg: the controller, the time step, the noise and the messages are a stranger's. The
simulation takes half the time step that the model asks for.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

RATE = 100.0  # Hz, of commands and sensors
NOISE = 5e-4  # rad, rad/s x 10, m: 1 sigma
Alter = Callable[[mujoco.MjModel], None]


@dataclass(frozen=True)
class Law:
    """How the stranger's robot follows its commands: position targets (kp > 0), speeds (kd alone), or torques.

    share : of each joint's range that the commands cover, about `home`. torque : limit [N m] where the model has none.
    logged : whether the bag holds the targets, or the torques that came of them.
    """

    kp: float
    kd: float
    torque: float
    share: float = 0.3
    speed: float = 0.0
    logged: str = "target"


def drive(
    model: mujoco.MjModel, joints: Sequence[str], home: np.ndarray, law: Law, seconds: float, seed: int
) -> dict[str, np.ndarray]:
    """{time, command, position, velocity, effort, base, attitude, twist} at RATE; the last three of a free base.

    joints : those that are driven. home : (joints,) where the commands begin. Commands are steps held for a while, sums
    of sines, and rests, each joint with its own.
    """
    rng = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    which = [model.joint(name).id for name in joints]
    q, v = model.jnt_qposadr[which], model.jnt_dofadr[which]
    data.qpos[q] = home
    mujoco.mj_forward(model, data)
    model.opt.timestep /= 2
    steps, every = round(seconds * RATE), round(1 / (RATE * model.opt.timestep))
    told = _commands(model, which, home, law, steps, rng)
    rows: dict[str, list[np.ndarray]] = {k: [] for k in ("command", "position", "velocity", "effort", "body")}
    free = int(np.flatnonzero(model.jnt_type == 0)[0]) if (model.jnt_type == 0).any() else None
    for command in told:
        torque = _torque(data, q, v, command, law)
        rows["command"].append(command if law.logged == "target" else torque)
        rows["position"].append(data.qpos[q].copy())
        rows["velocity"].append(data.qvel[v].copy())
        rows["effort"].append(torque)
        if free is not None:
            at, dof = model.jnt_qposadr[free], model.jnt_dofadr[free]
            rows["body"].append(np.concatenate([data.qpos[at : at + 7], data.qvel[dof : dof + 6]]))
        for _ in range(every):
            data.qfrc_applied[v] = torque if law.logged == "torque" else _torque(data, q, v, command, law)
            mujoco.mj_step(model, data)
        if not np.isfinite(data.qpos).all():
            raise RuntimeError("the stranger's simulation diverges")
    out = {name: np.array(value) for name, value in rows.items()}
    out["time"] = 1.7e9 + np.arange(steps) / RATE
    out["position"] += rng.normal(0, NOISE, out["position"].shape)
    out["velocity"] += rng.normal(0, 10 * NOISE, out["velocity"].shape)
    if free is not None:
        out["body"] += rng.normal(0, NOISE, out["body"].shape)
    return out


def _torque(data: mujoco.MjData, q: np.ndarray, v: np.ndarray, command: np.ndarray, law: Law) -> np.ndarray:
    if law.kp > 0:
        wanted = law.kp * (command - data.qpos[q]) - law.kd * data.qvel[v]
    else:
        wanted = law.kd * (command - data.qvel[v])
    return np.clip(wanted, -law.torque, law.torque)


def _commands(
    model: mujoco.MjModel, which: list[int], home: np.ndarray, law: Law, steps: int, rng: np.random.Generator
) -> np.ndarray:
    """(steps, joints): blocks of 4 s, of steps, of two sines, or of rest."""
    if law.kp > 0:
        ranges = model.jnt_range[which]
        limited = model.jnt_limited[which].astype(bool)
        low = np.where(limited, np.maximum(ranges[:, 0], home - 1.0), home - 1.0)
        high = np.where(limited, np.minimum(ranges[:, 1], home + 1.0), home + 1.0)
        reach = law.share * np.stack([home - low, high - home])
    else:
        reach = np.full((2, len(which)), law.speed)
        home = np.zeros(len(which))
    out = np.tile(home, (steps, 1))
    block = round(4 * RATE)
    for number, first in enumerate(range(round(RATE), steps, block)):
        rows = np.arange(first, min(first + block, steps))
        time = (rows - rows[0]) / RATE
        for j in range(len(which)):
            if number % 3 == 0:  # steps, a second or so each
                level = rng.uniform(-1, 1, 5)[(time / rng.uniform(0.7, 1.3)).astype(int) % 5]
            elif number % 3 == 1:
                level = 0.5 * sum(np.sin(2 * np.pi * f * time) for f in rng.uniform(0.2, 1.5, 2))
            else:
                level = np.where(time < 2.0, np.sin(np.pi * time / 2.0) * rng.choice([-1, 1]), 0.0)
            out[rows, j] = home[j] + np.where(level > 0, level * reach[1, j], level * reach[0, j])
    return out


def write_bag(folder: Path, joints: Sequence[str], log: dict[str, np.ndarray], command: str) -> Path:
    """A rosbag2 folder with MCAP: /joint_states, the commands, and /odom where there is a free base; its MCAP file."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        channel = {
            topic: bag.add_connection(topic, kind, typestore=store)
            for topic, kind in (
                ("/joint_states", "sensor_msgs/msg/JointState"),
                (command, "std_msgs/msg/Float64MultiArray"),
                *([("/odom", "nav_msgs/msg/Odometry")] if log["body"].size else []),
            )
        }

        def put(topic: str, message: object, stamp: int) -> None:
            bag.write(channel[topic], stamp, store.serialize_cdr(message, channel[topic].msgtype))

        for i, time in enumerate(log["time"]):
            stamp = int(round(time * 1e9))
            header = types["std_msgs/msg/Header"](
                stamp=types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9),
                frame_id="odom",
            )
            state = types["sensor_msgs/msg/JointState"](
                header=header,
                name=list(joints),
                position=log["position"][i],
                velocity=log["velocity"][i],
                effort=log["effort"][i],
            )
            put("/joint_states", state, stamp)
            layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
            put(
                command, types["std_msgs/msg/Float64MultiArray"](layout=layout, data=log["command"][i]), stamp
            )
            if log["body"].size:
                put("/odom", _odometry(types, header, log["body"][i]), stamp)
    return next(folder.glob("*.mcap"))


def _odometry(types: dict, header: object, body: np.ndarray) -> object:
    """Pose and twist of a free base, the twist in the base's own frame as ROS has it. body: (13,) qpos, qvel."""
    xyz, quat, linear, angular = body[:3], body[3:7] / np.linalg.norm(body[3:7]), body[7:10], body[10:13]
    turned = np.zeros(3)
    back = quat * np.array([1.0, -1.0, -1.0, -1.0])
    mujoco.mju_rotVecQuat(turned, linear, back)
    point, vector = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Vector3"]
    turn = types["geometry_msgs/msg/Quaternion"](x=quat[1], y=quat[2], z=quat[3], w=quat[0])
    pose = types["geometry_msgs/msg/Pose"](position=point(x=xyz[0], y=xyz[1], z=xyz[2]), orientation=turn)
    twist = types["geometry_msgs/msg/Twist"](
        linear=vector(x=turned[0], y=turned[1], z=turned[2]),
        angular=vector(x=angular[0], y=angular[1], z=angular[2]),
    )
    none = np.zeros(36)
    return types["nav_msgs/msg/Odometry"](
        header=header,
        child_frame_id="base_link",
        pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=none),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=none),
    )
