"""Where the drives' law changes during an episode."""

import numpy as np

from dynreg.sim.ports import law_changes, nominal_ports
from dynreg.sim.robot import load_robot


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
