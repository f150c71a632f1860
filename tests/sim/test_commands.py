import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dynreg.sim.commands import shaped_commands
from dynreg.sim.ports import nominal_ports
from dynreg.sim.robot import load_robot
from dynreg.sim.run import motor_noise

ROBOT = load_robot("so101")
N, T, A = 3, 12, 6


def _shaped(seed: int, noisy: bool = False, **control: np.ndarray) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    ports = nominal_ports(ROBOT, N)
    ports.control.update(control)
    actions, start = rng.normal(0, 2, (N, T, A)), rng.uniform(-1, 1, (N, A))
    low, high = -rng.uniform(1, 2, (N, A)), rng.uniform(1, 2, (N, A))
    draws = rng.standard_normal((N, T, A)) if noisy else None
    return shaped_commands(actions, start, low, high, ports, draws), actions, start, low, high, draws


@given(st.integers(0, 10_000), st.floats(0.01, 3.0))
@settings(max_examples=40)
def test_no_command_steps_farther_than_the_largest_step(seed: int, step: float):
    largest = np.array([step, 2 * step, np.inf])
    commands, actions, start, low, high, _ = _shaped(seed, max_step=largest)
    steps = np.abs(np.diff(np.concatenate([start[:, None], commands], axis=1), axis=1))
    assert np.all(steps.max(axis=(1, 2)) <= largest + 1e-12)
    assert np.all(commands >= low[:, None]) and np.all(commands <= high[:, None])
    wanted = np.clip(actions, low[:, None], high[:, None])
    np.testing.assert_array_equal(commands[2], wanted[2])
    # a command that is near enough is reached, the others are approached by one whole step
    before = np.concatenate([start[:, None], commands[:, :-1]], axis=1)
    reached = np.abs(wanted - before) <= largest[:, None, None]
    np.testing.assert_array_equal(commands[reached], wanted[reached])
    finite = ~reached & np.isfinite(largest)[:, None, None]
    np.testing.assert_allclose(steps[finite], np.broadcast_to(largest[:, None, None], steps.shape)[finite])


def test_commands_are_clipped_and_left_alone_otherwise():
    commands, actions, _, low, high, _ = _shaped(0)
    np.testing.assert_array_equal(commands, np.clip(actions, low[:, None], high[:, None]))


def test_noise_is_added_in_the_actions_unit():
    sigma = np.array([0.0, 0.1, 0.2])
    noisy, *_, draws = _shaped(1, noisy=True, noise=sigma)
    quiet, *_ = _shaped(1)
    np.testing.assert_allclose(noisy - quiet, sigma[:, None, None] * draws, atol=1e-12)


def test_motor_noise_depends_on_the_simulators_seed_alone():
    together = motor_noise(np.array([5, 7]), 2, T, A)
    np.testing.assert_array_equal(together[1:], motor_noise(np.array([7]), 2, T, A))
    assert abs(together.std() - 1) < 0.1 and not np.array_equal(together[0], together[1])
