"""The simulators in which a gait is sought."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.errors import NoMatchError, UsageError
from dynreg.results import Neighbours
from dynreg.rng import stream, stream_seed
from dynreg.sim.config import SimConfig
from dynreg.verbs.gait import GaitSettings, Progress
from dynreg.verbs.query import QuerySettings, query
from dynreg.verbs.simulators import NOMINAL, WORDS, own, simulator
from dynreg.verbs.subjects import Recorded, population_for


@dataclass(frozen=True)
class Chosen:
    """A registered simulator: its id, how it came to be chosen, its configuration, and the result that named it."""

    id: str
    kind: str
    config: SimConfig
    source: str | None = None


def choose(asked: Recorded, settings: GaitSettings, progress: Progress | None) -> tuple[Chosen, ...]:
    """The simulators that `settings.on` names.

    What a query tells is asked anew. Raises NoMatchError where no simulator is close enough or there is none of that
    name, UsageError where one is of another robot or there are too few.
    """
    on = settings.on
    if on in _MADE:
        return _MADE[on](asked, settings)
    if on in WORDS and WORDS[on].made_by == "query":
        found = _close_enough(asked, settings, progress)
        if on == "nearest":
            source = asked.registry.latest("neighbours", asked.recording.id).id
            return tuple(_named(asked, n.entry, "neighbour", source) for n in found.neighbours)
    return tuple(_named(asked, ref.strip()) for ref in on.split(","))


def _close_enough(asked: Recorded, settings: GaitSettings, progress: Progress | None) -> Neighbours:
    wanted = QuerySettings(k=settings.k, population=settings.population, threads=settings.threads)
    found = query(asked, wanted, progress)
    asked.registry.put_result("neighbours", asked.recording.id, found.to_dict())
    if not found.fits:
        raise NoMatchError(
            f"no simulator is close enough to {asked.name!r}: {found.alarm}",
            expected="a recording that the population can explain",
            do=f"find what the simulators lack with `dynreg diagnose {asked.name}`, then add --on diagnosed",
        )
    return found


def _named(asked: Recorded, ref: str, kind: str | None = None, source: str | None = None) -> Chosen:
    """A simulator by an id or a word; one of a population is an "entry"."""
    found = own(simulator(asked.registry, ref, asked.robot, asked.recording.id), asked.robot)
    kind = kind or (ref if ref in WORDS else "entry" if found.lineage.get("kind") == "entry" else "simulator")
    return Chosen(found.id, kind, found.config, source or found.source)


def _nominal(asked: Recorded, settings: GaitSettings) -> tuple[Chosen, ...]:
    return _made(asked, asked.robot.space.nominal[None], NOMINAL)


def _population(asked: Recorded, settings: GaitSettings) -> tuple[Chosen, ...]:
    """Configurations drawn from the parameters' ranges, as those of a population are."""
    seed = stream_seed(settings.seed, "gait simulators")
    return _made(asked, asked.robot.space.sample(0, settings.k, seed), "population")


def _random(asked: Recorded, settings: GaitSettings) -> tuple[Chosen, ...]:
    """Registered simulators, drawn at random: what the nearest must beat."""
    identity, many = population_for(asked.registry, asked.recording.id, settings.population)
    if settings.k > many:
        raise UsageError(
            f"k = {settings.k}",
            expected=f"1 to {many}, the simulators of the population",
            do="ask for fewer, or populate more simulators",
        )
    ids = asked.registry.load(identity, ()).ids
    rng = stream(settings.seed, "gait simulators")
    drawn = rng.choice(len(ids), settings.k, replace=False)
    return tuple(_named(asked, ids[i], "random") for i in drawn)


_MADE: dict[str, Callable[[Recorded, GaitSettings], tuple[Chosen, ...]]] = {
    NOMINAL: _nominal,
    "population": _population,
    "random": _random,
}


def _made(asked: Recorded, values: np.ndarray, kind: str) -> tuple[Chosen, ...]:
    """Simulators with parameters (k, P), registered."""
    robot, lineage = asked.robot, {"made_by": "gait", "kind": kind}
    configs = [SimConfig(robot.hash, robot.name, robot.space.as_dict(row)) for row in values]
    put = asked.registry.put_simulator
    return tuple(Chosen(put(c.as_dict() | {"lineage": lineage}), kind, c) for c in configs)
