"""The real XL330 bench with few effects: load friction is the cause, the supply that was measured is none."""

from pathlib import Path

import numpy as np
import pytest

import dynreg
from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.identifiability import unidentified
from dynreg.diagnose.measured import measured_effects
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans import Short
from dynreg.diagnose.pose import pose
from dynreg.diagnose.threshold import USUAL
from dynreg.evidence.likelihood import information
from dynreg.evidence.lockstep import run
from dynreg.evidence.slopes import sensitivities
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
    return run(calibrate(*posed, draws=Short().draws))


def test_load_friction_is_the_cause_and_takes_a_fifth_off_the_held_out_error(posed, calibrated):
    model, data = calibrated.model, posed[1]
    terms = [term(e) for e in EFFECTS]
    naming, _ = run(Short(iterations=3).name(model, calibrated.point, terms, calibrated.sample))
    assert naming.chosen.key == "load_friction" and naming.chosen.nats > USUAL
    test = data.sample(np.flatnonzero(data.parts.test))
    left = run(model.residuals([naming.start.point, naming.chosen.point], test))
    before, after = np.nanmean(np.abs(left), axis=(1, 2, 3))
    assert after < 0.8 * before


def test_the_measured_supply_is_no_candidate(posed):
    model, data = posed
    assert measured_effects(model.robot, data.windows) == {"voltage_sag": "supply"}


def test_the_recording_tells_the_mass_about_as_well_as_the_nameplate(posed, calibrated):
    model, point, sample = calibrated.model, calibrated.point, calibrated.sample
    (residual,), (slope,) = run(sensitivities(model, [point], sample))
    curvature, _ = information(point, residual, slope, sample)
    covariance = np.linalg.inv(curvature)
    mass = [model.robot.space.parameters[i].name for i in model.coordinates.free].index("tip_mass")
    assert 0.5 < np.sqrt(covariance[mass, mass]) < 0.9, "of the nameplate's standard deviation"
    assert unidentified(model.coordinates, covariance).alone == ()
