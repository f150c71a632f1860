"""Searches on plain functions: they find the top and keep budgets."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.search.cmaes import CmaEs
from dynreg.search.drive import Limits, drive
from dynreg.search.hill import HillClimber
from dynreg.search.race import Race
from dynreg.search.screened import Screened, after, around, different
from dynreg.search.start import Start
from dynreg.search.table import SEARCHES


def screened(rng: np.random.Generator, many: int, *, batch: int = 10, sigma: float = 0.12) -> Screened:
    """CMA-ES after `many` candidates, the middle first."""
    middle = np.full((1, 3), 0.5)
    candidates = np.concatenate([middle, around(middle, many - 1, rng)])
    return Screened(candidates, lambda best: CmaEs(best[0], sigma=sigma, rng=rng, batch=None), batch=batch)


MAKE = {
    name: lambda rng, kind=kind: kind.begin(Start(3, rng, kind.batch)) for name, kind in SEARCHES.items()
} | {"screened": lambda rng: screened(rng, 40)}


def hump(asked: np.ndarray) -> np.ndarray:
    """(n, 1) highest, 1, at (0.2, 0.7, 0.4)."""
    return 1.0 - ((asked - [0.2, 0.7, 0.4]) ** 2).sum(axis=1, keepdims=True)


def judge(grades: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return grades[:, 0], -grades[:, 0]


@pytest.mark.parametrize("name", MAKE)
def test_every_search_climbs_and_keeps_its_budget(name: str) -> None:
    found = drive(MAKE[name](stream(0, name)), hump, judge, Limits(400))
    assert found.evaluations <= 400 and found.value > {"random": 0.97}.get(name, 0.99)
    assert np.allclose(found.grades, hump(found.best[None])[0])


def test_ranks_say_which_is_the_best_where_values_alone_do_not() -> None:
    """Values from -0.3 on are alike, and of these the lowest is the best."""
    tenths = lambda asked: -np.rint(10 * asked[:, :1]) / 10  # noqa: E731

    def ranked(grades: np.ndarray) -> tuple[np.ndarray, ...]:
        values = grades[:, 0]
        return values, np.zeros(len(values)), np.stack([np.minimum(values, -0.3), -values], axis=1)

    found = drive(MAKE["random"](stream(0, "ranks")), tenths, ranked, Limits(100))
    assert found.value == pytest.approx(-0.3)
    assert [value for _, value in found.history][-1] == found.value


def test_what_is_no_number_is_the_worst_in_a_first_batch_too() -> None:
    first = []

    def unknown(asked: np.ndarray) -> np.ndarray:
        first.append(len(asked))
        return np.full((len(asked), 1), np.nan) if len(first) == 1 else hump(asked)

    found = drive(MAKE["random"](stream(0, "none")), unknown, judge, Limits(200))
    assert found.value > 0.8 and found.history[0][0] == 1 and found.history[1][0] > first[0]


def test_no_batch_is_begun_that_the_budget_has_no_room_for() -> None:
    """Batches of 5 while it screens, of 7 then."""
    for budget, used in ((10, 10), (16, 10), (17, 17), (23, 17), (24, 24)):
        search = screened(stream(0, "sizes"), 10, batch=5)
        asked = []
        found = drive(search, lambda x: asked.append(len(x)) or hump(x), judge, Limits(budget))  # noqa: B023
        assert found.evaluations == sum(asked) == used and found.ended == "budget"


WEIGHTS, LOWEST = np.array([1.0, 1.5, 2.0, 2.5, 3.0]), np.array([0.3, 0.7, 0.55, 0.4, 0.62])
NEAR = {
    "es": 0.01,
    "policy": 0.03,
    "roulette": 0.25,
}  # of the range, of the farthest gene after 1000 candidates


def ellipsoid(asked: np.ndarray) -> np.ndarray:
    """(n, 1) highest, 0, at `LOWEST`."""
    return -((WEIGHTS * (asked - LOWEST)) ** 2).sum(axis=1, keepdims=True)


@pytest.mark.parametrize("name", NEAR)
def test_the_middle_of_an_ellipsoid_is_found_and_by_chance_it_is_not(name: str) -> None:
    values = {}
    for kind in (SEARCHES[name], SEARCHES["random"]):
        begun = [kind.begin(Start(5, stream(s, kind.name), kind.batch)) for s in range(6)]
        found = [drive(search, ellipsoid, judge, Limits(1000)) for search in begun]
        values[kind.name] = np.mean([one.value for one in found])
        if kind.name == name:
            assert max(np.abs(one.best - LOWEST).max() for one in found) < NEAR[name]
    assert values[name] > 0.6 * values["random"]


@pytest.mark.parametrize("name", NEAR)
def test_what_lies_in_a_corner_is_reached_and_nothing_outside_is_asked(name: str) -> None:
    corner = np.array([0.0, 1.0, 0.0])
    kind = SEARCHES[name]
    search, tried = kind.begin(Start(3, stream(0, name), kind.batch)), []
    away = lambda x: -np.abs(x - corner).sum(axis=1, keepdims=True)  # noqa: E731
    found = drive(search, lambda x: tried.append(x) or away(x), judge, Limits(1500))
    tried = np.concatenate(tried)
    assert (tried >= 0.0).all() and (tried <= 1.0).all()
    assert np.abs(found.best - corner).max() < 0.01
    # it holds: what is asked in the end lies there, too
    assert np.abs(np.median(tried[-100:], axis=0) - corner).max() < 0.05


@pytest.mark.parametrize("name", ["hill", "cma", "screened"])
def test_searches_beat_chance_at_an_equal_budget(name: str) -> None:
    mean = {
        n: np.mean([drive(MAKE[n](stream(s, n)), hump, judge, Limits(200)).value for s in range(10)])
        for n in (name, "random")
    }
    assert mean[name] > mean["random"]


@pytest.mark.parametrize("budget", [1, 7, 10, 33])
@pytest.mark.parametrize("name", MAKE)
def test_a_batch_is_cut_to_what_the_budget_has_left(name: str, budget: int) -> None:
    tried = []
    limits = Limits(budget, cut=True)
    found = drive(MAKE[name](stream(2, name)), lambda x: tried.append(x) or hump(x), judge, limits)
    tried = np.concatenate(tried)
    assert found.evaluations == len(tried) == budget and found.ended == "budget"
    assert found.value == hump(tried).max()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", SEARCHES)
def test_what_is_known_is_tried_first_and_nothing_worse_comes_back(name: str, seed: int) -> None:
    known = np.array([[0.21, 0.69, 0.4]])
    rng = stream(seed, name)
    tried = []
    search = after(known, SEARCHES[name], Start(3, rng, SEARCHES[name].batch))
    found = drive(search, lambda x: tried.append(x) or hump(x), judge, Limits(41, cut=True))
    assert np.array_equal(tried[0], known) and found.value >= hump(known)[0, 0]
    assert found.history[0] == (1, hump(known)[0, 0]) and len(np.concatenate(tried)) == 41


@pytest.mark.parametrize("name", [name for name, kind in SEARCHES.items() if kind.from_one])
def test_a_search_from_one_point_sets_out_from_the_best_of_what_was_tried_first(name: str) -> None:
    best, kind = np.array([0.2, 0.75, 0.25]), SEARCHES[name]
    tried = np.stack([[0.8, 0.2, 0.8], best, np.full(3, 0.5)])
    search = after(tried, kind, Start(3, stream(4, name), kind.batch))
    assert np.array_equal(search.ask(), tried)
    search.tell(np.array([2.0, 1.0, 3.0]))
    # about the middle of the cube, its mean would lie 0.25 or more away in every dimension
    assert np.abs(search.ask().mean(axis=0) - best).max() < 0.12


@pytest.mark.parametrize("name", SEARCHES)
def test_the_same_draws_ask_the_same(name: str) -> None:
    first, again, other = (MAKE[name](stream(seed, name)) for seed in (0, 0, 1))
    for _ in range(3):
        asked = first.ask()
        assert np.array_equal(asked, again.ask()) and not np.array_equal(asked, other.ask())
        for search in (first, again, other):
            search.tell(np.arange(float(len(asked))))


@pytest.mark.parametrize("name", SEARCHES)
def test_ask_and_tell_take_turns(name: str) -> None:
    search = MAKE[name](stream(0, name))
    with pytest.raises(UsageError, match="losses"):
        search.tell(np.zeros(4))
    asked = search.ask()
    assert (asked >= 0).all() and (asked <= 1).all()
    with pytest.raises(UsageError, match="ask after ask"):
        search.ask()


def test_climbers_on_a_plain_try_other_starts_and_then_climb() -> None:
    search = HillClimber(2, rng=stream(0, "plain"), restarts=1, start=np.array([0.5, 0.5]))
    assert np.array_equal(search.ask(), [[0.5, 0.5]])
    search.tell(np.zeros(1))
    far = search.ask()
    search.tell(np.array([-1.0]))
    steps = []
    for _ in range(20):
        steps.append(search.ask() - far)
        search.tell(np.zeros(1))  # worse
    assert 0.05 < np.std(steps) < 0.2


def test_a_search_ends_where_it_is_told_to() -> None:
    ended = lambda **limits: drive(MAKE["cma"](stream(1, "a")), hump, judge, Limits(500, **limits)).ended  # noqa: E731
    assert ended(patience=30) == "patience"
    flat = drive(MAKE["hill"](stream(1, "a")), lambda x: np.zeros((len(x), 1)), judge, Limits(40))
    assert flat.ended == "budget" and flat.history == ((1, 0.0),)


def test_a_generator_of_its_own_leaves_the_global_one_alone() -> None:
    np.random.seed(0)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    drive(MAKE["cma"](stream(1, "a")), hump, judge, Limits(50))
    assert np.array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def test_a_screened_search_sets_out_from_the_best_that_it_saw() -> None:
    """Nothing but a narrow hump, which the middle does not see."""
    search = screened(stream(3, "narrow"), 60, sigma=0.02)
    assert np.array_equal(search.ask()[0], np.full(3, 0.5)) and search.middle is None
    search.tell(np.arange(10.0))
    best = None
    for _ in range(5):
        asked = search.ask()
        search.tell(np.arange(10.0) - 1.0)
        best = asked[0] if best is None else best
    assert np.abs(search.ask() - best).max() < 0.2
    assert np.abs(search.middle - best).max() < 0.2


def test_draws_about_starts_go_round_where_a_dimension_does() -> None:
    starts, rng = np.array([[0.99, 0.99], [0.01, 0.01]]), stream(5, "around")
    about = around(starts, 400, rng, np.array([False, True]))
    assert about.shape == (400, 2) and (about >= 0).all() and (about <= 1).all()
    assert np.median(about[::2, 0]) > 0.85 and np.median(about[1::2, 0]) < 0.15  # of the two starts in turn
    circular = np.exp(2j * np.pi * about[:, 1]).mean()
    assert abs(circular) > 0.15 and abs(np.angle(circular)) < 0.5
    edges = (about == 0.0) | (about == 1.0)
    assert edges[:, 0].mean() > 0.3 and not edges[:, 1].any()


def test_starts_of_a_race_lie_apart_and_the_best_comes_first() -> None:
    tried = np.array([[0.95, 0.5], [0.98, 0.5], [0.05, 0.5], [0.5, 0.5], [0.5, 0.9]])
    assert different(tried, 3).tolist() == [[0.95, 0.5], [0.05, 0.5], [0.5, 0.5]]
    assert different(tried, 3, np.array([True, False])).tolist() == [[0.95, 0.5], [0.5, 0.5], [0.5, 0.9]]
    assert len(different(tried[:2], 3)) == 1


def two_humps(asked: np.ndarray) -> np.ndarray:
    """(n, 1) a broad low hump at 0.2 and a narrow high one at 0.8."""
    away = lambda at: ((asked - at) ** 2).sum(axis=1, keepdims=True)  # noqa: E731
    return np.maximum(np.exp(-away(0.2) / 0.1), 3.0 * np.exp(-away(0.8) / 0.02))


def test_a_race_goes_on_where_most_is_found_though_it_began_lower() -> None:
    starts = np.array([[0.25, 0.25], [0.65, 0.65]])
    assert two_humps(starts)[0] > two_humps(starts)[1]
    alone = CmaEs(starts[0], rng=stream(0, "alone"), sigma=0.05, batch=6)
    runs = [CmaEs(s, rng=stream(i, "race"), sigma=0.05, batch=6) for i, s in enumerate(starts)]
    race, asked = Race(runs, laps=5), []
    found = drive(race, lambda x: asked.append(x.mean(axis=0)[0]) or two_humps(x), judge, Limits(300))
    assert drive(alone, two_humps, judge, Limits(300)).value < 1.01 < 2.9 < found.value
    sides = [x > 0.45 for x in asked]
    assert sides[:10] == [False, True] * 5 and all(sides[10:]), "in turn, then the better one alone"


def test_a_search_sets_out_from_several_of_the_best() -> None:
    kind, many = SEARCHES["cma"], 60
    candidates = stream(1, "candidates").uniform(size=(many, 2))
    apart = {}
    for runs in (1, 3):
        asked: list[np.ndarray] = []
        start = Start(2, stream(2, "runs"), kind.batch)
        search = after(candidates, kind, start, runs=runs, laps=40)
        drive(search, lambda x: asked.append(x) or two_humps(x), judge, Limits(many + 300))  # noqa: B023
        last = np.array([batch.mean(axis=0) for batch in asked[-3:]])
        apart[runs] = np.linalg.norm(last - last[[1, 2, 0]], axis=1).max()
    assert apart[1] < 0.1 < 0.5 < apart[3], "all batches on one hump, or some on the other"


def test_cma_es_passes_the_seam_of_a_dimension_that_runs_round() -> None:
    """The top lies at 0.1, the start at 0.95: 0.15 away across the seam, and uphill only that way."""
    away = lambda x: np.minimum(np.mod(x - 0.1, 1.0), np.mod(0.1 - x, 1.0))  # noqa: E731
    turning = np.array([True, False])
    search = CmaEs(np.array([0.95, 0.5]), sigma=0.03, rng=stream(2, "seam"), periodic=turning)
    for _ in range(40):
        asked = search.ask()
        assert (asked >= 0).all() and (asked <= 1).all()
        search.tell(away(asked[:, 0]) ** 2 + (asked[:, 1] - 0.4) ** 2)
    assert away(search.best[0]) < 0.01 and abs(search.best[1] - 0.4) < 0.05
    assert away(search.middle[0]) < 0.02 and 0.0 <= search.middle[0] < 1.0
