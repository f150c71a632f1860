"""Searches answered by hand: a function in the place of the engines, and a servo of one channel that it moves."""

from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from dynreg.evidence.accuracy import PLAIN, Accuracy
from dynreg.evidence.data import Data
from dynreg.evidence.hypothesis import Coordinates, Hypothesis
from dynreg.evidence.lockstep import Ask, Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.replay.parts import Parts
from dynreg.replay.windows import Windows
from dynreg.sim.effects import Term, term
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

T = TypeVar("T")
NOISE = 1e-3  # of the channel, whose spread is 1


def answered(search: Search[T], answer: Callable[[Ask], np.ndarray]) -> T:
    """What a search finds that is told `answer(ask)` (B, E, T+1, S)."""
    states = None
    while True:
        try:
            asked = search.send(states)
        except StopIteration as stop:
            return stop.value
        states = [answer(one) for one in asked]


def held_against_zero(
    *free: str,
    robot: str = "servo_pendulum",
    windows: int = 3,
    fits: int = 2,
    rows: int = 40,
    accuracy: Accuracy = PLAIN,
    tolerance: float = 1.0,
    segments: int = 1,
) -> tuple[Model, Data]:
    """A robot with these free parameters, in windows in which its first channel alone counts and was measured as 0.

    So residuals are the states that an answer tells. The number of a window is when it begins.
    """
    robot = load_robot(robot)
    known = robot.space.nominal.copy()
    known[[robot.space.names.index(name) for name in free]] = np.nan
    model = Model(robot, Coordinates(robot, known, tolerance=tolerance), accuracy=accuracy)
    shape = windows, rows + 1, len(robot.channels)
    numbers = np.arange(windows)
    run = Run(np.zeros((windows, rows, len(robot.actions))), initial=np.zeros(shape)[:, 0], begin=numbers)
    weight = (np.arange(shape[-1]) == 0).astype(float)
    cut = Windows(
        run, np.zeros(shape), np.ones(shape[-1]), weight, numbers, np.zeros((windows, 2), int), 0.01
    )
    fit = numbers < fits
    return model, Data(cut, Parts(fit, ~fit, np.zeros_like(fit)), np.full(shape[-1], NOISE), segments)


def first_channel(one: Ask, values: np.ndarray) -> np.ndarray:
    """States of which the first channel is `values`, broadcast to (B, E, T), after the start."""
    episodes, steps = one.case.run.actions.shape[-3:-1]
    states = np.zeros((len(one.case.values), episodes, steps + 1, len(one.robot.channels)))
    states[..., 1:, 0] = values
    return states


def effects_of(one: Ask) -> Iterator[tuple[int, Term, np.ndarray]]:
    """Number of the candidate, term and values (K,), of every term of every candidate."""
    terms = one.case.terms
    for own, values in zip(terms.terms, terms.values, strict=True) if terms else ():
        for i in np.flatnonzero(np.isfinite(values).all(axis=1)):
            yield int(i), own, values[i]


def keys_of(one: Ask) -> list[str]:
    """The terms of each candidate, as a hypothesis' key."""
    keys = [""] * len(one.case.values)
    for i, own, _ in effects_of(one):
        keys[i] = f"{keys[i]}+{own.key}".strip("+")
    return keys


def sizes_of(model: Model, one: Ask, key: str) -> np.ndarray:
    """(B,) first coordinate of each candidate's term of this key; 0 where it has none."""
    out = np.zeros(len(one.case.values))
    for i, own, values in effects_of(one):
        if own.key == key:
            out[i] = model.coordinates.effect_coordinates(own, values)[0]
    return out


def plain(*z: float) -> Point:
    """The plain model at these nominal coordinates."""
    return Point(Hypothesis(), np.array(z), np.zeros(0))


def with_effect(key: str, *z: float, size: float = 1.0) -> Point:
    """The model with one effect, its first coordinate at `size`, the others at their typical value."""
    own = term(key)
    effect = np.array([size, *np.zeros(len(own.effect.parameters) - 1)])
    return Point(Hypothesis((own,)), np.array(z), effect)
