"""The drives' law: what their limits damp, and where it changes during an episode."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.sim.ports import law_changes, nominal_ports, servo_law
from dynreg.sim.robot import load_robot
from dynreg.sim.sets import NO_LIMIT


def test_the_law_changes_where_an_input_of_any_simulation_does():
    leg = load_robot("leg")
    ports = nominal_ports(leg, 2)
    (heard,) = np.unique(ports.enable_input)
    inputs = np.ones((2, 8, len(leg.inputs) + 1))
    inputs[..., -1] = np.arange(8)  # no drive listens to this one
    assert law_changes(ports, inputs) == frozenset()
    inputs[0, 3:, heard] = 0.0
    inputs[1, 6, heard] = 0.0
    assert law_changes(ports, inputs) == {3, 6, 7}


@pytest.mark.parametrize("missing", [("torque_limit",), ("speed_limit",), ("torque_limit", "speed_limit")])
def test_a_limit_that_is_not_stated_damps_nothing(missing: tuple[str, ...]):
    leg = load_robot("leg")
    stated = nominal_ports(leg, 1)
    inputs = np.ones((1, len(leg.inputs)))
    assert np.array_equal(servo_law(stated, inputs).damping, np.full((1, len(leg.actions)), 4.1 / 12.0))
    plain = {k: v for k, v in leg.file.drives[0].model_dump(exclude_unset=True).items() if k not in missing}
    drive = type(leg.file.drives[0])(**plain)
    bare = replace(leg, file=leg.file.model_copy(update={"drives": [drive]}))
    assert not servo_law(nominal_ports(bare, 1), inputs).damping.any()


def test_a_share_of_a_limit_that_is_not_stated_limits_nothing():
    """As where a range of a parameter scales the torque limits of all drives, and one of them states none."""
    leg = load_robot("leg")
    ports, inputs = nominal_ports(leg, 1), np.ones((1, len(leg.inputs)))
    ports.drive["torque_limit"][:] = 0.8 * NO_LIMIT
    assert not servo_law(ports, inputs).damping.any()
