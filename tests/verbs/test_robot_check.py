"""What `robots check` says of a robot's gaits, motions and tasks: what a search for them would refuse."""

from pathlib import Path

import pytest
import toy_dog

from dynreg.verbs.robots import robot_check

MOTION = '[[motions]]\nname = "kick"\njoints = ["fl_rotor"]\n'
KICK = '[[tasks]]\nname = "kick"\nkind = "kick"\nmotion = "kick"\n'
FAULTS = {
    "a joint that is not there": ('joints = ["fl_rotor"]', 'joints = ["fl_wing"]', "[[motions]]", "'fl_wing'"),
    "a kind that is not there": ('kind = "locus"', 'kind = "lokus"', "[gait]", "unknown kind 'lokus'"),
    "a ball that is not told": ('tracked = ["ball"]', "", '[[tasks]]\nname = "kick"', "scores 1 tracked bodies"),
    "a gene that is not there": ("ramp = 0.5", "ramp = 0.5\nranges = {height = [0.0, 1.0]}", "[gait]", "'height'"),
    "a value that is not there": (KICK, KICK + "values = {wind = 1.0}\n", '[[tasks]]\nname = "kick"', "'wind'"),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return toy_dog.folder(
        tmp_path_factory.mktemp("robots") / "dog", toy_dog.walking(), MOTION + KICK, ball=True
    )


def test_a_dog_that_walks_and_kicks_is_sound(folder: Path) -> None:
    checked = robot_check(str(folder))
    assert checked.sound and checked.problems == ()


def test_so_is_the_quadruped_that_comes_along() -> None:
    assert robot_check("quadruped").sound


@pytest.mark.parametrize("fault", FAULTS)
def test_what_a_search_refuses_is_told_once_with_its_line(fault: str, folder: Path, tmp_path: Path) -> None:
    old, new, table, says = FAULTS[fault]
    (tmp_path / "model.xml").write_bytes((folder / "model.xml").read_bytes())
    text = (folder / "robot.toml").read_text(encoding="utf-8")
    assert text.count(old) == 1
    text = text.replace(old, new)
    (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
    (told,) = robot_check(str(tmp_path)).problems
    line = text[: text.index(table)].count("\n") + 1
    assert told.startswith(f"robot.toml, line {line}: ") and says in told
