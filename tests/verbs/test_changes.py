"""Drift of robots without wheels: a payload that was picked up is named with its direction, and nothing else is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynreg
from dynreg.data.recording import Recording
from dynreg.errors import Assumed, UsageError
from dynreg.evidence.truth import Hidden, hide, log_of, protocol
from dynreg.report.html import page
from dynreg.results import Changes
from dynreg.session import Session
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot

QUICK = {"effects": ["load_friction", "payload"], "threshold_runs": 0, "threads": 1}
SHARE, TIP = 0.25, 0.48  # of the tip, and its mass [kg]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


@pytest.fixture(scope="module")
def before(robot: Robot) -> Hidden:
    return hide(robot, (term("load_friction"),), "strong", 11)


def recorded(robot: Robot, hidden: Hidden, seed: int) -> Recording:
    return log_of(robot, hidden, protocol(robot, seed=seed, seconds=12.5), engine="mujoco")


@pytest.fixture(scope="module")
def registry(robot: Robot, before: Hidden, tmp_path_factory: pytest.TempPathFactory) -> Session:
    loaded = replace(
        before, terms=(*before.terms, term("payload")), values=(*before.values, np.array([SHARE * TIP]))
    )
    with dynreg.open(tmp_path_factory.mktemp("changes") / "registry") as session:
        for name, hidden, seed in (("monday", before, 1), ("tuesday", before, 2), ("friday", loaded, 3)):
            session.ingest(recorded(robot, hidden, seed), robot, name=name)
        yield session


@pytest.fixture(scope="module")
def loaded(registry: Session) -> Changes:
    return registry.drift("friday", "monday", **QUICK)


def test_a_load_that_was_picked_up_is_what_changed(loaded: Changes) -> None:
    """A load at the tip is a heavier tip: nothing tells them apart."""
    (change,) = loaded.changed
    assert loaded.verdict == "changed" and change.parameter in ("tip_mass", "mass")
    more = change.difference.value / TIP
    assert more == pytest.approx(SHARE, rel=0.2) and change.difference.low > 0
    assert str(loaded).startswith(f"From monday to friday, {change.name} rose by 0.")
    friction = next(one for one in loaded.changes if one.cause == "load_friction")
    assert friction.same and friction.values["before"].value == pytest.approx(0.2, rel=0.1)


def test_the_page_says_both_values_and_the_direction(loaded: Changes) -> None:
    html = page(loaded)
    assert f"From monday to friday, {loaded.changed[0].name} rose by" in html and "as monday was" in html
    assert html.count('class="pair ') == 2 and loaded.answer in html and loaded.began in html


def test_the_diagnoses_are_kept_and_the_earlier_one_is_taken_again(
    registry: Session, loaded: Changes
) -> None:
    assert registry.result("@last") == loaded == registry.result("friday")
    kinds = [item.name for item in registry.list("result").items]
    assert kinds.count("diagnosis") == 2 and kinds.count("changes") == 1
    found = registry.drift("tuesday", "monday", **QUICK)
    kinds = [item.name for item in registry.list("result").items]
    assert kinds.count("diagnosis") == 3 and found.began == loaded.began
    assert found.verdict == "still true" and found.changed == ()
    assert str(found) == "From monday to tuesday nothing changed that the recordings tell."
    assert "Go on with monday" in page(found)


def test_what_a_robot_without_wheels_cannot_be_asked_is_refused(registry: Session, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"which has no \[base\] table; expected a robot with"):
        registry.drift("friday", "monday", **QUICK, out=tmp_path / "table.parquet")
    with pytest.raises(UsageError, match="'monday' against itself"):
        registry.drift("monday", "monday", **QUICK)


def test_a_damaged_diagnosis_is_told_and_passed_over(registry: Session, loaded: Changes) -> None:
    """It ended the whole question."""
    from dynreg.verbs.changes import known
    from dynreg.verbs.diagnose import DiagnoseSettings
    from dynreg.verbs.subjects import recorded

    monday = recorded(registry.registry, "monday", ingest=False)
    settings = DiagnoseSettings(**QUICK)
    assert known(monday, settings).identity is not None
    (file,) = (registry.registry.path / "results").glob(f"diagnosis-{monday.recording.id[:16]}*")
    whole = file.read_bytes()
    try:
        file.write_bytes(whole[: len(whole) // 2])
        with pytest.warns(Assumed, match="the newest is damaged: see `dynreg verify`"):
            taken = known(monday, settings)
        assert taken.diagnosis is None
    finally:
        file.write_bytes(whole)
