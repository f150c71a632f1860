"""The answer of a query as a document, its simulators registered."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynreg.neighbours.judge import Judgement
from dynreg.neighbours.query import FEWEST, Case, Choice
from dynreg.neighbours.retrieve import Retrieved
from dynreg.neighbours.spending import Spending
from dynreg.replay.judged import gain, traced
from dynreg.results.neighbours import (
    ChannelError,
    MeasuredNeighbour,
    Neighbour,
    Neighbours,
    Nominal,
    Stage,
    Synthesised,
    Trace,
)
from dynreg.results.result import Cost, Estimate, Gain
from dynreg.sim.config import SimConfig
from dynreg.sim.space import none_below
from dynreg.verbs.held_out import held_out_notes
from dynreg.verbs.posteriors import posterior_told
from dynreg.verbs.shaped import queried
from dynreg.verbs.subjects import Recorded
from dynreg.verbs.unscored import unscored_notes

TRACES = 6  # channels shown in a report


@dataclass(frozen=True, eq=False)
class Subject:
    """What a query asks about, and the entries and recordings that it found near.

    began : its start by `time.perf_counter` [s].
    """

    asked: Recorded
    case: Case
    found: Retrieved
    measured: tuple[MeasuredNeighbour, ...]
    spending: Spending
    began: float

    def document(self, **judged: Any) -> Neighbours:
        """The document with the fields in `judged`."""
        case = self.case
        return Neighbours(
            robot=case.robot.name,
            population=case.population.id,
            recording=self.asked.recording.id,
            recording_name=self.asked.name,
            distance=self.found.distance_name,
            k=self.spending.k,
            measured=self.measured,
            parts=case.data.named,
            simulators=len(case.population),
            **judged,
        )

    def cost(self, rollouts: int, test_rollouts: int = 0) -> Cost:
        """The cost until now."""
        return Cost(
            evaluations=self.found.ranked.evaluations,
            rollouts=rollouts,
            test_rollouts=test_rollouts,
            seconds=time.perf_counter() - self.began,
        )

    def nominal(self, error: float | None) -> Nominal:
        """The robot folder's own values."""
        space = self.case.robot.space
        return Nominal(replay_error=error, parameters=space.as_dict(space.nominal))

    def neighbour(self, entry: int, error: float | None) -> Neighbour:
        """An entry by its row in the population; `error` is its replay error, None where it was not replayed."""
        entries, ranked, robot = self.case.population.entries, self.found.ranked, self.case.robot
        distance = float(ranked.distance[np.flatnonzero(ranked.order == entry)[0]])
        number = int(entries.numbers[entry])
        return Neighbour(
            entry=entries.ids[entry],
            name=f"{robot.name}-{number}",
            index=number,
            distance=distance if np.isfinite(distance) else None,
            replay_error=error,
            parameters=robot.space.as_dict(entries.values[entry]),
        )


def unjudged(subject: Subject) -> Neighbours:
    """The k nearest entries without a comparison; they have a replay error only where the distance is a replay."""
    ranked, k = subject.found.ranked, subject.spending.k
    errors = ranked.distance[:k].tolist() if ranked.replays else [None] * k
    near = [subject.neighbour(int(i), e) for i, e in zip(ranked.order[:k], errors, strict=True)]
    return subject.document(
        neighbours=tuple(near),
        synthesised=None,
        answer=near[0].entry,
        answer_kind="neighbour",
        answer_parameters=near[0].parameters,
        nominal=subject.nominal(None),
        stages=(),
        gain=None,
        channels=(),
        traces=(),
        fits=None,
        misfit=None,
        misfit_limit=None,
        alarm=None,
        notes=("the nearest simulator was not compared with the nominal one: its fit is not known",),
        cost=subject.cost(ranked.replays),
    )


def _gain(case: Case, chosen: Choice) -> Gain | None:
    """By how much the answer lowers the nominal simulator's error on the test part; None without one."""
    test = case.data.parts.test
    if not test.any():
        return None
    found = gain(chosen.tests[0], chosen.tests[chosen.answer], case.data.windows.episode[test])
    return found and Gain(**vars(found))


def judged(subject: Subject, chosen: Choice) -> Neighbours:
    """The answer that the replays chose, and its error on the held-out part."""
    case, replays, answer = subject.case, chosen.replays, chosen.answer
    score, space = replays.score, case.robot.space
    reported = {0, chosen.best, answer, chosen.made} - {None}
    simulators = {i: _simulator(subject, chosen, i) for i in reported}
    nearest = [i for i, c in enumerate(chosen.candidates) if c.kind == "neighbour"]
    ranks = sorted(nearest, key=lambda i: score[i]) if subject.spending.replay else nearest
    synthesised = None if chosen.made is None else _synthesised(case, chosen, simulators[chosen.made])
    alarm, notes = _alarm(chosen.judgement, len(case.population))
    return subject.document(
        neighbours=tuple(
            subject.neighbour(chosen.candidates[i].entry, float(score[i]))
            for i in ranks[: subject.spending.k]
        ),
        synthesised=synthesised,
        answer=simulators[answer],
        answer_kind=chosen.candidates[answer].kind,
        answer_parameters=space.as_dict(case.data.values_of(replays.unit[answer])),
        nominal=subject.nominal(float(score[0])),
        stages=_stages(subject, chosen, simulators),
        gain=_gain(case, chosen),
        channels=_channels(case, chosen),
        traces=_traces(case, chosen),
        fits=chosen.judgement.fits if chosen.judgement.ended else None,
        misfit=chosen.judgement.misfit,
        misfit_limit=chosen.judgement.misfit_limit,
        sharpened=chosen.judgement.sharpened,
        alarm=alarm,
        notes=(
            *notes,
            *bound_notes(synthesised.parameters if synthesised else {}),
            *held_out_notes(case.robot, case.data.windows, case.data.parts),
            *unscored_notes(case.robot, case.data.windows, case.data.parts),
        ),
        cost=subject.cost(chosen.rollouts, len(chosen.tests)),
    )


def _simulator(subject: Subject, chosen: Choice, number: int) -> str:
    """The id of a candidate: that of its entry, or else of the simulator that is registered here."""
    candidate, population = chosen.candidates[number], subject.case.population
    if candidate.entry is not None:
        return population.entries.ids[candidate.entry]
    lineage = {"population": population.id, "made_by": "query", "kind": candidate.kind}
    if number == chosen.made:
        lineage |= queried(subject.asked, "query", subject.case.data.named)
    config = SimConfig.of(subject.case.robot, subject.case.data.values_of(chosen.replays.unit[number]))
    return subject.asked.registry.put_simulator(config.as_dict() | {"lineage": lineage})


def _synthesised(case: Case, chosen: Choice, simulator: str) -> Synthesised:
    parameters = {}
    for p in case.robot.space.parameters:
        found = chosen.intervals[p.name]
        about = {"unit": p.unit, "nominal": p.nominal, "limits": (p.low, p.high)}
        parameters[p.name] = Estimate(**vars(found), **about)
    error = float(chosen.replays.score[chosen.made])
    return Synthesised(
        simulator=simulator,
        replay_error=error,
        parameters=parameters,
        posterior=posterior_told(chosen.posterior),
    )


def _stages(subject: Subject, chosen: Choice, simulators: dict[int, str]) -> tuple[Stage, ...]:
    replays, has_select = chosen.replays, bool(subject.case.data.parts.select.any())

    def stage(label: str, members: Sequence[int], spent: int) -> Stage:
        members = list(members)
        tested = [chosen.tests[i].mean() for i in members if chosen.tests[i].size]
        return Stage(
            stage=label,
            simulator=simulators.get(members[0]) if len(members) == 1 else None,
            fit=float(replays.fit[members].mean()),
            select=float(replays.select[members].mean()) if has_select else None,
            test=float(np.mean(tested)) if tested else None,
            simulations=spent,
        )

    out = [stage("nominal", [0], 1), stage("nearest", chosen.nearest, len(chosen.nearest))]
    if subject.spending.replay:
        out.append(stage("replayed", [chosen.best], chosen.begun))
    if chosen.made is not None:
        out.append(stage("synthesised", [chosen.made], chosen.spent))
    return (*out, stage("answer", [chosen.answer], chosen.spent))


def _channels(case: Case, chosen: Choice) -> tuple[ChannelError, ...]:
    """The errors of every measured channel: scored ones first, the largest (relative to the motion) of them on top."""
    spread, weight = case.data.windows.spread, case.data.windows.weight
    found = [
        ChannelError(
            channel=c.name,
            unit=c.unit,
            nominal=before,
            answer=after,
            spread=float(spread[s]),
            scored=bool(weight[s] > 0),
        )
        for s, (c, (before, after)) in enumerate(
            zip(case.robot.file.channels, chosen.channels.T.tolist(), strict=True)
        )
        if not np.isnan(chosen.channels[:, s]).all()
    ]
    return tuple(sorted(found, key=lambda c: (not c.scored, -c.answer / c.spread)))


def _traces(case: Case, chosen: Choice) -> tuple[Trace, ...]:
    """The curves of a report: the channels with the largest nominal error."""
    return tuple(
        Trace(
            episode=one.episode,
            channel=one.channel,
            unit=one.unit,
            time=one.time,
            measured=one.measured,
            nominal=one.simulated[0],
            answer=one.simulated[1],
        )
        for one in traced(
            case.robot,
            case.data.recording,
            case.data.windows,
            chosen.states,
            chosen.judged,
            worst=0,
            channels=TRACES,
        )
    )


def _alarm(judgement: Judgement, entries: int) -> tuple[str | None, tuple[str, ...]]:
    """The text of the alarm (None where the answer errs as those of the family's robots would), and the notes.

    entries : of the population that was asked.
    """
    usual = (
        "a simulator that is right would, with the noise of sensors, disturbed drives and finer time steps"
    )
    size, limit = f"the answer errs {judgement.misfit:.2g} times as much as {usual}", judgement.misfit_limit
    unsteady = ()
    ended = (
        ("the search had not ended, so the alarm is silent: raise --budget",) if not judgement.ended else ()
    )
    if judgement.unsteady > 1.0:
        runs = (
            f"{judgement.repeats} pair{'' if judgement.repeats == 1 else 's'} of runs with the same commands"
        )
        unsteady = (
            f"{runs} differ by more than those of such a simulator, so the usual error is taken "
            f"{judgement.unsteady:.2g} times as large",
        )
    if judgement.fits:
        return None, (size if limit is None else f"{size} (limit {limit:.2g})", *ended, *unsteady)
    why = (
        "The model lacks an effect, or its parameter ranges are too narrow"
        if judgement.sharpened
        else f"The population has {entries} simulators, too few to make another of them: populate more"
        if entries < FEWEST
        else "No search about it was made (--no-synthesise, or a small --budget): another simulator may fit"
    )
    alarm = f"{size}, above the limit of {limit:.2g}. {why}. The table of channels shows the largest errors"
    return alarm, unsteady


def bound_notes(parameters: Mapping[str, Estimate]) -> tuple[str, ...]:
    """What is said of parameters that a wider range would let go further."""
    at = [
        name
        for name, e in parameters.items()
        if e.at_bound and not (e.limits and none_below(e.value, *e.limits))
    ]
    if not at:
        return ()
    return (
        f"{', '.join(at)} {'is' if len(at) == 1 else 'are'} at the edge of the population's range: "
        "widen the range, or look for a missing effect",
    )
