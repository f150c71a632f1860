"""The search near a gait that walked: simulators take turns, and of the way that it found a part is gone."""

from pathlib import Path

import numpy as np
import pytest

from dynreg.gait.near import DOUBT, SHARES, STEP, between, farthest, may_stay, most_simulators, seek_near
from dynreg.gait.seek import Finals, SearchSettings
from dynreg.gait.tasks import task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.search.table import SEARCHES

NEAR = [method for method in SEARCHES if may_stay(method)]


def begun(trials: Trials) -> tuple[float, ...]:
    """The first of the robot's own gaits."""
    space = trials.space
    return tuple(space.feasible(space.from_unit(space.starts[:1]))[0].tolist())


def settings_of(trials: Trials, method: str = "cma", **how) -> SearchSettings:
    return SearchSettings(
        method,
        **({"rollouts": 150, "seed": 3, "doubt": DOUBT} | how),
        tried=(begun(trials),),
        near=True,
    )


def test_only_searches_that_set_out_from_one_gait_and_learn_from_each_batch_can_stay() -> None:
    assert NEAR == ["cma", "es"]


@pytest.mark.parametrize("method", NEAR)
def test_simulators_take_turns_and_what_is_tried_is_near(method: str, trials, monkeypatch) -> None:
    asked, again = [], trials.again
    monkeypatch.setattr(trials, "again", lambda *a, **k: asked.append((a, k)) or again(*a, **k))
    settings = settings_of(trials, method)
    found = seek_near(trials, settings)
    assert trials.rollouts <= settings.rollouts + 2  # the answer is run once more, for its way
    turns = [(a[0], k) for a, k in asked if k.get("only") is not None]
    assert len(turns) > 3
    for first, second in zip(
        turns[::2], turns[1::2], strict=False
    ):  # both in each round, in an order of its own
        assert sorted([*first[1]["only"], *second[1]["only"]]) == [0, 1]
    first = [k["only"][0] for _, k in turns[::2]]
    assert first == [trials.turn(2 * number, 1)[0] for number in range(len(first))]
    draws = [k["first"] for _, k in turns]
    assert len({*draws}) == len(draws)  # other noise and other parameters for each batch
    space = trials.space
    first, away = space.to_unit(np.array(begun(trials))[None]), space.to_unit(turns[0][0])
    apart = np.abs(away - first)
    apart[:, space.periodic] = np.minimum(apart, 1.0 - apart)[:, space.periodic]
    assert 0.3 * STEP < apart.mean() < 1.5 * STEP
    (points, last), how = asked[-1]  # then the points of the way meet other draws, the same for all, in both
    assert how["doubt"] == DOUBT and "only" not in how and how.get("first", 0) + last < min(draws)
    assert len(points) == len(SHARES) and any((gait == found.genes).all() for gait in points)
    assert found.finals.runs == 2 * last


def test_one_simulator_alone_does_what_it_does_beside_others(trials) -> None:
    genes = np.array([begun(trials)])
    for doubt in (0.0, 0.1):
        both = trials.again(genes, 2, doubt=doubt)
        for number in (0, 1):
            alone = trials.again(genes, 2, doubt=doubt, only=[number])
            assert np.array_equal(alone[:, :, 0], both[:, :, number])
    assert trials.rollouts == 2 * (4 + 2 * 2)


def test_a_search_near_a_gait_goes_on_to_the_same_end(trials, tmp_path: Path) -> None:
    settings, path, done = settings_of(trials), tmp_path / "one.jsonl", []
    whole = seek_near(trials, settings)

    def interrupt(stage: str, at: int, total: int) -> None:
        done.append(at)
        if len(done) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        seek_near(trials, settings, journal=path, key={"a": 1}, progress=interrupt)
    gone_on = seek_near(trials, settings, journal=path, key={"a": 1}, resume=True)
    assert gone_on.found.resumed == done[2] and np.array_equal(gone_on.genes, whole.genes)
    assert gone_on.finals == whole.finals and gone_on.found.history == whole.found.history
    assert not np.array_equal(seek_near(trials, settings_of(trials, seed=4)).genes, whole.genes)


def test_a_way_between_two_gaits_is_the_short_one_where_genes_run_round() -> None:
    begin, end, periodic = np.array([0.2, 0.9]), np.array([0.6, 0.1]), np.array([False, True])
    points = between(begin, end, periodic)
    assert points[:, 0] == pytest.approx([0.2, 0.3, 0.4, 0.5, 0.6])
    assert points[:, 1] == pytest.approx([0.9, 0.95, 0.0, 0.05, 0.1])


def test_of_the_way_as_much_is_gone_as_gains_most_on_average_over_all_draws(trials, monkeypatch) -> None:
    """In one simulator gaits get better all the way; in the other, where all do less, they get worse from half on."""
    points = between(*trials.space.to_unit(np.array([begun(trials), begun(trials)])), trials.space.periodic)
    there = np.array([[[5.0, 0.5]], [[5.5, 1.2]], [[7.0, 1.1]], [[9.0, 0.5]], [[12.0, 0.1]]])
    monkeypatch.setattr(trials, "again", lambda genes, draws, *, doubt: np.tile(there, (1, draws, 1)))
    best, finals = farthest(trials, SearchSettings(accept="min", doubt=DOUBT), points, 4)
    assert np.array_equal(best, points[2]) and finals == Finals(8, 0, 1.1)  # the other gains 2.0
    best, finals = farthest(trials, SearchSettings(accept="mean", doubt=DOUBT), points, 4)
    assert np.array_equal(best, points[4]) and finals == Finals(8, 0, 6.05)
    there[1:] = 0.1  # all are worse: the robot still gets another gait than it has had
    assert np.array_equal(
        farthest(trials, SearchSettings(accept="min", doubt=DOUBT), points, 4)[0], points[1]
    )
    assert np.array_equal(
        farthest(trials, SearchSettings(accept="min", doubt=DOUBT), points, 0)[0], points[2]
    )  # few rollouts: half of the way


# {case: (falls of forty runs at each point of the way, the point that is taken)}; the farther, the more it gains
FALLS = {
    "none falls": ((0, 0, 0, 0, 0), 4),
    "a twentieth more than the first is as often": ((2, 2, 4, 4, 5), 3),
    "the first falls, too": ((8, 0, 0, 20, 10), 4),
    "all others fall more often": ((0, 5, 4, 3, 6), 3),
}


@pytest.mark.parametrize("case", FALLS)
def test_no_farther_than_gaits_fall_no_more_often_than_the_one_that_walked(
    case: str, trials, monkeypatch
) -> None:
    points = between(*trials.space.to_unit(np.array([begun(trials), begun(trials)])), trials.space.periodic)
    falls, taken = FALLS[case]
    seen = np.array([[10.0 ** (4 + at)] * 40 for at in range(5)])
    for at, many in enumerate(falls):
        seen[at, :many] = -999.0
    monkeypatch.setattr(trials, "again", lambda genes, draws, *, doubt: seen.reshape(5, draws, 2))
    best, finals = farthest(trials, SearchSettings(accept="mean", doubt=DOUBT), points, 20)
    assert np.array_equal(best, points[taken]) and (finals.runs, finals.falls) == (40, falls[taken])


@pytest.mark.parametrize("k", [5, 6, 7, 16])
def test_a_batch_meets_no_simulator_twice_and_all_are_met_as_often(k: int, brief) -> None:
    values = np.tile(brief.space.nominal, (k, 1))
    trials = Trials(brief, task_of(brief), Simulators(values), rate=brief.rate, threads=1)
    batches = [trials.turn(number, 4) for number in range(3 * k)]
    assert all(len({*batch}) == 4 for batch in batches)
    assert np.bincount(np.concatenate(batches)).tolist() == [12] * k
    assert len({tuple(batch) for batch in batches}) > k  # orders are drawn anew


def test_values_of_batches_in_different_simulators_do_not_end_a_search(trials) -> None:
    asked = seek_near(trials, settings_of(trials, patience=1)).found.evaluations
    assert asked == seek_near(trials, settings_of(trials)).found.evaluations > 10


def test_the_points_of_the_way_meet_no_draw_of_a_batch_however_many_rollouts_there_are(
    trials, monkeypatch
) -> None:
    assert seek_near(trials, settings_of(trials)).finals.runs == 2 * 5
    monkeypatch.setattr("dynreg.gait.near.TURNS", range(3, 10))
    assert seek_near(trials, settings_of(trials)).finals.runs == 2 * 3


def test_few_rollouts_are_not_exceeded(trials) -> None:
    found = seek_near(trials, settings_of(trials, rollouts=22))
    assert found.finals is None and trials.space.problems(found.genes) == () and trials.rollouts <= 24


def test_of_many_simulators_each_meets_the_points_of_the_way_once(brief) -> None:
    """Where a fifth of the rollouts does not suffice for one draw of all points in all of them."""
    values = brief.space.sample(0, 7, 5)
    trials = Trials(brief, task_of(brief), Simulators(values), rate=brief.rate, threads=1)
    found = seek_near(trials, settings_of(trials, rollouts=150))
    assert found.finals.runs == 7 and trials.rollouts <= 150 + 7
    assert most_simulators(100) == 7 and most_simulators(99) == 6 and most_simulators(3) == 1
    assert seek_near(trials, settings_of(trials, rollouts=100)).finals.runs == 7
    assert seek_near(trials, settings_of(trials, rollouts=99)).finals is None
