"""The simulators in which the search for a gait evaluates it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynreg.errors import NoMatchError, UsageError, command
from dynreg.gait.tasks import Task
from dynreg.gait.trials import Trials, simulators_of
from dynreg.neighbours.draws import drawn
from dynreg.neighbours.query import choose as replayed
from dynreg.progress import Progress
from dynreg.replay.known import command_rate, known_values
from dynreg.results.neighbours import Neighbours
from dynreg.rng import stream, stream_seed
from dynreg.sim.config import SimConfig
from dynreg.verbs.neighbours import judged
from dynreg.verbs.query import QuerySettings, query, retrieved
from dynreg.verbs.shaped import queried
from dynreg.verbs.simulator import NAMES, NOMINAL, POSTERIOR, QUERIED, Simulator
from dynreg.verbs.simulators import own, simulator
from dynreg.verbs.subjects import Recorded, population_for

EARLIER = "earlier"  # the kind of a simulator that an earlier log told


@dataclass(frozen=True)
class Chosen:
    """Registered simulators, the kind of each, and the id of the result that named them. on : the word asked for."""

    on: str
    kinds: tuple[str, ...]
    simulators: tuple[Simulator, ...]
    source: str | None = None


def choose(
    asked: Recorded, on: str, settings: QuerySettings, many: int, seed: int, progress: Progress | None
) -> Chosen:
    """The simulators that `on` names: `settings.k` of them, or the listed ones. many : of the posterior, at most.

    Words that refer to a query run it again with `settings`. Raises NoMatchError if no simulator is close enough or a
    name is unknown, UsageError if a simulator is of another robot or is named twice, or there are too few.
    """
    if on in _MADE:
        return _MADE[on](asked, settings, seed)
    if on == POSTERIOR:
        return _posterior(asked, settings, many, seed, progress)
    if on in QUERIED:
        found = _close_enough(asked, settings, progress)
        if on == "nearest":
            named = simulators_named(asked, [n.entry for n in found.neighbours])
            source = asked.registry.latest("neighbours", asked.recording.id).id
            return Chosen(on, ("neighbour",) * len(named), named, source)
    refs = [ref.strip() for ref in on.split(",")]
    named = tuple(
        one
        if one.id is not None
        else _nominal(asked, settings, seed).simulators[0]  # which nobody registered yet
        for one in simulators_named(asked, refs)
    )
    _require_different(on, [one.id for one in named])
    kinds = tuple(ref if ref in NAMES else _kind(one) for ref, one in zip(refs, named, strict=True))
    return Chosen(on, kinds, named, named[0].source)


def _require_different(on: str, ids: Sequence[str]) -> None:
    """UsageError where two of the listed simulators are one."""
    if twice := [one for i, one in enumerate(ids) if one in ids[:i]]:
        raise UsageError(
            f"on {on!r} names simulator {twice[0][:12]} twice",
            expected="each simulator once, for it would count twice",
            do="name it once",
            setting="on",
        )


def trials_in(
    asked: Recorded, task: Task, simulators: Sequence[Simulator], *, seed: int, threads: int
) -> Trials:
    """Trials of the gaits of a task in simulators, with what the recording tells of the robot and of its commands.

    Raises RobotError as `Trials` does.
    """
    robot, known = asked.robot, known_values(asked.robot, asked.recording)
    configs = simulators_of(robot, [one.config for one in simulators], known)
    return Trials(robot, task, configs, rate=command_rate(robot, known), seed=seed, threads=threads)


def with_earlier(asked: Recorded, chosen: Chosen, ids: Sequence[str], most: int | None = None) -> Chosen:
    """The chosen simulators, and those that were chosen by the same word before (their ids), each once.

    The kind of these is "earlier": what they were to another log, they are not to this one. most : of all, at most;
    where there are more, half are earlier ones, the first before others. A first log of many short trials tells more
    than one of a walk.
    """
    has = {one.id for one in chosen.simulators}
    earlier = [i for i in dict.fromkeys(ids) if i not in has]
    if most is not None and len(has) + len(earlier) > most:
        earlier = earlier[: max(most - len(has), most // 2)]
        chosen = replace(
            chosen,
            kinds=chosen.kinds[: most - len(earlier)],
            simulators=chosen.simulators[: most - len(earlier)],
        )
    more = simulators_named(asked, earlier)
    kinds = (*chosen.kinds, *[EARLIER] * len(more))
    return replace(chosen, kinds=kinds, simulators=(*chosen.simulators, *more))


def _kind(one: Simulator) -> str:
    """The kind of a simulator: "entry" of a population, or "simulator"."""
    return "entry" if one.lineage.get("kind") == "entry" else "simulator"


def simulators_named(asked: Recorded, refs: Sequence[str]) -> tuple[Simulator, ...]:
    """The simulators of these ids or words, of the recording's robot. Raises NoMatchError for one that is not there."""
    found = (simulator(asked.registry, ref, asked.robot, asked.recording.id) for ref in refs)
    return tuple(own(one, asked.robot) for one in found)


def _close_enough(asked: Recorded, settings: QuerySettings, progress: Progress | None) -> Neighbours:
    return _kept(asked, query(asked, settings, progress))


def _kept(asked: Recorded, found: Neighbours) -> Neighbours:
    """What a query found, kept; NoMatchError where no simulator is close enough."""
    asked.keep(found)
    if found.fits is False:
        raise NoMatchError(
            f"no simulator is close enough to {asked.name!r}: {found.alarm}",
            expected="a recording that the population can explain",
            do=f"find the missing effect with `{command('diagnose', asked.name)}`, then add --on diagnosed",
        )
    return found


def _posterior(
    asked: Recorded, settings: QuerySettings, many: int, seed: int, progress: Progress | None
) -> Chosen:
    """The query's answer, and draws that the recording cannot tell apart from it."""
    subject = retrieved(asked, settings, progress)
    found = replayed(subject.case, subject.found, subject.spending)
    answer = _kept(asked, judged(subject, found)).answer
    values = drawn(subject.case, found, many, stream_seed(seed, "gait simulators"))
    source = asked.registry.latest("neighbours", asked.recording.id).id
    made = _made(asked, values[1:], POSTERIOR, **queried(asked, "gait", subject.case.data.named))
    return Chosen(
        POSTERIOR, ("answer", *made.kinds), (*simulators_named(asked, [answer]), *made.simulators), source
    )


def _nominal(asked: Recorded, settings: QuerySettings, seed: int) -> Chosen:
    return _made(asked, asked.robot.space.nominal[None], NOMINAL)


def _population(asked: Recorded, settings: QuerySettings, seed: int) -> Chosen:
    """Configurations sampled from the parameters' ranges, like those of a population."""
    seed = stream_seed(seed, "gait simulators")
    return _made(asked, asked.robot.space.sample(0, settings.k, seed), "population")


def _random(asked: Recorded, settings: QuerySettings, seed: int) -> Chosen:
    """Registered simulators drawn at random: the baseline of the nearest ones."""
    identity, many = population_for(asked, settings.population)
    if settings.k > many:
        raise UsageError(
            f"k = {settings.k}",
            expected=f"1 to {many}, the simulators of the population",
            do="ask for fewer, or populate more simulators",
        )
    ids = asked.registry.load(identity, ()).ids
    drawn = stream(seed, "gait simulators").choice(len(ids), settings.k, replace=False)
    return Chosen("random", ("random",) * settings.k, simulators_named(asked, [ids[i] for i in drawn]))


_MADE: dict[str, Callable[[Recorded, QuerySettings, int], Chosen]] = {
    NOMINAL: _nominal,
    "population": _population,
    "random": _random,
}


def _made(asked: Recorded, values: np.ndarray, kind: str, **origin: Any) -> Chosen:
    """Simulators with parameters (k, P), registered. origin : what of recordings shaped them; see `shaped.queried`."""
    robot, lineage = asked.robot, {"made_by": "gait", "kind": kind} | origin
    configs = [SimConfig.of(robot, row) for row in values]
    ids = [asked.registry.put_simulator(c.as_dict() | {"lineage": lineage}) for c in configs]
    made = (Simulator(i, kind, lineage, c, robot) for i, c in zip(ids, configs, strict=True))
    return Chosen(kind, (kind,) * len(ids), tuple(made))
