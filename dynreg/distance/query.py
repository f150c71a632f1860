"""The query of a distance: a recording, and the population whose entries it ranks."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynreg.data.recording import Recording
from dynreg.data.transitions import Transitions, filled, transitions
from dynreg.distance.population import Population, Shared
from dynreg.distance.rows import Rows, recording_rows, thin
from dynreg.errors import LogError
from dynreg.models.mlp import MlpStack
from dynreg.sim.robot import Robot

JUDGED_ALL = 250  # entries up to which all are judged: a search judges nearly as many
MODEL_ROWS = 1600  # rows from which the recording's own model is trained, at most
FEWEST = 20  # rows that a model is trained from, at least


OwnModel = Callable[[Shared, Rows, int], MlpStack]
"""The model of a recording's rows in a population; the last is how many threads train it, 0 for all."""


@dataclass(frozen=True)
class Ranked:
    """Entries in order of distance: numbers `order` (M',), nearest first, and `distance` (M',).

    evaluations : distances evaluated. replays : of them, simulators that were replayed.
    """

    order: np.ndarray
    distance: np.ndarray
    evaluations: int
    replays: int = 0


def in_order(entries: np.ndarray, distance: np.ndarray, evaluations: int, replays: int = 0) -> Ranked:
    """Entries (M',) sorted by their distance (M',); of equals the one that comes first."""
    order = np.argsort(distance, kind="stable")
    return Ranked(entries[order], distance[order], evaluations, replays)


@dataclass(frozen=True, eq=False)
class DistanceQuery:
    """A recording, all of which is read, and the population in which its nearest entries are sought.

    replayed : (n,) replay errors of unit parameters (n, P). known : (P,) values of the parameters known of the robot,
    NaN elsewhere; entries far from them are left out, down to `at_least`. wanted : how many of the nearest are asked
    for. exact : whether all are judged, rather than those that a search comes upon. own : gives the model of
    rows, as `own_model`.
    """

    population: Population
    recording: Recording
    replayed: Callable[[np.ndarray], np.ndarray]
    known: np.ndarray | None = None
    at_least: int = 1
    wanted: int = 1
    exact: bool = False
    threads: int = 0
    own: OwnModel | None = None

    @property
    def robot(self) -> Robot:
        """The population's robot."""
        return self.population.shared.robot

    @property
    def timed(self) -> bool:
        """Whether the robot's commands carry their own duration: models of one time step say nothing of them."""
        return self.robot.file.robot.control == "timed"

    @cached_property
    def allowed(self) -> np.ndarray:
        """(M',) entries within a fifth of the range of what is known, or the nearest fifth where that leaves few."""
        if self.known is None or np.isnan(self.known).all():
            return np.arange(len(self.population))
        space, unit = self.robot.space, self.population.unit
        at = np.flatnonzero(~np.isnan(self.known))
        target = space.to_unit(np.where(np.isnan(self.known), space.nominal, self.known))[at]
        apart = np.abs(unit[:, at] - target).max(axis=1)
        near, fewest = np.flatnonzero(apart <= 0.2), max(20, len(unit) // 5, self.at_least)
        return near if len(near) >= fewest else np.sort(np.argsort(apart, kind="stable")[:fewest])

    @property
    def searched(self) -> bool:
        """Whether the nearest are searched for, so that not all that are allowed are judged."""
        return not self.exact and len(self.allowed) > JUDGED_ALL

    @cached_property
    def transitions(self) -> Transitions:
        """Rows of the recording; optional inputs that it lacks take the robot's defaults."""
        return transitions_of(self.robot, self.recording)

    @property
    def sparse(self) -> bool:
        """Whether the log is long enough and all states were hardly ever measured in two rows in a row."""
        rows = sum(len(e.time) for e in self.recording.episodes)
        return len(self.transitions) < FEWEST and rows >= 2 * FEWEST

    @cached_property
    def rows(self) -> Rows:
        """The recording's rows as the population's models expect them."""
        return recording_rows(self.transitions, self.population.shared.normaliser)

    @cached_property
    def model(self) -> MlpStack:
        """(1) the recording's own model; raises as `own_model`."""
        return (self.own or own_model)(self.population.shared, self.rows, self.threads)

    @cached_property
    def vector(self) -> np.ndarray:
        """(D',) embedding of the recording's own model."""
        return self.population.embedding.vectors(self.model)[0]


def transitions_of(robot: Robot, recording: Recording) -> Transitions:
    """A recording's transitions in a robot's columns; optional inputs that it lacks take the robot's defaults."""
    whole = with_defaults(robot, recording)
    return transitions(whole, robot.channels, robot.actions, [*robot.inputs, *robot.settings])


def own_model(shared: Shared, rows: Rows, threads: int = 0) -> MlpStack:
    """(1) the model of a recording's rows, trained as those of the entries; LogError where they are too few."""
    inputs, targets = rows.train
    some = thin(len(inputs), MODEL_ROWS, shared.seed, "own model")
    if len(some) < FEWEST:
        raise LogError(
            f"{len(some)} usable rows",
            expected=f"at least {FEWEST} rows in which all is measured, and in the next as well",
            do="record longer, or query with --distance replay",
        )
    return shared.training.entries(shared.base, inputs[None, some], targets[None, some], shared.seed, threads)


def with_defaults(robot: Robot, recording: Recording) -> Recording:
    """The recording with the robot's default inputs and settings where it has none, or NaN."""
    nominal = {setting.name: setting.nominal for setting in robot.file.settings}
    return filled(recording, dict(zip(robot.inputs, robot.input_defaults.tolist(), strict=True)), nominal)
