"""Which simulator a session steps: by id, by word, or the nominal one of a robot."""

import shutil

import numpy as np
import pytest

from dynreg import session
from dynreg.errors import NoMatchError, UsageError
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot

EFFECT = {"coulomb_friction[arm]": {"torque": 0.02}, "backlash": {"gap": 0.02}}


@pytest.fixture(scope="module")
def opened(registry_folder, tmp_path_factory):
    """A registry of the servo bench with a simulator that has effects, which a diagnosis tells."""
    folder = tmp_path_factory.mktemp("live") / "registry"
    shutil.copytree(registry_folder, folder)
    robot = load_robot("servo_pendulum")
    with session.open(folder) as made:
        config = SimConfig.of(robot, robot.space.nominal, EFFECT)
        full = made.registry.put_simulator(config.as_dict())
        made.registry.put_result("diagnosis", made.show("bench").id, {"extended_simulator": full})
        yield made


def test_every_name_of_a_simulator_is_that_simulator(opened):
    identity = opened.registry.latest("diagnosis").document["extended_simulator"]
    for ref in (identity, identity[:10], "diagnosed", opened.registry.latest("diagnosis").id):
        live = opened.simulator(ref, settings={"kp": 800})
        assert live.config.effects == EFFECT and live.outside == ("backlash",)
    assert live.model.actuator_gainprm[0, 0] == 2 * opened.simulator(identity).model.actuator_gainprm[0, 0]
    assert opened.simulator(identity, "servo_pendulum").robot.name == "servo_pendulum"


def test_an_entry_is_stepped_with_its_own_parameters(opened):
    entry = opened.registry.load_entry(opened.registry.load("servo_pendulum").ids[3])
    live = opened.simulator(entry.id)
    assert live.config.values == entry.values and live.outside == ()
    assert (live.channels, live.actions) == (("arm/position", "arm/velocity"), ("arm/target",))
    assert np.isfinite(live.step([0.3])).all()


def test_the_nominal_simulator_is_one_of_a_robot(opened):
    live = opened.simulator("nominal", "leg")
    assert live.robot.name == "leg" and live.config.values == live.robot.space.as_dict(
        live.robot.space.nominal
    )
    with pytest.raises(UsageError, match="the 'nominal' simulator of no robot; .*robot="):
        opened.simulator("nominal")


def test_what_cannot_be_stepped_is_told(opened):
    with pytest.raises(NoMatchError, match="nothing"):
        opened.simulator("nothing")
    with pytest.raises(NoMatchError, match="no '@answer' simulator"):
        opened.simulator("@answer")
    with pytest.raises(UsageError, match="is of robot 'servo_pendulum'"):
        opened.simulator("diagnosed", "leg")
    with pytest.raises(UsageError, match="does not run on MuJoCo"):
        opened.simulator("nominal", "diffdrive")
