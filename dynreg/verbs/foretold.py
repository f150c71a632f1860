"""What it will cost to populate, told from a few simulators that are made in a temporary folder."""

import shutil
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from dynreg.distance.linking import CANDIDATES
from dynreg.distance.population import Training
from dynreg.errors import NoMatchError
from dynreg.executor import Local
from dynreg.models.threads import available_threads
from dynreg.neighbours.entries import Stopwatch, make_shared, population_id
from dynreg.progress import Progress
from dynreg.registry import Registry
from dynreg.results.stored import Expected, PopulationSummary
from dynreg.sim.robot import Robot
from dynreg.verbs.linking import FITTED, linked_of
from dynreg.verbs.populations import Plan, begin, fill, link

MADE = 8, 32  # simulators: those that warm up, and all, of which the others are timed
SMALL = 8, 2  # configurations and epochs of the base model that is made for them
FOLDERS = ("shards", "index")
KEPT = 3  # times that the index is in memory while it grows: as it was, as it is, and as bytes


def foretell(
    registry: Registry, robot: Robot, plan: Plan, report: Progress, *, linked: bool = True
) -> PopulationSummary:
    """What it would take to do what is left of a population of `plan.n`; nothing of it is kept."""
    began = time.perf_counter()
    identity = population_id(robot, plan.seed, plan.training)
    try:
        held = registry.count(identity)
        known = linked_of(registry, identity)
    except NoMatchError:
        held, known = 0, 0
    planned = max(plan.n, held)
    with tempfile.TemporaryDirectory() as folder:
        told = _measured(Path(folder) / "registry", robot, plan, report)
    missing, blobs = max(planned - held, 0), registry.addresses.get("blobs")
    bucket = blobs and blobs.partition("?")[0]
    seconds = {step: missing * spent for step, spent in told.each.items()}
    # the embedding is fitted to the first entries, and others are linked anew until these are there
    new = planned - known if known >= FITTED else planned
    seconds["link"] = told.linking.of(new) if linked and (missing or known < planned) else 0.0
    seconds["base"] = told.base if missing and not held else 0.0
    expected = Expected(
        made=MADE[1],
        missing=missing,
        seconds=seconds,
        disk_bytes=round(missing * told.shards + planned * told.index * linked),
        free_bytes=None if bucket else shutil.disk_usage(registry.path).free,
        bucket=bucket,
        memory_bytes=round(told.memory(min(plan.shard_size, missing), planned * linked)),
        cores=plan.threads or available_threads(),
    )
    return PopulationSummary(
        population=identity,
        robot=robot.name,
        entries=held,
        planned=planned,
        added=0,
        seconds=time.perf_counter() - began,
        expected=expected,
    )


@dataclass(frozen=True, eq=False)
class _Told:
    """What a few simulators took.

    each : seconds of a simulator by step. linking : what links them. base : seconds of the base model. shards, index :
    bytes of a simulator.
    resident, growth : bytes of memory for all, and more for each simulator that is made at once.
    """

    each: Mapping[str, float]
    linking: "_Linking"
    base: float
    shards: float
    index: float
    resident: float
    growth: float

    def memory(self, at_once: int, entries: int) -> float:
        """The most memory [bytes], with so many made at once and so many in the index."""
        made = self.resident + self.growth * max(at_once - MADE[1], 0)
        return max(made, self.resident + KEPT * self.index * entries)


@dataclass(frozen=True)
class _Linking:
    """Seconds to link so many simulators: at any number, and of each."""

    once: float
    each: float

    def of(self, entries: int) -> float:
        return self.once + self.each * entries


def _measured(place: Path, robot: Robot, plan: Plan, report: Progress) -> _Told:
    configurations, epochs = SMALL
    small = replace(plan.training, base_configurations=configurations, base_epochs=epochs)
    (few, all_made), here = MADE, Local(plan.threads)
    with Registry.open(place, create=True) as scratch:
        trial = Plan(few, plan.seed, small, all_made, plan.threads)
        identity = begin(scratch, robot, trial, Stopwatch(), report)
        fill(scratch, identity, here, Stopwatch(), lambda there: None)
        link(scratch, identity, threads=plan.threads)  # the first time takes longer
        small_links, _ = _linked(scratch, identity, plan.threads)
        warm, watch = _peak(), Stopwatch()
        with watch.of("base"):
            make_shared(robot, plan.seed, small, plan.threads)
        begin(scratch, robot, replace(trial, n=all_made), watch, report)
        fill(scratch, identity, here, watch, lambda there: report("trial", there, all_made))
        resident = _peak()
        links, evaluations = _linked(scratch, identity, plan.threads)
        sizes = {name: _bytes(place / name) / all_made for name in FOLDERS}
    more = all_made - few
    each = {step: watch.seconds[step] / more for step in ("simulate", "train", "store")}
    base = _base(plan.training, watch.seconds["base"], each)
    apart = links["graph"] / evaluations * CANDIDATES
    linking = _linking(small_links["index"], links["index"], apart)
    growth = (resident - warm) / more
    return _Told(each, linking, base, sizes["shards"], sizes["index"], resident, growth)


def _linked(registry: Registry, identity: str, threads: int) -> tuple[Mapping[str, float], int]:
    """Seconds to link a population anew, of its "index" and of its "graph"; and the distances evaluated for that."""
    watch = Stopwatch()
    with watch.of("all"):
        _, evaluations = link(registry, identity, threads=threads, anew=True, watch=watch)
    return {
        "graph": watch.seconds["graph"],
        "index": watch.seconds["all"] - watch.seconds["graph"],
    }, evaluations


def _linking(of_few: float, of_all: float, apart: float) -> _Linking:
    """From seconds for the index of few and of all simulators, and seconds of one's distances to its candidates."""
    few, every = MADE
    each = min(max(of_all - of_few, 0.0) / (every - few), of_all / every)
    return _Linking(of_all - every * each, each + apart)


def _base(training: Training, spent: float, each: Mapping[str, float]) -> float:
    """Seconds of a population's own base model: its simulations cost what those of its entries cost."""
    configurations, epochs = SMALL
    trained = max(spent - configurations * each["simulate"], 0.0) / (configurations * epochs)
    rows = training.base_configurations
    return rows * each["simulate"] + trained * rows * training.base_epochs


def _bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.iterdir() if path.is_file())


def _peak() -> float:
    """The most memory that this process had [bytes]; 0 where the system does not tell it."""
    try:
        import resource
    except ImportError:
        return 0.0
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # bytes there, kilobytes elsewhere
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
