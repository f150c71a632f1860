"""Models that are made from the first commands of a recording, and what they and simulators have in common."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

import numpy as np

from dynreg.compare.mlp import train_mlp
from dynreg.models.threads import available_threads
from dynreg.progress import Progress
from dynreg.timed.cellwise import fit_cellwise
from dynreg.timed.commands import Commands
from dynreg.timed.fit import Breeding, fit_unicycle
from dynreg.timed.models import Kinematic, Model, Unicycle
from dynreg.timed.networks import WEIGHTS, train
from dynreg.timed.told import Told
from dynreg.timed.unicycle import NAMES


class Predicts(Protocol):
    """Anything that says what commands of a recording do."""

    def moved(self, which: np.ndarray, share: float = 1.0) -> np.ndarray:
        """(m, 3) displacements of some commands (indexes) after a share of their time."""


@dataclass(frozen=True, eq=False)
class Made:
    """A model that was made here, the commands of the recording, and the seconds that making it took.

    kind : what the model is. parameters : what was fitted, by name.
    """

    model: Model
    told: Told
    seconds: float = 0.0
    kind: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)

    def moved(self, which: np.ndarray, share: float = 1.0) -> np.ndarray:
        """(m, 3) displacements of some commands (indexes) after a share of their time."""
        commands = self.told.commands.take(which)
        return self.model.predict(replace(commands, seconds=share * commands.seconds))


@dataclass(frozen=True)
class Plan:
    """Which models are made, and how.

    models : names of `MODELS`. longest : seconds after which a command counts as another. starts : of the networks.
    generations : of the genetic algorithm that fits the unicycle. seed : of every draw. threads : 0 for all cores;
    changes no number but the networks' last bits, which differ from run to run (`timed.networks.train`).
    """

    models: tuple[str, ...]
    longest: float
    starts: int
    generations: int
    seed: int
    threads: int = 0

    @property
    def cores(self) -> int:
        """That work side by side."""
        return self.threads or available_threads()


@dataclass(frozen=True)
class Making:
    """The input of models: the commands of a recording, slices to fit and to validate, and settings."""

    told: Told
    fit: slice
    validation: slice
    plan: Plan

    @property
    def known(self) -> tuple[Commands, np.ndarray]:
        """Commands to fit and what they moved."""
        return self.told.commands.take(self.fit), self.told.moved[self.fit]

    @property
    def unseen(self) -> tuple[Commands, np.ndarray]:
        """Commands to validate with and what they moved."""
        return self.told.commands.take(self.validation), self.told.moved[self.validation]


def _kinematic(making: Making, report: Callable[[int, int], None]) -> tuple[Model, dict[str, float]]:
    return Kinematic(making.told.track), {"track": making.told.track}


def _dynamic(making: Making, report: Callable[[int, int], None]) -> tuple[Model, dict[str, float]]:
    track = making.told.track
    found = fit_unicycle(
        *making.known,
        making.unseen,
        track,
        Breeding(generations=making.plan.generations, seed=making.plan.seed),
        threads=making.plan.cores,
        progress=report,
    ).parameters
    return Unicycle(found, track), {"track": track, **dict(zip(NAMES, map(float, found), strict=True))}


def _table(making: Making, report: Callable[[int, int], None]) -> tuple[Model, dict[str, float]]:
    found = fit_cellwise(*making.known, making.unseen, making.told.track)
    return found, {"track": making.told.track, "cells": float(found.grid.cells)}


def _network(making: Making, report: Callable[[int, int], None]) -> tuple[Model, dict[str, float]]:
    found = train(
        *making.known,
        making.unseen,
        starts=making.plan.starts,
        seed=making.plan.seed,
        workers=making.plan.cores,
        progress=report,
    )
    return found, {}


def _mlp(making: Making, report: Callable[[int, int], None]) -> tuple[Model, dict[str, float]]:
    return train_mlp(*making.known, making.unseen, seed=making.plan.seed, threads=making.plan.threads), {}


@dataclass(frozen=True)
class Recipe:
    """A kind of model: how it is made, what it is, and the fewest commands that it needs."""

    make: Callable[[Making, Callable[[int, int], None]], tuple[Model, dict[str, float]]]
    kind: str
    least: int


MODELS: Mapping[str, Recipe] = {
    "kinematic": Recipe(_kinematic, "closed form", 0),
    "dynamic": Recipe(_dynamic, "unicycle, fitted", 20),
    "table": Recipe(_table, "closed form, put right in cells of wheel speeds", 20),
    "network": Recipe(_network, "three networks 5-20-1, trained", WEIGHTS),
    "mlp": Recipe(_mlp, "network 5-128-128-128-3, trained", 40),
}


def made(name: str, making: Making, progress: Progress | None = None) -> Made:
    """A model by its name, one of `MODELS`."""
    began = time.perf_counter()
    report = partial(progress, name) if progress else lambda *_: None
    model, parameters = MODELS[name].make(making, report)
    return Made(model, making.told, time.perf_counter() - began, MODELS[name].kind, parameters)
