"""From points to the result: causes with intervals and gains, parameters, errors, traces, the simulators registered."""

import time
from typing import TYPE_CHECKING

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.estimate import estimates
from dynreg.diagnose.evidence import Evidence, rivals
from dynreg.diagnose.fit import information, sensitivities
from dynreg.diagnose.hypothesis import Hypothesis
from dynreg.diagnose.interval import Posterior, posterior
from dynreg.diagnose.loose import loose_ends
from dynreg.diagnose.name import Naming
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.rest import rest
from dynreg.diagnose.shown import shown
from dynreg.diagnose.tied import tied
from dynreg.diagnose.where import finding, split_errors
from dynreg.registry import Registry
from dynreg.replay.holes import holes, sentence
from dynreg.replay.parts import Parts, names
from dynreg.results import Cost, Diagnosis, Gain
from dynreg.results.diagnosis import (
    Cause,
    DiagnosisTrace,
    Moved,
    Pulled,
    Ranked,
    RolloutError,
    Threshold,
    Verdict,
    Where,
)
from dynreg.results.sentence import diagnosis_sentence
from dynreg.rng import stream
from dynreg.sim.config import SimConfig

if TYPE_CHECKING:
    from dynreg.diagnose.diagnose import Found
    from dynreg.diagnose.settings import Settings

MOVED = 0.5  # of its nameplate's sigma that a parameter must move to be told
PLACES = 12  # rows of where the error lives
WINDOWS, CHANNELS, POINTS = 3, 4, 300  # of the traces
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
    errors = _errors(problem, states, judged, evidence, "test" if split.test.any() else "select")
    draws = posterior(problem, found.extended, split.chosen)
    parameters = _parameters(problem, found.extended, draws)
    looked, pairs = tied(problem, found, split.chosen, settings)
    causes = _causes(problem, found, stages, states, judged, draws, verdict, bool(split.test.any()))
    whole = _gain(problem, states[1], states[-1], judged) if causes and split.test.any() else None
    kinds = {"calibrated": found.base, "extended": found.extended}
    ids = [_register(registry, problem, point, recording, kind) for kind, point in kinds.items()]
    covariance = _covariance(problem, found.extended, split.chosen)
    worst = max(errors, key=lambda e: (e.calibrated or 0.0) / max(_spread(problem, e.channel), 1e-12))
    shown = np.stack([states[0], states[1], states[-1]])
    rows = split_errors(robot, problem.windows.take(judged), shown)
    left, depends = rest(problem, found.extended, split.chosen, verdict, settings.seed) or (None, None)
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
        experiments=_experiments(found, verdict),
        parts=_parts(problem, recording, split),
        traces=_traces(problem, recording, shown, judged),
        inputs=_inputs(problem, recording),
        notes=(
            *_notes(problem, recording, parameters, evidence, settings),
            *loose_ends(problem.coordinates, covariance),
        ),
        calibrated_simulator=ids[0],
        extended_simulator=ids[1] if found.accepted else None,
        engine=settings.engine or robot.file.robot.engines[0],
        seed=settings.seed,
        cost=Cost(
            evaluations=0,
            rollouts=problem.candidates,
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
        same = tuple(t.key for t in others if term.effect.group and t.effect.group == term.effect.group)
        apart = tuple(rivals(naming))
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
                gain=_gain(problem, states[1 + number], states[2 + number], judged) if tested else None,
            )
        )
    return tuple(out)


def _gain(problem: Problem, before: np.ndarray, after: np.ndarray, judged: np.ndarray) -> Gain | None:
    """Share of the error (mean absolute, in units of the spread) that the cause takes off, with a 90 % interval."""
    errors = [_window_errors(problem, s, judged) for s in (before, after)]
    if not errors[0].mean() > 0:
        return None
    value = float(1.0 - errors[1].mean() / errors[0].mean())
    if len(judged) < 3:
        return Gain(value=value, low=None, high=None)
    draws = stream(0, "bootstrap").integers(0, len(judged), (2000, len(judged)))
    gains = 1.0 - errors[1][draws].mean(axis=1) / errors[0][draws].mean(axis=1)
    low, high = np.quantile(gains, [0.05, 0.95])
    return Gain(value=value, low=float(low), high=float(high))


def _window_errors(problem: Problem, states: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """(W,) weighted mean absolute error of states (W, T+1, S), in units of the channels' spread."""
    use = problem.use
    miss = (
        np.abs(states[:, 1:, use] - problem.windows.measured[judged][:, 1:, use])
        / problem.windows.spread[use]
    )
    miss = np.where(
        np.isfinite(problem.windows.measured[judged][:, 1:, use]) & ~np.isfinite(miss), 10.0, miss
    )
    each = np.nanmean(np.minimum(miss, 10.0), axis=1)
    return np.nansum(each * problem.windows.weight[use], axis=1)


def _errors(
    problem: Problem, states: np.ndarray, judged: np.ndarray, evidence: Evidence, part: str
) -> tuple[RolloutError, ...]:
    robot, out = problem.robot, []
    for column in problem.use:
        miss = np.abs(states[:, :, 1:, column] - problem.windows.measured[judged][:, 1:, column])
        mae = [float(np.nanmean(np.where(np.isfinite(m), m, np.nan))) for m in (miss[0], miss[1], miss[-1])]
        known = evidence.repeats[robot.channels[column]]
        out.append(
            RolloutError(
                channel=robot.channels[column],
                unit=robot.file.channels[column].unit,
                nominal=mae[0],
                calibrated=mae[1],
                extended=mae[2],
                repeatability=known.spread,
                part=part,
            )
        )
    return tuple(out)


def _spread(problem: Problem, channel: str) -> float:
    return float(problem.windows.spread[problem.robot.channels.index(channel)])


def _parameters(problem: Problem, point: Point, draws: Posterior) -> dict[str, Pulled]:
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
        out[p.name] = Pulled(
            value=float(value[i]),
            low=float(min(low[i], value[i])),
            high=float(max(high[i], value[i])),
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
        runs=len(found.threshold.scores), cached=found.threshold.cached, note=_threshold_note(found)
    )


def _parts(problem: Problem, recording: Recording, split: Parts) -> dict[str, tuple[str, ...]]:
    each = {"fit": split.fit, "select": split.select, "test": split.test}
    return {part: names(recording, problem.windows, mask) for part, mask in each.items()}


def _threshold_note(found: "Found") -> str:
    scores = found.threshold.scores
    if not scores:
        return "a default: this robot was not simulated without effects"
    return f"robots without an effect reached at most {max(scores):.3g} nats under these commands"


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


def _experiments(found: "Found", verdict: Verdict) -> tuple[str, ...]:
    """What to record next: what separates the first cause from its rivals, or repeats and more excitation."""
    if verdict in ("ambiguous", "partly_explained") and found.accepted:
        naming: Naming = found.rounds[0]
        term = naming.chosen.point.hypothesis.terms[-1]
        apart = rivals(naming)
        out = [f"To tell {term.key} from {', '.join(apart)}: {term.effect.separate_by}"] if apart else []
        return tuple(out)
    if verdict == "unknown":
        return (
            "Repeat the same commands: what differs from run to run cannot be explained by any simulator",
        )
    return ()


def _inputs(problem: Problem, recording: Recording) -> tuple[str, ...]:
    out = []
    for table in problem.robot.file.inputs:
        if table.name in recording.names:
            out.append(
                f"{table.name} was measured and drives the simulators; where the motion itself changes it, "
                "it is partly a consequence"
            )
        elif table.optional:
            out.append(f"{table.name} was not measured: {table.nominal:g} {table.unit} is assumed")
    for name, by in shown(problem.robot, problem.windows).items():
        out.append(f"{name} is no candidate: what was measured as {by} already holds it")
    return tuple(out)


def _notes(
    problem: Problem,
    recording: Recording,
    parameters: dict[str, Pulled],
    evidence: Evidence,
    settings: "Settings",
) -> tuple[str, ...]:
    out = []
    lost = holes(problem.robot, recording)
    if lost:
        out.append(f"{sentence(recording, lost)}: rollouts with such rows are left out")
    if settings.joints:
        out.append(
            f"{', '.join(settings.joints)} alone: parameters that cannot be seen there stay where the search began"
        )
    if evidence.noise.basis == "stated_noise":
        out.append(
            "no run was repeated: what is left is held against the stated sensor noise, which is less than it can be"
        )
    at_bound = [name for name, p in parameters.items() if p.at_bound]
    if at_bound:
        out.append(
            f"{', '.join(at_bound)} at the edge of the allowed range: widen it in robot.toml, or look on"
        )
    return tuple(out)


def _traces(
    problem: Problem, recording: Recording, states: np.ndarray, judged: np.ndarray
) -> tuple[DiagnosisTrace, ...]:
    """The channels with the largest calibrated error in some windows, thinned."""
    windows, robot = problem.windows, problem.robot
    size = [
        np.nanmean(np.abs(states[1][:, 1:, c] - windows.measured[judged][:, 1:, c])) / windows.spread[c]
        for c in problem.use
    ]
    shown = problem.use[np.argsort(size)[::-1][:CHANNELS]]
    out = []
    for w in np.unique(np.linspace(0, len(judged) - 1, min(WINDOWS, len(judged))).round().astype(int)):
        measured = windows.measured[judged[w]]
        rows = np.flatnonzero(np.isfinite(measured).any(axis=1))
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(POINTS, len(rows))).round().astype(int))]
        for c in shown:
            series = [[_number(v) for v in x] for x in (measured[rows, c], *(s[w, rows, c] for s in states))]
            out.append(
                DiagnosisTrace(
                    episode=recording.episodes[windows.episode[judged[w]]].name,
                    channel=robot.channels[c],
                    unit=robot.file.channels[c].unit,
                    time=[round(float(t * windows.period), 6) for t in rows],
                    measured=series[0],
                    nominal=series[1],
                    calibrated=series[2],
                    extended=series[3],
                )
            )
    return tuple(out)


def _register(
    registry: Registry | None, problem: Problem, point: Point, recording: Recording, kind: str
) -> str | None:
    if registry is None:
        return None
    robot = problem.robot
    values = robot.space.as_dict(problem.coordinates.values(point.nominal))
    effects = {}
    for term, row in zip(
        point.hypothesis.terms,
        problem.coordinates.effect_values(point.hypothesis, point.effect[None]),
        strict=True,
    ):
        effects[term.key] = {p.name: float(v) for p, v in zip(term.effect.parameters, row[0], strict=True)}
    config = SimConfig(robot.hash, robot.name, values, effects).as_dict()
    return registry.put_simulator(
        config | {"lineage": {"made_by": "diagnose", "kind": kind, "recording": recording.id}}
    )


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if np.isfinite(value) else None
