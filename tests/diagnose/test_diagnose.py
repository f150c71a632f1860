"""The whole diagnosis of a recorded hidden servo, through the session: result, simulators, storage."""

import numpy as np
import pytest

import dynreg
from dynreg.data.recording import Episode, Recording
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.errors import LogError
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    robot = load_robot("servo_pendulum")
    hidden = hide(robot, (term("cogging"),), "strong", 11)
    recording = log_of(robot, hidden, protocol(robot, seed=1), engine="mujoco")
    with dynreg.open(tmp_path_factory.mktemp("registry")) as registry:
        name = registry.ingest(recording, robot, name="hidden").recording
        found = registry.diagnose(
            name, hold_out="test_0,test_1,test_2,test_3", effects=["cogging", "payload"], threshold_runs=0
        )
        yield registry, robot, recording, found


def test_it_names_the_hidden_effect_and_says_what_it_gains(made):
    _, _, _, found = made
    assert found.verdict == "named" and found.causes[0].effect == "cogging"
    assert found.causes[0].gain.low > 0
    assert found.error.extended < 0.5 * found.error.calibrated
    assert set(found.parts["test"]).isdisjoint(found.parts["fit"] + found.parts["select"])


def test_the_extended_simulator_is_registered_with_its_lineage(made):
    registry, robot, _, found = made
    config = registry.registry.simulator(found.extended_simulator)
    assert set(config["effects"]) == {"cogging"} and config["robot"] == robot.hash
    assert config["lineage"]["made_by"] == "diagnose"
    assert config["values"] == {name: p.value for name, p in found.parameters.items()}


def test_a_recording_in_which_nothing_moves_is_refused(made):
    registry, robot, recording, _ = made
    still = tuple(
        Episode(e.name, e.time, np.tile(e.values[:1], (len(e.time), 1)), e.settings)
        for e in recording.episodes
    )
    registry.registry.put_recording(Recording(recording.channels, still, measured=False), robot.hash, "still")
    with pytest.raises(LogError, match="never change"):
        registry.diagnose("still", threshold_runs=0)
