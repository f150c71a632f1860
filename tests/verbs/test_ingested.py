"""What `ingest` says of a recording, and what reads a log."""

import json
import shutil
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from tiny_registry import bench_csv

import dynreg
from dynreg.data.recording import Recording
from dynreg.errors import AmbiguousError, LogError, MapError, NoMatchError, UsageError
from dynreg.report.stored import channel_words
from dynreg.verbs.robots import robot_check, robot_copy
from dynreg.verbs.subjects import every_recorded, found_in


def test_many_channels_are_told_as_groups_and_a_few_by_name():
    joints = [f"{side}_{joint}" for side in ("fl", "fr", "rl", "rr") for joint in ("hip", "thigh", "calf")]
    names = [f"{joint}/{what}" for what in ("position", "velocity", "target") for joint in joints]
    base = ["base/roll", "base/pitch"]
    assert channel_words((*names, *base, "supply", "load")) == (
        "12 joints: position, velocity, target; base: roll, pitch; supply; load"
    )
    assert channel_words(("arm/position", "arm/target")) == "arm/position, arm/target"


def test_findings_of_older_recordings_read_as_those_of_today(tmp_path: Path):
    """What to do had no place of its own once, and stood at the end of the message."""
    log = tmp_path / "run.csv"
    log.write_text(
        bench_csv(lambda i, row: [*row[:1], row[1] + 0.9 * (i == 100), *row[2:]]), encoding="utf-8"
    )
    with dynreg.open(tmp_path / "registry") as session:
        session.ingest(log, "servo_pendulum", name="spiky")
        stored = session.recording("spiky")
    today = found_in(stored)
    assert any(f.do.startswith("to leave it out, write outliers") for f in today)
    olden = [{**vars(f), "message": f.told} for f in today]
    for told in olden:
        del told["do"]
    read = Recording(stored.channels, stored.episodes, True, {**stored.provenance, "findings": olden})
    assert [str(f) for f in found_in(read)] == [str(f) for f in today]


def test_a_log_without_commands_is_ingested_and_says_so(tmp_path: Path):
    rows = "".join(f"{0.1 * k:.1f},{np.sin(0.1 * k):.4f},0,0\n" for k in range(60))
    (tmp_path / "drive.csv").write_text("time,base/speed,base/yaw_rate,imu/yaw_rate\n" + rows)
    with dynreg.open(tmp_path / "registry") as session:
        told = session.ingest(tmp_path / "drive.csv", "husky", name="drive")
    (said,) = told.notes
    assert (
        "no commands ('base/speed_command' is missing)" in said and "query and diagnose cannot use it" in said
    )


def test_a_word_that_means_a_simulator_names_no_recording_and_further_names_are_shown(tmp_path: Path):
    rows = "".join(f"{0.1 * k:.1f},{np.sin(0.1 * k):.4f},0,0\n" for k in range(60))
    (tmp_path / "drive.csv").write_text("time,base/speed,base/yaw_rate,imu/yaw_rate\n" + rows)
    with dynreg.open(tmp_path / "registry") as session:
        for word in ("nominal", "nearest", "diagnosed", "calibrated", "synthesised"):
            with pytest.raises(UsageError, match=f"'{word}' cannot be .*: it means a simulator"):
                session.ingest(tmp_path / "drive.csv", "husky", name=word)
        for name in ("monday", "first"):
            session.ingest(tmp_path / "drive.csv", "husky", name=name)
        assert session.show("monday").detail["also_called"] == ["first"]
        assert session.show("first").detail["also_called"] == ["monday"]


def test_what_a_map_of_the_robot_lacks_is_what_is_wrong(tmp_path: Path):
    """Not that the log has no columns of the channels' names: the map, whose columns it has, says where these are."""
    folder = tmp_path / "arm"
    robot_copy("two_joint_arm", folder)
    whats = {"position": "pos", "velocity": "vel", "target": "cmd"}
    named = {f"{j}/{what}": f"{j}.{word}" for j in ("shoulder", "elbow") for what, word in whats.items()}
    lacks = named.pop("elbow/target")
    log, rows = tmp_path / "run.csv", [f"{k / 100},{','.join(['0.1'] * 6)}" for k in range(60)]
    log.write_text("\n".join([f"time,{','.join([*named.values(), lacks])}", *rows]) + "\n")
    (folder / "maps").mkdir()
    text = "".join(f'[channels."{name}"]\nsource = "{column}"\n' for name, column in named.items())
    (folder / "maps" / "log.toml").write_text(text)
    (folder / "maps" / "other.toml").write_text(text.replace('source = "', 'source = "other_'))
    (told, _) = robot_check(str(folder)).warnings
    assert told.startswith("maps/log.toml: the map gives no source for channel 'elbow/target'")
    with dynreg.open(tmp_path / "registry") as session:
        with pytest.raises(
            MapError, match=r"gives no source for channel 'elbow/target' \(the robot's map .*log.toml\)"
        ):
            session.ingest(log, folder)
        log.write_text(log.read_text().replace("shoulder.pos", "unlike"))
        with pytest.raises(MapError, match="the log has no column 'shoulder/position'"):
            session.ingest(log, folder)


def test_nobody_is_asked_to_correct_a_map_that_comes_with_dynreg(tmp_path: Path):
    row = {"position": 0.1, "speed": 0.0, "goal_position": 0.0, "load": 0.0}
    rows = [{"timestamp": k / 100, **row} for k in range(60)]
    (tmp_path / "run.json").write_text(json.dumps({"kp": 8.0, "entries": rows}))
    with dynreg.open(tmp_path / "registry") as session:
        with pytest.raises(
            MapError, match=r"episode name .*\(the map bam_xl330.toml that comes with"
        ) as told:
            session.ingest(tmp_path / "run.json", "servo_pendulum")
    assert told.value.do.startswith("draft a map of this log"), told.value
    for k, one in enumerate(rows):
        one["timestamp"] = k * 1e4
    (tmp_path / "run.json").write_text(json.dumps({"kp": 8.0, "trajectory": "sine", "entries": rows}))
    with dynreg.open(tmp_path / "registry") as session, pytest.raises(LogError) as told:
        session.ingest(tmp_path / "run.json", "servo_pendulum")
    assert "time_unit" in told.value.do, "what a log lacks is told as it is"


def test_what_looks_like_a_log_and_is_none_is_told_as_such(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with dynreg.open(tmp_path / "registry") as session:
        for told in ({"robot": "servo_pendulum"}, {}):
            with pytest.raises(
                NoMatchError, match="called 'run.csv', and no log is there; expected the path of a log"
            ):
                session.diagnose("run.csv", **told)
        with pytest.raises(NoMatchError, match="no recording is called 'monday'; expected a hash"):
            session.diagnose("monday")
        two = AmbiguousError("'cd12' fits more than one", expected="a name", do="give more digits")
        monkeypatch.setattr(session.registry, "resolve", Mock(side_effect=two))
        with pytest.raises(AmbiguousError, match="more than one; expected a name; give more digits"):
            session.diagnose("cd12", robot="servo_pendulum")  # it is no log that is missing


def test_a_map_counts_where_one_of_several_recordings_is_a_log(registry_folder: Path, tmp_path: Path):
    """Beside stored recordings alone it would be ignored; a list of arguments may still hold both."""
    (tmp_path / "run.csv").write_text(bench_csv())
    (tmp_path / "map.toml").write_text(
        '[episodes]\nby = "gaps"\n'
        + "".join(f'[channels."arm/{c}"]\nsource = "arm/{c}"\n' for c in ("position", "velocity", "target"))
    )
    robot, given = "servo_pendulum", tmp_path / "map.toml"
    shutil.copytree(registry_folder, tmp_path / "registry")
    with dynreg.open(tmp_path / "registry") as session:
        found = every_recorded(session.registry, ["bench", tmp_path / "run.csv"], robot, given, ingest=False)
        assert found[0].name == "bench" and len(found) == 2
        with pytest.raises(UsageError, match="log_map '.*map.toml' with recording 'bench', which is stored"):
            session.drift("bench", "@last", log_map=given)
        with pytest.raises(UsageError, match="which is stored already"):
            session.gait_rounds("bench", lambda *told: None, log_map=given)
