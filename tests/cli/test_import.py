"""`dynreg import` on real registries: what it prints, its exit status, and what comes next."""

import json
from pathlib import Path

import pytest

from dynreg.registry import Registry


@pytest.fixture
def moved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A registry of two simulators, below the folder in which commands run."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DYNREG_REGISTRY", raising=False)
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "robot.toml").write_text('[robot]\nname = "arm"\n')
    with Registry.open(tmp_path / "moved", create=True) as registry:
        registry.put_robot(tmp_path / "robot", "ab" * 32, "arm")
        for mass in (1.0, 2.0):
            registry.put_simulator({"robot": "ab" * 32, "values": {"mass": mass}})
    return Path("moved")


def test_it_says_from_where_to_where_and_how_to_see_it(dynreg, moved):
    ended = dynreg("import", moved, "--registry", "else where")
    assert ended.status == 0 and "import of 'moved' into 'else where'" in ended.out
    assert "next: dynreg list --registry 'else where'" in ended.out
    assert "next: dynreg list\n" in dynreg("import", moved).out


def test_what_is_damaged_is_listed_and_ends_it_with_status_3(dynreg, moved):
    next((moved / "simulators").iterdir()).unlink()
    ended = dynreg("import", moved)
    assert ended.status == 3 and "left out: simulator" in ended.out
    assert "1 thing left out, as 'moved' is damaged" in ended.err
    assert "`dynreg verify --repair --registry moved`" in ended.err
    assert "No such file or directory" in " ".join(ended.out.split()) and "Errno" not in ended.out
    with Registry.open("dynreg-registry") as registry:
        assert len(registry.ids("simulator")) == 1
    ended = dynreg("import", moved, "--json")
    assert ended.status == 3 and json.loads(ended.out)["damaged"] == 1


def test_a_place_without_a_registry_asks_for_the_folder_of_one(dynreg, moved):
    (Path("empty")).mkdir()
    for place in ("nowhere", "empty", "robot"):
        ended = dynreg("import", place, "--registry", "new")
        assert ended.status == 1 and "give the folder of a registry" in ended.err
        assert "--registry" not in ended.err and not Path("new").exists()
