"""Query: from a recording to the simulator that predicts it best. Retrieve, replay and re-rank, synthesise."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import UsageError
from dynreg.neighbours.judge import alarm, channel_errors, traces
from dynreg.neighbours.population import Population
from dynreg.neighbours.retrieve import Retrieved, retrieve
from dynreg.neighbours.synthesise import (
    Evidence,
    effective_samples,
    empty_evidence,
    estimates,
    refine,
    replay_into,
)
from dynreg.registry import Registry
from dynreg.replay.cut import windows
from dynreg.replay.jitter import CANDIDATES, jitter
from dynreg.replay.judged import gain
from dynreg.replay.known import known_values
from dynreg.replay.parts import Parts, names, parts, seen
from dynreg.replay.timed import on_grid
from dynreg.replay.windows import Replayer, Windows, errors
from dynreg.results import Cost, Neighbour, Neighbours, Nominal, Stage, Synthesised
from dynreg.sim.config import SimConfig

REPLAYED = 0.6  # share of the budget that replays candidates; the rest synthesises
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Candidate:
    """One simulator that was replayed: where it came from and its unit parameters (P,)."""

    kind: str
    entry: int | None
    unit: np.ndarray


@dataclass(frozen=True)
class Settings:
    """What a query may be told; see `Session.query`. budget : replays, `usual_budget` where None."""

    k: int = 5
    distance: str = "auto"
    replay: bool = True
    synthesise: bool = True
    hold_out: str | None = None
    budget: int | None = None
    threads: int = 0


def query(
    registry: Registry,
    population: Population,
    recording: Recording,
    settings: Settings,
    *,
    name: str = "",
    progress: Progress | None = None,
) -> Neighbours:
    """The answer for one recording.

    The test part is replayed once, after everything is chosen, in the nominal, the k nearest, the best replayed
    and the synthesised simulator. Raises UsageError where k or the budget cannot be met, LogError where the
    recording cannot be replayed.
    """
    began = time.perf_counter()
    report = progress or (lambda *_: None)
    if settings.budget is None:
        settings = replace(settings, budget=usual_budget(len(population.shared.robot.space), settings.k))
    _check(settings, population)
    robot = population.shared.robot
    cut = windows(robot, recording)
    split = parts(recording, cut, settings.hold_out)
    cut = cut.scaled_by(robot, split.chosen)  # what is held out must not set the scale either
    replayer = Replayer(robot, cut, settings.threads)
    known = known_values(robot, recording)
    report("retrieve", 0, 1)

    def replayed(unit: np.ndarray) -> np.ndarray:
        values = np.where(np.isnan(known), robot.space.from_unit(unit), known)
        found = errors(replayer.residuals(values, split.chosen)).mean(axis=1)
        report("retrieve", replayer.rollouts, len(population))
        return found

    found = retrieve(
        registry,
        population,
        seen(on_grid(robot, recording), cut, split.chosen),
        distance=settings.distance,
        known=known,
        guess=settings.synthesise,
        at_least=settings.k,
        replayed=replayed,
        threads=settings.threads,
    )
    report("retrieve", 1, 1)
    if not settings.replay and not settings.synthesise:
        return _unjudged(
            population, recording, name, found, split, cut, settings, time.perf_counter() - began
        )
    search = _Search(population, found, known, split, replayer, settings, report)
    search.run()
    search.tell_noise(settings.threads)
    return _result(registry, population, recording, name, search, time.perf_counter() - began)


def usual_budget(parameters: int, k: int) -> int:
    """Simulators that a query replays to choose its answer: each parameter needs two to be told from the others."""
    return max(18 + 2 * parameters, k + 12)


class _Search:
    """Replay and synthesis of one query: fills the evidence and remembers where each candidate came from."""

    def __init__(
        self,
        population: Population,
        found: Retrieved,
        known: np.ndarray,
        split: Parts,
        replayer: Replayer,
        settings: Settings,
        report: Progress,
    ):
        self.population, self.found, self.split = population, found, split
        self.replayer, self.settings, self.report = replayer, settings, report
        space = population.shared.robot.space
        self.fixed = ~np.isnan(known)
        self.known = space.to_unit(np.where(self.fixed, known, space.nominal))
        self.evidence: Evidence = empty_evidence(space, ~self.fixed)
        self.candidates: list[Candidate] = []
        self.noisy = 0  # simulations that told the motor noise

    def run(self) -> None:
        """Nominal, guess and nearest first; then rounds of synthesis with what is left of the budget."""
        chosen = self.split.chosen
        replay = replay_into(self.evidence, self.replayer, chosen, self.split.fit[chosen])
        space = self.population.shared.robot.space
        first = [Candidate("nominal", None, self._with_known(space.to_unit(space.nominal)))]
        if self.settings.synthesise and self.found.guess is not None:
            first.append(Candidate("synthesised", None, self._with_known(self.found.guess)))
        for entry in self.found.order[: self._replayed(len(first))]:
            first.append(Candidate("neighbour", int(entry), self._with_known(self.population.unit[entry])))
        self.candidates = first
        self.report("replay", 0, self.settings.budget)
        replay(np.array([c.unit for c in first]))
        self.report("replay", len(first), self.settings.budget)
        self.first = len(first)
        left = self.settings.budget - len(first)
        if self.settings.synthesise and left > 0 and self.evidence.free.any() and len(first) > 3:
            refine(self.evidence, replay, left, self.population.shared.seed)
        self.candidates += [Candidate("synthesised", None, u) for u in self.evidence.unit[self.first :]]
        self.report("replay", self.settings.budget, self.settings.budget)

    def tell_noise(self, threads: int) -> None:
        """Give the best synthesised candidate the motor noise that the log tells: replays have none, and cannot."""
        made, space = self.best("synthesised"), self.population.shared.robot.space
        if made is None:
            return
        values = space.from_unit(self.evidence.unit[made])
        noisy = jitter(
            self.population.shared.robot,
            self.replayer.windows,
            values,
            None,
            self.split.chosen,
            threads=threads,
        )
        if noisy is values:
            return
        unit = self._with_known(space.to_unit(noisy))
        self.evidence.unit[made] = unit
        self.candidates[made] = replace(self.candidates[made], unit=unit)
        self.noisy = CANDIDATES

    def best(self, *kinds: str) -> int | None:
        """The candidate of these kinds with the lowest error on fit and select."""
        ids = [i for i, c in enumerate(self.candidates) if c.kind in kinds]
        return min(ids, key=lambda i: (self.evidence.score[i], i)) if ids else None

    def _replayed(self, taken: int) -> int:
        k = self.settings.k
        if not self.settings.replay:
            return k
        room = round(REPLAYED * self.settings.budget) if self.settings.synthesise else self.settings.budget
        return max(k, room - taken)

    def _with_known(self, unit: np.ndarray) -> np.ndarray:
        return np.where(self.fixed, self.known, unit)


def _result(
    registry: Registry,
    population: Population,
    recording: Recording,
    name: str,
    search: _Search,
    seconds: float,
) -> Neighbours:
    robot, evidence, split = population.shared.robot, search.evidence, search.split
    space = robot.space
    nominal, nearest = 0, [i for i, c in enumerate(search.candidates) if c.kind == "neighbour"]
    k_nearest = nearest[: search.settings.k]
    best = search.best("neighbour")
    made = search.best("synthesised")
    answer = search.best("nominal", "neighbour", "synthesised")
    test = _test_errors(
        search, sorted({nominal, *k_nearest, best, answer} | ({made} if made is not None else set()))
    )
    ids = {
        i: _simulator_id(registry, population, search.candidates[i], space)
        for i in {nominal, best, answer, made} - {None}
    }
    rank = sorted(nearest, key=lambda i: evidence.score[i]) if search.settings.replay else nearest
    stages = _stages(search, test, ids, nominal, k_nearest, best, made, answer)
    judged = np.flatnonzero(split.test) if split.test.any() else split.chosen
    pair = search.replayer.states(space.from_unit(evidence.unit[[nominal, answer]]), judged)
    misfit, alarmed, notes = alarm(search, answer)
    kind = search.candidates[answer].kind
    answer_values = space.from_unit(evidence.unit[answer])
    effective = effective_samples(evidence.residuals[answer])
    synthesised = None
    if made is not None:
        synthesised = Synthesised(
            simulator=ids[made],
            replay_error=float(evidence.score[made]),
            parameters=estimates(evidence, evidence.unit[made], effective),
        )
    return Neighbours(
        robot=robot.name,
        population=population.record.id,
        recording=recording.id,
        recording_name=name or recording.id[:12],
        distance=search.found.distance_name,
        k=search.settings.k,
        neighbours=tuple(
            _neighbour(population, search.found, search.candidates[i].entry, float(evidence.score[i]))
            for i in rank[: search.settings.k]
        ),
        synthesised=synthesised,
        answer=ids[answer],
        answer_kind=kind,
        answer_parameters=space.as_dict(answer_values),
        nominal=Nominal(replay_error=float(evidence.score[nominal]), parameters=space.as_dict(space.nominal)),
        stages=stages,
        gain=gain(test[nominal], test[answer]) if split.test.any() else None,
        parts={
            part: names(recording, search.replayer.windows, getattr(split, part))
            for part in ("fit", "select", "test")
        },
        channels=channel_errors(robot, search.replayer.windows, pair, judged),
        traces=traces(robot, recording, search.replayer.windows, pair, judged),
        fits=alarmed is None,
        misfit=misfit,
        alarm=alarmed,
        notes=notes + _bound_notes(synthesised),
        cost=Cost(
            evaluations=search.found.evaluations,
            rollouts=search.found.replays + len(evidence.unit) + search.noisy,
            test_rollouts=len(test),
            seconds=seconds,
        ),
    )


def _unjudged(
    population: Population,
    recording: Recording,
    name: str,
    found: Retrieved,
    split: Parts,
    cut: Windows,
    settings: Settings,
    seconds: float,
) -> Neighbours:
    """The k nearest alone: how well they predict is known only where replay ranked them."""
    space = population.shared.robot.space
    error = dict(zip(found.order.tolist(), found.distance.tolist(), strict=True)) if found.replays else {}
    near = [_neighbour(population, found, int(i), error.get(int(i))) for i in found.order[: settings.k]]
    return Neighbours(
        robot=population.shared.robot.name,
        population=population.record.id,
        recording=recording.id,
        recording_name=name or recording.id[:12],
        distance=found.distance_name,
        k=settings.k,
        neighbours=tuple(near),
        synthesised=None,
        answer=near[0].entry,
        answer_kind="neighbour",
        answer_parameters=near[0].parameters,
        nominal=Nominal(replay_error=None, parameters=space.as_dict(space.nominal)),
        stages=(),
        gain=None,
        parts={part: names(recording, cut, getattr(split, part)) for part in ("fit", "select", "test")},
        channels=(),
        traces=(),
        fits=True,
        misfit=None,
        alarm=None,
        notes=("nothing was held against the nominal simulator: whether the nearest one fits is not known",),
        cost=Cost(evaluations=found.evaluations, rollouts=found.replays, seconds=seconds),
    )


def _test_errors(search: _Search, ids: list[int]) -> dict[int, np.ndarray]:
    """{candidate: (W_test,) errors}: the only time that the test part is read."""
    chosen = np.flatnonzero(search.split.test)
    if not len(chosen):
        return {i: np.zeros(0) for i in ids}
    values = search.evidence.space.from_unit(search.evidence.unit[ids])
    found = errors(search.replayer.residuals(values, chosen))
    return dict(zip(ids, found, strict=True))


def _stages(
    search: _Search,
    test: dict[int, np.ndarray],
    ids: dict[int, str],
    nominal: int,
    nearest: list[int],
    best: int,
    made: int | None,
    answer: int,
) -> tuple[Stage, ...]:
    evidence = search.evidence
    has_select = bool(search.split.select.any())

    def stage(label: str, members: list[int], spent: int) -> Stage:
        tested = [test[i].mean() for i in members if test[i].size]
        return Stage(
            stage=label,
            simulator=ids.get(members[0]) if len(members) == 1 else None,
            fit=float(evidence.fit[members].mean()),
            select=float(evidence.select[members].mean()) if has_select else None,
            test=float(np.mean(tested)) if tested else None,
            simulations=spent,
        )

    first = search.first
    out = [stage("nominal", [nominal], 1), stage("nearest", nearest, len(nearest))]
    if search.settings.replay:
        out.append(stage("replayed", [best], first))
    if made is not None:
        out.append(stage("synthesised", [made], len(evidence.unit)))
    return (*out, stage("answer", [answer], len(evidence.unit)))


def _simulator_id(registry: Registry, population: Population, candidate: Candidate, space) -> str:
    if candidate.entry is not None:
        return population.entries.ids[candidate.entry]
    values = space.as_dict(space.from_unit(candidate.unit))
    lineage = {"population": population.record.id, "made_by": "query", "kind": candidate.kind}
    config = SimConfig(population.record.robot_hash, population.shared.robot.name, values)
    return registry.put_simulator(config.as_dict() | {"lineage": lineage})


def _neighbour(population: Population, found: Retrieved, entry: int, error: float | None) -> Neighbour:
    entries = population.entries
    at = int(np.flatnonzero(found.order == entry)[0])
    return Neighbour(
        entry=entries.ids[entry],
        name=f"{population.shared.robot.name}-{int(entries.numbers[entry])}",
        index=int(entries.numbers[entry]),
        distance=_finite(found.distance[at]),
        replay_error=error,
        parameters=population.shared.robot.space.as_dict(entries.values[entry]),
    )


def _finite(distance: float) -> float | None:
    return float(distance) if np.isfinite(distance) else None


def _bound_notes(synthesised: Synthesised | None) -> tuple[str, ...]:
    if synthesised is None:
        return ()
    at = [name for name, e in synthesised.parameters.items() if e.at_bound]
    if not at:
        return ()
    return (
        f"{', '.join(at)} {'lies' if len(at) == 1 else 'lie'} at the edge of the population's range: "
        "widen it, or look for a missing cause",
    )


def _check(settings: Settings, population: Population) -> None:
    if not 1 <= settings.k <= len(population):
        raise UsageError(
            f"k = {settings.k}",
            expected=f"1 to {len(population)}, the simulators of the population",
            do="ask for fewer neighbours, or populate more simulators",
        )
    if settings.budget < settings.k + 2:
        raise UsageError(
            f"a budget of {settings.budget} replays",
            expected=f"at least {settings.k + 2} for k = {settings.k}",
            do="raise --budget or lower -k",
        )
