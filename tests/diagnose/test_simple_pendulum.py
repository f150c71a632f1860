"""The real pendulum whose logs do not tell its bob's mass: the diagnosis says so, and what would."""

import pytest

import dynreg
from dynreg.results import Diagnosis, diagnosis_details

LOADED = "energy_shaping_1kg"  # with about 0.4 kg more


@pytest.fixture(scope="module")
def found(tmp_path_factory, data_dir):
    folder = data_dir / "dfki_simple_pendulum"
    logs = [folder / f"control_method_{LOADED}_{part}.csv" for part in ("measured", "desired")]
    with dynreg.open(tmp_path_factory.mktemp("registry")) as registry:
        name = registry.ingest(logs, "simple_pendulum", name=LOADED).recording
        yield registry.diagnose(
            name, effects=["payload"], engine="joint", horizon=1.0, threshold_runs=0, threads=1
        )


def test_payload_and_the_drives_gain_are_reported_as_not_told_apart(found):
    (pair,) = found.inseparable
    assert pair.between == ("payload", "drive_gain") and pair.growth > 1.5
    assert "coulomb_friction" in found.looked.rivals, "friction was looked at; the nominal one already varies"


def test_the_interval_holds_the_payload_only_if_rivals_may_act(found):
    true = 0.4  # kg
    alone, wide = found.looked.alone["mass"], found.looked.whatever["mass"]
    assert not alone.low <= true <= alone.high
    assert wide.low <= true <= wide.high


def test_the_sentence_names_the_pair_the_interval_and_the_experiment(found):
    wide = found.looked.whatever["mass"]
    details = "\n".join(diagnosis_details(found))
    assert "does not separate payload from drive_gain" in details
    assert f"between {wide.low:.3g} and {wide.high:.3g}" in details
    assert "dynreg excite simple_pendulum --for payload," in details
    assert Diagnosis.model_validate_json(found.to_json()) == found
