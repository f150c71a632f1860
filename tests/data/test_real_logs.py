"""Every measured data set is ingested with its packaged map."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dynreg.data.ingest import doctor, read_log, read_recording
from dynreg.data.maps import read_map
from dynreg.data.recording import Recording
from dynreg.data.schema import ChannelSpec, RecordingSpec

ROBOTS = Path(__file__).parents[2] / "dynreg" / "robots"
JOINTS = ("rotation", "pitch", "elbow", "wrist_pitch", "wrist_roll", "jaw")


def _joint_channels(joints: tuple[str, ...], command: str, unit: str) -> tuple[ChannelSpec, ...]:
    kinds = (("position", "rad", "state"), ("velocity", "rad/s", "state"), (command, unit, "action"))
    return tuple(ChannelSpec(f"{j}/{name}", unit, kind) for j in joints for name, unit, kind in kinds)


SPECS = {
    "servo_pendulum": RecordingSpec(
        "servo_pendulum",
        (
            ChannelSpec("arm/position", "rad", "state", low=-3.2, high=3.2),
            ChannelSpec("arm/velocity", "rad/s", "state"),
            ChannelSpec("arm/target", "rad", "action", low=-3.1, high=3.1),
            ChannelSpec("supply", "V", "input", optional=True),
            ChannelSpec("arm/enabled", "1", "enable", optional=True),
        ),
        ("kp",),
        100.0,
    ),
    "emps": RecordingSpec(
        "emps",
        (
            ChannelSpec("slider/position", "m", "state"),
            ChannelSpec("slider/velocity", "m/s", "state"),
            ChannelSpec("slider/voltage", "V", "action"),
        ),
        (),
        200.0,
    ),
    "so101": RecordingSpec("so101", _joint_channels(JOINTS, "target", "rad"), (), 50.0),
    "simple_pendulum": RecordingSpec(
        "simple_pendulum", _joint_channels(("pivot",), "torque", "N*m"), (), 100.0
    ),
    "double_pendulum": RecordingSpec(
        "double_pendulum", _joint_channels(("shoulder", "elbow"), "torque", "N*m"), (), 500.0
    ),
    "husky": RecordingSpec(
        "husky",
        (
            ChannelSpec("base/speed", "m/s", "state"),
            ChannelSpec("base/yaw_rate", "rad/s", "state"),
            ChannelSpec("imu/yaw_rate", "rad/s", "input"),
        ),
        (),
        10.0,
    ),
}
SETS = {  # robot: (map, files, episodes, rows)
    "servo_pendulum": ("bam_xl330", "bam_xl330_pendulum/raw/*.json", 16, 9568),
    "emps": ("emps_mat", "emps/*.mat", 2, 9936),
    "so101": ("sage_parquet", "sage_so101_arm/*.parquet", 15, 83_958),
    "simple_pendulum": ("dfki_csv", "dfki_simple_pendulum/*.csv", 8, 15_345),
    "double_pendulum": ("dfki_parquet", "dfki_double_pendulum/*.parquet", 10, 45_998),
    "husky": ("husky_bag", "husky_rosbag/*.bag", 1, 3953),
}

FASTER = ("emps", "simple_pendulum")  # logged at twice their control_rate, or more


@cache
def ingest(robot: str, data_dir: Path) -> Recording:
    name, pattern, _, _ = SETS[robot]
    log_map = read_map(ROBOTS / robot / "maps" / f"{name}.toml")
    return read_recording(sorted(data_dir.glob(pattern)), SPECS[robot], log_map)


@pytest.mark.parametrize("robot", SETS)
def test_every_set_is_ingested_whole(robot: str, data_dir: Path):
    recording = ingest(robot, data_dir)
    _, _, episodes, rows = SETS[robot]
    assert recording.names == tuple(c.name for c in SPECS[robot].channels)
    assert (len(recording.episodes), sum(len(e.time) for e in recording.episodes)) == (episodes, rows)
    assert all(np.isfinite(e.values).all() for e in recording.episodes)
    found = {f["check"] for f in recording.provenance["findings"]}
    assert found - {"rate"} <= {"clock", "spike", "units", "jitter"}
    assert ("rate" in found) == (robot in FASTER)
    assert not any("/" in entry["name"] for entry in recording.provenance["files"])


def test_servo_positions_stay_within_a_milliradian_of_the_log(data_dir: Path):
    recording = ingest("servo_pendulum", data_dir)
    files = sorted((data_dir / "bam_xl330_pendulum" / "raw").glob("*.json"))
    for episode, file in zip(recording.episodes, files, strict=True):
        raw = read_log(file).sources["position"]
        inside = raw.time <= episode.time[-1]
        back = np.interp(raw.time[inside], episode.time, episode.values[:, 0])
        assert np.mean(np.abs(back - raw.values[inside])) < 1e-3
    kp400 = [e for e in recording.episodes if e.settings["kp"] == 400]
    assert [e.name.removesuffix("_kp400") for e in kp400] == [
        "sin_sin",
        "lift_and_drop",
        "up_and_down",
        "sin_time_square",
    ]
    enabled = recording.columns(["arm/enabled"])[0]
    assert 0 < kp400[1].values[:, enabled].mean() < 1 and kp400[0].values[:, enabled].all()


def test_servo_duty_follows_the_documented_control_law(data_dir: Path):
    # duty = clip(0.002877 kp (goal - q), -1, 1): so the duty is decoded with the right sign and scale
    for file in sorted((data_dir / "bam_xl330_pendulum" / "raw").glob("*.json"))[::4]:
        log = read_log(file)
        error = log.sources["goal_position"].values - log.sources["position"].values
        law = np.clip(0.002877 * log.metadata["kp"] * error, -1, 1)
        assert np.corrcoef(law, log.sources["duty"].values)[0, 1] > 0.999


@pytest.mark.parametrize("robot", ["servo_pendulum", "emps", "so101", "simple_pendulum", "double_pendulum"])
def test_velocities_are_the_rates_of_their_positions(robot: str, data_dir: Path):
    recording = ingest(robot, data_dir)
    for name in recording.names:
        if not name.endswith("/velocity"):
            continue
        velocity, position = recording.columns([name, name.replace("velocity", "position")])
        rate = [
            np.diff(e.values[::20, position]) * 0.05 / np.median(np.diff(e.time)) for e in recording.episodes
        ]
        mean = [
            np.array([np.trapezoid(e.values[i : i + 21, velocity]) / 20 for i in range(0, 20 * len(r), 20)])
            for e, r in zip(recording.episodes, rate, strict=True)
        ]
        rate, mean = np.concatenate(rate), np.concatenate(mean)
        assert np.dot(rate, mean) / np.dot(rate, rate) == pytest.approx(1.0, abs=0.03), name


def test_bag_and_mcap_of_the_husky_are_the_same_numbers(data_dir: Path):
    folder = data_dir / "husky_rosbag"
    log_map = read_map(ROBOTS / "husky" / "maps" / "husky_bag.toml")
    bag = ingest("husky", data_dir)
    mcap = read_recording(folder / "husky_mcap" / "husky_mcap.mcap", SPECS["husky"], log_map)
    np.testing.assert_array_equal(bag.episodes[0].time, mcap.episodes[0].time)
    np.testing.assert_array_equal(bag.episodes[0].values, mcap.episodes[0].values)
    speed, odometry, gyro = bag.episodes[0].values.T
    assert np.corrcoef(odometry, gyro)[0, 1] > 0.8  # the IMU's y is the robot's z


def test_truncated_husky_mcap_is_salvaged(data_dir: Path, tmp_path: Path):
    data = (data_dir / "husky_rosbag" / "husky_mcap" / "husky_mcap.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 6 // 10])
    log_map = read_map(ROBOTS / "husky" / "maps" / "husky_bag.toml")
    recording = read_recording(tmp_path / "cut.mcap", SPECS["husky"], log_map)
    assert len(recording.episodes[0].time) > 2000
    (finding,) = [f for f in recording.provenance["findings"] if f["check"] == "lost"]
    # the chunk that is cut ends with message 11983; what it lost is reckoned from the bytes that are missing
    read, lost = (int(n) for n in re.findall(r"(\d+) messages read, about (\d+) lost", finding["message"])[0])
    assert read == 10184 and abs(lost - (11983 - 10184)) <= 5


def test_a_saw_tooth_yaw_is_told(data_dir: Path):
    channels = (
        ChannelSpec("x", "m", "state"),
        ChannelSpec("y", "m", "state"),
        ChannelSpec("yaw", "rad", "state"),
    )
    findings = doctor(
        data_dir / "utias_mrclam/ds6_robot1_groundtruth.parquet", RecordingSpec("c", channels, (), 50.0)
    )
    assert "wrap" in {f.check for f in findings}
