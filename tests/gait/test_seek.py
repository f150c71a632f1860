"""Gaits in several simulators, and the search for them: alone as together, the same again, resumed to the bit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynreg.errors import RobotError, UsageError
from dynreg.gait.accept import ACCEPT
from dynreg.gait.seek import (
    DOUBT,
    UNSEEN,
    Finals,
    SearchSettings,
    Sought,
    best_again,
    expected,
    ranks,
    search_of,
    seek,
)
from dynreg.gait.tasks import fell as fallen
from dynreg.gait.tasks import fitness, task_of
from dynreg.gait.trials import TURNS, Simulators, Trials, simulators_of
from dynreg.search.table import SEARCHES
from dynreg.sim.config import SimConfig

BUDGET = dict.fromkeys(SEARCHES, 60) | {"cma": 84, "hill": 40, "es": 100}  # some batches in two simulators


def first_gaits(trials: Trials, count: int = 3) -> np.ndarray:
    space = trials.space
    unit = np.tile(space.starts[0], (count, 1))
    unit[:, 3] += 0.1 * np.arange(count)
    return space.feasible(space.from_unit(unit))


@pytest.fixture
def tried(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> list[tuple[np.ndarray, int]]:
    """The gaits of each batch, and its draw; nothing runs: a gait is worth its last gene in every simulator."""
    asked, many = [], len(trials.simulators)

    def grades(genes: np.ndarray, draw: int = 0) -> np.ndarray:
        asked.append((genes, draw))
        return np.tile(genes[:, -1:], (1, many))

    monkeypatch.setattr(trials, "grades", grades)
    return asked


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
    assert {how: of(values)[0] for how, of in ACCEPT.items()} == {"min": 1.0, "mean": 3.0, "quantile": 2.0}


@pytest.fixture(scope="module")
def ended() -> dict[str, Sought]:
    """What searches of the third seed found, by their methods, as far as a test has run them to their end."""
    return {}


@pytest.mark.parametrize("method", SEARCHES)
def test_a_search_is_the_same_again_and_keeps_its_budget(method: str, trials, ended) -> None:
    settings = SearchSettings(method, rollouts=BUDGET[method], seed=3)
    first = ended[method] = seek(trials, settings)
    assert trials.rollouts <= BUDGET[method] + 2  # the best gait is run once more, for its way
    again = seek(trials, settings)
    assert np.array_equal(first.genes, again.genes) and first.found.history == again.found.history
    assert first.found.value == fitness(first.found.grades[None]).min()
    assert trials.space.problems(first.genes) == ()
    values = [value for _, value in first.found.history]
    assert values == sorted(values)


@pytest.mark.parametrize("method", SEARCHES)
def test_another_seed_finds_another_gait(method: str, trials, tried) -> None:
    found = [seek(trials, SearchSettings(method, rollouts=BUDGET[method], seed=seed)) for seed in (3, 4)]
    assert not np.array_equal(found[0].genes, found[1].genes)


@pytest.mark.parametrize("method", SEARCHES)
def test_an_interrupted_search_goes_on_to_the_same_end(method: str, trials, ended, tmp_path: Path) -> None:
    settings = SearchSettings(method, rollouts=BUDGET[method], seed=3)
    whole = ended.get(method) or seek(trials, settings)
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
    again = seek(trials, settings, journal=path, key={"a": 1}, resume=True)  # and from its end
    assert again.found.resumed == again.found.evaluations


def test_too_few_rollouts_and_unknown_methods_are_refused(trials) -> None:
    with pytest.raises(UsageError, match="5 rollouts in 2 simulators"):
        seek(trials, SearchSettings(rollouts=5))
    with pytest.raises(UsageError, match="method 'ants'"):
        SearchSettings("ants")


@pytest.mark.parametrize("method", SEARCHES)
def test_the_robots_own_gaits_are_tried_first(method: str, trials, tried) -> None:
    starts = trials.space.starts
    seek(trials, SearchSettings(method, rollouts=2 * (len(starts) + SEARCHES[method].batch), seed=1))
    genes = np.concatenate([batch for batch, _ in tried])
    found = genes[: len(starts)]
    assert len(starts) > 1 and np.allclose(found, trials.space.from_unit(starts))
    first = trials.space.as_dict(found[0])
    assert {name: first[name] for name in trials.space.first[0]} == pytest.approx(dict(trials.space.first[0]))
    assert len(genes) > len(starts)


def test_the_best_gaits_are_tried_again_with_other_noise(trials, monkeypatch) -> None:
    """60 of 150 rollouts in two simulators: ten gaits once, the better five twice more, two of them four times more."""
    settings = SearchSettings(rollouts=150, seed=3, again=0.4)
    assert settings.finals(2) == ((10, 1), (5, 2), (2, 4)) and settings.finals(1) == ((10, 2), (5, 4), (2, 8))
    assert settings.finals(5) == ((4, 1), (2, 2)) and settings.finals(50) == ()  # too few to choose from
    asked, again = [], trials.again
    monkeypatch.setattr(trials, "again", lambda *a, **k: asked.append((a, k, again(*a, **k))) or asked[-1][2])
    found = seek(trials, settings)
    assert trials.rollouts <= 150 + 2
    assert [(len(a[0]), a[1], k["first"]) for a, k, _ in asked] == [(10, 1, 0), (5, 2, 1), (2, 4, 3)]
    assert len(np.unique(asked[0][0][0], axis=0)) == 10
    assert all((asked[r + 1][0][0][:, None] == asked[r][0][0]).all(axis=2).any(axis=1).all() for r in (0, 1))
    last = asked[-1][0][0]
    assert (last == found.genes).all(axis=1).any()
    row = last[(last == found.genes).all(axis=1)][0]
    seen = np.concatenate([out[int(np.flatnonzero((a[0] == row).all(axis=1))[0])] for a, _, out in asked])
    assert found.finals.value == pytest.approx(fitness(seen).mean(axis=0).min())
    assert (found.finals.runs, found.finals.falls) == (14, int(fallen(seen).sum()))
    once = seek(trials, SearchSettings(rollouts=40, seed=3, again=0.5))  # which serve for three gaits
    assert np.array_equal(once.genes, seek(trials, SearchSettings(rollouts=40, seed=3)).genes)
    with pytest.raises(UsageError, match="again = 1.0"):
        SearchSettings(again=1.0)


def test_of_the_last_gaits_the_one_that_falls_least_often_is_taken(trials, monkeypatch) -> None:
    """A fast gait that falls once in six runs, a slow one that never does, and one that stands still."""
    unit = trials.space.starts[[0, 0, 0]].copy()
    unit[1:, 0] = 0.2, 0.5

    def graded(genes: np.ndarray, draws: int, *, first: int, doubt: float) -> np.ndarray:
        out = np.zeros((len(genes), draws, 2))
        fast, slow = (np.isclose(genes[:, 0], trials.space.from_unit(u)[0]) for u in unit[:2])
        out[slow], out[fast] = 0.4, 2.0
        if first == 0:
            out[fast, 0, 0] = -999.0
        return out

    monkeypatch.setattr(trials, "again", graded)
    assert trials.task.success == 0.3
    of = lambda accept: best_again(trials, SearchSettings(accept=accept), unit, ((3, 1), (3, 2)))  # noqa: E731
    slow, fast = Finals(6, 0, pytest.approx(0.4)), Finals(6, 1, pytest.approx((0.0 + 2.0 + 2.0) / 3))
    best, finals = of("min")
    assert np.array_equal(best, unit[1]) and finals == slow
    trials.task.success = 0.5  # now the slow one is worth no more than the one that stands still
    best, finals = of("min")
    assert np.array_equal(best, unit[0]) and finals == fast
    trials.task.success = 0.3
    best, finals = of("mean")
    assert np.array_equal(best, unit[1]) and finals == slow
    trials.task.success = 0.5
    best, finals = of("mean")
    assert np.array_equal(best, unit[0])
    assert finals.value == pytest.approx(((0.0 + 2.0 + 2.0) / 3 + 2.0) / 2)
    trials.task.success = (
        9.0  # none is worth anything: not the one that stands still, but the one that goes farthest
    )
    for accept in ("min", "mean"):
        assert np.array_equal(of(accept)[0], unit[0])


def test_of_gaits_that_achieve_nothing_the_one_that_stands_is_better(trials, monkeypatch) -> None:
    values, falls = np.array([0.0, -0.01, -0.4, 0.1, 0.0, -0.2]), np.array([9, 0, 0, 5, 3, 3])
    order = sorted(range(6), key=lambda i: tuple(ranks(values, falls)[i]), reverse=True)
    assert order == [3, 1, 2, 4, 5, 0]

    unit = np.tile(trials.space.starts[0], (2, 1))
    unit[1, 0] = 0.2
    stands = trials.space.from_unit(unit[1])[0]

    def graded(genes: np.ndarray, draws: int, **_: object) -> np.ndarray:
        return np.tile(np.where(np.isclose(genes[:, 0], stands), -0.01, -999.0)[:, None, None], (1, draws, 2))

    monkeypatch.setattr(trials, "again", graded)
    best, finals = best_again(trials, SearchSettings(), unit, ((2, 1), (2, 2)))
    assert np.array_equal(best, unit[1]) and finals == Finals(6, 0, pytest.approx(-0.01))


@pytest.mark.parametrize(
    ("method", "again", "patience", "anew"),
    [
        ("cma", 0.2, None, True),
        ("cma", 0.0, None, False),
        ("cma", 0.2, 900, False),
        ("hill", 0.2, None, False),
    ],
)
def test_only_a_search_that_compares_within_batches_draws_noise_anew(
    method, again, patience, anew, trials, tried, monkeypatch
) -> None:
    monkeypatch.setattr(trials, "again", lambda genes, many, **_: np.zeros((len(genes), many, 2)))
    seek(trials, SearchSettings(method, rollouts=120, seed=1, again=again, patience=patience))
    draws = [draw for _, draw in tried]
    assert draws == ([*range(len(draws))] if anew else [0] * len(draws)) and len(draws) > 2


@pytest.mark.parametrize("many", [0, 1, 3])
@pytest.mark.parametrize("method", SEARCHES)
def test_a_robot_brings_any_number_of_gaits(many: int, method: str, trials, tried) -> None:
    trials.space = replace(trials.space, first=trials.space.first[:many])
    found = seek(trials, SearchSettings(method, rollouts=60, seed=1))
    assert 20 <= found.found.evaluations == sum(len(genes) for genes, _ in tried) <= 30


def test_what_the_lab_knows_and_what_lies_outside_the_ranges_is_not_moved(trials, monkeypatch) -> None:
    space = trials.robot.space
    at = space.names.index("torque")
    values = trials.simulators.values.copy()
    values[1, at] = 0.9 * space.bounds[at, 0]
    trials.simulators = Simulators(values)
    made = []
    monkeypatch.setattr(Trials, "grades", lambda self, genes: made.append(self) or np.zeros((len(genes), 6)))
    trials.again(first_gaits(trials), 3, doubt=0.05)
    moved = made[0].simulators.values != np.tile(values, (3, 1))
    known = [i for i, p in enumerate(space.parameters) if p.known]
    assert known and not moved[:, known].any() and not moved[1::2, at].any() and moved[::2, at].all()
    assert moved.mean() > 0.7


def test_what_is_tried_again_has_other_noise_and_other_parameters(trials) -> None:
    genes = first_gaits(trials)
    noisy = trials.again(genes, 3)
    assert noisy.shape == (3, 3, 2) and np.array_equal(trials.again(genes, 3), noisy)
    assert np.array_equal(trials.again(genes, 2, first=1), noisy[:, 1:])  # draws have numbers
    assert not np.array_equal(noisy[:, 0], trials.grades(genes))  # noise that the search did not see
    moved = trials.again(genes, 3, doubt=0.05)
    assert np.array_equal(trials.again(genes, 3, doubt=0.05), moved) and not (moved == noisy).any()
    batches = [trials.grades(genes, draw) for draw in (0, 1, 2, 1)]
    assert np.array_equal(batches[1], batches[3]) and len({*(b[0, 0] for b in batches)}) == 3


def test_the_same_simulators_can_be_tried_with_other_noise_alone(trials, monkeypatch) -> None:
    made = []
    monkeypatch.setattr(Trials, "grades", lambda self, genes: made.append(self) or np.zeros((len(genes), 6)))
    trials.again(first_gaits(trials), 3, first=7, doubt=0.05)
    trials.again(first_gaits(trials), 3, first=50, doubt=0.05, moved=7)
    one, two = made
    assert np.array_equal(one.simulators.values, two.simulators.values)
    assert not np.isclose(one._noise, two._noise).all(axis=(1, 2, 3)).any()


def test_what_is_tried_again_has_the_simulators_effects(brief) -> None:
    rubbing = SimConfig(brief.hash, brief.name, {"motor_noise": 0.0}, {"coulomb_friction": {"torque": 0.1}})
    one = Trials(brief, task_of(brief), simulators_of(brief, [rubbing]), rate=36.0, threads=1)
    genes = first_gaits(one)
    assert np.array_equal(one.again(genes, 3)[:, :, 0], np.repeat(one.grades(genes), 3, axis=1))  # no noise


def test_an_interrupted_search_with_finalists_goes_on_to_the_same_end(trials, tmp_path: Path) -> None:
    settings = SearchSettings(rollouts=100, seed=3, again=0.3)
    whole, path = seek(trials, settings), tmp_path / "one.jsonl"

    def interrupt(stage: str, done: int, total: int) -> None:
        if done > 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        seek(trials, settings, journal=path, progress=interrupt)
    gone_on = seek(trials, settings, journal=path, resume=True)
    assert gone_on.found.resumed > 20 and np.array_equal(gone_on.genes, whole.genes)
    assert gone_on.finals == whole.finals


def test_a_trial_is_predicted_by_runs_that_nothing_has_seen(trials, monkeypatch) -> None:
    """Other draws than those of the finals, with other parameters; so many of each simulator that it is 40 in all."""
    gait, again, seen = first_gaits(trials, 1)[0], trials.again, []
    monkeypatch.setattr(trials, "again", lambda *a, **how: seen.append((a[1], how)) or again(*a, **how))
    best_again(trials, SearchSettings(), trials.space.starts[:2], ((2, 2), (1, 4)))
    (grades,) = expected(trials, gait[None])
    assert len(grades) == 40 and trials.rollouts >= 40
    *finals, (draws, how) = seen
    assert how["doubt"] == DOUBT and how["first"] > max(f["first"] + d for d, f in finals) and draws == 20


def test_gaits_that_the_robot_has_had_are_tried_before_all_others(trials) -> None:
    space = trials.space
    had = space.feasible(space.from_unit(np.random.default_rng(5).uniform(size=(3, len(space)))))
    for method in SEARCHES:
        for packaged in (True, False):
            settings = SearchSettings(
                method, rollouts=600, packaged=packaged, tried=tuple(map(tuple, had.tolist()))
            )
            asked = search_of(trials, settings, settings.evaluations(2)).ask()
            seen = [space.from_unit(one) for one in asked]
            assert all(any(np.allclose(one, gait) for one in seen) for gait in had), method


def many_simulators(brief, many: int = 6) -> Trials:
    values = brief.space.sample(0, many, 5)
    return Trials(brief, task_of(brief), Simulators(values), rate=brief.rate, threads=1)


def test_simulators_take_turns_and_each_batch_meets_some(brief, monkeypatch) -> None:
    trials, asked = many_simulators(brief), []
    again = trials.again
    monkeypatch.setattr(trials, "again", lambda *a, **k: asked.append((a, k)) or again(*a, **k))
    settings = SearchSettings("cma", rollouts=300, again=0.3, seed=2, meets=2, doubt=0.07)
    found = seek(trials, settings)
    turns = [k for _, k in asked if "only" in k]
    met = [number for k in turns for number in k["only"]]
    assert all(len(k["only"]) == 2 and k["doubt"] == 0.07 for k in turns)
    assert len(met) > 12 and all(sorted(met[i : i + 6]) == [*range(6)] for i in range(0, len(met) - 5, 6))
    assert len({tuple(met[i : i + 6]) for i in range(0, len(met) - 5, 6)}) > 1
    assert len({k["first"] for k in turns}) == len(turns)  # other noise for each batch
    assert {k["doubt"] for _, k in asked if "only" not in k} == {0.07}  # the finals, in all six
    assert trials.rollouts <= settings.rollouts + 6 and found.found.evaluations > settings.rollouts * 0.5 / 6
    assert not found.helpless.any()
    alone = trials.in_turn(first_gaits(trials), 3, 2, 0.07)
    assert np.array_equal(
        alone, trials.again(first_gaits(trials), 1, first=TURNS[3], doubt=0.07)[:, 0, trials.turn(3, 2)]
    )


@pytest.mark.parametrize(("method", "patience"), [("hill", None), ("cma", 50)])
def test_searches_that_compare_batches_meet_all_simulators(method: str, patience, brief) -> None:
    settings = SearchSettings(method, rollouts=300, again=0.3, patience=patience, meets=2)
    assert settings.met(6) == 6 and replace(settings, method="cma", patience=None).met(6) == 2
    assert replace(settings, method="cma", patience=None).met(1) == 1
    trials, met = many_simulators(brief), []
    trials.grades = lambda genes, **_: met.append(len(genes)) or np.ones((len(genes), 6))
    trials.again = lambda genes, draws, **_: np.ones((len(genes), draws, 6))  # the finals
    trials.in_turn = lambda *_: pytest.fail("a batch met some of them alone")
    assert seek(trials, settings).found.evaluations == sum(met) <= 300 // 6


def test_an_interrupted_search_in_turn_goes_on_to_the_same_end(brief, tmp_path: Path) -> None:
    settings, path, done = (
        SearchSettings("cma", rollouts=180, again=0.4, seed=2, meets=2),
        tmp_path / "one.jsonl",
        [],
    )
    whole = seek(many_simulators(brief), settings)

    def interrupt(stage: str, at: int, total: int) -> None:
        done.append(at)
        if len(done) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        seek(many_simulators(brief), settings, journal=path, key={"a": 1}, progress=interrupt)
    gone_on = seek(many_simulators(brief), settings, journal=path, key={"a": 1}, resume=True)
    assert gone_on.found.resumed == done[2] and np.array_equal(gone_on.genes, whole.genes)
    assert np.array_equal(gone_on.helpless, whole.helpless) and gone_on.finals == whole.finals


def test_a_simulator_whose_turn_never_came_is_not_called_helpless(brief) -> None:
    """Of six, two batches of two meet four at most; in the simulators of the others no gait fell, for none ran."""
    trials, helpless = many_simulators(brief), []
    settings = SearchSettings("cma", rollouts=100, again=0.75, seed=2, meets=2)
    assert settings.met(6) == 2 and settings.evaluations(6) < 3 * SEARCHES["cma"].batch
    fall = lambda genes, *_: np.full((len(genes), 2), -999.5)  # noqa: E731
    trials.in_turn = fall
    found = seek(trials, settings)
    helpless = {n for n in range(6) if found.helpless[n]}
    assert helpless == {n for batch in range(2) for n in trials.turn(batch, 2)} and len(helpless) < 6


def test_runs_that_predict_a_trial_are_no_draws_of_a_turn(brief) -> None:
    assert TURNS.stop <= UNSEEN and len(TURNS) > 1000
    trials, genes = many_simulators(brief), first_gaits(many_simulators(brief), 1)
    first = trials.in_turn(genes, 0, 6, 0.1)
    later = trials.in_turn(
        genes, len(TURNS), 6, 0.1
    )  # 36 rounds of turns fit: the same noise, in another order
    order = [trials.turn(len(TURNS), 6).index(number) for number in trials.turn(0, 6)]
    assert np.array_equal(first[:, :], later[:, order])
