"""One log with two robots: each name of the recording keeps its robot, and results of one are not the other's."""

import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
import tiny_registry

from dynreg import session
from dynreg.errors import Assumed, NoMatchError
from dynreg.registry import Registry, removal, remove, verify
from dynreg.session import Session
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot
from dynreg.verbs.export_dataset import contents
from dynreg.verbs.simulators import simulator
from dynreg.verbs.subjects import recorded

KINDS = {"neighbours": "@answer", "calibration": "calibrated", "diagnosis": "diagnosed"}


def servo(folder: Path, name: str, high: float = 0.6) -> Path:
    """The servo bench under another name, with another range: another robot of the same channels."""
    shutil.copytree(load_robot("servo_pendulum").folder, folder)
    text = (folder / "robot.toml").read_text()
    text = text.replace('name = "servo_pendulum"', f'name = "{name}"', 1)
    (folder / "robot.toml").write_text(text.replace("high = 0.6\n", f"high = {high}\n", 1))
    return folder


@pytest.fixture
def swinger(tmp_path: Path) -> Path:
    return servo(tmp_path / "swinger", "swinger")


@pytest.fixture
def swinger_rad(tmp_path: Path) -> Path:
    return servo(tmp_path / "swinger_rad", "swinger_rad")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    (tmp_path / "bench.csv").write_text(tiny_registry.bench_csv())
    return tmp_path / "bench.csv"


@pytest.fixture
def reg(tmp_path: Path, log: Path, swinger: Path, swinger_rad: Path) -> Iterator[Session]:
    """One log, ingested as `bench` of swinger, then as `bench_rad` of swinger_rad."""
    with session.open(tmp_path / "registry", create=True) as opened:
        opened.ingest(log, swinger, name="bench")
        opened.ingest(log, swinger_rad, name="bench_rad")
        yield opened


def asked(reg: Session, ref, robot=None) -> tuple[str, str]:
    """Robot and name with which a recording is asked."""
    found = recorded(reg.registry, ref, robot, ingest=False)
    return found.robot.name, found.name


def told(registry: Registry, recording: str, robot: Path, kind: str) -> str:
    """A stored result for a robot; the id of the simulator that it recommends."""
    owner = load_robot(robot)
    values = owner.space.as_dict(owner.space.nominal)
    made = SimConfig(owner.hash, owner.name, values).as_dict() | {"lineage": {"kind": kind}}
    one = registry.put_simulator(made)
    keys = {"answer": one, "simulator": one, "calibrated_simulator": one}
    registry.put_result(kind, recording, {"robot": owner.name} | keys)
    return one


@pytest.mark.parametrize("name, robot", [("bench", "swinger"), ("bench_rad", "swinger_rad")])
def test_an_export_by_a_name_tells_the_hash_of_its_robot(name: str, robot: str, reg: Session, tmp_path: Path):
    told = contents(reg.registry, [name])
    assert (told.dataset.robot, told.robots) == (robot, (load_robot(tmp_path / robot).hash,))


def test_a_name_keeps_the_robot_that_it_was_ingested_with(reg: Session):
    assert asked(reg, "bench") == ("swinger", "bench")
    assert asked(reg, "bench_rad") == ("swinger_rad", "bench_rad")
    assert asked(reg, "@last") == asked(reg, reg.recording("bench").id) == ("swinger_rad", "bench_rad")
    assert not verify(reg.path).faults


def test_an_answer_is_headed_by_the_name_that_was_asked_for(reg: Session, swinger: Path, swinger_rad: Path):
    assert asked(reg, "bench", swinger_rad) == ("swinger_rad", "bench")
    assert asked(reg, "@last", swinger) == ("swinger", "bench")


def test_what_ingesting_answered_asks_with_its_robot(
    reg: Session, log: Path, swinger: Path, swinger_rad: Path
):
    first = reg.ingest(log, swinger, name="bench")
    unnamed = reg.ingest(log, swinger_rad)
    assert asked(reg, first) == ("swinger", "bench") and asked(reg, unnamed) == ("swinger_rad", "bench_rad")


def test_a_recording_put_without_a_name_is_called_by_its_id_where_a_name_would_lead_elsewhere(
    reg: Session, log: Path, tmp_path: Path
):
    said = reg.ingest(log, servo(tmp_path / "third", "third"))
    assert asked(reg, "@last") == ("third", said.recording[:12]) == ("third", said.name)
    assert asked(reg, "bench") == ("swinger", "bench")


def test_ingesting_for_another_robot_says_what_each_name_means(reg: Session, log: Path, swinger: Path):
    _, kept = reg.ingest(log, swinger).notes
    assert kept == (
        "'bench_rad' still means robot 'swinger_rad'. The recording's id and @last mean robot 'swinger' from now on. "
        "For another robot, add --robot"
    )


def test_a_name_ingested_again_with_its_own_robot_says_what_the_id_means_now(
    reg: Session, log: Path, swinger: Path
):
    assert asked(reg, "@last")[0] == "swinger_rad"
    (note,) = reg.ingest(log, swinger, name="bench").notes
    assert asked(reg, "@last")[0] == "swinger"
    assert "id and @last now mean version 1 of robot 'swinger' " in note and "'swinger_rad'" in note
    assert not reg.ingest(log, swinger, name="bench").notes


def test_a_damaged_result_of_the_other_robot_is_left_out_and_said(
    reg: Session, swinger: Path, swinger_rad: Path
):
    recording = reg.recording("bench").id
    mine = told(reg.registry, recording, swinger, "diagnosis")
    told(reg.registry, recording, swinger_rad, "diagnosis")
    (stored,) = [
        p for p in (reg.path / "results").rglob("*") if p.is_file() and "swinger_rad" in p.read_text()
    ]
    stored.write_bytes(stored.read_bytes()[:-9])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = simulator(reg.registry, "diagnosed", load_robot(swinger), recording)
    assert found.id == mine
    assert any("is left out" in str(one.message) for one in said if one.category is Assumed)


def test_a_name_follows_a_newer_version_of_its_robot_and_no_other(reg: Session, log: Path, tmp_path: Path):
    newer = servo(tmp_path / "newer", "swinger", 0.7)
    reg.ingest(log, newer)
    assert recorded(reg.registry, "bench", ingest=False).robot.hash == load_robot(newer).hash
    assert asked(reg, "bench_rad") == ("swinger_rad", "bench_rad")


def test_a_name_that_is_given_again_gets_the_new_robot(reg: Session, log: Path, swinger_rad: Path):
    reg.ingest(log, swinger_rad, name="bench")
    assert asked(reg, "bench") == ("swinger_rad", "bench")


def test_a_newer_version_is_told_of_the_robot_that_is_used(reg: Session, tmp_path: Path):
    newer = load_robot(servo(tmp_path / "newer", "swinger_rad", 0.7))
    reg.registry.put_robot(newer.files, newer.hash, newer.name)
    with warnings.catch_warnings():
        warnings.simplefilter("error", Assumed)
        recorded(reg.registry, "bench", ingest=False)
    with pytest.warns(Assumed, match="'bench_rad' was ingested with version 1 of robot 'swinger_rad'"):
        recorded(reg.registry, "bench_rad", ingest=False)


def test_list_and_show_tell_each_name_s_robot(reg: Session):
    (row,) = reg.list("recording").items
    assert (row.name, row.robot) == ("bench_rad, bench (of swinger)", "swinger_rad")
    assert [(reg.show(n).name, reg.show(n).robot) for n in ("bench", "bench_rad")] == [
        ("bench", "swinger"),
        ("bench_rad", "swinger_rad"),
    ]
    assert [item.detail["recordings"] for item in reg.list("robot").items] == [1, 1]


@pytest.mark.parametrize("kind, word", KINDS.items())
def test_words_mean_results_for_the_robot_that_is_asked_about(
    reg: Session, swinger: Path, swinger_rad: Path, kind: str, word: str
):
    recording, registry = reg.recording("bench").id, reg.registry
    other = told(registry, recording, swinger_rad, kind)
    with pytest.raises(
        NoMatchError, match="and robot 'swinger' .there is one for 'swinger_rad'.*--robot swinger"
    ):
        simulator(registry, word, load_robot(swinger), recording)
    mine = told(registry, recording, swinger, kind)
    assert simulator(registry, word, load_robot(swinger), recording).id == mine
    assert simulator(registry, word, load_robot(swinger_rad), recording).id == other


def test_compare_never_mixes_simulators_of_two_robots(reg: Session, swinger_rad: Path):
    told(reg.registry, reg.recording("bench").id, swinger_rad, "diagnosis")
    with pytest.raises(NoMatchError, match="no 'diagnosed' simulator: .*robot 'swinger'"):
        reg.compare("bench", simulators=("nominal", "diagnosed"))


def test_an_export_keeps_the_robots_of_names(reg: Session, tmp_path: Path):
    reg.export("bench", tmp_path / "copy")
    with session.open(tmp_path / "copy") as copy:
        assert copy.registry.recordings() == reg.registry.recordings()
        assert asked(copy, "bench") == ("swinger", "bench")


def test_a_lost_catalogue_is_written_again_with_the_robots_of_names(reg: Session):
    before, path = reg.registry.recordings(), reg.path
    reg.close()
    (path / "catalog.sqlite").unlink()
    verify(path, repair=True)
    with session.open(path) as again:
        assert again.registry.recordings() == before


def test_names_outlive_the_robot_that_they_do_not_belong_to(reg: Session, swinger: Path, swinger_rad: Path):
    last = load_robot(swinger_rad)
    remove(reg.registry, [last.hash])
    (info,) = reg.registry.recordings()
    assert info.robot_hash == load_robot(swinger).hash and set(info.names) == {"bench", "bench_rad"}
    assert asked(reg, "bench") == ("swinger", "bench") and not verify(reg.path).faults


def test_a_name_whose_robot_is_removed_asks_with_another_version_else_with_the_last(
    reg: Session, log: Path, tmp_path: Path, swinger: Path, swinger_rad: Path
):
    newer = load_robot(servo(tmp_path / "newer", "swinger", 0.7))
    reg.ingest(log, newer.folder, name="bench")
    reg.ingest(log, swinger_rad)
    assert removal(reg.registry, [newer.hash]).named["bench"].version == 1
    remove(reg.registry, [newer.hash])
    assert asked(reg, "bench") == ("swinger", "bench")
    remove(reg.registry, [load_robot(swinger).hash])
    assert asked(reg, "bench") == ("swinger_rad", "bench") and not verify(reg.path).faults
