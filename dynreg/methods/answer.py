"""Versions: every simulator that a method makes or takes on its way to its answer, and what shaped it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dynreg.adapt.tried import Tried


@dataclass(frozen=True, eq=False)
class Version:
    """One simulator: parameters (P,) in their units and effects, {key: {parameter: value}}.

    stage : what made it. parent : number of the version that it came from; None of the nominal simulator, or the one
    that the question begins with. entry : id of the registered simulator that it is; None of a new one. episodes : of
    the recording, that shaped it. before, after : the objective that the stage made small, at its parent and at it;
    None where the stage has none. unit : of these, "" of a replay error. figures : what else is worth telling, by name.
    history : (simulators run in the stage, lowest objective) whenever it fell; empty of a stage that is no search.
    trials : names of the trials on the robot that shaped it.
    """

    stage: str
    values: np.ndarray
    parent: int | None
    episodes: tuple[str, ...]
    before: float | None = None
    after: float | None = None
    entry: str | None = None
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    figures: Mapping[str, float] = field(default_factory=dict)
    history: tuple[tuple[int, float], ...] = ()
    trials: tuple[str, ...] = ()
    unit: str = ""


@dataclass(frozen=True, eq=False)
class Answer:
    """What a method answers: its versions in the order in which they were made, of which the last is the answer.

    ended : why it ended. rollouts : simulators run, those of an interrupted run too. simulated : seconds of them; None
    where nobody counted them. evaluations : distances. resumed : of the rollouts, those that an interrupted run had
    left. intervals : {parameter: (low, high)} of 90 %, of a method that tells any. causes : keys of the effects that it
    names; None of a method that looks for none. saw : names of what is held out that the method saw all the same.
    free : (P,) which parameters it could move; None of all.
    tried : of a method that tries gaits on the robot, all of them. best : the one of them that it answers with; see
    `adapt.tried.best_of`. gait : (G,) its genes.
    """

    versions: tuple[Version, ...]
    ended: str
    rollouts: int
    simulated: float | None
    evaluations: int = 0
    resumed: int = 0
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    causes: tuple[str, ...] | None = None
    saw: tuple[str, ...] = ()
    free: np.ndarray | None = None
    tried: tuple[Tried, ...] = ()
    best: Tried | None = None
    gait: np.ndarray | None = None

    @property
    def final(self) -> Version:
        """The last one."""
        return self.versions[-1]
