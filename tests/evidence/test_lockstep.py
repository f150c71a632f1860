"""Searches in lockstep: each finds to the last bit what it finds alone, whatever else is in the batch."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest
from by_hand import answered, first_channel, held_against_zero, plain
from legs import in_the_air, over_its_stop
from threadpoolctl import threadpool_info, threadpool_limits

from dynreg.evidence import lockstep
from dynreg.evidence.accuracy import rough
from dynreg.evidence.data import Data
from dynreg.evidence.fit import fit
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.lockstep import Ask, Search, counted, run, together
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.sim.effects import term

FREE = ("coulomb_friction", "resistance")


def bits(found: tuple[list[Point], np.ndarray]) -> list[bytes]:
    points, cost = found
    return [cost.tobytes(), *(point.z.tobytes() for point in points)]


def fitted(model: Model, data: Data, keys: tuple[str, ...], iterations: int) -> Search[tuple]:
    """A refit of the plain model and of one with each of these effects."""
    points = [model.start]
    for key in keys:
        own = Hypothesis((term(key),))
        points.append(Point(own, model.start.nominal, np.full(len(own.parameters), 0.5)))
    return fit(model, points, data.sample(data.fit), iterations=iterations)


def searches() -> dict[str, Callable[[], Search]]:
    """Searches of two robots, on two engines, with more and fewer steps, with effects and without."""
    air, data, _ = in_the_air("payload")
    ground, on_it, _ = over_its_stop(0.2)
    servo, held = held_against_zero(*FREE)
    return {
        "leg": lambda: fitted(air, data, ("payload", "backlash[knee]"), 1),
        "leg again": lambda: fitted(air, data, (), 2),
        "leg on the ground": lambda: fitted(ground, on_it, (), 1),
        "servo": lambda: fitted(servo, held, ("load_friction", "command_delay"), 4),
        "servo again": lambda: fitted(servo, held, (), 2),
        "nothing asked": lambda: together([]),
    }


@lru_cache
def alone() -> dict[str, list]:
    return {name: told(run(search())) for name, search in searches().items()}


def told(found: list | tuple) -> list[bytes]:
    return bits(found) if found else []


@pytest.mark.parametrize(("threads", "turned"), [(1, False), (2, True)])
def test_a_search_finds_the_same_alone_and_beside_others(threads: int, turned: bool):
    names = list(searches())[:: -1 if turned else 1]
    beside = run(together([searches()[name]() for name in names]), threads=threads)
    assert {name: told(found) for name, found in zip(names, beside, strict=True)} == alone()


def asks(times: int, model: Model, data: Data) -> Search[int]:
    """A search that asks so many times, and finds what it was told in all."""
    told = 0.0
    for number in range(times):
        states = yield from model.states([plain(float(number))], data.windows.run)
        told += states[0, 0, -1, 0]
    return told


def test_many_searches_take_as_many_steps_as_the_longest_of_them():
    model, data = held_against_zero(FREE[0])
    steps: list[int] = []

    def answer(one: Ask) -> np.ndarray:
        return first_channel(one, 1.0)

    def batches(search: Search) -> Search:
        states = None
        while True:
            try:
                asked = search.send(states)
            except StopIteration as stop:
                return stop.value
            steps.append(len(asked))
            states = yield asked

    found = answered(batches(together([asks(n, model, data) for n in (3, 0, 1)])), answer)
    assert found == [3.0, 0.0, 1.0] and steps == [2, 1, 1]
    nested = together([together([asks(2, model, data), asks(1, model, data)]), asks(1, model, data)])
    assert answered(nested, answer) == [[2.0, 1.0], 1.0]


def test_every_simulator_that_was_asked_for_is_counted():
    model, data = held_against_zero(FREE[0])
    found, many = answered(
        counted(model.residuals([plain(0.0)] * 5, data.sample(data.fit))), lambda a: first_channel(a, 2.0)
    )
    assert many == 5 and (found == 2.0).all()
    both = counted(together([asks(3, model, data), asks(1, model, data)]))
    assert answered(both, lambda a: first_channel(a, 0.0))[1] == 4


def test_what_goes_wrong_in_one_search_is_told():
    def broken() -> Search[None]:
        yield []
        raise ValueError("on its way")

    model, data = held_against_zero(FREE[0])
    with pytest.raises(ValueError, match="on its way"):
        run(together([asks(3, model, data), broken()]))


def test_the_accuracy_of_one_search_is_its_own():
    """Of the same robot, one with a finer time step and one without."""
    model, data, _ = over_its_stop(0.2)
    fine = Model(model.robot, model.coordinates, accuracy=rough(model.robot)).fine
    asked = [model.residuals([model.start], data.sample(data.fit)) for model in (model, fine)]
    usual, finer = run(together(asked))
    assert np.abs(usual - finer).max() > 1e-6
    assert np.array_equal(run(fine.residuals([model.start], data.sample(data.fit))), finer)


@pytest.mark.parametrize("name", ["leg", "servo"])
def test_what_takes_long_is_asked_in_parts_and_finds_the_same(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also an ask alone is parted; each part is told."""
    for constant, value in (("LEAST", 3), ("FIRST", 3), ("OFTEN", 0.0)):
        monkeypatch.setattr(lockstep, constant, value)
    counts: list[int] = []
    found, many = run(counted(searches()[name](), counts.append))
    assert told(found) == alone()[name]
    assert counts[-1] == many and counts[0] == 3 and set(np.diff(counts).tolist()) <= {1, 2, 3}


def test_linear_algebra_has_one_thread_while_a_search_runs() -> None:
    """A ranking by simulators with one effect each said other numbers on one core and on two."""
    many = lambda: {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}  # noqa: E731

    def search() -> Search[set[int]]:
        return many()
        yield []

    with threadpool_limits(2, user_api="blas"):
        assert run(search()) == {1} and many() == {2}
