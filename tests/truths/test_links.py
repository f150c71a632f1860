"""The links of hidden robots move as MuJoCo's do, and a chain with more on it is the chain with more on it."""

import mujoco
import numpy as np
import pytest

from dynreg.sim.robot import load_robot
from dynreg.truths.links import dynamics
from dynreg.truths.table import KINDS


def moved(name: str, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    robot = load_robot(name)
    chain = KINDS[name].chain(robot.space.as_dict(robot.space.nominal), {})
    M, bias = np.zeros((len(q), len(q))), np.zeros(len(q))
    dynamics(*chain.parts, q, v, M, bias)
    return M, bias


@pytest.mark.parametrize("name", ["two_joint_arm", "six_joint_arm"])
def test_inertia_and_bias_are_mujocos(name):
    robot, rng = load_robot(name), np.random.default_rng(1)
    model = robot.model
    data = mujoco.MjData(model)
    for _ in range(3):
        q, v = rng.uniform(-2, 2, model.nv), rng.uniform(-3, 3, model.nv)
        M, bias = moved(name, q, v)
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        assert M + np.diag(model.dof_armature) == pytest.approx(full, abs=1e-9)
        assert bias == pytest.approx(data.qfrc_bias, abs=1e-9)


def test_the_bench_is_a_pendulum():
    M, bias = moved("servo_pendulum", np.array([0.5]), np.zeros(1))
    assert M[0, 0] == pytest.approx(0.49 * 0.1**2, rel=1e-3)
    assert bias[0] == pytest.approx(0.49 * 9.80665 * 0.1 * np.sin(0.5), rel=1e-3)


def test_a_mass_on_a_link_adds_its_moment_and_weight():
    chain = KINDS["two_joint_arm"].chain({"upper_mass": 1.2, "fore_mass": 0.8}, {})
    q, v, tip = np.array([0.3, -0.7]), np.zeros(2), np.array([0.0, 0.0, -0.25])

    def of(one) -> tuple[np.ndarray, np.ndarray]:
        M, bias = np.zeros((2, 2)), np.zeros(2)
        dynamics(*one.parts, q, v, M, bias)
        return M, bias

    (M, bias), (heavier, pulled) = of(chain), of(chain.carrying(1, 0.5, tip))
    assert heavier[1, 1] - M[1, 1] == pytest.approx(0.5 * 0.25**2)
    assert pulled[1] - bias[1] == pytest.approx(0.5 * 9.80665 * 0.25 * np.sin(q.sum()))


def test_a_stand_below_a_chain_changes_nothing_while_it_stands():
    robot = load_robot("two_joint_arm")
    chain = KINDS["two_joint_arm"].chain(robot.space.as_dict(robot.space.nominal), {})
    stood = chain.on_stand(np.array([0.0, 1.0, 0.0]), 0.2)
    q, v = np.array([0.3, -0.7]), np.array([1.0, 2.0])
    M, bias = np.zeros((3, 3)), np.zeros(3)
    dynamics(*stood.parts, np.append(0.0, q), np.append(0.0, v), M, bias)
    own, pulled = moved("two_joint_arm", q, v)
    assert M[1:, 1:] == pytest.approx(own) and bias[1:] == pytest.approx(pulled)
