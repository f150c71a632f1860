"""A registry takes only robots in which `robots check` finds no error; what a check found is kept."""

import subprocess
from pathlib import Path

import pytest
import tiny_registry

from dynreg import session
from dynreg.errors import LogError, RobotError
from dynreg.registry import Registry
from dynreg.sim import child
from dynreg.sim.robot import load_robot, packaged_robots
from dynreg.verbs import accepted
from dynreg.verbs.doctor import findings as doctor
from dynreg.verbs.subjects import read_log


def folder(path: Path, old: str, new: str) -> Path:
    """The servo bench with something else in its robot.toml."""
    source = packaged_robots()["servo_pendulum"]
    path.mkdir()
    text = (source / "robot.toml").read_text(encoding="utf-8")
    assert old in text
    (path / "robot.toml").write_text(text.replace(old, new), encoding="utf-8")
    (path / "model.xml").write_bytes((source / "model.xml").read_bytes())
    return path


def test_what_a_check_refuses_is_neither_ingested_nor_populated(tmp_path: Path):
    wrong = folder(tmp_path / "wrong", "mj.body_mass[tip] =", "mj.body_mass[top] =")
    log = tmp_path / "bench.csv"
    log.write_text(tiny_registry.bench_csv(), encoding="utf-8")
    with session.open(tmp_path / "registry") as opened:
        with pytest.raises(
            RobotError, match=r"'servo_pendulum' cannot be used: robot.toml, line \d+: parameter 'tip_mass'"
        ):
            opened.ingest(log, wrong)
        with pytest.raises(RobotError, match="robots check"):
            opened.populate(wrong, 4, training=tiny_registry.QUICK)
        assert not opened.list("recording").items and not opened.list("population").items


def test_a_robot_is_checked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """In one registry, also by another process: the second time there is nothing to simulate."""
    own = folder(tmp_path / "own", 'name = "servo_pendulum"', 'name = "my_servo"')
    log = tmp_path / "bench.csv"
    log.write_text(tiny_registry.bench_csv(), encoding="utf-8")
    seen = []
    monkeypatch.setattr(accepted, "inspect_files", lambda files: seen.append(files.hash) or [])
    for name in ("first", "second"):
        monkeypatch.setattr(accepted, "_SOUND", set())
        with session.open(tmp_path / "registry") as opened:
            opened.ingest(log, own, name=name)
    assert len(seen) == 1


def test_a_check_that_came_to_no_end_is_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A busy hour says nothing about a robot."""
    own = folder(tmp_path / "own", 'name = "servo_pendulum"', 'name = "my_servo"')
    log = tmp_path / "bench.csv"
    log.write_text(tiny_registry.bench_csv(), encoding="utf-8")

    def busy(*args, **kwargs):
        raise subprocess.TimeoutExpired("python", 1)

    monkeypatch.setattr(accepted, "_SOUND", set())
    with session.open(tmp_path / "registry") as opened:
        with monkeypatch.context() as hour, pytest.raises(RobotError, match="takes too long"):
            hour.setattr(child.subprocess, "run", busy)
            opened.ingest(log, own)
        opened.ingest(log, own, name="later")
        assert len(opened.list("recording").items) == 1


def test_a_check_is_done_again_under_other_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    own = load_robot(folder(tmp_path / "own", 'name = "servo_pendulum"', 'name = "my_servo"'))
    seen = []
    monkeypatch.setattr(accepted, "inspect_files", lambda files: seen.append(files.hash) or [])
    with Registry.open(tmp_path / "registry", create=True) as registry:
        for bodies in ("100", "100", "200"):
            monkeypatch.setattr(accepted, "_SOUND", set())
            monkeypatch.setenv("DYNREG_MAX_BODIES", bodies)
            accepted.accept(registry, own)
    assert len(seen) == 2


def test_the_maps_of_a_copied_folder_are_its_own_under_another_name(tmp_path: Path):
    own = folder(tmp_path / "own", 'name = "servo_pendulum"', 'name = "my_servo"')
    (own / "maps").mkdir()
    columns = {"arm/position": "p", "arm/velocity": "v", "arm/target": "t"}
    told = "".join(f'[channels."{name}"]\nsource = "{column}"\n' for name, column in columns.items())
    (own / "maps" / "log.toml").write_text(f'[map]\nrobot = "servo_pendulum"\n{told}', encoding="utf-8")
    rows = "".join(f"{i / 100},{i / 100},1.0,{i / 99}\n" for i in range(100))
    log = tmp_path / "log.csv"
    log.write_text("time,p,v,t\n" + rows, encoding="utf-8")
    recording = read_log(log, load_robot(own))
    assert {*columns} <= {channel.name for channel in recording.channels}
    assert not [f for f in doctor([log], str(own), None).findings if f.severity == "error"]
    (own / "maps" / "another.toml").write_text(told.replace('"p"', '"else"'), encoding="utf-8")
    log.write_text("time,p,v,t\n" + rows + "0.5,1.0,1.0,1.0\n", encoding="utf-8")
    with pytest.raises(
        LogError, match="the clock runs back by 0.49"
    ):  # its map is there: that is what is wrong
        read_log(log, load_robot(own))
