"""The threshold: how much evidence this robot gives for causes that it does not have, under these very commands."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

import numpy as np

from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.effort import FULL, Effort
from dynreg.diagnose.name import name_one
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.truth import Hidden, hide, measured_states
from dynreg.replay.parts import Parts
from dynreg.replay.windows import starts
from dynreg.rng import stream_seed
from dynreg.sim.effects import Term

LEAST = 5.0  # nats: no simulation lowers the threshold below this,
USUAL = 20.0  # and this is it where nothing was simulated
ALARMS = 0.01  # of robots without an effect that may score more
TAIL = 5  # of the largest scores, and at least a tenth of all: what the exponential tail is fitted to
KIND = "threshold"
SEARCH = 9  # goes up when scores change: thresholds found before no longer serve
Progress = Callable[[str, int, int], None]


class Cache(Protocol):
    """Keeps what can be computed again, by kind and key, both plain JSON; a registry is one."""

    def cached(self, kind: str, key: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """What was kept under this key; None where there is nothing."""
        ...

    def cache(self, kind: str, key: Mapping[str, Any], document: Mapping[str, Any]) -> None:
        """Keep the document under this key."""
        ...


@dataclass(frozen=True)
class Threshold:
    """A threshold [nats], and the best scores of the simulated robots without an effect that it comes from."""

    nats: float
    scores: tuple[float, ...]
    cached: bool = False


def threshold(
    cache: Cache | None,
    problem: Problem,
    terms: list[Term],
    split: Parts,
    *,
    runs: int,
    seed: int = 0,
    effort: Effort = FULL,
    progress: Progress | None = None,
) -> Threshold:
    """The evidence above which a cause is named: simulated robots of the nameplate, without effects, diagnosed alike.

    Kept in the cache under `key_of`.
    """
    if runs == 0:
        return Threshold(USUAL, ())
    key = key_of(problem, terms, split, runs=runs, seed=seed, effort=effort)
    known = None if cache is None else cache.cached(KIND, key)
    if known is not None:
        return Threshold(known["nats"], tuple(known["scores"]), cached=True)
    scores = []
    for i in range(runs):
        scores.append(null_score(problem, terms, split, null_seed(seed, i), effort))
        if progress:
            progress("threshold", i + 1, runs)
    found = Threshold(level(scores), tuple(scores))
    if cache is not None:
        cache.cache(KIND, key, {"nats": found.nats, "scores": scores})
    return found


def level(scores: Sequence[float]) -> float:
    """The threshold [nats] that the best scores of robots without an effect ask for."""
    return max(LEAST, exceeded(scores))


def null_seed(seed: int, number: int) -> int:
    """Of the robot without an effect of that number."""
    return stream_seed(seed, "no effect", number) % 2**31


def exceeded(scores: Sequence[float]) -> float:
    """[nats] that a share `ALARMS` of robots exceeds, by these scores and an exponential tail of the largest.

    Beyond a high enough score what is left to exceed it is nearly exponential (J. Pickands, Statistical Inference Using
    Extreme Order Statistics, Ann. Stat. 3, 1975); the largest of all alone would make the threshold one robot's matter.
    """
    largest = np.sort(scores)[::-1]
    tail = min(max(TAIL, len(largest) // 10), len(largest) - 1)
    if tail == 0:
        return float(largest[0])
    excess = float(np.mean(largest[:tail] - largest[tail]))
    return float(largest[tail]) + excess * np.log(tail / len(largest) / ALARMS)


def null_score(
    problem: Problem,
    terms: list[Term],
    split: Parts,
    seed: int,
    effort: Effort = FULL,
) -> float:
    """[nats] of the cause chosen for one simulated robot that lacks none, under the commands of the problem."""
    fit_on, select_on = _windows(split)
    chosen = np.concatenate([fit_on, select_on])
    windows = problem.windows.take(chosen)
    where = {"engine": problem.engine, "threads": problem.threads}
    measured = measured_states(problem.robot, null_robot(problem, seed), windows.run, **where)
    measured = np.where(np.isnan(windows.measured), np.nan, measured)
    begun = starts(problem.robot, windows.run.actions, measured, windows.run.before)
    initial = np.where(np.isnan(windows.run.initial), np.nan, begun)
    windows = replace(windows, measured=measured, run=replace(windows.run, initial=initial))
    same = Problem(
        problem.robot, windows, problem.coordinates, problem.engine, problem.threads, begun=problem.begun
    )
    fits, selects = np.arange(len(fit_on)), np.arange(len(fit_on), len(chosen))
    base, effective = calibrate(same, fits, draws=0 if len(terms) > effort.long else effort.draws)
    chosen = name_one(same, base, terms, fits, selects, effective, effort=effort).chosen
    return 0.0 if chosen is None else max(0.0, chosen.nats)


def null_robot(problem: Problem, seed: int) -> Hidden:
    """A robot that the simulator a search begins with lacks nothing of: drawn about it, with its effects.

    Just what the search's prior takes for likely, and effects as far as a fit reaches.
    """
    start, c = problem.start, problem.coordinates
    drawn = hide(problem.robot, (), None, seed, centre=c.centre, tolerance=c.tolerance)
    values = c.effect_values(start.hypothesis, start.effect[None])
    return replace(drawn, terms=start.hypothesis.terms, values=tuple(row[0] for row in values))


def _windows(split: Parts) -> tuple[np.ndarray, np.ndarray]:
    """The windows to fit and to select by."""
    return np.flatnonzero(split.fit), np.flatnonzero(split.select)


def key_of(
    problem: Problem, terms: list[Term], split: Parts, *, runs: int, seed: int, effort: Effort
) -> dict[str, Any]:
    """All that the scores depend on, but for what was measured: plain JSON."""
    fit_on, select_on = _windows(split)
    cut = problem.windows.take(np.concatenate([fit_on, select_on]))
    run = cut.run
    says: dict[str, Any] = {
        "robot": problem.robot.hash,
        "engine": problem.running,
        "terms": [t.key for t in terms],
        "runs": runs,
        "seed": seed,
        "parts": [len(fit_on), len(select_on)],
        "tolerance": problem.coordinates.tolerance,
        "free": problem.coordinates.free.tolist(),
        "joints": run.joints,
        "effort": asdict(effort),
        "search": SEARCH,
    }
    digest = hashlib.sha256()
    inputs = None if run.inputs is None else np.nan_to_num(run.inputs)
    unknown = None if run.initial is None else np.isnan(run.initial)
    for array in (
        run.actions,
        run.settings,
        inputs,
        np.isnan(cut.measured),
        unknown,
        run.velocity,
        run.before,
        cut.spread,
        cut.weight,
        problem.coordinates.centre,
    ):
        if array is not None:
            digest.update(np.ascontiguousarray(array, dtype=float).tobytes())
    if problem.begun:
        effects = zip(problem.begun.terms, problem.begun.values, strict=True)
        says["begun"] = {term.key: values.tolist() for term, values in effects}
    return says | {"arrays": digest.hexdigest()}
