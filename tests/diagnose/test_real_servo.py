"""The real XL330 bench with few effects: load friction is the cause, the supply that was measured is none."""

from pathlib import Path

import numpy as np
import pytest

import dynreg
from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.effort import Effort
from dynreg.diagnose.fit import information, sensitivities
from dynreg.diagnose.loose import loose_ends
from dynreg.diagnose.name import name_one
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.shown import shown
from dynreg.diagnose.threshold import USUAL
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

EFFECTS = ("load_friction", "cogging", "force_offset")


@pytest.fixture(scope="module")
def posed(data_dir: Path, tmp_path_factory):
    logs = sorted((data_dir / "bam_xl330_pendulum" / "raw").glob("*.json"))
    if not logs:
        pytest.skip("no XL330 log in DYNREG_DATA_DIR")
    with dynreg.open(tmp_path_factory.mktemp("registry")) as registry:
        recording = registry.registry.recording(registry.ingest(logs, "servo_pendulum").recording)
    settings = DiagnosisOptions(hold_out="kp=400", tolerance=5.0, threads=1)
    return pose(load_robot("servo_pendulum"), recording, settings)


@pytest.fixture(scope="module")
def calibrated(posed):
    problem, split = posed
    return calibrate(problem, np.flatnonzero(split.fit), iterations=3)


def test_load_friction_is_the_cause_and_takes_a_fifth_off_the_held_out_error(posed, calibrated):
    problem, split = posed
    base, effective = calibrated
    fit_on, select_on = np.flatnonzero(split.fit), np.flatnonzero(split.select)
    naming = name_one(
        problem, base, [term(e) for e in EFFECTS], fit_on, select_on, effective, effort=Effort(iterations=3)
    )
    assert naming.chosen.key == "load_friction" and naming.chosen.nats > USUAL
    left = problem.residuals([naming.start.point, naming.chosen.point], np.flatnonzero(split.test))
    before, after = np.nanmean(np.abs(left), axis=(1, 2, 3))
    assert after < 0.8 * before


def test_the_measured_supply_is_no_candidate(posed):
    problem, _ = posed
    assert shown(problem.robot, problem.windows) == {"voltage_sag": "supply"}


def test_the_scale_of_the_mass_is_left_open(posed, calibrated):
    problem, split = posed
    point, effective = calibrated
    fit_on = np.flatnonzero(split.fit)
    residual, slopes = sensitivities(problem, [point], fit_on)
    curvature, _ = information(problem, point, residual[0], slopes[0], effective)
    assert "tip_mass" in loose_ends(problem.coordinates, np.linalg.inv(curvature)).alone
