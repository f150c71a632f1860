"""Searches on plain functions: they find the top, keep budgets, and their journal is trusted only where it fits."""

from pathlib import Path

import numpy as np
import pytest

from dynreg.errors import CorruptError, UsageError
from dynreg.rng import stream
from dynreg.search.at_random import AtRandom
from dynreg.search.cmaes import CmaEs
from dynreg.search.drive import Limits, drive
from dynreg.search.genetic import Genetic
from dynreg.search.hill import HillClimber
from dynreg.search.journal import Journal
from dynreg.search.screened import ScreenedCmaEs

MAKE = {
    "hill": lambda rng: HillClimber(3, rng=rng, restarts=4),
    "cma": lambda rng: CmaEs(np.full(3, 0.5), rng=rng),
    "screened": lambda rng: ScreenedCmaEs(np.full(3, 0.5), rng=rng, screen=40),
    "genetic": lambda rng: Genetic(3, rng=rng, population=20, tournament=3, elite=1),
    "random": lambda rng: AtRandom(3, rng=rng, batch=8),
}


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


def test_no_batch_is_begun_that_the_budget_has_no_room_for() -> None:
    """Batches of 5 while it screens, of 7 then."""
    for budget, used in ((10, 10), (16, 10), (17, 17), (23, 17), (24, 24)):
        search = ScreenedCmaEs(np.full(3, 0.5), rng=stream(0, "sizes"), screen=10, batch=5)
        asked = []
        found = drive(search, lambda x: asked.append(len(x)) or hump(x), judge, Limits(budget))  # noqa: B023
        assert found.evaluations == sum(asked) == used and found.ended == "budget"


@pytest.mark.parametrize("name", ["hill", "cma", "screened"])
def test_searches_beat_chance_at_an_equal_budget(name: str) -> None:
    mean = {
        n: np.mean([drive(MAKE[n](stream(s, n)), hump, judge, Limits(200)).value for s in range(10)])
        for n in (name, "random")
    }
    assert mean[name] > mean["random"]


@pytest.mark.parametrize("name", ["hill", "cma", "genetic"])
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
    assert ended(target=0.9) == "target"
    assert ended(patience=30) == "patience"
    flat = drive(MAKE["hill"](stream(1, "a")), lambda x: np.zeros((len(x), 1)), judge, Limits(40))
    assert flat.ended == "budget" and flat.history == ((1, 0.0),)


def test_a_generator_of_its_own_leaves_the_global_one_alone() -> None:
    np.random.seed(0)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    drive(MAKE["cma"](stream(1, "a")), hump, judge, Limits(50))
    assert np.array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def journal_of(path: Path, batches: int = 2) -> None:
    kept = Journal(path, {"seed": 1}, resume=False)
    search = MAKE["random"](stream(1, "a"))
    for _ in range(batches):
        asked = search.ask()
        kept.next(asked)
        kept.add(asked, hump(asked))


def test_a_journal_gives_back_what_was_found_and_drops_a_torn_line(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    journal_of(path)
    text = path.read_text()
    path.write_text(text + '{"asked": "12')
    kept, search = Journal(path, {"seed": 1}, resume=True), MAKE["random"](stream(1, "a"))
    for _ in range(2):
        asked = search.ask()
        assert np.array_equal(kept.next(asked), hump(asked))
    assert kept.next(search.ask()) is None
    assert path.read_text() == text
    assert Journal(path, {"seed": 1}, resume=False).next(asked) is None  # begun anew


def test_a_journal_of_another_search_or_of_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    journal_of(path)
    with pytest.raises(UsageError, match="another search .seed differ"):
        Journal(path, {"seed": 2}, resume=True)
    kept = Journal(path, {"seed": 1}, resume=True)
    with pytest.raises(CorruptError, match="asked something else"):
        kept.next(np.zeros((8, 3)))
    path.write_text("not json\n")
    with pytest.raises(CorruptError, match="no journal"):
        Journal(path, {"seed": 1}, resume=True)
    assert path.read_text() == "not json\n"


def test_a_screened_search_sets_out_from_the_best_that_it_saw() -> None:
    """Nothing but a narrow hump, which the middle does not see."""
    search = ScreenedCmaEs(np.full(3, 0.5), rng=stream(3, "narrow"), screen=60, batch=10, sigma=0.02)
    assert np.array_equal(search.ask()[0], np.full(3, 0.5))
    search.tell(np.arange(10.0))
    best = None
    for _ in range(5):
        asked = search.ask()
        search.tell(np.arange(10.0) - 1.0)
        best = asked[0] if best is None else best
    assert np.abs(search.ask() - best).max() < 0.2
