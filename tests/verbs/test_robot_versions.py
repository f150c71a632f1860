"""Edit robot.toml, ingest again, ask again: a recording is its log's, and versions of a robot follow each other."""

import re
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
import tiny_registry

from dynreg import session
from dynreg.cli.main import main
from dynreg.errors import Assumed, NoMatchError, RegistryError, UsageError
from dynreg.registry import verify
from dynreg.session import Session
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot
from dynreg.verbs.subjects import word_for

QUICK = {"budget": 7, "synthesise": False}


def edited(folder: Path, *changes: tuple[str, str]) -> Path:
    """A copy of the servo bench in which these texts of robot.toml are others."""
    shutil.copytree(load_robot("servo_pendulum").folder, folder)
    text = (folder / "robot.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "robot.toml").write_text(text)
    return folder


@pytest.fixture
def heavier(tmp_path: Path) -> Path:
    return edited(tmp_path / "heavier", ("high = 0.6\n", "high = 0.7\n"))


@pytest.fixture
def slower(tmp_path: Path) -> Path:
    return edited(tmp_path / "slower", ("control_rate = 100", "control_rate = 50"))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    (tmp_path / "bench.csv").write_text(tiny_registry.bench_csv())
    return tmp_path / "bench.csv"


@pytest.fixture
def reg(registry_folder: Path, tmp_path: Path) -> Iterator[Session]:
    with session.open(shutil.copytree(registry_folder, tmp_path / "registry")) as opened:
        yield opened


def test_the_same_log_with_an_edited_robot_is_the_same_recording(reg: Session, log: Path, heavier: Path):
    before = reg.recording("bench").id
    again = reg.ingest(log, heavier, name="bench")
    assert (again.recording, again.version) == (before, 2)
    assert re.search("now used with version 2 .*, before with version 1", again.notes[0])
    assert reg.registry.recording_info("bench").robot_hash == load_robot(heavier).hash
    with pytest.raises(NoMatchError, match="no simulators of version 2 of robot 'servo_pendulum'") as error:
        reg.query("bench", **QUICK)
    (population,) = reg.registry.populations()
    told = f"version 1 has 8; .*dynreg populate {load_robot(heavier).hash[:12]} -n 8`, or add --population "
    assert re.search(told + population.id[:12], str(error.value))
    with pytest.warns(Assumed, match="is of version 1 of robot 'servo_pendulum' .*that one simulates"):
        assert reg.query("bench", population=population.id, **QUICK).population == population.id
    made = reg.populate(load_robot(heavier).hash[:12], 6, training=tiny_registry.QUICK)
    assert reg.query("bench", **QUICK).population == made.population
    assert not verify(reg.path).faults


def test_a_newer_version_is_told_until_the_log_is_ingested_with_it(reg: Session, heavier: Path):
    newer = reg.populate(heavier, 6, training=tiny_registry.QUICK)
    with pytest.warns(Assumed, match=f"Version 2 is newer: add --robot {load_robot(heavier).hash[:12]}"):
        old = reg.query("bench", **QUICK)
    assert old.population != newer.population
    with warnings.catch_warnings():
        warnings.simplefilter("error", Assumed)
        assert reg.query("bench", robot=heavier, **QUICK).population == newer.population
    assert reg.registry.recording_info("bench").robot_hash == load_robot("servo_pendulum").hash


def test_a_name_moves_between_recordings_of_the_same_files(
    reg: Session, log: Path, tmp_path: Path, slower: Path
):
    first = reg.recording("bench").id
    moved = reg.ingest(log, slower, name="bench")
    assert moved.recording != first and reg.recording("bench").id == moved.recording
    (said,) = moved.notes
    assert said.startswith("the name 'bench' now means this recording.")
    assert f"Recording {first[:12]} of version 1 of robot 'servo_pendulum'" in said
    assert reg.recording(first[:12]).id == first, "the old one stays under its id"
    assert reg.registry.recording_info(first).names == ()
    other = tmp_path / "other.csv"
    other.write_text(tiny_registry.bench_csv(lambda i, row: [row[0], row[1] + 0.01, *row[2:]]))
    with pytest.raises(RegistryError, match="'bench' is in use .*other log files"):
        reg.ingest(other, "servo_pendulum", name="bench")
    assert reg.recording("bench").id == moved.recording and not verify(reg.path).faults


def test_a_robot_that_a_recording_does_not_fit_says_what_is_missing(reg: Session, slower: Path):
    missing = "lacks what robot 'double_pendulum' .*: channel '.*', .*command '"
    with pytest.raises(UsageError, match=missing):
        reg.diagnose("bench", robot="double_pendulum")
    with pytest.raises(UsageError, match=r"rows at 50 Hz \(it has 100 Hz\)"):
        reg.query("bench", robot=slower)


def test_versions_are_listed_in_the_order_in_which_they_came(reg: Session, heavier: Path, slower: Path):
    for folder in (heavier, slower):
        reg.registry.put_robot(folder, load_robot(folder).hash, "servo_pendulum")
    robots = [(i.id, i.name, i.detail["version"]) for i in reg.list("robot").items]
    ids = [load_robot(ref).hash for ref in ("servo_pendulum", heavier, slower)]
    assert robots == [(identity, "servo_pendulum", n + 1) for n, identity in enumerate(ids)]
    used = [
        (i.detail["populations"], i.detail["entries"], i.detail["recordings"])
        for i in reg.list("robot").items
    ]
    assert used == [(1, 8, 1), (0, 0, 0), (0, 0, 0)]
    assert reg.registry.resolve("servo_pendulum", ("robot",)) == ("robot", ids[2])
    reg.registry.put_robot(heavier, ids[1], "servo_pendulum")
    assert reg.registry.robot_info(ids[1]).version == 2, "putting it again changes nothing"


def test_an_exported_version_keeps_its_number(reg: Session, log: Path, heavier: Path, tmp_path: Path):
    reg.ingest(log, heavier)
    reg.export("bench", tmp_path / "copy")
    with session.open(tmp_path / "copy") as copy:
        (robot,) = copy.list("robot").items
        assert (robot.id, robot.detail["version"]) == (load_robot(heavier).hash, 2)


def test_a_simulator_of_another_version_says_so(reg: Session, log: Path, heavier: Path):
    from dynreg.verbs.simulators import own, simulator

    entry = reg.query("bench", **QUICK).answer
    reg.ingest(log, heavier)
    robot = load_robot(heavier)
    found = simulator(reg.registry, entry, robot)
    assert found.name.endswith("(version 1)") and found.robot.hash != robot.hash
    with pytest.raises(UsageError, match="is of another version of robot 'servo_pendulum' .*--robot"):
        own(found, robot)


@pytest.mark.parametrize(
    "arguments",
    [
        ["ingest", "{log}", "--robot", "servo_pendulum", "--name", "@x"],
        ["export", "bench", "--to", "{folder}"],
    ],
)
def test_what_was_asked_wrongly_exits_2(reg: Session, log: Path, arguments: list[str], capsys):
    given = [a.format(log=log, folder=reg.path) for a in arguments]
    assert main([*given, "--registry", str(reg.path)]) == 2
    assert capsys.readouterr().err.startswith("error: ")


@pytest.fixture
def no_gain(tmp_path: Path) -> Path:
    """A log that does not tell the gain: `ingest` takes it, and the nominal one is used."""
    columns = [name for name in tiny_registry.COLUMNS if name != "kp"]
    kept = [i for i, name in enumerate(tiny_registry.COLUMNS) if name != "kp"]
    text = tiny_registry.bench_csv(lambda _, row: [row[i] for i in kept], columns)
    (tmp_path / "no_gain.csv").write_text(text)
    return tmp_path / "no_gain.csv"


def test_a_recording_without_a_setting_outlives_a_version_of_its_robot(
    reg: Session, no_gain: Path, heavier: Path, slower: Path
):
    made = reg.ingest(no_gain, "servo_pendulum", name="no gain")
    assert any("setting 'kp' is not known" in one for one in made.findings)
    with pytest.warns(
        Assumed, match="'no gain' does not tell kp in every episode: the nominal value of robot"
    ):
        reg.query("no gain", robot=heavier, population=reg.registry.populations()[0].id, **QUICK)
    for folder in (heavier, slower):
        reg.registry.put_robot(folder, load_robot(folder).hash, "servo_pendulum")
    gone = reg.remove([load_robot("servo_pendulum").hash])
    assert made.recording not in [item.id for item in gone.items]
    assert "version 2" in " ".join(gone.moved), "version 3 has another rate"


def test_a_recording_without_a_setting_is_shown_beside_a_simulator(reg: Session, no_gain: Path, slower: Path):
    reg.ingest(no_gain, "servo_pendulum", name="no gain")
    with warnings.catch_warnings():
        warnings.simplefilter("error", Assumed)
        assert len(reg.frames("no gain").times) > 900
    other = load_robot(slower)
    reg.registry.put_robot(other.files, other.hash, other.name)
    simulator = reg.registry.put_simulator(SimConfig.of(other, other.space.nominal).as_dict())
    with pytest.raises(
        UsageError, match=r"recording 'no gain' lacks what .*: rows at 50 Hz \(it has 100 Hz\)"
    ):
        reg.frames("no gain", simulator)


def test_the_word_of_a_robot_means_it_before_it_is_registered_too(
    reg: Session, heavier: Path, tmp_path: Path
):
    """A command that a diagnosis of a log prints stands where its robot is not kept yet."""
    own = load_robot(edited(tmp_path / "own", ('name = "servo_pendulum"', 'name = "armg"')))
    packaged, other = load_robot("servo_pendulum"), load_robot(heavier)
    words = [word_for(reg.registry, robot) for robot in (packaged, other, own)]
    assert words == ["servo_pendulum", other.hash[:12], "armg"]
