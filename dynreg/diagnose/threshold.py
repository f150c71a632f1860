"""The threshold: the evidence that simulated robots without an effect reach by chance, under the same commands."""

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.noise import noisier, own_noise
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.ranking.population import EffectPopulation
from dynreg.diagnose.settle import unlike
from dynreg.diagnose.tail import exceeded
from dynreg.diagnose.verdict import lefts, most_left
from dynreg.evidence.data import Data
from dynreg.evidence.lockstep import Search, together
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.truth import Hidden, hide, measured_states
from dynreg.progress import Progress
from dynreg.replay.parts import Parts
from dynreg.replay.windows import starts
from dynreg.rng import stream_seed
from dynreg.sim.effects import Term
from dynreg.sim.robot import Robot
from dynreg.sim.versions import versions

LEAST = 5.0  # nats: the lowest threshold; the leg on the ground needs it
USUAL = 20.0  # the threshold without simulations: by contract, about what the benches find (5 to 22)
FEW = 6  # robots that lower it: a tail of fewer scores than `tail.TAIL`, and the one it begins at, tells no rate
ALARMS = 0.01  # false-alarm rate of robots without an effect: by contract (bench_naming: 1 of 150)
# That the rate is no higher, whichever robots were drawn. Of 60 wheels (own simulations) one in ten scores 6 to 19
# nats: by the mean of the tail, sets of 20 of them put the limit anywhere between 5 and 27 nats.
CONFIDENCE = 0.8
KIND = "threshold"
SEARCH = 15  # version of the scores: a new one invalidates cached thresholds
# Mean difference of the commands of a window, in each action's spread: of all actions, and of any one. All a row late
# the packaged protocols differ by 0.24 and 0.55 at most (quadruped, 35 Hz), others of the same kinds by 1.5 and more.
ALIKE, ANY = 0.3, 0.7
OFFSET = 0.1  # of the spread that the mean of a window may differ by; a row late they do by 0.053 at most
STRETCHES = 8  # of a window, in which commands are compared
# Robots in lockstep. On the XL330 log 20, 5 and 2 at a time take 43, 40 and 38 s of one core; MuJoCo's calls are dear
# below 64 simulations, which five fill; and between groups there is something to tell.
TOGETHER = 5

# `null` of so many robots, computed elsewhere, with these simulators of one effect each to guide their searches
Nulls = Callable[[int, EffectPopulation | None], Iterable[tuple[float, float]]]


class Cache(Protocol):
    """A store of results that can be computed again, by kind and key (plain JSON); a registry is one."""

    def cached(self, kind: str, key: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """The document under this key; None without one."""
        ...

    def cache(self, kind: str, key: Mapping[str, Any], document: Mapping[str, Any]) -> None:
        """Store the document under this key."""
        ...


@dataclass(frozen=True)
class Threshold:
    """A threshold [nats], and what the simulated robots without an effect say that it comes from.

    scores : the best of each. ratios : of each what its calibrated simulator leaves, over the stated noise; see
    `verdict.most_left`.
    """

    nats: float
    scores: tuple[float, ...]
    ratios: tuple[float, ...] = ()
    cached: bool = False

    @classmethod
    def of(cls, made: Sequence[tuple[float, float]]) -> "Threshold":
        """From the (score, ratio) of each simulated robot; see `null`."""
        scores, ratios = zip(*made, strict=True)
        return cls(level(scores), scores, ratios)


def threshold(
    problem: Problem,
    recording: Recording,
    options: DiagnosisOptions,
    cache: Cache | None = None,
    progress: Progress | None = None,
    nulls: Nulls | None = None,
) -> Search[Threshold]:
    """The evidence above which a cause is named, from diagnoses of simulated robots without an effect.

    These robots are drawn from the nameplate. The threshold is cached by `key_of` for similar commands, so a second
    recording with the same commands needs no simulation. nulls : what they say, from elsewhere; None computes it here.
    """
    runs = options.threshold_runs
    at_once = found_before(problem, recording, options, cache)
    if at_once is not None:
        return at_once
    noise = own_noise(problem.model.robot, problem.train_part(recording))
    key, told = key_of(problem, noise, runs, options.seed), commands(problem.data)
    report = progress or (lambda *_: None)
    report("threshold", 0, runs)
    done = lambda ended: report("threshold", ended, runs)  # noqa: E731
    if nulls is None:
        seeds = [null_seed(options.seed, i) for i in range(runs)]
        made = yield from nulls_of(problem, noise, seeds, done)
    else:
        known = None if problem.guide is None else problem.guide.population
        made = _told(nulls(runs, known), done)
    found = Threshold.of(made)
    if cache is not None:
        kept = (cache.cached(KIND, key) or {"found": []})["found"]
        row = {"commands": told.tolist(), "scores": found.scores, "ratios": found.ratios}
        cache.cache(KIND, key, {"found": [*kept, row]})
    return found


def _told(nulls: Iterable[tuple[float, float]], done: Callable[[int], None]) -> list[tuple[float, float]]:
    made = []
    for one in nulls:
        made.append(one)
        done(len(made))
    return made


def found_before(
    problem: Problem, recording: Recording, options: DiagnosisOptions, cache: Cache | None
) -> Threshold | None:
    """The threshold that takes no simulation: the usual one, or a cached one; None where robots must be simulated."""
    runs = options.threshold_runs
    if runs == 0:
        return Threshold(USUAL, ())
    key = key_of(problem, own_noise(problem.model.robot, problem.train_part(recording)), runs, options.seed)
    told = commands(problem.data)
    for one in [] if cache is None else (cache.cached(KIND, key) or {"found": []})["found"]:
        if same(told, np.array(one["commands"])):
            return replace(Threshold.of([*zip(one["scores"], one["ratios"], strict=True)]), cached=True)
    return None


def known(limit: Threshold) -> Search[Threshold]:
    """A known threshold."""
    return limit
    yield  # makes this a search, one that asks for no rollouts


def level(scores: Sequence[float]) -> float:
    """The threshold [nats] for the best scores of robots without an effect; few of them only raise the usual one."""
    return max(USUAL if len(scores) < FEW else LEAST, exceeded(scores, ALARMS, CONFIDENCE))


def null_seed(seed: int, number: int) -> int:
    """The seed of robot number `number` of those without an effect."""
    return stream_seed(seed, "no effect", number) % 2**31


def nulls_of(
    problem: Problem,
    noise: Mapping[str, float],
    seeds: Sequence[int],
    done: Callable[[int], None] | None = None,
) -> Search[list[tuple[float, float]]]:
    """`null` of the robots with these seeds, several at a time in lockstep.

    noise : of the log's own sensors; see `own_noise`. done : is called with the number of finished robots.
    """
    robot, made = noisier(problem.model.robot, noise), []
    for begin in range(0, len(seeds), TOGETHER):
        some = seeds[begin : begin + TOGETHER]
        made += yield from together([null(problem, robot, seed) for seed in some])
        if done:
            done(len(made))
    return made


def null(problem: Problem, robot: Robot, seed: int) -> Search[tuple[float, float]]:
    """One simulated robot without an effect, under the problem's commands: the score [nats] of the best cause, which a
    threshold below it would name (`score.passing`), and what the calibrated simulator leaves over the stated noise.

    robot : with the sensor noise of its log.
    """
    model, plan = problem.model, problem.plan
    data = yield from null_data(problem, robot, seed)
    found = yield from calibrate(model, data, draws=plan.draws)
    left = yield from lefts(found.model, found.point, data)
    terms = unlike(model.robot, problem.terms, model.start.hypothesis.terms)
    if not terms:
        return 0.0, most_left(left)
    hints: list[Point] = []
    if problem.guide is not None:
        ranking = yield from problem.guide.ranking(model, data, terms)
        hints = problem.guide.hints(ranking, found.model, found.point, terms)
    naming, _ = yield from plan.name(found.model, found.point, terms, found.sample, hints)
    return naming.most, most_left(left)


def null_data(problem: Problem, robot: Robot, seed: int) -> Search[Data]:
    """The data of a simulated robot without an effect under the commands of the problem."""
    model, posed = problem.model, problem.data
    windows = posed.windows.take(posed.both)
    truth = null_robot(model, seed)
    measured = yield from measured_states(robot, truth, windows.run, engine=model.engine)
    measured = np.where(np.isnan(windows.measured), np.nan, measured)
    begun = starts(robot, windows.run.actions, measured, windows.run.rolling)
    initial = np.where(np.isnan(windows.run.initial), np.nan, begun)
    windows = replace(windows, measured=measured, run=replace(windows.run, initial=initial))
    fit = np.arange(len(windows)) < len(posed.fit)
    parts = Parts(fit, ~fit, np.zeros_like(fit))
    every = np.arange(len(windows))
    scaled = windows.scaled_by(model.robot, every)
    # whatever is still in it: it is scored by the channels that the log is scored by
    return replace(posed, windows=replace(scaled, weight=windows.weight), parts=parts)


def null_robot(model: Model, seed: int) -> Hidden:
    """A robot that the initial simulator explains: drawn from the search's prior, with the simulator's effects."""
    start, c = model.start, model.coordinates
    drawn = hide(model.robot, (), None, seed, centre=c.centre, tolerance=c.tolerance)
    values = c.effect_values(start.hypothesis, start.effect[None])
    return replace(drawn, terms=start.hypothesis.terms, values=tuple(row[0] for row in values))


def key_of(problem: Problem, noise: Mapping[str, float], runs: int, seed: int) -> dict[str, Any]:
    """All that the scores depend on besides the commands, as plain JSON: robot, settings, plan, and noise.

    Values that only the measurement changes are not in it: channels, measured inputs, their spread, and the starts.
    """
    model, data = problem.model, problem.data
    windows = data.windows.take(data.both)
    run = windows.run
    digest = hashlib.sha256()
    # which drives are switched off, and when
    told = None if run.inputs is None else run.inputs[..., len(model.robot.file.inputs) :]
    rows = np.isfinite(windows.measured).mean(axis=(0, 1)).round(1)  # that were measured, of every channel
    c = model.coordinates
    # the log's own rate of commands is measured, too
    centre = [v if np.isnan(k) else float(f"{k:.2g}") for v, k in zip(c.centre, c.known, strict=True)]
    for array in (told, run.settings, data.windows.weight, rows, centre):
        if array is not None:
            digest.update(np.ascontiguousarray(array, dtype=float).tobytes())
    says: dict[str, Any] = {
        "robot": model.robot.hash,
        "engine": model.running,
        "accuracy": asdict(model.accuracy),
        "plan": {"kind": type(problem.plan).__name__} | asdict(problem.plan),
        "terms": [_terms_say(t) for t in problem.terms],
        "runs": runs,
        "seed": seed,
        "parts": [len(data.fit), len(data.select)],
        "windows": [run.steps, float(f"{windows.period:.2g}")],
        "tolerance": c.tolerance,
        "free": c.free.tolist(),
        "joints": run.joints,
        "noise": dict(noise),
        "search": SEARCH,
        "versions": versions(),
        "arrays": digest.hexdigest(),
    }
    if problem.guide is not None:
        says["guide"] = len(problem.guide.population)
    if model.begun:
        effects = zip(model.begun.terms, model.begun.values, strict=True)
        says["begun"] = {term.key: values.tolist() for term, values in effects}
    return says


def commands(data: Data) -> np.ndarray:
    """(W, S, A) mean command of every action in each stretch of the windows to fit and to select by."""
    return stretched(data.windows.run.actions[data.both])


def stretched(actions: np.ndarray) -> np.ndarray:
    """(W, S, A) mean of commands (W, T, A) in each stretch of their windows."""
    stretches = np.array_split(actions, min(STRETCHES, actions.shape[1]), axis=1)
    return np.stack([part.mean(axis=1) for part in stretches], axis=1)


def same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two recordings have the same commands (W, S, A); a logger's clock may shift them by a row."""
    if one.shape != other.shape:
        return False
    spread = np.maximum(one.std(axis=(0, 1)), 1e-3 * np.abs(one).max(axis=(0, 1)))
    off = (one - other) / np.maximum(spread, 1e-9)
    apart = np.abs(off).mean(axis=1)
    near = (apart.mean(axis=1) <= ALIKE).all() and (apart <= ANY).all()
    return bool(near and (np.abs(off.mean(axis=1)) <= OFFSET).all())


def _terms_say(term: Term) -> list[Any]:
    """The key of a term and the sizes of its effect, which a plugin may change."""
    return [term.key, *([p.name, p.weak, p.medium, p.strong, p.most] for p in term.effect.parameters)]
