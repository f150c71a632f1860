"""A floating base on its feet: where its terms start, what is fitted finely, and what is of whole rollouts."""

from collections import Counter
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from by_hand import answered, first_channel, held_against_zero, keys_of, with_effect

from dynreg.data.recording import Recording
from dynreg.diagnose.diagnose import Diagnosed, search
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans import Feet
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.shortlist import best_of_each, in_turn
from dynreg.diagnose.threshold import Threshold, known
from dynreg.diagnose.trial import Trials, Tried, attainable_share
from dynreg.diagnose.verdict import Evidence
from dynreg.diagnose.zeros import rezeroed
from dynreg.evidence.accuracy import ROUGH, SEGMENT, Accuracy
from dynreg.evidence.data import Data
from dynreg.evidence.hypothesis import Coordinates, Hypothesis, single_terms
from dynreg.evidence.likelihood import objective
from dynreg.evidence.lockstep import Ask, run
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.truth import Hidden, hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

SETTINGS = DiagnosisOptions(hold_out="test_0", threads=1, max_causes=2)
FREE = ("torque", "leg_mass")
LITTLE = Feet(alone=1, rival=1)  # takes less time


# ---- where terms start ----

AHEAD = [
    (950.0, with_effect("gravity_tilt", 0.0)),
    (900.0, with_effect("payload", 0.0)),
]  # from the nameplate
NEAR = [
    (960.0, with_effect("payload", 0.0)),
    (940.0, with_effect("com_offset", 0.0)),
]  # from the calibrated model


def keys(points: list[Point]) -> list[str]:
    return [point.hypothesis.key for point in points]


def test_terms_come_in_turn_from_the_nameplate_and_from_the_calibrated_model():
    listed = in_turn(AHEAD, NEAR)
    assert keys(listed) == ["payload", "com_offset", "gravity_tilt"]
    assert listed[0] is AHEAD[1][1], "each term once, where it comes first"
    assert keys(in_turn(AHEAD, [])) == ["payload", "gravity_tilt"]


def test_terms_of_other_rough_robots_are_sorted_together():
    assert keys(best_of_each([*NEAR, *AHEAD])) == ["payload", "com_offset", "gravity_tilt"]


STANDING = Accuracy(4.0, fine=True, slopes=2.0, width=ROUGH, sides=2)
NOISE = np.random.default_rng(0).standard_normal((3, 40))
SAMPLES = 120.0  # independent ones in it


def asked(costs: dict[str, float], plan: Feet = LITTLE, windows: int = 3) -> tuple[Counter, list[str]]:
    """Simulators that a round asks for in all windows, by term, where the objective is that of each term, whatever its
    coordinates; and the terms that were ranked."""
    model, data = held_against_zero("resistance", accuracy=STANDING)
    runs: Counter = Counter()

    def answer(one: Ask) -> np.ndarray:
        names = keys_of(one)
        if one.case.run.actions.shape[-3] == windows:
            runs.update(names)
        sizes = np.array([np.exp(costs[name] / SAMPLES) for name in names])
        return first_channel(one, 0.1 * sizes[:, None, None] * NOISE[: one.case.run.actions.shape[-3]])

    terms = [term(key) for key in costs if key]
    naming, _ = answered(plan.name(model, model.start, terms, data.sample(data.fit)), answer)
    return runs, [one.key for one in naming.ranking]


def test_what_is_far_behind_does_not_go_on_to_the_end():
    plan = replace(LITTLE, away=40.0)
    runs, ranked = asked({"": 0.0, "payload": -90.0, "cogging": -80.0, "com_offset": -20.0}, plan)
    assert ranked == ["payload", "cogging", "com_offset"]
    assert 0 < runs["com_offset"] < min(runs["cogging"], runs["payload"])


@pytest.mark.parametrize(("clear", "more"), [(10.0, False), (400.0, True)])
def test_what_is_clear_from_the_nameplate_is_not_sought_from_the_calibrated_model_too(
    clear: float, more: bool
):
    """Then fewer simulators are asked for in the windows to fit."""
    few, _ = asked({"": 0.0, "payload": -90.0}, replace(LITTLE, clear=clear), windows=2)
    least, _ = asked({"": 0.0, "payload": -90.0}, replace(LITTLE, clear=0.0), windows=2)
    assert (few["payload"] > least["payload"]) is more


# ---- a quadruped with a payload ----


@lru_cache
def posed() -> tuple[Model, Data, Hidden, Recording]:
    """All of its parameters but two are known, which takes less time."""
    robot = load_robot("quadruped")
    plan = protocol(robot, seed=1, seconds=6.5, episode=1.25, reach=0.3)
    hidden = hide(robot, (term("payload"),), "strong", 11)
    log = log_of(robot, hidden, plan)
    model, data = pose(robot, log, SETTINGS)
    values = hidden.parameters.copy()
    values[[robot.space.names.index(name) for name in FREE]] = np.nan
    return replace(model, coordinates=Coordinates(robot, values)), data, hidden, log


def points() -> tuple[Point, Point]:
    """The true robot without its payload, and with it."""
    model, _, hidden, _ = posed()
    c = model.coordinates
    effect = c.effect_coordinates(hidden.terms[0], hidden.values[0])
    z = c.from_values(hidden.parameters)
    return Point(Hypothesis(), z, np.zeros(0)), Point(Hypothesis(hidden.terms), z, effect)


@lru_cache
def found() -> Diagnosed:
    """A search for two causes among some of the whole base and of its legs."""
    model, data, _, log = posed()
    terms = single_terms(model.robot, ("payload", "ground_friction"))
    return run(search(Problem(model, data, tuple(terms), LITTLE), log, known(Threshold(30.0, ())), SETTINGS))


def test_a_segment_is_as_long_wherever_rollouts_are_cut_and_only_feet_need_it():
    model, data, _, log = posed()
    rows = data.windows.measured.shape[1] - 1
    assert data.segments == round(rows * data.windows.period / SEGMENT) == 2
    assert pose(model.robot, log, replace(SETTINGS, horizon=0.75))[1].segments == 1
    leg = load_robot("leg")
    made = log_of(leg, hide(leg, (), None, 11), protocol(leg, seed=1, seconds=6.5, episode=1.25))
    assert pose(leg, made, DiagnosisOptions(threads=1))[1].segments == 1


def test_the_payload_is_named_and_a_round_that_finds_no_more_is_not_lost():
    model, data, *_ = posed()
    state = found().found
    assert [t.key for t in state.current.hypothesis.terms] == ["payload"]
    assert state.accepted == 1 and len(state.rounds) == 2
    assert state.current is state.rounds[1].start.point
    # the round that finds no cause has refitted the model that it began with
    every = data.sample(data.both)
    ends = [state.rounds[0].chosen.point, state.current]
    made = run(model.fine.residuals(ends, every))
    first, last = objective(ends, made, every.reweighted(made[1]))
    assert last <= first
    # what its own rollouts differ by with a finer time step is known, where it is less than chaos
    usual, fine = (run(m.residuals([state.current], every)) for m in (state.model, state.model.fine))
    assert np.nanmedian(np.abs(usual - fine)) < 1e-12


def test_with_and_without_a_term_it_is_fitted_on_all_windows_from_where_either_ended():
    model, data, *_ = posed()
    naming = found().found.rounds[0]
    start, best = naming.start.point, naming.chosen.point
    every = data.sample(data.both)
    tried = [found().found.base, Point(Hypothesis(), best.nominal, np.zeros(0)), start, best]
    made = run(model.fine.residuals(tried, every))
    cost = objective(tried, made, every.reweighted(made[-1]))
    assert cost[2] <= min(cost[0], cost[1]) and cost[3] < cost[2]


def test_a_search_that_may_name_nothing_calibrates():
    model, data, _, log = posed()
    made = run(search(Problem(model, data, (), LITTLE), log, known(Threshold(5.0, ())), SETTINGS))
    assert made.found.accepted == 0 and np.isfinite(made.found.base.nominal).all()
    assert made.found.current is made.found.base


def test_what_can_be_won_is_won_with_the_hidden_payload():
    _, data, hidden, _ = posed()
    made = found()
    without, true = points()
    state = replace(made.found, base=without, current=true)
    trials = Trials(made.problem.model.robot, protocol(made.problem.model.robot, seconds=12.5), threads=1)
    assert attainable_share(trials, Tried(hidden, replace(made, found=state), 0.0, 0.0)) > 0.5
    nothing = replace(data.parts, test=np.zeros_like(data.parts.test))
    held = replace(made, problem=replace(made.problem, data=replace(data, parts=nothing)))
    assert attainable_share(trials, Tried(hidden, held, 0.0, 0.0)) is None


def test_the_verdict_is_of_whole_rollouts():
    model, data, _, log = posed()
    without, true = points()

    def ratio(data: Data, point: Point) -> float:
        state = State(model, data.sample(data.fit), without, point)
        return run(Evidence.of(state, log)).noise.ratio

    assert ratio(data, true) == ratio(data.whole, true) < ratio(data, without)


def test_zeros_are_of_whole_episodes():
    model, data, *_ = posed()
    channels = [
        c.model_copy(update={"zero": 0.02}) if "/position" in c.name else c for c in model.robot.file.channels
    ]
    robot = replace(model.robot, file=model.robot.file.model_copy(update={"channels": channels}))
    initial = np.nan_to_num(data.windows.run.initial)  # not only settled stances
    windows = replace(data.windows, run=replace(data.windows.run, initial=initial))
    there = replace(data, windows=windows)
    moved = run(rezeroed(replace(model, robot=robot), there, points()[1], data.parts.chosen))
    off = moved.measured - windows.measured
    assert np.abs(np.nan_to_num(off)).max() < 0.1 and np.nanmax(np.abs(off)) > 0
    assert np.nanmax(np.nanstd(off, axis=1)) < 1e-12


def test_a_threshold_that_is_known_is_taken_as_it_is():
    assert found().threshold == Threshold(30.0, ())
    assert found().verdict in ("named", "partly_explained")
