"""Searches that ask for rollouts, and many of them answered from one batch.

A search is a generator: it yields the rollouts that it wants and is sent their states. So each algorithm is written
once, and many searches advance together: a robot's own, those of its simulated robots, those of a table of trials.
"""

from collections.abc import Generator, Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from dynreg.sim.engines import Case, rollouts
from dynreg.sim.robot import Robot


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


def counted(search: Search[T]) -> Search[tuple[T, int]]:
    """What a search finds, and how many simulators it asked for."""
    many, states = 0, None
    while True:
        try:
            asked = search.send(states)
        except StopIteration as stop:
            return stop.value, many
        many += sum(len(one.case.values) for one in asked)
        states = yield asked


def run(search: Search[T], *, threads: int = 1) -> T:
    """What a search finds; whatever it asks in one step is simulated as one batch.

    threads : of a batch, 0 for all cores; the numbers do not depend on it, nor on what else is in the batch.
    Raises what the search raises, and as `rollouts` does.
    """
    states = None
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
