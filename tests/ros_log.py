"""A ROS 2 log written as a robot's drivers write it: joint states, a trajectory, an IMU, odometry and tf."""

from pathlib import Path

import numpy as np
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

START = 1_700_000_000_123_456_789  # ns
STEP = 10_000_000
JOINTS = ("left_shoulder_joint", "left_elbow_joint")


def quaternion(roll, pitch, yaw) -> tuple[float, float, float, float]:
    """(x, y, z, w) of turns about z, then y, then x."""
    (cr, cp, cy), (sr, sp, sy) = (f(np.array([roll, pitch, yaw]) / 2) for f in (np.cos, np.sin))
    x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
    return x, y, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy


def truth(seconds: float = 4.0) -> dict[str, np.ndarray]:
    """What the robot does, at each step: angles, rates, commands, attitude and motion."""
    t = np.arange(0.0, seconds, STEP * 1e-9)
    command = np.stack([0.6 * np.sin(2 * t), 0.4 * np.cos(3 * t)], axis=1)
    position = np.stack([0.5 * np.sin(2 * t - 0.1), 0.3 * np.cos(3 * t - 0.1)], axis=1)
    return {
        "time": t,
        "command": command,
        "position": position,
        "velocity": np.gradient(position, t, axis=0),
        "effort": command - position,
        "rpy": np.stack([0.1 * np.sin(t), 0.2 * np.sin(t + 1), 2.0 * t], axis=1),  # a yaw that wraps
        "linear": np.stack([0.5 + 0.1 * np.sin(t), 0.1 * np.cos(t), 0 * t], axis=1),
        "place": np.stack([0.5 * t, 0.1 * t, 0.3 + 0 * t], axis=1),
        "rate": np.stack([0.1 * np.cos(t), 0.2 * np.cos(t + 1), 2.0 + 0 * t], axis=1),
    }


class RosLog:
    """Writes messages of ROS 2 Humble to an MCAP file."""

    def __init__(self, path: Path):
        self.store = get_typestore(Stores.ROS2_HUMBLE)
        self._file = path.open("wb")
        self._writer = Writer(self._file)
        self._writer.start()
        self._channels: dict[str, int] = {}

    def make(self, kind: str, **fields):
        """A message of a type such as "sensor_msgs/msg/Imu"."""
        return self.store.types[kind](**fields)

    def header(self, stamp: int, frame: str = ""):
        """A header with a stamp [ns]."""
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame)

    def vector(self, kind: str, values):
        """A Vector3, Point or Quaternion of these values."""
        return self.make(f"geometry_msgs/msg/{kind}", **dict(zip("xyzw", map(float, values), strict=False)))

    def write(self, topic: str, kind: str, message, stamp: int) -> None:
        """Add one message."""
        if topic not in self._channels:
            text, _ = self.store.generate_msgdef(kind, ros_version=2)
            schema = self._writer.register_schema(kind, "ros2msg", text.encode())
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)
        self._writer.add_message(
            self._channels[topic], stamp, bytes(self.store.serialize_cdr(message, kind)), stamp
        )

    def close(self) -> None:
        """End the file."""
        self._writer.finish()
        self._file.close()


def joint_state(log: RosLog, k: int, told: dict[str, np.ndarray], stamp: int):
    """JointState, whose joints change places from message to message."""
    order = [0, 1] if k % 2 == 0 else [1, 0]
    return log.make(
        "sensor_msgs/msg/JointState",
        header=log.header(stamp),
        name=[JOINTS[i] for i in order],
        **{name: told[name][k][order] for name in ("position", "velocity", "effort")},
    )


def trajectory(log: RosLog, points, stamp: int, joints=JOINTS):
    """JointTrajectory whose points are (seconds from its start, positions)."""
    made = [
        log.make(
            "trajectory_msgs/msg/JointTrajectoryPoint",
            positions=np.array(positions, dtype=float),
            velocities=np.array([]),
            accelerations=np.array([]),
            effort=np.array([]),
            time_from_start=log.make(
                "builtin_interfaces/msg/Duration", sec=int(after), nanosec=round(after % 1 * 1e9)
            ),
        )
        for after, positions in points
    ]
    return log.make(
        "trajectory_msgs/msg/JointTrajectory", header=log.header(stamp), joint_names=[*joints], points=made
    )


def twist(log: RosLog, linear, angular):
    """A Twist."""
    return log.make(
        "geometry_msgs/msg/Twist",
        linear=log.vector("Vector3", linear),
        angular=log.vector("Vector3", angular),
    )


def write_robot(path: Path, told: dict[str, np.ndarray] | None = None, start: int = START) -> None:
    """A log of a robot with two joints and a base that moves."""
    told = truth() if told is None else told
    log = RosLog(path)
    zeros = np.zeros(9), np.zeros(36)
    for k in range(len(told["time"])):
        stamp = start + k * STEP
        turn = log.vector("Quaternion", quaternion(*told["rpy"][k]))
        log.write("/joint_states", "sensor_msgs/msg/JointState", joint_state(log, k, told, stamp), stamp)
        command = trajectory(log, [(0.0, told["command"][k])], 0)
        log.write("/arm_controller/joint_trajectory", "trajectory_msgs/msg/JointTrajectory", command, stamp)
        imu = log.make(
            "sensor_msgs/msg/Imu",
            header=log.header(stamp, "imu"),
            orientation=turn,
            orientation_covariance=zeros[0],
            angular_velocity=log.vector("Vector3", told["rate"][k]),
            angular_velocity_covariance=zeros[0],
            linear_acceleration=log.vector("Vector3", (0, 0, 9.81)),
            linear_acceleration_covariance=zeros[0],
        )
        log.write("/imu", "sensor_msgs/msg/Imu", imu, stamp)
        pose = log.make(
            "geometry_msgs/msg/Pose", position=log.vector("Point", told["place"][k]), orientation=turn
        )
        odometry = log.make(
            "nav_msgs/msg/Odometry",
            header=log.header(stamp, "odom"),
            child_frame_id="base_link",
            pose=log.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=zeros[1]),
            twist=log.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=twist(log, told["linear"][k], told["rate"][k]),
                covariance=zeros[1],
            ),
        )
        log.write("/odom", "nav_msgs/msg/Odometry", odometry, stamp)
        _transforms(log, k, told, turn, stamp)
    log.close()


def _transforms(log: RosLog, k: int, told: dict[str, np.ndarray], turn, stamp: int) -> None:
    """Two transforms, which change places from message to message."""
    frames = [("odom", "base_link", told["place"][k], turn), ("map", "odom", (1.0, 2.0, 0.0), None)]
    made = [
        log.make(
            "geometry_msgs/msg/TransformStamped",
            header=log.header(stamp, parent),
            child_frame_id=child,
            transform=log.make(
                "geometry_msgs/msg/Transform",
                translation=log.vector("Vector3", place),
                rotation=rotation or log.vector("Quaternion", (0, 0, 0, 1)),
            ),
        )
        for parent, child, place, rotation in (frames if k % 2 else frames[::-1])
    ]
    log.write("/tf", "tf2_msgs/msg/TFMessage", log.make("tf2_msgs/msg/TFMessage", transforms=made), stamp)
