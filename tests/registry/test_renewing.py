"""Registries whose files did not explain themselves are brought to the present form, once, and keep what they hold."""

import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from older_form import POPULATION, drawn, fill, recording

import dynreg.registry.renewing as renewing
from dynreg.errors import RegistryError, Renewed
from dynreg.registry import Registry, verify
from dynreg.registry.headers import is_old
from dynreg.registry.shards import read_states_header
from dynreg.sim.engines import rollout
from dynreg.sim.ports import log_periods
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run
from dynreg.verbs.populations import columns_of

CONTENTS = ("populations", "shards", "recordings", "robots")


@pytest.fixture
def old(tmp_path: Path) -> Path:
    shutil.unpack_archive(Path(__file__).with_name("form_2.zip"), tmp_path / "old")
    return tmp_path / "old"


def files_of(path: Path) -> set[str]:
    return {f.relative_to(path).as_posix() for c in CONTENTS for f in (path / c).rglob("*") if f.is_file()}


def told(robot):
    columns = columns_of(robot)
    commanded = {"actions": columns.actions, "inputs": columns.inputs, "settings": columns.settings}
    return commanded | {"parameter_units": tuple(p.unit for p in robot.space.parameters)}


def written_today(path: Path) -> Path:
    def periods(robot, values):
        return {"periods": log_periods(robot, values, Run(np.zeros((2, 3, len(robot.actions)))))}

    then = path.with_name("then")
    shutil.unpack_archive(Path(__file__).with_name("form_2.zip"), then)
    (quadruped,) = (then / "robots").iterdir()
    with pytest.warns(Renewed), Registry.open(then) as registry:
        values = registry.load(POPULATION).values
    np.testing.assert_allclose(values, drawn(load_robot(quadruped)), rtol=1e-12)
    with Registry.open(path, create=True) as registry:
        fill(registry, told, periods, quadruped, values)
    return path


def test_its_files_become_those_that_are_written_today(old, tmp_path):
    with pytest.warns(Renewed, match="written anew, once"), Registry.open(old) as registry:
        renewed = registry.content_hash(), registry.load(POPULATION)
    today = written_today(tmp_path / "today")
    assert files_of(old) == files_of(today)  # each name ends in the hash of the file's bytes
    with Registry.open(today) as registry:
        assert renewed[0] == registry.content_hash()
        np.testing.assert_array_equal(renewed[1].states, registry.load(POPULATION).states)
    assert not verify(old).faults
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with Registry.open(old) as registry:
            assert registry.recording("monday").id == recording().id


def test_the_ledger_tells_it_so_that_a_lost_catalogue_comes_back(old):
    with pytest.warns(Renewed), Registry.open(old) as registry:
        before = registry.content_hash()
    for path in old.glob("catalog.sqlite*"):
        path.unlink()
    verify(old, repair=True)
    with Registry.open(old) as registry:
        assert registry.content_hash() == before and len(registry.load(POPULATION)) == 4


@pytest.mark.parametrize("done", range(4))
def test_one_that_was_cut_short_is_gone_on_with(old, tmp_path, monkeypatch, done):
    replace, calls = renewing._replace, []

    def cut_short(*told):
        if len(calls) == done:
            raise KeyboardInterrupt
        calls.append(told)
        replace(*told)

    monkeypatch.setattr(renewing, "_replace", cut_short)
    with pytest.warns(Renewed), pytest.raises(KeyboardInterrupt):
        Registry.open(old)
    monkeypatch.undo()
    with pytest.warns(Renewed), Registry.open(old) as registry:
        assert len(registry.load(POPULATION)) == 4
    assert files_of(old) == files_of(written_today(tmp_path / "today")) and not verify(old).faults


def test_one_without_room_answers_as_it_is(old, monkeypatch):
    def full(*_):
        raise RegistryError("no room", expected="room", do="make some")

    monkeypatch.setattr(renewing, "_replace", full)
    before = files_of(old)
    with pytest.warns(Renewed), Registry.open(old) as registry:
        entry = registry.load(POPULATION, ()).ids[3]
        assert registry.load_entry(entry).states.shape == (2, 4, 33)
    assert files_of(old) == before
    monkeypatch.undo()
    with pytest.warns(Renewed):
        Registry.open(old).close()
    assert files_of(old) != before


def test_one_whose_robot_is_damaged_answers_as_it_is(old):
    (toml,) = (old / "robots").rglob("robot.toml")
    toml.write_text("no robot")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Registry.open(old) as registry:
            assert len(registry.load(POPULATION)) == 4
    assert all(is_old(read_states_header(path)) for path in (old / "shards").glob("*.parquet"))


ODD = {
    "more parameters than values": "[robot]\ncontrol_rate = 50.0\n"
    + '[[parameters]]\nname = "p"\nunit = "1"\nsets = ["control.rate *="]\n' * 99,
    "a target that is a number": '[robot]\ncontrol_rate = 50.0\n[[parameters]]\nunit = "1"\nsets = [5]\n',
    "a drive that is a text": 'drives = ["x"]\n[robot]\ncontrol_rate = 50.0\n[[parameters]]\nsets = 5\n',
    "deep brackets": "a = " + "[" * 100_000,
    "a rate of zero": "[robot]\ncontrol_rate = 0.0\n",
    "a rate that no float holds": f"[robot]\ncontrol_rate = {10**400}\n",
    "a robot that is a list": "robot = [1]\n",
    "too long": "[robot]\ncontrol_rate = 50.0\n" + "#" * 1_000_000,
    "bytes of no text": b"\xff\xfe",
}


@pytest.fixture
def put_robot_file(tmp_path, monkeypatch):
    """Let the registry have another robot.toml, as if it had been registered so."""

    def put(content: bytes) -> None:
        (tmp_path / "odd").mkdir()
        (tmp_path / "odd" / "robot.toml").write_bytes(content)
        monkeypatch.setattr(renewing, "robot_folder", lambda *_: tmp_path / "odd")

    return put


@pytest.mark.parametrize("title", ODD)
def test_an_odd_robot_file_leaves_what_it_told_as_it_is(title, old, put_robot_file):
    put_robot_file(ODD[title] if isinstance(ODD[title], bytes) else ODD[title].encode())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", Renewed)
        with Registry.open(old) as registry:
            assert len(registry.load(POPULATION)) == 4
    assert all(is_old(read_states_header(path)) for path in (old / "shards").glob("*.parquet"))


def test_units_that_are_no_text_are_not_written_into_a_population(old, put_robot_file):
    (toml,) = (old / "robots").rglob("robot.toml")
    put_robot_file(toml.read_bytes().replace(b'unit = "rad"', b"unit = 5"))
    with pytest.warns(Renewed), Registry.open(old) as registry:
        assert registry.population(POPULATION).actions == ()


def test_times_are_those_at_which_the_engine_reads_states():
    robot = load_robot("quadruped")
    values = robot.space.sample(0, 3, 0)
    run = Run(np.zeros((1, 4, len(robot.actions))))
    periods = log_periods(robot, values, run)
    rate = robot.space.names.index("action_rate")
    np.testing.assert_allclose(periods[:, 0], 1.0 / values[:, rate])
    done = rollout(robot, values, run)
    assert done.physics_steps == 4 * robot.substeps(periods).sum()
