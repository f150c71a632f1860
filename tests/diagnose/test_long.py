"""Many joints: a long list of terms still holds the right one, in its joint, and on the ground, too."""

import numpy as np
import pytest
from by_hand import answered, effects_of, first_channel, held_against_zero, keys_of, plain, sizes_of
from legs import calibrated

from dynreg.diagnose.linear import REFINED
from dynreg.diagnose.plans import Long
from dynreg.diagnose.plans.contact import begun
from dynreg.diagnose.shortlist import PROBED, mirrored, promising
from dynreg.evidence.hypothesis import Hypothesis, single_terms
from dynreg.evidence.likelihood import objective
from dynreg.evidence.lockstep import Ask, run
from dynreg.evidence.point import Point
from dynreg.sim.effects import term

SOME = ("coulomb_friction", "torque_limit", "encoder_scale", "backlash", "payload")


@pytest.mark.parametrize("key", ["coulomb_friction[knee]", "torque_limit[hip_pitch]"])
def test_the_best_of_the_list_is_the_hidden_effect_in_its_joint(key: str):
    found = calibrated(key)
    terms = single_terms(found.model.robot, SOME)
    naming, model = run(Long(iterations=3, rounds=1).name(found.model, found.point, terms, found.sample))
    ranked = [one.key for one in naming.ranking]
    assert naming.chosen.key == ranked[0] == key and naming.chosen.nats > 100
    assert len(set(ranked)) == len(ranked) < len(terms)
    assert set(model.corrections) > set(found.model.corrections), "the time step's part is known for the best"


@pytest.mark.parametrize("key", ["gravity_tilt", "payload"])
def test_a_rough_list_holds_the_hidden_effect_too(key: str):
    found = calibrated(key, roughly=True)
    terms = single_terms(found.model.robot, (*SOME, "gravity_tilt"))
    points, _ = run(promising(found.model, found.point, terms, found.sample, turned=True))
    keys = [p.hypothesis.key for p in points]
    assert key in keys[:3] and len(set(keys)) == len(keys) <= PROBED


def test_what_has_a_sign_is_tried_with_the_other_one():
    probe = lambda key, effect: Point(Hypothesis((term(key),)), np.zeros(6), np.array(effect))  # noqa: E731
    assert mirrored(probe("coulomb_friction[knee]", [1.0])) == []
    (tilted,) = mirrored(probe("gravity_tilt", [1.0]))
    assert tilted.effect.tolist() == [-1.0]
    both = Point(
        Hypothesis((term("payload"), term("cogging[knee]"))), np.zeros(6), np.array([0.5, 1.0, 0.0, 0.3])
    )
    (turned,) = mirrored(both)
    assert turned.effect.tolist() == [0.5, -1.0, 0.0, 0.3]


@pytest.mark.parametrize("turned", [True, False])
def test_what_a_probe_reaches_with_the_other_sign_lists_a_term_only_where_rollouts_are_rough(turned: bool):
    """A tilt helps at one sign alone, and is all of the error there; of the others each takes a little of it."""
    model, data = held_against_zero("damping", robot="leg")
    t = np.linspace(0.0, 2.0 * np.pi, 40)
    error, other = np.sin(t), np.cos(t)

    def answer(one: Ask) -> np.ndarray:
        rows = []
        for key, size in zip(keys_of(one), sizes_of(model, one, "gravity_tilt"), strict=True):
            straight = error * (0.95 if key else 1.0)
            tilted = error + size * other if size > 0 else error * (1.0 + max(size, -1.0))
            rows.append(tilted if key == "gravity_tilt" else straight)
        return first_channel(one, np.array(rows)[:, None])

    frictions = [
        t for t in single_terms(model.robot, ("coulomb_friction", "viscous_friction", "backlash")) if t.joints
    ]
    more = [
        t for t in single_terms(model.robot, ("load_friction", "joint_elasticity", "inertia")) if t.joints
    ]
    terms = [*frictions, *more, term("gravity_tilt")]
    assert len(terms) > PROBED
    points, _ = answered(promising(model, plain(0.0), terms, data.sample(data.fit), turned), answer)
    keys = [p.hypothesis.key for p in points]
    assert ("gravity_tilt" in keys) is turned and len(keys) == PROBED
    if turned:
        assert keys[0] == "gravity_tilt" and points[0].effect[0] == -1.0


def test_what_acts_on_a_joint_already_is_only_refined():
    """As much friction again, and the joint sticks: probes of it stay small."""
    model, data = held_against_zero("upper_mass", robot="double_pendulum")
    base = Point(Hypothesis((term("coulomb_friction"),)), np.zeros(1), np.array([0.7]))
    terms = [term("coulomb_friction[shoulder]"), term("inertia[elbow]")]
    probed: dict[str, float] = {}

    def answer(one: Ask) -> np.ndarray:
        for _, own, values in effects_of(one):
            size = float(model.coordinates.effect_coordinates(own, values)[0])
            probed.setdefault(own.key, size)
        return first_channel(one, np.sin(np.arange(40.0)))

    answered(promising(model, base, terms, data.sample(data.fit)), answer)
    assert probed == pytest.approx(
        {"coulomb_friction": 0.7, "coulomb_friction[shoulder]": REFINED, "inertia[elbow]": 1.0}
    )


def test_what_is_far_behind_the_best_of_its_own_start_is_not_refitted():
    found = calibrated("gravity_tilt", roughly=True)
    terms = single_terms(found.model.robot, ("coulomb_friction", "gravity_tilt"))
    kept = {
        behind: run(begun(found.model, found.point, terms, found.sample, behind)) for behind in (0.0, np.inf)
    }
    assert 1 == len(kept[0.0]) < len(kept[np.inf])
    assert kept[0.0][0][1].hypothesis.key == "gravity_tilt"


def test_from_the_nameplate_the_best_terms_walk_on_before_they_are_judged():
    found = calibrated("payload", roughly=True)
    model, sample = found.model, found.sample
    nameplate = Point(Hypothesis(), np.zeros(len(found.point.nominal)), np.zeros(0))
    terms = single_terms(model.robot, ("payload", "coulomb_friction"))
    first, further = (run(begun(model, nameplate, terms, sample, ahead=ahead)) for ahead in ((0, 0), (2, 3)))
    points = [p for _, p in further]
    fine = objective(points, run(model.fine.residuals(points, sample)), sample)
    assert [cost for cost, _ in further] == pytest.approx(list(fine)), "judged by the finer time step"
    assert min(fine) < min(cost for cost, _ in first) - 10.0
