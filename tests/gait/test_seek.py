"""Gaits in several simulators, and the search for them: alone as together, the same again, resumed to the bit."""

from pathlib import Path

import numpy as np
import pytest

from dynreg.errors import RobotError, UsageError
from dynreg.gait.methods import METHODS
from dynreg.gait.seek import SearchSettings, accepted, seek
from dynreg.gait.tasks import fitness, task_of
from dynreg.gait.trials import Simulators, Trials, simulators_of
from dynreg.sim.config import SimConfig

BUDGET = {"cma": 44, "hill": 30, "random": 40}  # two or three batches in two simulators


def first_gaits(trials: Trials, count: int = 3) -> np.ndarray:
    space = trials.space
    unit = np.tile(space.starts[0], (count, 1))
    unit[:, 3] += 0.1 * np.arange(count)
    return space.feasible(space.from_unit(unit))


def test_gaits_run_together_do_what_each_does_alone(trials) -> None:
    genes = first_gaits(trials)
    together = trials.grades(genes)
    assert together.shape == (3, 2) and trials.rollouts == 6
    alone = np.concatenate([trials.grades(g[None]) for g in genes])
    assert np.array_equal(together, alone)
    assert np.array_equal(trials.grades(genes), together)  # and again from the same start


def test_simulators_with_effects_and_known_parameters(brief) -> None:
    nominal = SimConfig(brief.hash, brief.name, {})
    heavy = SimConfig(brief.hash, brief.name, {}, {"payload": {"share": 0.4}})
    rubbing = SimConfig(brief.hash, brief.name, {}, {"coulomb_friction": {"torque": 0.1}})
    known = np.full(len(brief.space), np.nan)
    known[0] = 36.0
    three = simulators_of(brief, [nominal, heavy, rubbing], known)
    assert (three.values[:, 0] == 36.0).all() and len(three.terms.terms) == 2
    trials = Trials(brief, task_of(brief), three, rate=36.0, threads=1)
    genes = first_gaits(trials, 2)
    found = trials.grades(genes)
    assert len({*found[0]}) == 3
    assert np.array_equal(trials.grades(genes), found)  # effects forget what they remember
    alone = Trials(brief, task_of(brief), simulators_of(brief, [rubbing], known), rate=36.0, threads=1)
    alone._noise = trials._noise[2:]
    assert np.array_equal(alone.grades(genes)[:, 0], found[:, 2])


def test_commands_too_rare_for_a_sine_are_refused(brief) -> None:
    simulators = Simulators(brief.space.nominal[None])
    with pytest.raises(RobotError, match="5 commands a second"):
        Trials(brief, task_of(brief), simulators, rate=5.0)


def test_what_is_accepted() -> None:
    values = np.array([[1.0, 2.0, 3.0, 4.0, 5.0]])
    assert [accepted(values, how)[0] for how in ("min", "mean", "quantile")] == [1.0, 3.0, 2.0]


@pytest.mark.parametrize("method", METHODS)
def test_a_search_is_the_same_again_and_keeps_its_budget(method: str, trials) -> None:
    settings = SearchSettings(method, rollouts=BUDGET[method], seed=3)
    first = seek(trials, settings)
    assert trials.rollouts <= BUDGET[method] + 2  # the best gait is run once more, for its way
    again = seek(trials, settings)
    assert np.array_equal(first.genes, again.genes) and first.found.history == again.found.history
    assert not np.array_equal(
        seek(trials, SearchSettings(method, rollouts=BUDGET[method], seed=4)).genes, first.genes
    )
    assert first.found.value == fitness(first.found.grades[None]).min()
    assert trials.space.problems(first.genes) == ()
    values = [value for _, value in first.found.history]
    assert values == sorted(values)


@pytest.mark.parametrize("method", METHODS)
def test_an_interrupted_search_goes_on_to_the_same_end(method: str, trials, tmp_path: Path) -> None:
    settings = SearchSettings(method, rollouts=BUDGET[method], seed=3)
    whole = seek(trials, settings)
    path = tmp_path / "searches" / "one.jsonl"
    batches = []

    def interrupt(stage: str, done: int, total: int) -> None:
        batches.append(done)
        if len(batches) == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        seek(trials, settings, journal=path, key={"a": 1}, progress=interrupt)
    np.random.default_rng().random()
    np.random.seed(7)  # noqa: NPY002  what others draw must not matter
    before = trials.rollouts
    gone_on = seek(trials, settings, journal=path, key={"a": 1}, resume=True)
    assert np.array_equal(gone_on.genes, whole.genes) and gone_on.found.history == whole.found.history
    assert gone_on.found.resumed == batches[0]
    assert trials.rollouts - before == 2 * (whole.found.evaluations - batches[0] + 1)
    ended = seek(trials, settings, journal=path, key={"a": 1}, resume=True)  # and from its end
    assert ended.found.resumed == ended.found.evaluations


def test_too_few_rollouts_and_unknown_methods_are_refused(trials) -> None:
    with pytest.raises(UsageError, match="5 rollouts in 2 simulators"):
        seek(trials, SearchSettings(rollouts=5))
    with pytest.raises(UsageError, match="method 'ants'"):
        SearchSettings("ants")


@pytest.mark.parametrize("method", METHODS)
def test_the_hand_written_start_is_tried_first(method: str, trials, monkeypatch) -> None:
    tried, grades = [], trials.grades
    monkeypatch.setattr(trials, "grades", lambda genes: tried.append(genes) or grades(genes))
    seek(trials, SearchSettings(method, rollouts=20, seed=1))
    by_name = trials.space.as_dict(tried[0][0])
    assert {name: by_name[name] for name in trials.space.first} == pytest.approx(dict(trials.space.first))
    assert len(tried[0]) > 1 and not (tried[0] == tried[0][0]).all()


def test_the_best_gaits_are_tried_again_with_other_noise(trials, monkeypatch) -> None:
    """150 rollouts in two simulators: 7 gaits with two draws of their noise."""
    settings = SearchSettings(rollouts=150, seed=3, again=0.2)
    assert settings.finals(2) == (7, 2) and settings.finals(1) == (6, 5)
    assert settings.finals(5) == (6, 1) and settings.finals(50) == (
        0,
        1,
    )  # too few would be left to choose from
    asked, again = [], trials.again
    monkeypatch.setattr(trials, "again", lambda genes, draws: asked.append(genes) or again(genes, draws))
    found = seek(trials, settings)
    assert trials.rollouts <= 150 + 2
    ((finalists,),) = [asked]
    assert len(finalists) == 7 == len(np.unique(finalists, axis=0))
    grades = again(finalists, 2)
    assert grades.shape == (7, 4)
    values = accepted(fitness(grades), "min")
    assert found.found.value == values.max() and (finalists == found.genes).all(axis=1).any()
    assert np.array_equal(again(finalists, 2), grades)
    assert not np.array_equal(grades[:, :2], trials.grades(finalists))  # noise that the search did not see
    once = seek(trials, SearchSettings(rollouts=40, seed=3, again=0.2))
    assert np.array_equal(once.genes, seek(trials, SearchSettings(rollouts=40, seed=3)).genes)
    with pytest.raises(UsageError, match="again = 1.0"):
        SearchSettings(again=1.0)


def test_what_is_tried_again_has_the_simulators_effects(brief) -> None:
    rubbing = SimConfig(brief.hash, brief.name, {"motor_noise": 0.0}, {"coulomb_friction": {"torque": 0.1}})
    one = Trials(brief, task_of(brief), simulators_of(brief, [rubbing]), rate=36.0, threads=1)
    genes = first_gaits(one)
    assert np.array_equal(one.again(genes, 3), np.repeat(one.grades(genes), 3, axis=1))  # there is no noise


def test_an_interrupted_search_with_finalists_goes_on_to_the_same_end(trials, tmp_path: Path) -> None:
    settings = SearchSettings(rollouts=150, seed=3, again=0.2)
    whole, path = seek(trials, settings), tmp_path / "one.jsonl"

    def interrupt(stage: str, done: int, total: int) -> None:
        if done > 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        seek(trials, settings, journal=path, progress=interrupt)
    gone_on = seek(trials, settings, journal=path, resume=True)
    assert gone_on.found.resumed > 20 and np.array_equal(gone_on.genes, whole.genes)
    assert gone_on.found.value == whole.found.value
