"""Effects of one's own: twenty lines, and every engine has them (the example of docs/effects.md)."""

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from effect_benches import bench, plain, rms

from dynreg.errors import RobotError, UsageError
from dynreg.sim.effects import Terms, applicable, effect, effects, term
from dynreg.sim.engines import rollout

PAGE = Path(__file__).parents[3] / "docs" / "effects.md"


class _Point:
    """An entry point that loads a class."""

    def __init__(self, plugin: type):
        self.plugin, self.value = plugin, f"somewhere:{plugin.__name__}"

    def load(self) -> type:
        return self.plugin


def _code() -> str:
    """The first Python block of the page."""
    return re.search(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL).group(1)


@pytest.fixture
def documented(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[type]:
    """The class of that block, from a file of its own as a user would write it."""
    assert len(_code().splitlines()) <= 20
    (tmp_path / "cables.py").write_text(_code())
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("cables").CableDrag
    del sys.modules["cables"]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Iterator:
    """Puts classes where entry points of installed packages would be."""

    def put(*plugins: type) -> None:
        monkeypatch.setattr("dynreg.plugins.entry_points", lambda group: [_Point(p) for p in plugins])
        effects.cache_clear()

    yield put
    effects.cache_clear()


@pytest.mark.usefixtures("own_effects_alone")
def test_the_documented_plugin_is_listed_and_works_on_both_engines(install, documented):
    install(documented)
    assert list(effects())[-1] == "cable_drag"
    drag = effect("cable_drag")
    assert drag in applicable(bench("servo").robot).values()
    pulled = [
        bench(name).changes({drag: "strong"}, {drag: 0.02}, {drag: 0.01})
        for name in ("servo", "servo_mujoco")
    ]
    assert rms(pulled[0][0]) > 0.005
    assert rms(pulled[0][0] - pulled[1][0]) < 0.1 * rms(pulled[0][0])
    assert 1.4 < rms(pulled[0][1]) / rms(pulled[0][2]) < 2.8


def test_an_installed_package_is_found_by_its_entry_point(tmp_path: Path, monkeypatch):
    entry = re.search(
        r"```toml\n\[project.entry-points.\"dynreg.effects\"\]\n(.*?)```", PAGE.read_text(), re.DOTALL
    )
    (tmp_path / "my_package").mkdir()
    (tmp_path / "my_package" / "cables.py").write_text(_code())
    about = tmp_path / "my_package-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: my_package\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[dynreg.effects]\n" + entry.group(1).replace('"', ""))
    monkeypatch.syspath_prepend(str(tmp_path))
    effects.cache_clear()
    try:
        assert effect("cable_drag").title == "a cable pulls the joint back"
    finally:
        effects.cache_clear()


@pytest.mark.usefixtures("own_effects_alone")
def test_a_plugin_composes_with_the_packaged_effects(install, documented):
    install(documented)
    b, drag = bench("air"), effect("cable_drag")
    both = b.states({drag: "strong", effect("load_friction"): "strong"})
    assert np.isfinite(both).all()
    assert rms(both[0] - plain(b)) > 0


def test_a_plugin_cannot_take_an_id_that_is_taken(install, documented):
    taken = type("Taken", (documented,), {"id": "backlash"})
    install(taken)
    with pytest.raises(RobotError, match="'backlash'.*not taken"):
        effects()


def test_a_plugin_that_cannot_be_made_is_named(install, documented):
    def broken(self):
        raise ValueError("no cable")

    install(type("Broken", (documented,), {"__init__": broken}))
    with pytest.raises(RobotError, match="somewhere:Broken cannot be loaded: ValueError: no cable"):
        effects()


def test_a_plugin_that_is_no_effect_is_refused(install):
    install(dict)
    with pytest.raises(RobotError, match="somewhere:dict is <class 'dict'>; expected a class derived from"):
        effects()


def test_a_joint_that_is_named_is_the_only_one_that_has_the_effect():
    """Friction on the knee holds the knee back and, through the links alone, the hip."""
    b = bench("air")
    states = {}
    for key in ("coulomb_friction[knee]", "coulomb_friction[hip_roll,hip_pitch,knee]", "coulomb_friction"):
        terms = Terms((term(key),), (np.array([[0.3]]),))
        states[key] = rollout(b.robot, b.robot.space.nominal[None], b.run, terms=terms).states[0]
    knee, named, every = states.values()
    np.testing.assert_array_equal(named, every)
    moved = np.sqrt(((knee - plain(b)) ** 2).mean(axis=(0, 1)))[b.columns]
    joints = [b.robot.channels[c].split("/")[0] for c in b.columns]
    assert joints[int(moved.argmax())] == "knee" and moved.max() > 3 * np.median(moved)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("bakclash", "unknown effect 'bakclash'; expected one of [0-9]+ names .near: 'backlash'"),
        ("backlash[knee", "EFFECT or EFFECT\\[JOINT,...\\]"),
        ("backlash[ankle]", "no action drives 'ankle'.*hip_pitch"),
        ("imu_misalignment", "no roll and pitch of a base are measured"),
    ],
)
def test_what_cannot_be_is_told_in_one_line(key: str, message: str):
    b = bench("air")
    with pytest.raises(UsageError, match=message):
        chosen = term(key)
        values = np.full((1, len(chosen.effect.parameters)), 0.01)
        rollout(b.robot, b.robot.space.nominal[None], b.run, terms=Terms((chosen,), (values,)))
