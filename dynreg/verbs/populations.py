"""Populations of a registry: begun, filled, linked, and held ready for queries."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

import dynreg.verbs.linking as linking
from dynreg.data.recording import Channel
from dynreg.data.trajectories import Columns
from dynreg.distance.population import Entries, Population, Shared, Training
from dynreg.errors import CorruptError, DiffersError, NoMatchError
from dynreg.executor import Executor
from dynreg.index import Graph
from dynreg.neighbours.entries import (
    Made,
    Stopwatch,
    make_entries,
    make_shared,
    population_id,
    population_spec,
    shared_arrays,
    shared_from,
)
from dynreg.progress import Progress
from dynreg.registry import PopulationRecord, Registry, ShardData, persistent
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.accepted import accept
from dynreg.verbs.subjects import Recorded, population_for

_READY: WeakKeyDictionary[Registry, tuple[tuple[str, int], Population]] = WeakKeyDictionary()
WAIT = 0.1  # seconds between looks at what other processes have left


@dataclass(frozen=True)
class Plan:
    """The plan of a population: its least number of entries, seed, training and entries for each shard."""

    n: int
    seed: int
    training: Training
    shard_size: int
    threads: int


def begin(
    registry: Registry,
    robot: Robot,
    plan: Plan,
    watch: Stopwatch,
    report: Progress,
) -> str:
    """The id of a population, registered with what its entries share: as the registry holds it, else made."""
    identity = population_id(robot, plan.seed, plan.training)
    accept(registry, robot)
    registry.put_robot(robot.files, robot.hash, robot.name)
    known = _held(registry, identity)
    if known is None:
        report("base model", 0, 1)
        with watch.of("base"):
            shared = make_shared(robot, plan.seed, plan.training, plan.threads)
        report("base model", 1, 1)
        known = _first(registry, record_of(robot, plan, shared))
    if plan.n > known.size:
        registry.put_population(replace(known, size=plan.n))
    return identity


def _first(registry: Registry, record: PopulationRecord) -> PopulationRecord:
    """The population as it was registered first: another processor may make other last bits."""
    try:
        registry.put_population(record)
    except DiffersError:
        known = _held(registry, record.id)
        if known is None:
            raise
        return known
    return record


def record_of(robot: Robot, plan: Plan, shared: Shared) -> PopulationRecord:
    """A new population, with what its entries share."""
    columns = columns_of(robot)
    return PopulationRecord(
        id=population_id(robot, plan.seed, plan.training),
        robot_hash=robot.hash,
        name=robot.name,
        channels=columns.states,
        parameters=robot.space.names,
        size=plan.n,
        seed=plan.seed,
        spec=population_spec(robot, plan.seed, plan.training),
        arrays=shared_arrays(shared),
        shard_size=plan.shard_size,
        actions=columns.actions,
        inputs=columns.inputs,
        settings=columns.settings,
        parameter_units=tuple(p.unit for p in robot.space.parameters),
    )


def columns_of(robot: Robot) -> Columns:
    """The columns of a robot's rows."""
    units = {t.name: t.unit for t in robot.file.inputs}
    return Columns(
        states=tuple(Channel(c.name, c.unit) for c in robot.file.channels),
        actions=tuple(Channel(a.name, a.unit) for a in robot.file.actions),
        inputs=tuple(Channel(name, units.get(name, "1")) for name in robot.inputs),
        settings=tuple(Channel(s.name, s.unit) for s in robot.file.settings),
    )


def _held(registry: Registry, identity: str) -> PopulationRecord | None:
    """The population as the registry holds it; None where it is new or its file is lost, so that it is put again."""
    try:
        return registry.population(identity)
    except (NoMatchError, CorruptError):
        return None


def fill(
    registry: Registry,
    identity: str,
    executor: Executor,
    watch: Stopwatch,
    report: Callable[[int], None],
    made_by: Callable[..., tuple[int, dict[str, float]]] | None = None,
    *,
    stop: int | None = None,
) -> int:
    """Have the missing ones of the first `stop` entries (by default of all) made and stored, a shard a job: how many.

    Other processes are waited for; a claim of one ends with it. report : called with how many entries are there.
    made_by : makes a shard, as `fill_span`, the usual one, does.
    """
    told = {"registry": str(registry.path.resolve()), "population": identity, "threads": executor.threads}
    total = 0
    while spans := [s for s in registry.missing_spans(identity) if stop is None or s[0] < stop]:
        added = 0
        for made, seconds in executor.map(made_by or fill_span, [told | {"span": span} for span in spans]):
            added += made
            watch.seconds.update(seconds)
            if made:
                report(registry.count(identity))
        if not added:
            time.sleep(WAIT)
            report(registry.count(identity))
        total += added
    return total


def fill_span(
    registry: str, population: str, span: tuple[int, int], threads: int
) -> tuple[int, dict[str, float]]:
    """Make and store the entries of a missing span, unless another process does: how many, and the seconds by part.

    registry : its path. A server that is away is waited for. The bytes of entries depend on the population and their
    numbers alone, and they are entered at once, so that a job whose process was lost, or that is done twice, leaves
    what one that ends well leaves.
    """
    watch = Stopwatch()
    with persistent(Registry.open)(registry) as held, held.claim(population, span[0]) as mine:
        if not mine:
            return 0, {}
        shared = shared_of(held, held.population(population))
        data = shard(make_entries(shared, np.arange(*span), threads, watch))
        with watch.of("store"):
            added = len(held.put_shard(population, span[0], data))
    return added, dict(watch.seconds)


def shard(made: Made) -> ShardData:
    """Entries as the registry stores them."""
    extra, weights = {"fallen": made.fallen, "diverged": made.diverged}, made.stack.as_arrays()
    losses = made.own_loss, made.train_loss
    return ShardData(made.values, made.states, weights, *losses, extra, made.periods)


def link(
    registry: Registry,
    population: str,
    *,
    threads: int = 0,
    anew: bool = False,
    watch: Stopwatch | None = None,
) -> tuple[int, int]:
    """Link the entries that are not linked yet, or all of them `anew`; see `linking.link`."""
    shared = shared_of(registry, registry.population(population))
    return linking.link(registry, population, shared, threads=threads, anew=anew, watch=watch)


def ready(asked: Recorded, ref: str | None, *, states: bool = False, judged: bool = False) -> Population:
    """The population to ask about a recording: `ref`, or the only one of its robot; the last stays loaded.

    Raises as `population_for`.
    """
    registry, key = asked.registry, population_for(asked, ref)
    held_key, held = _READY.get(registry, (None, None))
    lacks = held is None or (states and held.entries.states is None) or (judged and held.judged is None)
    if held_key != key or lacks:
        held = load_population(registry, key[0], states=states, judged=judged)
    elif held.graph is None:  # it may have been linked since it was loaded
        held = replace(held, graph=load_graph(registry, key[0], held.entries.ids))
    _READY[registry] = (key, held)
    return held


def load_population(
    registry: Registry, ref: str, *, states: bool = False, judged: bool = False
) -> Population:
    """A population held ready for queries; what its index lacks is computed, models are read when they are asked for.

    states : whether what all entries did is read. judged : whether the rows are that judge them by cross-loss.
    """
    from threadpoolctl import threadpool_limits

    record = registry.population(ref)
    shared = shared_of(registry, record)
    numbers = registry.numbers(ref)
    ids = tuple(numbers)  # an index of entries that others add meanwhile is none of these
    arrays = registry.index(ref, "embedding", ids)
    if arrays is not None and "digests" in arrays:
        embedded = linking.Embedded.from_arrays(arrays)
        stack = linking.StoredModels(registry.models(ref, numbers.values(), embedded.digests))
    else:
        stack = linking.StoredModels(registry.models(ref, numbers.values()))
        with threadpool_limits(1):  # the same bytes as those that linking keeps
            embedded = linking.embed(registry, ref, ids, shared, stack)
    rows = registry.index(ref, "judged", ids) if judged else None
    if judged:
        rows = (
            linking.judge(registry, ref, ids, shared, stack)
            if rows is None
            else linking.judged_from(rows, stack)
        )
    did = _states(registry, ref, ids) if states else None
    places = np.array(list(numbers.values()), dtype=np.int64)
    entries = Entries(ids, places, embedded.values, did, embedded.train_loss)
    vectors = np.asarray(embedded.vectors, dtype=float)
    graph = load_graph(registry, ref, ids)
    return Population(record.id, shared, entries, stack, embedded.embedding, vectors, graph, rows)


def _states(registry: Registry, ref: str, ids: Sequence[str]) -> np.ndarray:
    """(M, E, T+1, S) what the entries `ids` did; others may have come meanwhile."""
    told = registry.load(ref, ("states",))
    if told.ids == tuple(ids):
        return told.states
    place = {identity: row for row, identity in enumerate(told.ids)}
    return told.states[[place[identity] for identity in ids]]


def load_graph(registry: Registry, ref: str, entries: Sequence[str] | None = None) -> Graph | None:
    """The graph over a population's entries (those it holds now); None where it was not linked with these."""
    arrays = registry.index(ref, "graph", entries)
    return None if arrays is None else Graph.from_arrays(arrays)


def shared_of(registry: Registry, record: PopulationRecord) -> Shared:
    """What a population's entries share, its robot from the registry's own copy, with the population's ranges."""
    robot = load_robot(registry.robot_folder(record.robot_hash))
    try:
        ranges = {name: (low, high) for name, (low, high, _) in record.spec["ranges"].items()}
        robot = replace(robot, space=robot.space.with_ranges(ranges))
    except (KeyError, TypeError, ValueError) as error:
        raise _lacking(record, error) from error
    return _shared(robot, record)


def _shared(robot: Robot, record: PopulationRecord) -> Shared:
    try:
        return shared_from(robot, record.spec, record.arrays)
    except (AttributeError, KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
        raise _lacking(record, error) from error


def _lacking(record: PopulationRecord, error: Exception) -> CorruptError:
    return CorruptError(
        f"population {record.id[:12]} does not hold what its models need: {error}",
        expected="the ranges, the commands and the training of a population",
        do="run `dynreg verify` on the registry",
    )
