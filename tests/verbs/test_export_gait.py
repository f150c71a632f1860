"""A run of a gait as a log for Foxglove, simulated beside measured, read back."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from dynreg import session
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.errors import LogError, NoMatchError, UsageError
from dynreg.gait.play import commands
from dynreg.results import Gait
from dynreg.session import Session
from dynreg.sim.layout import BASE
from dynreg.sim.real import RealTrial, SimulatedRobot


@dataclass(frozen=True)
class Played:
    """A registry, a gait in it, and its trial on the nominal robot, ingested as "trial"."""

    opened: Session
    gait: Gait
    gait_id: str
    trial: RealTrial


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory, brief, short_log) -> Iterator[Played]:
    with session.open(tmp_path_factory.mktemp("runs") / "registry") as opened:
        opened.ingest(short_log, brief, name="log")
        gait = opened.gait("log", on="nominal", rollouts=22, threads=1)
        real = SimulatedRobot(brief, brief.space.nominal, seed=1)
        trial = real.run(commands(gait)[1], gait.rate)
        opened.ingest(trial.recording, brief, name="trial", gait="@last")
        yield Played(opened, gait, opened.registry.latest("gait").id, trial)


def read(path: Path) -> dict[str, list[tuple[float, dict]]]:
    """{topic: (time [s] since the file began, message)}."""
    out: dict[str, list[tuple[float, dict]]] = {}
    with open(path, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            out.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
    begin = min(stamp for rows in out.values() for stamp, _ in rows)
    return {topic: [((stamp - begin) * 1e-9, m) for stamp, m in rows] for topic, rows in out.items()}


def angles(rows: list[tuple[float, dict]]) -> np.ndarray:
    return np.array([m["position"] for _, m in rows])


def places(rows: list[tuple[float, dict]]) -> np.ndarray:
    return np.array([[m["pose"]["position"][axis] for axis in "xyz"] for _, m in rows])


def attitudes(rows: list[tuple[float, dict]]) -> np.ndarray:
    """(T, 3) yaw, pitch, roll."""
    quaternions = [[m["pose"]["orientation"][axis] for axis in "xyzw"] for _, m in rows]
    return Rotation.from_quat(quaternions).as_euler("ZYX")


def test_of_a_gait_it_is_the_run_of_its_document(played: Played, tmp_path: Path) -> None:
    played.opened.export_gait(played.gait, tmp_path / "run.mcap", "foxglove")
    topics = read(tmp_path / "run.mcap")
    assert sorted(topics) == ["/joint_commands", "/simulated/joint_states", "/simulated/pose"]
    trial, times = played.gait.trials[0], np.array([t for t, _ in topics["/simulated/pose"]])
    steps = np.round(np.array(trial.time) * played.gait.rate).astype(int)
    assert np.allclose(times[steps], trial.time)
    assert np.array_equal(places(topics["/simulated/pose"])[steps, :2], np.stack([trial.x, trial.y], axis=1))
    assert np.allclose(attitudes(topics["/simulated/pose"])[steps, 0], trial.yaw)
    assert np.abs(angles(topics["/joint_commands"]) - commands(played.gait)[1]).max() < 2e-4
    first = topics["/simulated/joint_states"][0][1]
    assert first["name"][:2] == ["fl_hip", "fl_shoulder"] and len(first["position"]) == 12
    pose = topics["/simulated/pose"][0][1]
    assert pose["frame_id"] == "world" and pose["timestamp"] == {"sec": 1_700_000_000, "nsec": 0}
    played.opened.export_gait("@last", tmp_path / "again.mcap", "foxglove")
    assert (tmp_path / "again.mcap").read_bytes() == (tmp_path / "run.mcap").read_bytes()


def test_of_a_trial_what_was_measured_stands_beside_what_is_simulated(
    played: Played, tmp_path: Path, brief
) -> None:
    assert played.opened.export_gait("trial", tmp_path / "run.mcap", "foxglove") == played.gait
    topics = read(tmp_path / "run.mcap")
    assert len(topics) == 5
    log = played.trial.recording
    own = log.episodes[0].values[:, log.columns([f"{j}/position" for j in _joints(topics)])]
    measured, simulated = (angles(topics[f"/{of}/joint_states"]) for of in ("measured", "simulated"))
    assert np.array_equal(measured, own) and simulated.shape == measured.shape
    assert np.abs(measured - simulated).mean() < 0.05  # the same robot, with noise of its own
    there = played.trial.walk.base[0, 0][:, [BASE.index(a) for a in "xyz"]]
    reckoned = places(topics["/measured/pose"])
    assert np.allclose(reckoned[0], places(topics["/simulated/pose"])[0])
    assert np.abs((reckoned - reckoned[0])[:, :2] - (there - there[0])[:, :2]).max() < 0.05
    roll = log.episodes[0].values[:, log.columns(["base/roll"])[0]]
    assert np.allclose(attitudes(topics["/measured/pose"])[:, 2], roll)


def _joints(topics: dict) -> list[str]:
    return topics["/measured/joint_states"][0][1]["name"]


def with_columns(log: Recording, change: dict[str, np.ndarray | float], **more: np.ndarray) -> Recording:
    """The one episode of a log with other values of some channels, and more channels in metres."""
    (episode,) = log.episodes
    values = np.concatenate([episode.values, *(column[:, None] for column in more.values())], axis=1)
    for name, column in change.items():
        values[:, log.columns([name])[0]] = column
    channels = (*log.channels, *(Channel(f"base/{name}", "m") for name in more))
    return Recording(channels, (replace(episode, values=values),), measured=False)


def test_a_compass_and_a_camera_are_turned_to_the_start(played: Played, brief, tmp_path: Path) -> None:
    """The robot stood and looked elsewhere, and a camera saw where it went."""
    log, base = played.trial.recording, played.trial.walk.base[0, 0]
    yaw = log.episodes[0].values[:, log.columns(["base/yaw"])[0]]
    camera = {"x": 5.0 - base[:, 1], "y": 7.0 + base[:, 0], "z": 1.0 + base[:, 2]}  # a quarter to the left
    seen = with_columns(log, {"base/yaw": yaw + np.pi / 2, "base/vx": 9.0}, **camera)
    played.opened.ingest(seen, brief, name="seen", gait=played.gait_id)
    played.opened.export_gait("seen", tmp_path / "run.mcap", "foxglove")
    topics = read(tmp_path / "run.mcap")
    measured, simulated = (places(topics[f"/{of}/pose"]) for of in ("measured", "simulated"))
    assert np.allclose(measured[0], simulated[0])
    assert np.abs((measured - measured[0]) - (base - base[0])[:, :3]).max() < 5e-3
    first = [attitudes(topics[f"/{of}/pose"])[0, 0] for of in ("measured", "simulated")]
    assert first[0] == pytest.approx(first[1])


def test_gaps_are_left_out_and_commands_hold_over_them(played: Played, brief, tmp_path: Path) -> None:
    log = played.trial.recording
    lost = np.where(np.arange(len(log.episodes[0].time)) % 5 == 3, np.nan, 1.0)
    value = lambda name: lost * log.episodes[0].values[:, log.columns([name])[0]]  # noqa: E731
    holes = {name: value(name) for name in ("fl_hip/target", "fr_elbow/position", "base/roll")}
    played.opened.ingest(with_columns(log, holes), brief, name="holes", gait=played.gait_id)
    played.opened.export_gait("holes", tmp_path / "run.mcap", "foxglove")
    topics, rows = read(tmp_path / "run.mcap"), np.isfinite(lost).sum()
    assert len(topics["/measured/joint_states"]) == len(topics["/measured/pose"]) == rows
    hip = angles(topics["/joint_commands"])[:, 0]
    assert len(hip) == len(lost) - 1 and hip[3] == hip[2] != hip[4]


def test_logs_without_commands_or_attitude(played: Played, brief, tmp_path: Path) -> None:
    log = played.trial.recording
    played.opened.ingest(
        with_columns(log, {"base/roll": np.nan}), brief, name="no attitude", gait=played.gait_id
    )
    played.opened.export_gait("no attitude", tmp_path / "run.mcap", "foxglove")
    assert "/measured/pose" not in read(tmp_path / "run.mcap")
    silent = with_columns(log, {"fl_hip/target": np.nan})
    played.opened.ingest(silent, brief, name="silent", gait=played.gait_id)
    with pytest.raises(LogError, match="holds no commands"):
        played.opened.export_gait("silent", tmp_path / "silent.mcap", "foxglove")
    with pytest.raises(UsageError, match="exists already"):
        played.opened.export_gait("trial", tmp_path / "run.mcap", "foxglove")
    assert not (tmp_path / "silent.mcap").exists()


def test_episodes_follow_each_other(played: Played, brief, tmp_path: Path) -> None:
    log = played.trial.recording
    (episode,) = log.episodes
    late = Episode("late", episode.time + 100.0, episode.values)
    twice = replace(log, episodes=(episode, late))
    played.opened.ingest(twice, brief, name="twice", gait=played.gait_id)
    played.opened.export_gait("twice", tmp_path / "run.mcap", "foxglove")
    rows = read(tmp_path / "run.mcap")["/simulated/pose"]
    assert len(rows) == 2 * len(episode.time)
    assert rows[len(episode.time)][0] == pytest.approx(100.0)
    assert np.array_equal(*np.split(places(rows), 2))  # each from the same start


@pytest.mark.parametrize("form", ["csv", "mcap", "foxglove", "python"])
def test_without_a_gait_an_export_of_the_last_one_says_what_to_do(
    form: str, registry_folder, tmp_path
) -> None:
    shutil.copytree(registry_folder, tmp_path / "registry")
    with session.open(tmp_path / "registry") as opened:
        with pytest.raises(
            NoMatchError, match="no gait is stored; .*`dynreg gait RECORDING`, or name a recording"
        ):
            opened.export_gait("@last", tmp_path / "out", form)
        with pytest.raises(
            NoMatchError, match="no gait is stored about recording 'bench'.*`dynreg gait bench`"
        ):
            opened.export_gait("bench", tmp_path / "out", "python")
    assert not (tmp_path / "out").exists()
