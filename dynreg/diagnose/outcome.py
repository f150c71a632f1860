"""From points to the result: causes with intervals and gains, parameters, errors, traces, the simulators registered."""

import time
from typing import TYPE_CHECKING

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.estimate import estimates
from dynreg.diagnose.evidence import Evidence, rivals
from dynreg.diagnose.fit import information, sensitivities
from dynreg.diagnose.gained import channel_errors, gain, worst_of
from dynreg.diagnose.hypothesis import Hypothesis
from dynreg.diagnose.interval import Posterior, posterior
from dynreg.diagnose.loose import loose_ends
from dynreg.diagnose.noted import experiments, inputs, notes, threshold_note
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.rest import rest
from dynreg.diagnose.tied import tied
from dynreg.diagnose.where import finding, split_errors
from dynreg.registry import Registry
from dynreg.replay.judged import traced
from dynreg.replay.parts import Parts, names
from dynreg.results import Cost, Diagnosis
from dynreg.results.diagnosis import (
    Cause,
    DiagnosisTrace,
    Moved,
    Pulled,
    Ranked,
    Threshold,
    Verdict,
    Where,
)
from dynreg.results.sentence import diagnosis_sentence
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import Terms, one_group
from dynreg.sim.robot import Robot

if TYPE_CHECKING:
    from dynreg.diagnose.diagnose import Found
    from dynreg.diagnose.settings import Settings

MOVED = 0.5  # of its nameplate's sigma that a parameter must move to be told
PLACES = 12  # rows of where the error lives
CHANNELS = 4  # of the traces
NAMES = ("nominal", "calibrated", "extended")


def outcome(
    registry: Registry,
    problem: Problem,
    split: Parts,
    recording: Recording,
    settings: "Settings",
    found: "Found",
    evidence: Evidence,
    verdict: Verdict,
    name: str,
    began: float,
) -> Diagnosis:
    """The diagnosis; reads the test part (select, where nothing was held out) once."""
    robot = problem.robot
    judged = np.flatnonzero(split.test) if split.test.any() else np.flatnonzero(split.select)
    nominal = Point(Hypothesis(), np.zeros(len(problem.coordinates)), np.zeros(0))
    stages = _stages(found)
    states = problem.states([nominal, found.base, *stages], judged)
    errors = channel_errors(
        problem, states, judged, evidence.repeats, "test" if split.test.any() else "select"
    )
    draws = posterior(found.problem, found.extended, split.chosen, seed=settings.seed)
    kinds = (
        {"calibrated": found.base, "extended": found.extended}
        if found.accepted
        else {"calibrated": found.base}
    )
    made = {kind: problem.simulator(p, split.chosen, seed=settings.seed) for kind, p in kinds.items()}
    parameters = _parameters(problem, found.extended, draws, list(made.values())[-1][0])
    looked, pairs = tied(found.problem, found, draws, split.chosen, settings)
    causes = _causes(problem, found, stages, states, judged, draws, verdict, bool(split.test.any()))
    whole = gain(problem, states[1], states[-1], judged) if causes and split.test.any() else None
    ids = {kind: _register(registry, problem.robot, recording, kind, *own) for kind, own in made.items()}
    covariance = _covariance(found.problem, found.extended, split.chosen)
    worst = worst_of(problem, errors)
    simulated = np.stack([states[0], states[1], states[-1]])
    rows = split_errors(robot, problem.windows.take(judged), simulated)
    left, depends = rest(found.problem, found.extended, split.chosen, verdict, settings.seed) or (None, None)
    return Diagnosis(
        robot=robot.name,
        recording=recording.id,
        recording_name=name or recording.id[:12],
        start=settings.start,
        simulator=None,
        verdict=verdict,
        sentence=diagnosis_sentence(
            name or recording.id[:12],
            verdict,
            causes,
            error=worst,
            threshold_nats=found.threshold.nats,
            noise=evidence.noise,
            residual=depends,
            gain=whole,
            looked=looked,
            inseparable=pairs,
        ),
        causes=causes,
        gain=whole,
        ranking=_ranking(found),
        threshold_nats=found.threshold.nats,
        threshold=_threshold(found),
        parameters=parameters,
        moved=_moved(problem, found) if found.accepted else (),
        error=worst,
        errors=errors,
        where=_where(rows),
        finding=finding(rows, 1),
        looked=looked,
        inseparable=pairs,
        noise=evidence.noise,
        rest=left,
        residual=depends,
        experiments=experiments(found, verdict),
        parts=_parts(problem, recording, split),
        traces=_traces(problem, recording, simulated, judged),
        inputs=inputs(problem, recording),
        notes=(
            *notes(problem, recording, parameters, evidence, settings),
            *loose_ends(problem.coordinates, covariance),
        ),
        calibrated_simulator=ids["calibrated"],
        extended_simulator=ids.get("extended"),
        engine=robot.running(settings.engine),
        seed=settings.seed,
        cost=Cost(
            evaluations=0,
            rollouts=problem.spent.candidates,
            test_rollouts=len(states),
            seconds=time.perf_counter() - began,
        ),
    )


def _stages(found: "Found") -> list[Point]:
    """The point after each accepted cause; the last is the extended simulator, refitted on fit and select."""
    after = [naming.chosen.point for naming in found.rounds[: found.accepted]]
    return [*after[:-1], found.extended] if after else [found.extended]


def _covariance(problem: Problem, point: Point, chosen: np.ndarray) -> np.ndarray:
    """(P' + K, P' + K) covariance of the coordinates, from the curvature of the log posterior."""
    residual, slopes = sensitivities(problem, [point], chosen)
    effective = problem.effective(residual[0])
    curvature, _ = information(problem, point, residual[0], slopes[0], effective)
    return np.linalg.pinv(curvature + 1e-9 * np.eye(len(curvature)))


def _causes(
    problem: Problem,
    found: "Found",
    stages: list[Point],
    states: np.ndarray,
    judged: np.ndarray,
    draws: Posterior,
    verdict: Verdict,
    tested: bool,
) -> tuple[Cause, ...]:
    out = []
    for number, naming in enumerate(found.rounds[: found.accepted]):
        term = naming.chosen.point.hypothesis.terms[-1]
        others = [s.point.hypothesis.terms[-1] for s in naming.equivalent]
        same = tuple(t.key for t in others if one_group(problem.robot, term, t))
        apart = tuple(rivals(problem.robot, naming))
        this = (
            verdict
            if number == 0
            else ("partly_explained" if verdict == "partly_explained" else "ambiguous" if apart else "named")
        )
        out.append(
            Cause(
                effect=term.effect.id,
                joints=term.joints,
                title=term.effect.title,
                verdict=this,
                parameters=estimates(problem, found.extended, number, draws),
                evidence_nats=naming.chosen.nats,
                equivalent=apart + same,
                inseparable=same,
                separate_by=term.effect.separate_by,
                gain=gain(problem, states[1 + number], states[2 + number], judged) if tested else None,
            )
        )
    return tuple(out)


def _parameters(problem: Problem, point: Point, draws: Posterior, simulator: np.ndarray) -> dict[str, Pulled]:
    """Of the point; what no fit sees is as the simulator (P,) that comes of it has it."""
    c = problem.coordinates
    limits = c.nominal_bounds
    value = c.values(np.clip(point.nominal, *limits.T))
    low, high = draws.quantiles(c.values(draws.z[:, : len(point.nominal)]))
    out = {}
    for i, p in enumerate(problem.robot.space.parameters):
        free = np.flatnonzero(c.free == i)
        pull = float(point.nominal[free[0]]) if len(free) and np.isfinite(p.tolerance) else None
        at_bound = bool(len(free)) and bool(
            point.nominal[free[0]] <= limits[free[0], 0] + 1e-3
            or point.nominal[free[0]] >= limits[free[0], 1] - 1e-3
        )
        best, least, most = value[i], min(low[i], value[i]), max(high[i], value[i])
        if not len(free):
            best = least = most = simulator[i]
        out[p.name] = Pulled(
            value=float(best),
            low=float(least),
            high=float(most),
            unit=p.unit,
            nominal=float(p.nominal),
            at_bound=at_bound,
            limits=(p.low, p.high),
            pulled_sigma=pull,
        )
    return out


def _moved(problem: Problem, found: "Found") -> tuple[Moved, ...]:
    c = problem.coordinates
    before, after = c.values(found.base.nominal), c.values(found.extended.nominal)
    apart = np.abs(found.base.nominal - found.extended.nominal)
    moved = c.free[apart > MOVED]
    parameters = problem.robot.space.parameters
    return tuple(
        Moved(
            name=parameters[i].name, before=float(before[i]), after=float(after[i]), unit=parameters[i].unit
        )
        for i in moved
    )


def _ranking(found: "Found") -> tuple[Ranked, ...]:
    out = []
    for number, naming in enumerate(found.rounds, start=1):
        for scored in naming.ranking:
            term = scored.point.hypothesis.terms[-1]
            out.append(
                Ranked(effect=term.effect.id, joints=term.joints, score_nats=scored.nats, round=number)
            )
    return tuple(out)


def _threshold(found: "Found") -> Threshold:
    return Threshold(
        runs=len(found.threshold.scores), cached=found.threshold.cached, note=threshold_note(found)
    )


def _parts(problem: Problem, recording: Recording, split: Parts) -> dict[str, tuple[str, ...]]:
    each = {"fit": split.fit, "select": split.select, "test": split.test}
    return {part: names(recording, problem.windows, mask) for part, mask in each.items()}


def _where(rows) -> tuple[Where, ...]:
    chosen = sorted((r for r in rows if r.simulator == 1), key=lambda r: (r.regime != "overall", -r.share))[
        :PLACES
    ]
    return tuple(
        Where(
            channel=r.channel,
            regime=r.regime,
            share=r.share,
            simulator=NAMES[r.simulator],
            joint=r.joint,
            unit=r.unit,
            error=r.error,
            ratio=r.ratio,
        )
        for r in chosen
    )


def _traces(
    problem: Problem, recording: Recording, states: np.ndarray, judged: np.ndarray
) -> tuple[DiagnosisTrace, ...]:
    """Of states (3, W, T+1, S) the channels with the largest calibrated error in some windows, thinned."""
    each = traced(problem.robot, recording, problem.windows, states, judged, worst=1, channels=CHANNELS)
    return tuple(
        DiagnosisTrace(
            episode=one.episode,
            channel=one.channel,
            unit=one.unit,
            time=one.time,
            measured=one.measured,
            **dict(zip(NAMES, one.simulated, strict=True)),
        )
        for one in each
    )


def _register(
    registry: Registry | None,
    robot: Robot,
    recording: Recording,
    kind: str,
    values: np.ndarray,
    terms: Terms | None,
) -> str | None:
    if registry is None:
        return None
    effects = {}
    for term, row in zip(terms.terms, terms.values, strict=True) if terms else ():
        effects[term.key] = {p.name: float(v) for p, v in zip(term.effect.parameters, row[0], strict=True)}
    config = SimConfig(robot.hash, robot.name, robot.space.as_dict(values), effects).as_dict()
    return registry.put_simulator(
        config | {"lineage": {"made_by": "diagnose", "kind": kind, "recording": recording.id}}
    )
