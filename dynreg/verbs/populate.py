"""Populate: simulate, train, register and link the entries of a population, shard by shard."""

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynreg.errors import UsageError
from dynreg.limits import limits, variable
from dynreg.progress import Progress
from dynreg.verbs.arguments import require
from dynreg.verbs.settings import Settings, address, executor, option, seed, threads

if TYPE_CHECKING:
    from dynreg.distance.population import Training
    from dynreg.registry import Registry
    from dynreg.results.stored import PopulationSummary
    from dynreg.sim.robot import Robot


@dataclass(frozen=True)
class PopulateSettings(Settings):
    """The settings of `populate`."""

    seed: int = seed()
    ranges: str | None = option(None, "Named parameter ranges of robot.toml.")
    shard_size: int = option(200, "Simulators that are stored together.", flag=None, least=1)
    link: bool = option(True, "Also link the new simulators in the search graph.")
    relink: bool = option(False, "Build the search graph anew.", flag="--relink")
    dry_run: bool = option(
        False, "Tell disk, time and memory by a few simulators, and keep nothing.", flag="--dry-run"
    )
    effects: bool = option(
        False, "Give each simulator one effect, or none, under the commands of a recording."
    )
    like: str | None = option(None, "With --effects: the recording.", metavar="RECORDING")
    threads: int = threads()
    executor: str = executor(" On other machines these need a shared registry.")
    address: str | None = address()


def populate(
    registry: "Registry",
    robot: "Robot",
    n: int,
    settings: PopulateSettings,
    *,
    training: "Training | None" = None,
    progress: Progress | None = None,
) -> "PopulationSummary":
    """Extend a population to n entries, and build its search graph. Existing entries are not changed.

    Entry i has the parameters of row i of the Sobol sequence over the robot's ranges. It is simulated with the commands
    of the shared bank and with its own motor noise; its model is warm-started from the base model. Its bytes depend
    only on the robot, the seed and i. An interrupted populate resumes; with fewer entries it makes these, in whole
    shards. Several processes share the work, and each returns when all entries are done: those of an executor take a
    shard each.

    With `effects` the entries carry one effect each, or none, under the commands of the recording `like`.

    With `dry_run` a few simulators are made in a temporary folder, and tell what those that are missing would cost.

    Raises UsageError as `check_count`, where only one of `effects` and `like` is given, and for settings of which one
    would do nothing beside the other.
    """
    check_count(n)
    if not settings.dry_run:
        registry.check_writable()
    if settings.effects != (settings.like is not None):
        raise UsageError(
            "--effects without --like" if settings.effects else "--like without --effects",
            expected="both: effects are told apart under the commands of a recording",
            do="add the other, such as --effects --like RECORDING",
        )
    if settings.effects and settings.dry_run:
        raise UsageError(
            "--dry-run with --effects",
            expected="one of them",
            do="leave --dry-run out: such populations are small",
        )
    if settings.effects and (settings.ranges is not None or not settings.link):
        other = "--no-link" if settings.ranges is None else f"--ranges {settings.ranges}"
        raise UsageError(
            f"--effects with {other}",
            expected="one of them: simulators with effects are told apart at one robot, and are not linked",
            do=f"leave {other} out",
        )
    if settings.effects and (training is not None or settings.shard_size != PopulateSettings.shard_size):
        other = "shard_size" if training is None else "training"
        raise UsageError(
            f"effects with {other}",
            expected="one of them: simulators with effects have no models, and shards of one size",
            do=f"leave {other} out",
        )
    if settings.dry_run and settings.executor != "local":
        raise UsageError(
            f"--dry-run with --executor {settings.executor}",
            expected="one of them: what is told is of this machine",
            do="leave --executor out",
        )
    if settings.relink and (settings.effects or settings.dry_run or not settings.link):
        other = "--effects" if settings.effects else "--dry-run" if settings.dry_run else "--no-link"
        raise UsageError(
            f"--relink with {other}",
            expected="one of them: with the other no search graph is built",
            do=f"leave --relink or {other} out",
        )
    if settings.effects:
        return with_effects(registry, robot, n, settings, progress)
    return with_models(registry, robot, n, settings, training, progress)


def check_count(n: int) -> None:
    """UsageError where a population may not have n entries."""
    if n < 1:
        raise UsageError(f"{n} simulators", expected="at least 1", do="ask for more, such as -n 1000")
    if n > limits().entries:
        do = f"ask for fewer, or set {variable('entries')} higher"
        raise UsageError(f"{n} simulators", expected=f"at most {limits().entries}", do=do)


def with_models(
    registry: "Registry",
    robot: "Robot",
    n: int,
    settings: PopulateSettings,
    training: "Training | None",
    progress: Progress | None,
) -> "PopulationSummary":
    """Extend a population of simulators with a dynamics model each to n entries; see `populate`."""
    from numpy import median

    from dynreg.distance.population import Training
    from dynreg.executor import opened
    from dynreg.neighbours.entries import Stopwatch
    from dynreg.results.stored import PopulationSummary
    from dynreg.sim.robot import with_population
    from dynreg.verbs.foretold import foretell
    from dynreg.verbs.linking import linked_of
    from dynreg.verbs.populations import Plan, begin, fill, link

    report, watch, began = progress or (lambda *_: None), Stopwatch(), time.perf_counter()
    if training is not None:
        require("training", training, Training)
    plan = Plan(n, settings.seed, training or Training(), settings.shard_size, settings.threads)
    robot = robot if settings.ranges is None else with_population(robot, settings.ranges)
    if settings.dry_run:
        return foretell(registry, robot, plan, report, linked=settings.link)
    advance = lambda there: report("simulators", min(there, n), n)  # noqa: E731
    with opened(settings.executor, settings.address, settings.threads) as executor:
        identity = begin(registry, robot, plan, watch, report)
        added = fill(registry, identity, executor, watch, advance, stop=n)
    linked, evaluations = 0, 0
    if settings.link:
        report("link", 0, 1)
        if added or settings.relink or linked_of(registry, identity) < registry.count(identity):
            with watch.of("link"):
                linked, evaluations = link(registry, identity, threads=settings.threads, anew=settings.relink)
        report("link", 1, 1)
    own = registry.load(identity, ()).own_loss
    return PopulationSummary(
        population=identity,
        robot=robot.name,
        entries=len(own),
        planned=registry.population(identity).size,
        added=added,
        seconds=time.perf_counter() - began,
        simulate_seconds=watch.seconds["simulate"],
        train_seconds=watch.seconds["train"] + watch.seconds["base"],
        link_seconds=watch.seconds["link"],
        own_loss_median=float(median(own)) if len(own) else None,
        linked=linked,
        evaluations=evaluations,
        recording=_recorded_last(registry, robot),
    )


def _recorded_last(registry: "Registry", robot: "Robot") -> str | None:
    """What the recording of a robot is called with it that was ingested last; None where there is none."""
    mine = [info for info in registry.recordings() if robot.hash in (info.robot_hash, *info.robots)]
    return mine[-1].name_with(robot.hash) if mine else None


def with_effects(
    registry: "Registry", robot: "Robot", n: int, settings: PopulateSettings, progress: Progress | None
) -> "PopulationSummary":
    """Extend a population of simulators that carry one effect or none to n entries; see `populate`."""
    from dynreg.diagnose.guided import keep
    from dynreg.executor import opened
    from dynreg.neighbours.entries import Stopwatch
    from dynreg.results.stored import PopulationSummary
    from dynreg.verbs.effect_populations import begin, fill_span, held, hold, posed
    from dynreg.verbs.populations import fill
    from dynreg.verbs.subjects import recorded

    report, watch, began = progress or (lambda *_: None), Stopwatch(), time.perf_counter()
    advance = lambda there: report("simulators", min(there, n), n)  # noqa: E731
    with opened(settings.executor, settings.address, settings.threads) as executor:
        like = recorded(registry, settings.like, robot, None, ingest=True)
        given = posed(like, settings.seed, settings.threads)
        identity = begin(registry, robot, given, n)
        hold(given, settings.threads)
        added = fill(registry, identity, executor, watch, advance, fill_span, stop=n)
    report("link", 0, 1)
    with watch.of("train"):
        population, _, _ = held(registry, identity)
        keep(population, given.problem, given.noise, registry)  # for diagnoses under these commands
    report("link", 1, 1)
    return PopulationSummary(
        population=identity,
        robot=robot.name,
        entries=len(population),
        planned=registry.population(identity).size,
        added=added,
        seconds=time.perf_counter() - began,
        simulate_seconds=watch.seconds["simulate"],
        train_seconds=watch.seconds["train"],
        recording=like.name,
    )
