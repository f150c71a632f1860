"""tf by its frames, trajectories where their points are to be reached, quaternions as angles."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros_log import START, RosLog, quaternion, trajectory, truth, write_robot

from dynreg.data.attitude import euler
from dynreg.data.contents import contents
from dynreg.data.readers import ReadOptions, read_log
from dynreg.data.series import Series
from dynreg.errors import MapError

ANGLE = st.floats(-1.5, 1.5)


@given(ANGLE, ANGLE, st.floats(-3.1, 3.1), st.floats(0.5, 2.0))
def test_euler_angles_are_those_that_the_quaternion_was_made_of(roll, pitch, yaw, length):
    x, y, z, w = (length * part for part in quaternion(roll, pitch, yaw))
    parts = [Series(np.zeros(1), np.array([value])) for value in (w, x, y, z)]
    for angle, wanted in (("roll", roll), ("pitch", pitch), ("yaw", yaw)):
        assert euler(parts, angle, "base").values[0] == pytest.approx(wanted, abs=1e-6)


def test_a_quaternion_of_zeros_tells_nothing_and_parts_go_together():
    zeros = [Series(np.zeros(2), np.zeros(2))] * 4
    assert np.isnan(euler(zeros, "yaw", "base").values).all()
    with pytest.raises(MapError, match="same stamps"):
        euler([*zeros[:3], Series(np.arange(2.0), np.zeros(2))], "yaw", "base")


def test_transforms_are_told_apart_by_their_frames(tmp_path: Path):
    write_robot(tmp_path / "run.mcap")
    log, told = read_log(tmp_path / "run.mcap"), truth()
    for axis, name in enumerate("xyz"):
        series = log.sources[f"/tf[odom->base_link].transform.translation.{name}"]
        np.testing.assert_array_equal(series.values, told["place"][:, axis])
    assert set(log.sources["/tf[map->odom].transform.translation.x"].values) == {1.0}
    wanted = "/tf[map->odom].transform.translation.x"
    assert set(read_log(tmp_path / "run.mcap", ReadOptions(sources=(wanted,))).sources) == {wanted}


def test_points_of_trajectories_are_straight_lines_until_the_next_takes_over(tmp_path: Path):
    log = RosLog(tmp_path / "run.mcap")
    kind, topic = "trajectory_msgs/msg/JointTrajectory", "/arm"
    log.write(topic, kind, trajectory(log, [(0.0, (0.0,)), (1.0, (1.0,))], 0, ("elbow",)), START)
    log.write(topic, kind, trajectory(log, [(0.5, (0.0,))], 0, ("elbow",)), START + 500_000_000)
    log.close()
    series = read_log(tmp_path / "run.mcap").sources["/arm.point.position[elbow]"]
    at = np.array([0.0, 0.25, 0.49, 0.75, 1.0])
    np.testing.assert_allclose(
        np.interp(at, series.time, series.values), [0, 0.25, 0.49, 0.25, 0], atol=0.011
    )
    assert (np.diff(series.time) >= 0).all() and series.time[-1] == pytest.approx(1.0)


def test_what_a_log_holds(tmp_path: Path):
    write_robot(tmp_path / "run.mcap")
    held = {topic.topic: topic for topic in contents(read_log(tmp_path / "run.mcap"))}
    assert held["/imu"].type == "sensor_msgs/msg/Imu" and held["/imu"].messages == 400
    assert held["/imu"].rate == pytest.approx(100.0) and held["/imu"].end == pytest.approx(3.99)
    assert {"/tf[odom->base_link]", "/arm_controller/joint_trajectory.point"} <= set(held)
    assert "position[left_elbow_joint]" in held["/joint_states"].signals
