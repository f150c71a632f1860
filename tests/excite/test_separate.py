"""Expected evidence between two hypotheses: laws of its first-order refits."""

import numpy as np
import pytest

from dynreg.excite.candidates import Pool, pool
from dynreg.excite.limits import Limits
from dynreg.excite.separate import Judge, Pair
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

STEPS = 50


def candidates(some: slice = slice(0, 60, 6)) -> Pool:
    robot = load_robot("servo_pendulum")
    made = pool(robot, Limits.of(robot), (), STEPS, 0)
    return made.take(np.arange(len(made))[some])


def judge(first: str, second: str, made: Pool | None = None) -> Judge:
    """Both hypotheses at medium size as rivals of each other."""
    pair = Pair(load_robot("servo_pendulum"), (term(first), term(second)))
    out = Judge(pair, made or candidates())
    for which, z in pair.truths:
        out.add(which, z)
    return out


@pytest.fixture(scope="module")
def friction() -> Judge:
    return judge("payload", "coulomb_friction")


def test_more_episodes_never_tell_less(friction: Judge) -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        chosen = rng.choice(len(friction.pool), 3)
        whole = friction.nats(chosen[None])[0]
        parts = friction.nats(chosen[:, None]).max(axis=0)
        assert (whole >= parts - 0.05 * whole - 0.1).all()


def test_an_order_of_episodes_does_not_matter(friction: Judge) -> None:
    sets = np.array([[0, 3, 5], [5, 0, 3]])
    nats = friction.nats(sets)
    np.testing.assert_allclose(nats[0], nats[1], rtol=1e-6)


def test_a_refit_takes_evidence_away_and_costs_its_prior(friction: Judge) -> None:
    every = np.arange(len(friction.pool))[:, None]
    rival = friction.rivals[1][0]
    nats, ends = rival.refit(0, every, friction.noise, friction.effective, STEPS)
    fixed = 0.5 * friction.effective * np.log1p(rival.square[0] / STEPS / friction.noise)
    assert (nats <= fixed.sum(axis=1) + 1e-9).all() and (nats > 0).all()
    assert (nats >= 0.5 * (rival.prior * ends**2).sum(axis=1) - 1e-9).all()


def test_refits_stay_in_their_room(friction: Judge) -> None:
    every = np.arange(len(friction.pool))[:, None]
    for number in (0, 1):
        (rival,), limits = friction.rivals[number], friction.pair.bounds(number)
        _, ends = rival.refit(0, every, friction.noise, friction.effective, STEPS)
        assert (ends >= limits[:, 0] - 1e-9).all() and (ends <= limits[:, 1] + 1e-9).all()


def test_a_rival_that_is_the_truth_leaves_no_evidence() -> None:
    # Stribeck friction without its extra is coulomb friction: 1.2 x 0.025 of the torque limit is 0.03 of it
    made = judge("coulomb_friction", "stribeck_friction")
    free = len(made.pair.coordinates)
    apart = made.nats(np.arange(len(made.pool))[None])[0]
    made.add(1, np.concatenate([np.zeros(free), [1e-3, 1.2, 0.0]]))
    nats = made.nats(np.arange(len(made.pool))[None])[0]
    assert nats[0] < 0.1 < apart[0] and nats[1] == pytest.approx(apart[1])


def test_rivals_found_later_only_take_evidence_away(friction: Judge) -> None:
    made = judge("payload", "coulomb_friction")
    before = made.nats(np.array([[0, 2, 4]]))
    made.add(1, made.nearest(0, np.array([0, 2, 4]))[0])
    after = made.nats(np.array([[0, 2, 4]]))
    assert (after <= before).all() and (after[:, 1] == before[:, 1]).all()


def test_going_on_with_some_episodes_keeps_their_evidence(friction: Judge) -> None:
    made = judge("payload", "coulomb_friction")
    kept = np.array([1, 4, 7])
    before = made.nats(kept[:, None])
    made.keep(kept)
    np.testing.assert_allclose(made.nats(np.arange(3)[:, None]), before)
    assert made.pool.names == friction.pool.take(kept).names


def test_a_signed_effect_is_true_either_way() -> None:
    pair = Pair(load_robot("servo_pendulum"), (term("drive_gain"), term("voltage_sag")))
    free = len(pair.coordinates)
    assert [(which, z[free]) for which, z in pair.truths] == [(0, 1.0), (0, -1.0), (1, 1.0)]
    assert all((z[:free] == 0).all() for _, z in pair.truths)


def test_episodes_beyond_the_range_of_a_joint_are_of_no_use() -> None:
    robot = load_robot("servo_pendulum")
    run = candidates(slice(0, 2)).run
    far = np.full((1, STEPS, 1), 3.0)
    whirl = Run(
        np.concatenate([run.actions, far]),
        inputs=np.tile(robot.input_defaults, (3, STEPS, 1)),
        settings=np.array([[400.0, 0.0], [400.0, 0.0], [8000.0, 0.0]]),
        period=run.period,
    )
    made = Judge(
        Pair(_narrow(robot, 1.5), (term("payload"), term("inertia"))), Pool(("a", "b", "whirl"), whirl)
    )
    assert made.usable.tolist() == [True, True, False]
    assert made.reached[2, 1, 0] > 1.5


def _narrow(robot, far: float):
    """The robot with its position channel limited to +-far [rad]."""
    from dataclasses import replace

    tables = [
        c.model_copy(update={"low": -far, "high": far}) if c.name == "arm/position" else c
        for c in robot.file.channels
    ]
    return replace(robot, file=robot.file.model_copy(update={"channels": tables}))
