"""Doubts: what speaks against calling a cause named, however much evidence it has."""

from dataclasses import dataclass

import numpy as np

from dynreg.diagnose.judging import Judged
from dynreg.diagnose.kinds import DoubtKind
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.ranking.population import Ranking
from dynreg.diagnose.score import INSTEAD, Naming
from dynreg.evidence.estimate import EDGE
from dynreg.evidence.hypothesis import Coordinates, Hypothesis, effect_bounds, weak_coordinate, worth_naming
from dynreg.evidence.point import Point
from dynreg.sim.space import none_below

# Sigma of its nameplate, as wide as `DiagnosisOptions.tolerance` makes it, beyond which a parameter more likely makes
# up for something: by contract.
PULLED = 3.0


@dataclass(frozen=True)
class Doubt:
    """One reason not to call a cause named.

    kind : "pulled": a parameter had to leave its nameplate by `value` sigma, as robot.toml states it.
        "parameter_at_bound", "size_at_bound": a parameter, or the size of a cause, ended at the edge of its range, at
        `value`. "small": after the last fit a cause is under half its weak size; `value` is the size over the weak one.
        "no_gain": a cause raises the held-out error; `value` is its gain. "no_better": the last simulator errs more on
        the judged windows than a robot that holds still or just follows its commands; `value` is its error over theirs.
        "unlike": no simulator with one of the known causes looks like the log; `value` is how much the nearest does, up
        to 1. A log with several causes looks like none of them.
    of : the parameter or the key of the cause; "" of the whole simulator.
    """

    kind: DoubtKind
    of: str
    value: float


def doubts(state: State, judged: Judged, ranking: Ranking | None = None) -> tuple[Doubt, ...]:
    """The doubts about the causes that were accepted; without a cause only whether the simulator is worth anything.

    ranking : what the log looks like; None where that was not asked.
    """
    if not state.accepted:
        return tuple(_no_better(judged))
    c, point = state.model.coordinates, state.current
    unlike = ranking is not None and ranking.outside and state.accepted == 1
    return (
        *_pulled(c, point),
        *(Doubt("parameter_at_bound", name, value) for name, value in at_bounds(c, point)),
        *_of_sizes(point),
        *_without_gain(state, judged),
        *_no_better(judged),
        *([Doubt("unlike", "", ranking.resemblance)] if unlike else []),
    )


def at_bounds(c: Coordinates, point: Point) -> list[tuple[str, float]]:
    """(name, value) of the parameters at the edge of their range, but for those at 0, which no range can go below."""
    stopped, values, out = stopped_by_bounds(c, point), c.values(point.nominal), []
    for i, at_edge in zip(c.free, stopped, strict=True):
        p = c.robot.space.parameters[i]
        if at_edge and not none_below(values[i], p.low, p.high):
            out.append((p.name, float(values[i])))
    return out


def stopped_by_bounds(c: Coordinates, point: Point) -> np.ndarray:
    """(P',) whether each free parameter ended at an end of its range."""
    low, high = c.nominal_bounds.T
    return (point.nominal <= low + EDGE) | (point.nominal >= high - EDGE)


def _pulled(c: Coordinates, point: Point) -> list[Doubt]:
    far = np.abs(c.pulls(point.nominal, c.tolerance)) > PULLED
    names = [c.robot.space.parameters[i].name for i in c.free[far]]
    told = c.pulls(point.nominal)[far]
    return [Doubt("pulled", name, float(value)) for name, value in zip(names, told, strict=True)]


def _of_sizes(point: Point) -> list[Doubt]:
    """Of every accepted cause: a size at the edge of what a fit may reach, or one that is not worth a name."""
    out, hypothesis = [], point.hypothesis
    for number in range(hypothesis.given, len(hypothesis.terms)):
        term, own = hypothesis.terms[number], point.effect[hypothesis.columns(number)]
        alone = Hypothesis((term,))
        edge = effect_bounds(alone)[:, 1]
        sized = [not p.shape for p in term.effect.parameters]
        at_edge = (np.abs(own) >= edge - EDGE) & sized
        if at_edge.any():
            out.append(Doubt("size_at_bound", term.key, float(own[at_edge][0])))
        if not worth_naming(alone, own):
            each = zip(own, term.effect.parameters, strict=True)
            ratio = max(abs(z) / weak_coordinate(p) for z, p in each if not (p.shape or p.shared))
            out.append(Doubt("small", term.key, float(ratio)))
    return out


def _without_gain(state: State, judged: Judged) -> list[Doubt]:
    """The causes that raise the held-out error: at all beside what was accepted before, or clearly beside the better
    calibration.

    Where calibrated parameters stand in for a cause (`replaced`), its gain over them is chance: only what is clear
    counts.
    """
    point, out = state.current, []
    for number, naming in enumerate(state.rounds[: state.accepted]):
        after = judged.CAUSES + number
        gain = judged.gained(after - 1 if number else judged.CALIBRATED, after)
        if gain is None:
            continue
        worse = judged.clearly_worse(number)
        if worse or (gain.value < 0 and not replaced(naming)):
            key = point.hypothesis.terms[point.hypothesis.given + number].key
            out.append(Doubt("no_gain", key, (judged.of_cause(number) if worse else gain).value))
    return out


def replaced(naming: Naming) -> bool:
    """Whether calibrated parameters stand in for a cause.

    Much of its evidence then comes from their return to the nameplate, and it cannot lower the error they reach.
    """
    relief = naming.start.point.penalty - naming.chosen.point.penalty
    return relief >= INSTEAD * naming.chosen.nats


def _no_better(judged: Judged) -> list[Doubt]:
    """Whether a baseline without a simulator errs less than the simulator that is left."""
    ratio = float(judged.each[judged.last].mean() / judged.plain.mean()) if judged.plain.mean() > 0 else 0.0
    return [Doubt("no_better", "", ratio)] if ratio > 1 else []
