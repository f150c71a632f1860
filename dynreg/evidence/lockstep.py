"""Searches that ask for rollouts, and many of them answered from one batch.

A search is a generator: it yields the rollouts that it wants and is sent their states. So each algorithm is written
once, and many searches advance together: a robot's own, those of its simulated robots, those of a table of trials.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from dynreg.sim.engines import Case, rollouts
from dynreg.sim.robot import Robot

OFTEN = 5.0  # [s] between two words of how far a search is
# Simulators in one batch: the least, for calls of fewer are dear (with the four windows of a short log 64 of MuJoCo's),
# and the most before it is known how long they take.
LEAST, FIRST = 16, 256


@dataclass(frozen=True, eq=False)
class Ask:
    """Rollouts of a robot that are wanted, on one of its engines (None for its first): their states (B, E, T+1, S)."""

    robot: Robot
    case: Case
    engine: str | None = None


T = TypeVar("T")
Search = Generator[list[Ask], list[np.ndarray], T]


def ask(one: Ask) -> Search[np.ndarray]:
    """The search that asks once, and finds what it is told."""
    (states,) = yield [one]
    return states


def together(searches: Iterable[Search[T]]) -> Search[list[T]]:
    """The search that advances all of these at once, and finds what each of them finds.

    Raises what any of them raises.
    """
    every = list(searches)
    found: list[T | None] = [None] * len(every)
    asked: dict[int, list[Ask]] = {}

    def go(number: int, states: list[np.ndarray] | None) -> None:
        try:
            asked[number] = every[number].send(states)
        except StopIteration as stop:
            asked.pop(number, None)
            found[number] = stop.value

    for number in range(len(every)):
        go(number, None)
    while asked:
        states = yield [one for own in asked.values() for one in own]
        at = 0
        for number, own in list(asked.items()):
            go(number, states[at : at + len(own)])
            at += len(own)
    return found


def counted(search: Search[T], told: Callable[[int], None] | None = None) -> Search[tuple[T, int]]:
    """What a search finds, and how many simulators it asked for.

    told : is called with the number so far, each time that what was asked has been simulated. What takes longer than
    `OFTEN` seconds is asked in parts then; the numbers do not depend on that.
    """
    many, states, pace = 0, None, math.inf
    while True:
        try:
            asked = search.send(states)
        except StopIteration as stop:
            return stop.value, many
        if told is None:
            states = yield asked
            many += sum(len(one.case.values) for one in asked)
            continue
        parts: list[list[np.ndarray]] = [[] for _ in asked]
        left = deque(enumerate(asked))
        while left:
            numbers, some = _next(left, max(LEAST, round(pace * OFTEN) if pace < math.inf else FIRST))
            began = time.perf_counter()
            for number, made in zip(numbers, (yield some), strict=True):
                parts[number].append(made)
            count = sum(len(one.case.values) for one in some)
            many, pace = many + count, count / max(time.perf_counter() - began, 1e-6)
            told(many)
        states = [one[0] if len(one) == 1 else np.concatenate(one) for one in parts]


def _next(left: deque[tuple[int, Ask]], most: int) -> tuple[list[int], list[Ask]]:
    """The next of what is left to simulate, at most so many simulators: numbers of asks, and these or parts of them."""
    numbers, some = [], []
    while left and most > 0:
        number, one = left.popleft()
        count = len(one.case.values)
        if count > most:
            left.appendleft((number, replace(one, case=one.case.take(slice(most, count)))))
            one = replace(one, case=one.case.take(slice(0, most)))
        most -= count
        numbers.append(number)
        some.append(one)
    return numbers, some


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Linear algebra on one thread: with more it would add in another order, and its matrices are small."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield


def run(search: Search[T], *, threads: int = 1) -> T:
    """What a search finds; whatever it asks in one step is simulated as one batch.

    threads : of a batch, 0 for all cores; the numbers do not depend on it, nor on what else is in the batch.
    Linear algebra has one thread meanwhile. Raises what the search raises, and as `rollouts` does.
    """
    states = None
    with one_blas_thread():
        while True:
            try:
                asked = search.send(states)
            except StopIteration as stop:
                return stop.value
            states = _answered(asked, threads)


def _answered(asked: list[Ask], threads: int) -> list[np.ndarray]:
    alike: dict[tuple[Robot, str | None], list[int]] = {}
    for number, one in enumerate(asked):
        alike.setdefault((one.robot, one.engine), []).append(number)
    states: list[np.ndarray] = [np.zeros(0)] * len(asked)
    for (robot, engine), numbers in alike.items():
        made = rollouts(robot, [asked[i].case for i in numbers], engine=engine, threads=threads)
        for i, one in zip(numbers, made, strict=True):
            states[i] = one.states
    return states
