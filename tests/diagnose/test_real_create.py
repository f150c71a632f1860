"""The real iRobot Create (UTIAS MRCLAM), diagnosed from the kinematic model that does at once what it is told."""

from pathlib import Path

import pytest

import dynreg
from dynreg.data.recording import Episode, Recording
from dynreg.sim.robot import load_robot

HALVES = ("first", "second")


@pytest.fixture(scope="module")
def found(data_dir: Path, tmp_path_factory):
    logs = sorted((data_dir / "utias_mrclam").glob("*.parquet"))
    if not logs:
        pytest.skip("no log of the Create in DYNREG_DATA_DIR")
    robot = load_robot("create")
    with dynreg.open(tmp_path_factory.mktemp("registry")) as registry:
        given = registry.ingest(logs, "create", log_map=robot.folder / "maps" / "utias_mrclam.toml")
        log = registry.registry.recording(given.recording)
        whole = log.episodes[0]
        assert whole.duration > 700
        cut = len(whole.time) // 2
        parts = zip(HALVES, (slice(cut), slice(cut, None)), strict=True)
        episodes = tuple(Episode(name, whole.time[s], whole.values[s]) for name, s in parts)
        split = Recording(log.channels, episodes, log.measured, log.provenance)
        identity = registry.registry.put_recording(split, robot.hash)
        yield registry.diagnose(
            identity,
            hold_out="second",
            effects=("turn_slowdown", "drive_inertia", "command_deadband"),
            threshold_runs=0,
            threads=1,
        )


def test_it_names_what_turns_cost_and_the_missing_lag(found) -> None:
    assert {"turn_slowdown", "drive_inertia"} == {c.effect for c in found.causes}
    sizes = {c.effect: next(iter(c.parameters.values())) for c in found.causes}
    assert sizes["turn_slowdown"].value == pytest.approx(0.095, abs=0.012)  # m
    assert 0.15 < sizes["drive_inertia"].value < 0.32  # s
    assert found.parameters["yaw_gain"].value == pytest.approx(0.94, abs=0.035)


def test_the_half_that_was_held_out_is_nearer(found) -> None:
    assert all("second" in name for name in found.parts["test"])
    errors = {e.channel: e for e in found.errors if e.part == "test"}
    for axis in ("base/x", "base/y"):
        assert errors[axis].extended < 0.65 * errors[axis].nominal
