"""The real EMPS (https://www.nonlinearbenchmark.org), diagnosed from its published model without dry friction."""

from pathlib import Path

import pytest

import dynreg

PUBLISHED = {"coulomb_friction": 20.3935, "force_offset": 3.1648}  # N


@pytest.fixture(scope="module")
def ingested(data_dir: Path, tmp_path_factory):
    logs = sorted((data_dir / "emps").glob("*.mat"))
    if not logs:
        pytest.skip("no EMPS log in DYNREG_DATA_DIR")
    with dynreg.open(tmp_path_factory.mktemp("registry")) as registry:
        yield registry, registry.ingest(logs, "emps", name="emps").recording


def _diagnose(ingested, *effects: str):
    registry, recording = ingested
    return registry.diagnose(
        recording, hold_out="DATA_EMPS_PULSES", effects=effects, threshold_runs=0, threads=1
    )


def test_it_names_dry_friction_and_how_viscous_friction_differs_between_directions(ingested):
    found = _diagnose(
        ingested, "coulomb_friction", "stribeck_friction", "force_offset", "asymmetric_viscous", "payload"
    )
    assert [c.effect for c in found.causes] == ["coulomb_friction", "asymmetric_viscous"]
    torque = found.causes[0].parameters["torque"]
    published = PUBLISHED["coulomb_friction"]  # the interval holds it, and is a tenth of it wide
    assert torque.low < published < torque.high < torque.low + 0.1 * published and torque.unit == "N"
    assert found.causes[1].parameters["difference"].value < -20.0
    assert found.error.extended < 0.3 * found.error.calibrated < 0.3 * found.error.nominal
    assert not any("PULSES" in name for name in found.parts["fit"] + found.parts["select"])


@pytest.mark.slow
def test_with_the_published_structure_it_names_dry_friction_and_the_constant_force(ingested):
    found = _diagnose(ingested, "coulomb_friction", "force_offset", "payload")
    assert [c.effect for c in found.causes] == ["coulomb_friction", "force_offset"]
    # one viscous friction for both directions: the windows disagree about the rest
    for cause in found.causes:
        assert cause.parameters["torque"].value == pytest.approx(PUBLISHED[cause.effect], rel=0.15)
    assert found.error.extended < 0.5 * found.error.calibrated
