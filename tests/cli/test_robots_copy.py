"""`dynreg robots copy`: a robot's folder under another name, to be changed."""

from pathlib import Path

import pytest

from dynreg.folder import read_folder
from dynreg.sim.robot import load_robot, packaged_robots


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", ["servo_pendulum", "emps", pytest.param("aibo", marks=pytest.mark.slow)])
def test_a_packaged_robot_is_copied_whole_but_for_its_name(dynreg, here: Path, name: str) -> None:
    made = dynreg("robots", "copy", name, "mine")
    assert (
        made.status == 0 and "mine: sound" in made.out and "next: dynreg ingest LOG --robot mine" in made.out
    )
    old, new = read_folder(packaged_robots()[name], links=True).files, read_folder(here / "mine").files
    assert old.keys() == new.keys() and [path for path in old if old[path] != new[path]] == ["robot.toml"]
    before, after = old["robot.toml"].decode(), new["robot.toml"].decode()
    assert after == before.replace(f'name = "{name}"', 'name = "mine"', 1)
    assert load_robot("mine").name == "mine"


def test_a_folder_of_ones_own_is_copied_too(dynreg, here: Path) -> None:
    assert dynreg("robots", "copy", "servo_pendulum", "mine").status == 0
    toml = here / "mine" / "robot.toml"
    toml.write_text(toml.read_text().replace('name = "mine"', "name = 'mine' # ours"))
    ended = dynreg("robots", "copy", "./mine", "other")
    assert ended.status == 1 and "cannot be replaced" in ended.err and not (here / "other").exists()
    toml.write_text(toml.read_text().replace("'mine' # ours", '"mine" # ours'))
    assert dynreg("robots", "copy", "mine", "other").status == 0
    assert 'name = "other" # ours' in (here / "other" / "robot.toml").read_text()


@pytest.mark.parametrize(
    ("source", "folder", "says"),
    [
        ("servo_pendulum", "taken", "'taken' exists already"),
        ("servo_pendulum", "nowhere/mine", "No such file or directory"),
        ("servo_pendulum", "quadruped", "no name of a robot that comes with dynreg"),
        ("servo_pendulum", "my robot", "robot name 'my robot', by the folder's"),
        ("servo", "mine", "no robot 'servo'"),
    ],
)
def test_what_cannot_be_copied_leaves_nothing(
    dynreg, here: Path, source: str, folder: str, says: str
) -> None:
    (here / "taken").mkdir()
    (here / "taken" / "kept").write_text("kept")
    ended = dynreg("robots", "copy", source, folder)
    assert ended.status != 0 and says in ended.err, ended
    assert [path.name for path in here.iterdir()] == ["taken"]
    assert (here / "taken" / "kept").read_text() == "kept"
