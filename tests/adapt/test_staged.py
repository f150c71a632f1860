"""Stages follow each other: each fits its own parameters, begins where the last ended, and carries its steps on."""

import numpy as np
import pytest

from dynreg.adapt.plan import Stage, StageTable
from dynreg.adapt.staged import Loss, staged, within
from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.search.journal import Journal

TRUTH = np.array([0.3, 0.8, 0.6, 0.1])
START = np.full(4, 0.5)


def stage(name: str, parameters: list[int], **told) -> Stage:
    table = StageTable(**{"name": name, "parameters": ["*"], "generations": 40, **told})
    return Stage(table, np.array(parameters), np.arange(1))


def bowl(asked: list[np.ndarray], of: Stage) -> Loss:
    def squares(unit: np.ndarray) -> np.ndarray:
        asked.append(unit)
        return ((unit - TRUTH)[:, of.parameters] ** 2).sum(axis=1)

    return Loss(squares, 4.0, of.windows)


def fit(stages: list[Stage], asked: list[np.ndarray] | None = None, **told):
    losses = [bowl([] if asked is None else asked, one) for one in stages]
    return staged(stages, losses, START, lambda name: stream(3, name), **told)


def test_each_stage_moves_its_own_parameters_and_begins_where_the_last_one_ended() -> None:
    first, second = fit([stage("a", [0, 1]), stage("b", [2, 3])])
    np.testing.assert_allclose(first.unit[:2], TRUTH[:2], atol=1e-3)
    assert (first.unit[2:] == START[2:]).all(), "the others stay"
    assert (second.unit[:2] == first.unit[:2]).all()
    np.testing.assert_allclose(second.unit, TRUTH, atol=1e-3)


@pytest.mark.parametrize("search", ["es", "cma", "random"])
def test_no_stage_ends_worse_than_it_began(search: str) -> None:
    found = fit(
        [stage("a", [0, 1, 2, 3], search=search, generations=2), stage("b", [0, 1, 2, 3], search=search)]
    )
    assert all(one.last <= one.first for one in found)


def test_what_was_fitted_before_begins_with_the_carried_step() -> None:
    asked: list[np.ndarray] = []
    first, _ = fit([stage("a", [0, 1]), stage("b", [0, 1, 2, 3], carry=0.02)], asked)
    children = asked[42]  # the start of a, its 40 generations, the start of b, the first children of b
    assert len(children) == 25
    spread = (children - first.unit).std(axis=0)
    assert (spread[:2] < 0.05).all() and (spread[2:] > 0.05).all()


@pytest.mark.parametrize("budget", [52, 53, 200, 1000, 5000])
def test_a_budget_is_shared_by_the_stages_and_kept(budget: int) -> None:
    stages = [stage("a", [0, 1]), stage("b", [2, 3], generations=10)]
    many = within(stages, budget)
    spent = sum(one.evaluations for one in fit(stages, generations=many))
    assert spent <= budget and all(1 <= n <= s.table.generations for n, s in zip(many, stages, strict=True))
    assert budget < 5000 or many == within(stages, None) == [40, 10]


def test_a_budget_below_one_generation_of_each_stage_is_refused() -> None:
    with pytest.raises(UsageError, match="budget of 51 simulations for a plan of 2 stages"):
        within([stage("a", [0, 1]), stage("b", [2, 3])], 51)


def test_an_interrupted_run_goes_on_to_the_same_numbers(tmp_path) -> None:
    stages = [stage("a", [0, 1], generations=6), stage("b", [2, 3], generations=6)]

    def journal(resume: bool):
        return lambda name: Journal(tmp_path / f"{name}.jsonl", {"of": name}, resume=resume)

    class Cut(Exception):
        pass

    def cut(name: str, done: int, total: int) -> None:
        if name == "b" and done > 60:
            raise Cut

    alone = fit(stages)
    with pytest.raises(Cut):
        fit(stages, journal=journal(False), progress=cut)
    asked: list[np.ndarray] = []
    again = fit(stages, asked, journal=journal(True))
    assert [one.resumed for one in again] == [151, 76] and sum(map(len, asked)) == 75
    for one, other in zip(alone, again, strict=True):
        assert one.unit.tobytes() == other.unit.tobytes() and one.history == other.history
