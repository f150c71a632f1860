"""The document of a diagnosis: its numbers with their names and units, and what is said about them."""

from typing import Any

import numpy as np

from dynreg.diagnose.account import Account
from dynreg.diagnose.diagnose import Diagnosed
from dynreg.diagnose.doubts import replaced, stopped_by_bounds
from dynreg.diagnose.measured import measured_effects
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.verdict import group_of, not_told_apart, rivals
from dynreg.evidence.estimate import gaussian
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.replay.judged import Gain as Gained
from dynreg.replay.judged import traced
from dynreg.replay.parts import names
from dynreg.results.diagnosis import (
    Cause,
    Diagnosis,
    DiagnosisTrace,
    Doubt,
    EffectEstimate,
    Moved,
    Noise,
    Pulled,
    Ranked,
    Resemblance,
    ResidualShare,
    Rest,
    RolloutError,
    Threshold,
    Where,
)
from dynreg.results.result import Cost, Gain
from dynreg.results.sentence import diagnosis_sentence
from dynreg.verbs.diagnosis_words import experiments, finding, inputs, notes, threshold_note
from dynreg.verbs.looked import inseparable, looked
from dynreg.verbs.posteriors import posterior_told
from dynreg.verbs.subjects import Recorded, word_for

MOVED = 0.5  # a parameter is reported as moved from this many standard deviations of its nameplate on
PLACES = 12  # reported rows of `where`
LIKELY = 5  # reported causes that the recording looks like
CHANNELS = 4  # most channels of the traces
NAMES = ("nominal", "calibrated", "extended")
ASKED = (
    "effects",
    "without",
    "max_causes",
    "engine",
    "threshold_runs",
    "tolerance",
    "horizon",
    "joints",
    "windows",
)  # of `DiagnosisOptions`


def document(
    asked: Recorded,
    start: str,
    options: DiagnosisOptions,
    made: Diagnosed,
    seen: Account,
    ids: dict[str, str | None],
    cost: Cost,
) -> Diagnosis:
    """The diagnosis of a recording, which began with the simulator `start`.

    ids : of the simulators, by kind; "start" is None where it has none.
    """
    model, found, errors = made.problem.model, made.found, _errors(made)
    of_robot = parameters(model, found.current, seen)
    limit, spread = made.threshold, made.problem.data.spread
    judged = made.judged
    size = judged.errors[judged.CALIBRATED] / np.maximum(spread, 1e-12)
    worst = int(size[np.isfinite(size)].argmax())  # channel of the calibrated simulator
    told = Diagnosis(
        robot=model.robot.name,
        recording=asked.recording.id,
        recording_name=asked.name or asked.recording.id[:12],
        start=start,
        simulator=ids["start"],
        verdict=made.verdict,
        sentence="",
        causes=_causes(made, seen),
        gain=_gain(judged.of_all),
        rival="unpenalised" if judged.rival == judged.UNPENALISED else "calibrated",
        calibration=_gain(judged.gained(judged.START, judged.CALIBRATED)),
        over_start=_gain(judged.gained(judged.START, judged.last)),
        doubts=tuple(Doubt(**vars(one)) for one in made.doubts),
        ranking=_ranking(made),
        threshold_nats=limit.nats,
        threshold=Threshold(runs=len(limit.scores), cached=limit.cached, note=threshold_note(limit.scores)),
        parameters=of_robot,
        posterior=posterior_told(
            gaussian(model.coordinates, found.current, seen.draws, seen.unidentified.alone)
        ),
        moved=_moved(made) if found.accepted else (),
        error=errors[worst],
        errors=errors,
        where=_where(seen),
        finding=finding(seen.where),
        looked=looked(made, seen),
        inseparable=inseparable(made, seen, word_for(asked.registry, asked.robot)),
        noise=Noise(
            **vars(made.evidence.noise), usual=made.evidence.usual, explained=made.evidence.explained
        ),
        **_left(seen),
        experiments=experiments(made),
        parts=_parts(asked, made),
        traces=_traces(asked, made, seen),
        inputs=inputs(made.problem, asked.recording),
        notes=notes(made, seen, asked.recording, of_robot, options),
        resembles=_resembles(made),
        asked=options_told(options),
        calibrated_simulator=ids["calibrated"],
        extended_simulator=ids.get("extended"),
        engine=model.running,
        seed=options.seed,
        cost=cost,
    )
    return told.model_copy(update={"sentence": diagnosis_sentence(told)})


def options_told(options: DiagnosisOptions) -> dict[str, Any]:
    """The options that decide what is found, by name, as a stored document tells them.

    Which part was held out, the seed and the threads do not: they leave the question as it is.
    """
    told = {name: getattr(options, name) for name in ASKED}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in told.items()}


def _resembles(made: Diagnosed) -> Resemblance | None:
    if made.ranking is None:
        return None
    own = made.ranking
    return Resemblance(
        causes=own.keys[:LIKELY],
        resemblance=own.resemblance,
        outside=own.outside,
        entries=len(own.cosines),
    )


def _gain(own: Gained | None) -> Gain | None:
    return None if own is None else Gain(**vars(own))


def _causes(made: Diagnosed, seen: Account) -> tuple[Cause, ...]:
    robot, found, out = made.problem.model.robot, made.found, []
    held = tuple(measured_effects(robot, made.problem.data.train))
    for number, naming in enumerate(found.rounds[: found.accepted]):
        term = naming.chosen.point.hypothesis.terms[-1]
        tied = "ambiguous" if rivals(robot, naming) else "named"
        later = made.verdict if made.verdict == "partly_explained" else tied
        out.append(
            Cause(
                effect=term.effect.id,
                joints=term.joints,
                bodies=term.bodies,
                title=term.effect.title_at(term.at),
                verdict=later if number else made.verdict,
                parameters={name: EffectEstimate(**vars(e)) for name, e in seen.causes[number].items()},
                evidence_nats=naming.chosen.nats,
                replaced=replaced(naming),
                equivalent=tuple(not_told_apart(robot, naming, held)),
                inseparable=tuple(group_of(robot, term, held)),
                separate_by=term.effect.separate_by_at(term.at),
                gain=_gain(made.judged.of_cause(number)),
            )
        )
    return tuple(out)


def _errors(made: Diagnosed) -> tuple[RolloutError, ...]:
    """Errors of every scored channel that was measured in the judged part."""
    robot, judged = made.problem.model.robot, made.judged
    rows = dict(zip((*NAMES[:2], "unpenalised"), judged.errors, strict=False))
    rows["extended"] = judged.errors[judged.last]
    rows |= {"held": judged.held, "followed": judged.followed}
    return tuple(
        RolloutError(
            channel=robot.channels[column],
            unit=robot.file.channels[column].unit,
            **{name: float(errors[c]) if np.isfinite(errors[c]) else None for name, errors in rows.items()},
            repeatability=made.evidence.repeats[robot.channels[column]].spread,
            part="test" if judged.tested else "select",
        )
        for c, column in enumerate(made.problem.data.use)
        if np.isfinite(judged.errors[judged.CALIBRATED, c])
    )


def parameters(model: Model, point: Point, seen: Account) -> dict[str, Pulled]:
    """Parameters of the point; those that are not fitted are as in the resulting simulator, without interval."""
    c, draws, simulator = model.coordinates, seen.draws, list(seen.simulators.values())[-1][0]
    stopped = dict(zip(c.free.tolist(), stopped_by_bounds(c, point).tolist(), strict=True))
    value = c.values(np.clip(point.nominal, *c.nominal_bounds.T))
    low, high = draws.quantiles(c.values(draws.z[:, : len(point.nominal)]))
    pulls, out = c.pulls(point.nominal), {}
    for i, p in enumerate(model.robot.space.parameters):
        free = np.flatnonzero(c.free == i)
        pull = float(pulls[free[0]]) if len(free) and np.isfinite(p.tolerance) else None
        out[p.name] = Pulled(
            value=float(value[i] if len(free) else simulator[i]),
            low=float(min(low[i], value[i])) if len(free) else None,
            high=float(max(high[i], value[i])) if len(free) else None,
            unit=p.unit,
            nominal=float(p.nominal),
            at_bound=stopped.get(i, False),
            limits=(p.low, p.high),
            pulled_sigma=pull,
            share=_share(seen, free),
        )
    return out


def _share(seen: Account, free: np.ndarray) -> float | None:
    """What a parameter alone makes of the gain of calibration; None where that is no number."""
    share = np.nan if seen.shares is None or not len(free) else seen.shares[free[0]]
    return float(share) if np.isfinite(share) else None


def _moved(made: Diagnosed) -> tuple[Moved, ...]:
    """Parameters that took another value when the causes were added."""
    c, base, extended = made.problem.model.coordinates, made.found.base, made.found.current
    before, after = c.values(base.nominal), c.values(extended.nominal)
    moved = c.free[np.abs(base.nominal - extended.nominal) > MOVED]
    parameters = made.problem.model.robot.space.parameters
    return tuple(
        Moved(
            name=parameters[i].name, before=float(before[i]), after=float(after[i]), unit=parameters[i].unit
        )
        for i in moved
    )


def _ranking(made: Diagnosed) -> tuple[Ranked, ...]:
    out = []
    for number, naming in enumerate(made.found.rounds, start=1):
        for scored in naming.ranking:
            term = scored.point.hypothesis.terms[-1]
            out.append(
                Ranked(
                    effect=term.effect.id,
                    joints=term.joints,
                    bodies=term.bodies,
                    score_nats=scored.nats,
                    round=number,
                )
            )
    return tuple(out)


def _left(seen: Account) -> dict[str, tuple[Rest | ResidualShare, ...]]:
    """The residual of each joint, and the signals that predict it; nothing without a residual."""
    if seen.residuals is None:
        return {}
    told = [
        Rest(
            joint=one.joint,
            unit=one.unit,
            left=one.size,
            told=one.explained,
            chance=one.null,
            samples=one.samples,
            trajectories=one.trajectories,
        )
        for one in seen.residuals
    ]
    shares = [ResidualShare(**vars(row)) for one in seen.residuals for row in one.rows]
    return {"rest": tuple(told), "residual": tuple(shares)}


def _parts(asked: Recorded, made: Diagnosed) -> dict[str, tuple[str, ...]]:
    parts, windows = made.problem.data.parts, made.problem.data.windows
    each = {"fit": parts.fit, "select": parts.select, "test": parts.test}
    return {part: names(asked.recording, windows, mask) for part, mask in each.items()}


def _where(seen: Account) -> tuple[Where, ...]:
    """The regimes of the calibrated simulator's error, the largest shares first."""
    rows = sorted(seen.where, key=lambda r: (r.regime != "overall", -r.share))
    told = ("channel", "regime", "share", "joint", "unit", "error", "ratio")
    return tuple(Where(**{key: getattr(r, key) for key in told}) for r in rows[:PLACES])


def _traces(asked: Recorded, made: Diagnosed, seen: Account) -> tuple[DiagnosisTrace, ...]:
    """The channels with the largest calibrated error in some windows, thinned."""
    model, data = made.problem.model, made.problem.data
    each = traced(
        model.robot,
        asked.recording,
        data.windows,
        seen.states,
        made.judged.windows,
        worst=1,
        channels=CHANNELS,
    )
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
