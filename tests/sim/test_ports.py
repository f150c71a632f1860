"""Where the drives' law changes during an episode."""

import numpy as np

from dynreg.sim.ports import law_changes, nominal_ports
from dynreg.sim.robot import load_robot


def test_the_law_changes_where_an_input_of_any_simulation_does():
    leg = load_robot("leg")
    inputs = np.ones((2, 8, len(leg.inputs)))
    ports = nominal_ports(leg, 2)
    assert law_changes(ports, inputs) == frozenset()
    inputs[0, 3:] = 0.0
    inputs[1, 6] = 0.0
    assert law_changes(ports, inputs) == {3, 6, 7}


def test_inputs_that_no_drive_listens_to_change_nothing():
    robot = load_robot("double_pendulum")
    ports = nominal_ports(robot, 1)
    assert law_changes(ports, np.arange(8.0).reshape(1, 8, 1)) == frozenset()
