"""Nouns of a diagnosis: frozen; and what a model's own time step does to its rollouts is taken off, in a new model."""

from dataclasses import FrozenInstanceError, fields, is_dataclass, replace

import numpy as np
import pytest
from by_hand import held_against_zero, plain, with_effect
from legs import in_the_air, over_its_stop

from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans import Contact, Feet, Long, Short
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem
from dynreg.evidence.accuracy import PLAIN, Accuracy, rough, usual
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.lockstep import run
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot


def nouns() -> list:
    model, data = held_against_zero("coulomb_friction")
    sample, point = data.sample(data.fit), plain(0.0)
    problem, state = Problem(model, data, (), Short()), State(model, sample, point, point)
    plans = [Short(), Long(), Contact(), Feet()]
    return [model, data, sample, point, point.hypothesis, PLAIN, problem, state, *plans]


@pytest.mark.parametrize("noun", nouns(), ids=lambda noun: type(noun).__name__)
def test_nothing_of_a_noun_can_be_set(noun):
    assert is_dataclass(noun)
    names = [f.name for f in fields(noun)]
    assert all(getattr(noun, name) is getattr(noun, name) for name in names)
    for name in [*names, "anything else"]:
        with pytest.raises(FrozenInstanceError):
            setattr(noun, name, None)


def true_point(model: Model, hidden) -> Point:
    return Point(Hypothesis(), model.coordinates.from_values(hidden.parameters), np.zeros(0))


def test_with_the_time_step_taken_off_the_true_parameters_leave_the_noise():
    model, data, hidden = in_the_air()
    truth, sample, noise = true_point(model, hidden), data.sample(data.fit), np.sqrt(data.floor)
    refined = run(model.corrected([truth], data))
    before, after = (
        np.sqrt((run(m.residuals([truth], sample))[0] ** 2).mean(axis=(0, 1))) for m in (model, refined)
    )
    assert (before > 1.3 * noise).all()
    assert (after < 1.2 * noise).all()
    assert not model.corrections, "a new model has them"
    with pytest.raises(TypeError):
        refined.corrections[frozenset()] = np.zeros(1)


def test_a_term_without_a_correction_of_its_own_takes_that_of_what_it_extends():
    model, data, hidden = in_the_air()
    truth, sample = true_point(model, hidden), data.sample(data.fit)
    extended = Point(Hypothesis((term("payload"),)), truth.nominal, np.array([1e-3]))
    usual_, refined = (
        run(m.residuals([truth, extended], sample)) for m in (model, run(model.corrected([truth], data)))
    )
    assert refined[1] - usual_[1] == pytest.approx(refined[0] - usual_[0])
    assert np.abs(refined - usual_).max() > 1e-3


def test_what_extends_nothing_known_has_nothing_taken_off():
    model, data, hidden = in_the_air()
    truth, sample = true_point(model, hidden), data.sample(data.fit)
    loaded = with_effect("payload", *truth.nominal, size=1e-3)
    refined = run(model.corrected([loaded], data))
    plain_, own = (run(m.residuals([truth, loaded], sample)) for m in (model, refined))
    assert np.array_equal(plain_[0], own[0]) and np.abs(plain_[1] - own[1]).max() > 1e-3


def test_the_time_steps_part_is_that_of_the_terms_in_any_order():
    model, data, hidden = in_the_air()
    truth, sample = true_point(model, hidden), data.sample(data.fit)
    terms = term("payload"), term("coulomb_friction")
    one, other = (Point(Hypothesis(own), truth.nominal, np.ones(2)) for own in (terms, terms[::-1]))
    first, second = run(run(model.corrected([one], data)).residuals([one, other], sample))
    assert second == pytest.approx(first, abs=1e-9)
    assert np.abs(first - run(model.residuals([one], sample))[0]).max() > 1e-3


def test_it_is_not_sought_in_what_is_held_out():
    model, data, hidden = in_the_air()
    truth = true_point(model, hidden)
    some = run(model.corrected([truth], data))
    for chosen, corrected in ((data.both, True), (np.flatnonzero(data.parts.test), False)):
        own, known = (run(m.residuals([truth], data.sample(chosen))) for m in (model, some))
        assert bool(np.abs(own - known).max() > 1e-3) is corrected


@pytest.mark.parametrize("key", [None, "command_lag", "wheel_slip"])
def test_the_step_of_wheels_is_corrected_where_commands_lag_or_a_wheel_slips(key):
    robot = load_robot("diffdrive")
    hidden = hide(robot, (term(key),) if key else (), "medium" if key else None, 1)
    log = log_of(robot, hidden, protocol(robot, seed=1, seconds=10.0))
    model, data = pose(robot, log, DiagnosisOptions(threads=1))
    effect = [
        model.coordinates.effect_coordinates(t, v) for t, v in zip(hidden.terms, hidden.values, strict=True)
    ]
    one = replace(
        true_point(model, hidden), hypothesis=Hypothesis(hidden.terms), effect=np.concatenate([[], *effect])
    )
    sample, noise = data.sample(data.both), np.sqrt(data.floor)
    own, known, truth = (
        run(m.residuals([one], sample))
        for m in (model, run(model.corrected([one], data)), replace(model, finely=64.0))
    )
    whole, left = (float(np.sqrt(np.nanmean(((r - truth) / noise) ** 2))) for r in (own, known))
    assert left < 0.25 * whole if key else whole < 0.01


def test_simulated_finely_the_true_parameters_leave_the_noise_on_the_ground_too():
    model, data, hidden = over_its_stop(0.2)
    truth, sample = [true_point(model, hidden)], data.sample(data.fit)
    model = Model(model.robot, model.coordinates, accuracy=rough(model.robot))
    coarse, fine = (run(m.residuals(truth, sample))[0] for m in (model, model.fine))
    left = [np.sqrt((r**2).mean(axis=(0, 1)) / data.floor) for r in (coarse, fine)]
    assert (left[1] < 1.6).all() and (left[0] > 1.5 * left[1]).any()


def time_step(model: Model) -> float:
    """[s] of the rollouts that the model asks for."""
    (asked,) = model.states([model.start], held_against_zero()[1].windows.run).send(None)
    return asked.robot.file.robot.timestep


@pytest.mark.parametrize(
    ("accuracy", "fine", "slopes"),
    [
        (Accuracy(8.0), 1.0, 1.0),
        (Accuracy(8.0, fine=True, slopes=8.0), 8.0, 8.0),
        (Accuracy(4.0, fine=True, slopes=2.0), 4.0, 2.0),
    ],
    ids=["corrected", "contacts", "on its feet"],
)
def test_only_rough_rollouts_are_simulated_finely_and_their_derivatives_as_fine_as_stated(
    accuracy: Accuracy, fine: float, slopes: float
):
    model, _ = held_against_zero(accuracy=accuracy)
    step = time_step(model)
    assert step / time_step(model.fine) == pytest.approx(fine)
    assert step / time_step(model.fine.sloped) == pytest.approx(slopes)
    assert time_step(model.sloped) == step


def test_a_robot_on_its_feet_is_fine_and_cut_from_the_start():
    legged, hanging = usual(load_robot("quadruped")), usual(load_robot("leg"))
    assert legged.fine and legged.sides == 2 and legged.segment and legged.finer / legged.slopes == 2.0
    assert not hanging.fine and hanging.sides == 1 and hanging.segment is None and hanging.finer > 1.0
    assert rough(load_robot("leg")).fine and rough(load_robot("leg")).segment is None


def test_what_the_finer_step_itself_still_lacks_is_extrapolated():
    """By the order of the error: what is left lies nearer to a step that is eight times finer still."""
    model, data, hidden = in_the_air()
    truth, sample = true_point(model, hidden), data.sample(data.fit)
    refined = run(model.corrected([truth], data))
    (extrapolated,) = run(refined.residuals([truth], sample))
    fine, finest = (
        run(replace(model, finely=model.accuracy.finer * more).residuals([truth], sample))[0]
        for more in (1, 8)
    )
    size = lambda apart: float(np.sqrt(np.nanmean(apart**2)))  # noqa: E731
    assert size(extrapolated - finest) < 0.5 * size(fine - finest)
