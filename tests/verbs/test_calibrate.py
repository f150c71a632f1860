"""One interface for every method: the same document, the lineage of what was made, and a run that goes on."""

from pathlib import Path

import pytest
from tiny_registry import bench_csv, make

import dynreg
from dynreg.cli.schemas import schema_files
from dynreg.errors import UsageError
from dynreg.methods.table import METHODS
from dynreg.results import Calibration
from dynreg.session import Session

PLAN = """
[[stages]]
name = "masses"
parameters = ["tip_mass", "rotor_inertia"]
recordings = ["e0", "e1", "e2"]
loss = "joint"
shift = 0.02
generations = 2
children = 6
mu = 2

[[stages]]
name = "all"
parameters = ["*"]
generations = 2
children = 6
mu = 2
"""
TOLD = {"budget": 30, "hold_out": "e4", "threads": 1}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibrated")
    make(folder)
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def session(place: Path):
    with dynreg.open(place / "registry") as opened:
        yield opened


def asked(session: Session, place: Path, method: str, **told) -> Calibration:
    plan = {"plan": place / "plan.toml"} if "plan" in METHODS[method].needs else {}
    return session.calibrate("bench", method=method, **{**TOLD, **plan, **told})


@pytest.fixture(scope="module")
def found(session: Session, place: Path) -> dict[str, Calibration]:
    return {name: asked(session, place, name) for name in METHODS if name != "diagnose"}


def test_every_method_answers_by_the_same_measure(found: dict[str, Calibration]) -> None:
    assert {(one.nominal_train_error, one.nominal_test_error) for one in found.values()} == {
        (found["cma"].nominal_train_error, found["cma"].nominal_test_error)
    }
    assert all(0 < one.test_error < 10 and one.ended for one in found.values())
    assert "calibration.2.json" in schema_files()


def test_every_version_is_a_registered_simulator_that_says_what_it_came_from(
    session: Session, found: dict[str, Calibration]
) -> None:
    for one in found.values():
        assert one.versions[-1].simulator == one.simulator
        for version in one.versions:
            kept = session.registry.simulator(version.simulator)
            assert kept["lineage"]["made_by"] == f"calibrate {one.method}"
            assert kept["lineage"].get("parent") == version.parent
            assert version.recordings == (one.recording,) and "e4" not in version.episodes, (
                "what is held out shapes nothing"
            )


def test_the_stages_of_a_plan_are_versions_in_turn(found: dict[str, Calibration]) -> None:
    masses, every = found["staged"].versions
    assert (masses.stage, every.stage) == ("masses", "all") and every.parent == masses.simulator
    assert masses.episodes == ("e0", "e1", "e2") and every.episodes == ("e0", "e1", "e2", "e3")
    assert masses.after <= masses.before and every.after <= every.before


def test_a_simulator_is_made_of_the_nearest_one(found: dict[str, Calibration]) -> None:
    nearest, made = found["synthesis"].versions
    assert made.parent == nearest.simulator and found["synthesis"].population == found["nearest"].population
    assert len(found["nearest"].versions) == 1


def test_the_document_reads_back_and_version_1_still_opens(found: dict[str, Calibration]) -> None:
    document = found["cma"].to_dict()
    assert Calibration.model_validate(document) == found["cma"]
    new = {"versions", "causes", "parts", "ended", "population", "seed"}
    old = {name: value for name, value in document.items() if name not in new}
    old |= {"schema": "dynreg/calibration/1"}
    old["cost"] = {k: v for k, v in old["cost"].items() if k not in ("simulated_seconds", "core_seconds")}
    assert Calibration.model_validate(old).train_error == found["cma"].train_error


def test_a_calibration_is_simulated_by_its_word(session: Session, found: dict[str, Calibration]) -> None:
    compared = session.compare("bench", simulators=["nominal", "calibrated"], hold_out="e4")
    assert compared.rows()


def test_an_interrupted_calibration_goes_on_and_asks_for_the_same_settings(
    session: Session, place: Path
) -> None:
    whole = asked(session, place, "es", seed=5)

    def stop(stage: str, done: int, total: int) -> None:
        if done > 15:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        asked(session, place, "es", seed=5, progress=stop)
    with pytest.raises(UsageError, match=r"another search \(seed differ"):
        asked(session, place, "es", seed=6, resume=True)
    again = asked(session, place, "es", seed=5, resume=True)
    assert (again.parameters, again.history) == (whole.parameters, whole.history)


def test_several_recordings_are_fitted_together_and_a_stage_may_name_one(
    session: Session, place: Path
) -> None:
    slower = bench_csv(lambda i, row: [row[0], 0.9 * row[1], 0.9 * row[2], *row[3:]])
    (place / "other.csv").write_text(slower, encoding="utf-8")
    other = session.ingest(place / "other.csv", "servo_pendulum", name="other")
    plan = PLAN.replace('"e0", "e1", "e2"', '"other"')
    (place / "both.toml").write_text(plan, encoding="utf-8")
    found = session.calibrate(
        ["bench", "other"], method="staged", plan=place / "both.toml", budget=30, threads=1
    )
    first, second = found.versions
    assert first.recordings == (other.recording,) and len(second.recordings) == 2


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ({"method": "staged"}, "without a plan"),
        ({"method": "cma", "plan": Path("x.toml")}, "reads none"),
        ({"method": "es", "population": "crowd"}, "reads none"),
        ({"method": "btr"}, "method 'btr'"),
    ],
)
def test_a_method_without_what_it_needs_says_so(session: Session, told: dict, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        session.calibrate("bench", **told)


def test_it_begins_with_another_simulator_and_carries_what_that_had_fitted(
    session: Session, place: Path, found: dict[str, Calibration]
) -> None:
    start = found["cma"]
    again = asked(session, place, "staged", start=start.simulator)
    assert again.versions[0].parent == start.simulator
    assert again.versions[1].before <= start.train_error * 1.001, "the second stage is of the replay error"
    with pytest.raises(UsageError, match="begins with registered simulators"):
        asked(session, place, "nearest", start=start.simulator)
