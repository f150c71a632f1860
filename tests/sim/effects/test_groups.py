"""Exact groups: causes that no excitation of one joint tells apart, so that a diagnosis must name the group."""

from dataclasses import replace

import numpy as np
import pytest
from effect_benches import Bench, bench, rms
from scipy.optimize import minimize_scalar

from dynreg.sim.effects import Term, Terms, effects
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot

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


@pytest.mark.parametrize("difference", [0.004, -0.015])
def test_friction_that_differs_between_directions_is_a_constant_torque(difference: float):
    """Moving or at rest: symmetric dry friction and a constant torque do the same, but for rounding."""
    assert sorted(_members("constant torque")) == ["asymmetric_friction", "force_offset"]
    robot, mean = load_robot("servo_pendulum"), 0.02
    run = excitation(robot, seed=1, name="groups", episodes=4, steps=150)
    keys = (("asymmetric_friction",), ("coulomb_friction", "force_offset"))
    values = (([difference, mean],), ([mean], [-difference]))
    both = [
        rollout(
            robot,
            robot.space.nominal[None],
            run,
            terms=Terms(tuple(Term(E[k]) for k in key), tuple(np.array([v]) for v in own)),
        ).states[0]
        for key, own in zip(keys, values, strict=True)
    ]
    plain = rollout(robot, robot.space.nominal[None], run).states[0]
    assert rms(both[0] - both[1]) < 0.03 * rms(both[0] - plain)


def test_a_leg_on_a_slope_is_its_first_encoder_offset():
    """In the air the hip turns with the base: a tilt about its axis and its encoder's zero are one, and no other."""
    leg = load_robot("leg")
    tilt, offset = E["gravity_tilt"], E["encoder_offset"]
    assert tilt.about(leg, ()) == offset.about(leg, ("hip_roll",)) == ("hip_roll",)
    assert E["com_offset"].about(leg, ()) is None  # the shank hangs on the thigh
    assert tilt.about(load_robot("quadruped"), ()) is None
    run = excitation(leg, seed=2, name="groups", episodes=2, steps=60)

    def moves(term: Term | None, size: float) -> np.ndarray:
        terms = Terms((term,), (np.array([[size]]),)) if term else Terms()
        return rollout(leg, leg.space.nominal[None], run, terms=terms).states[0]

    angle, plain = 3 * np.pi / 180, moves(None, 0.0)
    tilted = moves(Term(tilt), angle)[..., :3] - plain[..., :3]

    def left(joint: str, size: float) -> float:
        return rms(tilted - (moves(Term(offset, (joint,)), size)[..., :3] - plain[..., :3])) / rms(tilted)

    assert min(left("hip_roll", size) for size in (angle, -angle)) < LEFT
    assert min(left("knee", size) for size in (angle, -angle)) > 0.5
