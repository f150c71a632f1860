"""Exact groups: causes that no excitation of one joint tells apart, so that a diagnosis must name the group."""

from dataclasses import replace

import numpy as np
import pytest
from effect_benches import Bench, bench, rms
from scipy.optimize import minimize_scalar

from dynreg.sim.effects import effects

LEFT = 0.05  # of the change, that the other member may leave unexplained: a shifted mass is also farther away
E = effects()


def _fitted(b: Bench, effect: str, target: np.ndarray) -> tuple[float, float]:
    """The size (times weak) at which an effect comes nearest to the change `target`, and what is left of it."""

    def left(size: float) -> float:
        return rms(b.changes({E[effect]: size})[0] - target) / rms(target)

    ends = [minimize_scalar(left, bounds=bounds, method="bounded") for bounds in ((0.1, 9.0), (-9.0, -0.1))]
    best = min(ends, key=lambda end: end.fun)
    return float(best.x), float(best.fun)


def _members(group: str) -> list[str]:
    return [e.id for e in E.values() if e.group == group]


@pytest.mark.parametrize("name", ["encoder_offset", "com_offset"])
def test_gravity_phase_is_one_cause_on_one_joint(name: str):
    """A tilt, an encoder's zero and a shifted mass turn the load's phase: each makes the change of the others."""
    assert set(_members("gravity phase")) == {"gravity_tilt", "encoder_offset", "com_offset"}
    b = bench("servo_short")
    tilted = b.changes({E["gravity_tilt"]: 3.0})[0]
    size, left = _fitted(b, name, tilted)
    assert left < LEFT
    assert abs(abs(size) - 3.0) < 0.1  # all three are sized as the same angle


def test_a_gravity_phase_is_no_other_cause():
    b = bench("servo_short")
    tilted = b.changes({E["gravity_tilt"]: 3.0})[0]
    assert min(_fitted(b, name, tilted)[1] for name in ("payload", "encoder_scale", "drive_gain")) > 0.3


def test_late_commands_are_late_measurements():
    """From rest under a held command, delayed commands and delayed states are the same log."""
    assert set(_members("time shift")) == {"command_delay", "sensor_delay"}
    b = bench("servo_short")
    actions = np.zeros((1, 60, 1))
    actions[0, 10:, 0] = 0.6 * np.sin(0.15 * np.arange(50))
    b = replace(
        b,
        name="from rest",
        run=replace(b.run.take([0]), actions=actions, inputs=None, initial=np.zeros((1, 2))),
    )
    late = b.changes({E["command_delay"]: 2.0})[0]
    size, left = _fitted(b, "sensor_delay", late)
    assert left < LEFT
    assert abs(size * E["sensor_delay"].size.weak / (2.0 * E["command_delay"].size.weak) - 1.0) < 0.05


@pytest.mark.parametrize("size", [1.0, 6.0])
def test_a_sagging_supply_is_a_motor_that_saturates(size: float):
    """Which of the two it is, only the voltage at the drive tells: the motion is the same to the last bit."""
    assert _members("torque droop") == ["voltage_sag", "torque_saturation"]
    b = bench("servo_short")
    sag, saturation = (b.changes({E[name]: size})[0] for name in ("voltage_sag", "torque_saturation"))
    assert rms(sag) > 0
    np.testing.assert_array_equal(sag, saturation)
