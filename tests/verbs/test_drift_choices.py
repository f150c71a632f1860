"""What `drift` begins from: which recording is earlier, which stored diagnosis fits, which settings have a meaning."""

from dataclasses import replace
from pathlib import Path

import made_up_diagnosis
import numpy as np
import pytest

import dynreg
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.diagnose.refitted import Left, Refits
from dynreg.errors import Assumed, NoMatchError, UsageError
from dynreg.report.changes import left_words, steps
from dynreg.results import Diagnosis
from dynreg.session import Session
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.changes import known, verdict_of
from dynreg.verbs.diagnose import DiagnoseSettings
from dynreg.verbs.diagnosis import options_told
from dynreg.verbs.drift import DriftSettings, _first, in_time
from dynreg.verbs.subjects import Recorded, recorded

DAY = 1_768_472_911.0  # 2026-01-15 10:28:31 UTC


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def log(clock: float, size: float = 1.0) -> Recording:
    """A short swing whose log's clock begins so."""
    time = 0.01 * np.arange(200)
    values = np.stack([size * np.sin(time), size * np.cos(time), size * np.sin(time), 7.4 + 0 * time], axis=1)
    names = zip(
        ("arm/position", "arm/velocity", "arm/target", "supply"), ("rad", "rad/s", "rad", "V"), strict=True
    )
    episode = Episode("run", time, values, {"kp": 400.0, "added_mass": 0.0})
    return Recording(tuple(Channel(*one) for one in names), (episode,), True, {"clocks": {"run": clock}})


@pytest.fixture
def session(tmp_path: Path) -> Session:
    with dynreg.open(tmp_path / "registry") as opened:
        yield opened


def asked(session: Session, robot: Robot, name: str, clock: float, size: float) -> Recorded:
    session.ingest(log(clock, size), robot, name=name)
    return recorded(session.registry, name, ingest=False)


# ---- which recording is the earlier one ----


def test_a_clock_of_the_day_is_told_from_one_that_begins_anywhere() -> None:
    assert log(DAY).began == DAY
    assert log(0.0).began is None and log(86_400.0 * 300).began is None and log(1e12).began is None
    assert replace(log(DAY), provenance={}).began is None


def test_the_logs_own_clocks_say_which_is_earlier(session: Session, robot: Robot) -> None:
    """Whatever was ingested first, and whatever --against names."""
    friday = asked(session, robot, "friday", DAY + 4 * 86_400, 1.0)
    monday = asked(session, robot, "monday", DAY, 1.1)
    for order in (in_time(friday, monday, chosen=False), in_time(monday, friday, chosen=False)):
        assert (order.recent.name, order.earlier.name) == ("friday", "monday")
        said = "monday (2026-01-15 10:28:31 UTC) is earlier than friday (2026-01-19 10:28:31 UTC)"
        assert f"by the logs' own clocks {said}" in order.said
    assert order.said.endswith("although --against names the latter")
    assert _first(friday).name == "monday", "it was ingested after friday"
    with pytest.raises(NoMatchError, match="no earlier recording"):
        _first(monday)


def test_without_clocks_of_the_day_what_was_named_decides_and_is_said(session: Session, robot: Robot) -> None:
    one, other = asked(session, robot, "one", 0.0, 1.0), asked(session, robot, "other", DAY, 1.1)
    order = in_time(one, other, chosen=False)
    assert (order.recent, order.earlier) == (one, other)
    assert order.said == (
        "the logs keep no clock of the day: other is taken for the earlier recording, as --against names it"
    )
    assert in_time(other, one, chosen=True).said.endswith("as it was ingested first")


# ---- which diagnosis ----


def stored(session: Session, about: Recorded, settings: DiagnoseSettings, **other: object) -> str:
    """A diagnosis of a recording as it is kept; its id. other : fields that differ."""
    robot = about.robot
    config = SimConfig.of(robot, robot.space.nominal)
    made = session.registry.put_simulator(config.as_dict() | {"lineage": {"kind": "calibrated"}})
    told = made_up_diagnosis.diagnosis("none").model_copy(
        update={
            "recording": about.recording.id,
            "calibrated_simulator": made,
            "asked": options_told(settings.options),
            "robot": robot.name,
        }
        | other
    )
    document = Diagnosis.model_validate(told.to_dict()).to_dict()
    return session.registry.put_result("diagnosis", about.recording.id, document)


def test_the_newest_diagnosis_that_fits_is_taken_and_said(session: Session, robot: Robot) -> None:
    monday, usual = asked(session, robot, "monday", DAY, 1.0), DiagnoseSettings()
    stored(session, monday, usual, seed=3)
    fits = stored(session, monday, usual, seed=4)
    stored(session, monday, replace(usual, tolerance=5.0))
    stored(session, monday, usual, calibrated_simulator=None)
    other = SimConfig("ab" * 32, robot.name, robot.space.as_dict(robot.space.nominal))
    elsewhere = session.registry.put_simulator(other.as_dict() | {"lineage": {}})
    stored(session, monday, usual, calibrated_simulator=elsewhere)
    taken = known(monday, usual)
    assert taken.identity == fits and taken.diagnosis.seed == 4
    assert taken.said == f"diagnosis {fits[:12]} of monday was taken, the newest of 5"
    assert known(monday, replace(usual, seed=9, hold_out="run")).identity == fits, "the same question"


def test_where_none_fits_it_is_said_what_to_type(session: Session, robot: Robot) -> None:
    monday, usual = asked(session, robot, "monday", DAY, 1.0), DiagnoseSettings()
    assert known(monday, usual).said == "no diagnosis of monday was stored: one was made"
    stored(session, monday, replace(usual, tolerance=5.0, effects=("payload", "cogging")))
    with pytest.warns(Assumed, match="add --effects payload,cogging --tolerance 5.0"):
        taken = known(monday, usual)
    assert taken.diagnosis is None and "the stored diagnosis of monday does not fit" in taken.said
    stored(session, monday, usual, asked=None)
    with pytest.warns(
        Assumed, match="none of the 2 stored diagnoses of monday fits .* does not tell its options"
    ):
        assert known(monday, usual).identity is None


# ---- the third verdict ----


@pytest.mark.parametrize(
    ("before", "after", "verdict", "said"),
    [
        ((0.01, 0.002), (0.012, 0.002), "named", "still true"),
        ((0.01, 0.002), (0.02, 0.002), "named", "unexplained"),
        ((0.001, 0.01), (0.012, 0.01), "named", "still true"),  # both are noise
        ((0.01, 0.002), (0.01, 0.002), "unknown", "unexplained"),
        ((0.01, 0.002), (0.01, 0.002), "partly_explained", "still true"),
    ],
)
def test_what_no_value_explains_is_not_called_still_true(before, after, verdict, said) -> None:
    both = Refits((), {"before": Left(*before), "after": Left(*after)})
    assert verdict_of(both, made_up_diagnosis.diagnosis(verdict)) == said


def test_what_to_do_where_neither_diagnosis_explains_the_recent_recording() -> None:
    import made_up_changes

    found = made_up_changes.changes(changed=False)
    both = {"before": {"residual": 0.01, "noise": 0.002}, "after": {"residual": 0.05, "noise": 0.002}}
    found = found.model_validate(found.to_dict() | {"verdict": "unexplained", "left": both})
    assert str(found) == "From monday to friday no value changed, but neither diagnosis explains friday."
    told = " ".join(steps(found))
    assert "dynreg doctor LOG" in told and "dynreg diagnose friday" in told and "Go on with" not in told
    assert "leaves 1 % of the motion of monday unexplained, and 5 % of that of friday" in left_words(found)
    changed = made_up_changes.changes()
    worse = changed.model_validate(changed.to_dict() | {"gain": {"value": -0.4, "low": -0.6, "high": -0.2}})
    assert "Do not use simulator 343434343434:" in steps(worse)[0]
    assert steps(changed)[0].startswith("Use simulator")


# ---- settings ----


@pytest.mark.parametrize(
    ("name", "settings", "said"),
    [
        (
            "servo_pendulum",
            {"cells": 10},
            r"--cells 10 has no meaning for robot 'servo_pendulum', which has no \[base\] table",
        ),
        (
            "husky",
            {"cells": 10},
            r"'husky', which has no \[base\] table",
        ),  # it has wheels, driven by two speeds
        ("servo_pendulum", {"welch": True}, "--welch has no meaning"),
        ("servo_pendulum", {"together": False}, "--no-fdr has no meaning"),
        (
            "diffdrive",
            {"effects": ("payload",)},
            "--effects payload has no meaning for robot 'diffdrive', which has",
        ),
        ("diffdrive", {"threshold_runs": 0}, "--threshold-runs 0 has no meaning"),
        ("diffdrive", {"horizon": 2.0}, "--horizon 2.0 has no meaning"),
    ],
)
def test_a_setting_without_a_meaning_for_the_robot_is_refused(name: str, settings: dict, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        DriftSettings(**settings).meant_for(load_robot(name))


def test_settings_with_a_meaning_are_taken() -> None:
    DriftSettings(cells=10, welch=True, seed=3, threads=1).meant_for(load_robot("diffdrive"))
    DriftSettings(effects=("payload",), horizon=2.0, seed=3, threads=1).meant_for(
        load_robot("servo_pendulum")
    )
