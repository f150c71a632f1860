"""Calibrate: adapt a robot's simulator to a recording by one of many methods, with one answer for all of them."""

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dynreg.errors import NoMatchError, UsageError
from dynreg.methods.table import METHODS
from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, hold_out, option, seed, threads
from dynreg.verbs.simulators import NAMES, NOMINAL, OLD, simulator

if TYPE_CHECKING:
    from dynreg.adapt.version import Fitted, Version
    from dynreg.distance.population import Population
    from dynreg.methods.calibrator import Evidence, Limits, Question
    from dynreg.results.calibration import Calibration
    from dynreg.sim.config import SimConfig
    from dynreg.sim.robot import Robot
    from dynreg.verbs.simulators import Simulator
    from dynreg.verbs.subjects import Recorded


@dataclass(frozen=True)
class CalibrateSettings(Settings):
    """The settings of `calibrate`.

    Raises UsageError for a plan without the method that reads it, and the other way round.
    """

    method: str = option("cma", "Method.", choices=tuple(METHODS), old={"cmaes": "cma", "genetic": "ga"})
    seed: int = seed()
    budget: int | None = option(
        None, "Most simulations.", usual="600 of a search, else the method's own number", least=1
    )
    hold_out: str | None = hold_out()
    start: str = option(
        NOMINAL,
        f"Simulator to begin from, also of another robot with parameters of these names: {', '.join(NAMES)} or an ID.",
        metavar="ID",
        old=OLD,
    )
    plan: Path | None = option(
        None,
        "TOML file with the stages of `staged`, or one that a robot brings, as aibo/air.",
        metavar="FILE",
    )
    population: str | None = option(
        None,
        "Population of `nearest` and `synthesis`.",
        usual="the only one",
        complete="stored_names",
    )
    resume: bool = option(False, "Continue an interrupted calibration.")
    threads: int = threads()

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, given in (("plan", self.plan), ("population", self.population)):
            if given is not None and name not in METHODS[self.method].needs:
                able = [kind.name for kind in METHODS.values() if name in kind.needs]
                raise UsageError(
                    f"{name} {str(given)!r} with method {self.method!r}, which reads none",
                    expected=f"it with {' or '.join(able)}",
                    do="leave it out, or choose that method",
                    setting=name,
                )
        if self.start != NOMINAL and not METHODS[self.method].starts:
            raise UsageError(
                f"start {self.start!r} with method {self.method!r}, which begins with registered simulators",
                expected="a method that begins with one",
                do="leave it out, or choose another method",
                setting="start",
            )
        if "plan" in METHODS[self.method].needs and self.plan is None:
            raise UsageError(
                f"method {self.method!r} without a plan",
                expected="the TOML file of its stages",
                do="name it with --plan; see `dynreg calibrate --help`",
                setting="plan",
            )


def calibrate(
    asked: "Recorded", settings: CalibrateSettings, progress: Progress | None = None
) -> "Calibration":
    """Adapt a robot's simulator to a recording by one of many methods.

    A search fits all parameters at once and begins at the nominal values; its answer is never worse than these on the
    train part. `staged` fits them in stages, by a plan. `nearest` and `synthesis` take registered simulators.
    `diagnose` also looks for physical causes. The answer has the same form for all, so that they can be compared.

    Every simulator on the way is registered, with its parent and what shaped it. An interrupted search resumes with
    --resume.

    Example: dynreg calibrate monday --method cma --hold-out kp=400
    """
    from dynreg.methods.judged import replay_errors
    from dynreg.results.calibration import Calibration, CalibrationCost, CalibrationStep
    from dynreg.sim.config import SimConfig

    began, worked = time.perf_counter(), time.process_time()
    population = _population(asked, settings)
    robot = asked.robot if population is None else population.shared.robot
    begin = _begin(asked, settings, robot)
    question, evidence, limits = _posed(asked, settings, robot, begin, population, progress)
    cut = question.data
    found = METHODS[settings.method].made().fit(question, evidence, limits)
    configs = [SimConfig.of(robot, v.values, v.effects) for v in found.versions]
    errors = replay_errors(cut, [SimConfig.of(robot, cut.start), configs[-1]], settings.threads)
    before = None if begin is None else begin.id
    ids = _register(asked, settings.method, found, configs, before)
    tested = (None, None) if not cut.parts.test.any() else tuple(errors[:, 1].tolist())
    return Calibration(
        robot=robot.name,
        recording=asked.recording.id,
        method=settings.method,
        simulator=ids[-1],
        versions=tuple(
            _version(asked, one, identity, (*ids, before))
            for one, identity in zip(found.versions, ids, strict=True)
        ),
        parameters=_parameters(robot, found),
        causes=found.causes,
        train_error=errors[1, 0],
        test_error=tested[1],
        nominal_train_error=errors[0, 0],
        nominal_test_error=tested[0],
        history=tuple(CalibrationStep(simulations=n, error=e) for n, e in found.history),
        parts=cut.named,
        ended=found.ended,
        population=population and population.id,
        seed=settings.seed,
        cost=CalibrationCost(
            evaluations=found.evaluations,
            rollouts=found.rollouts,
            test_rollouts=0 if tested[0] is None else 2,
            seconds=time.perf_counter() - began,
            simulated_seconds=found.simulated,
            core_seconds=time.process_time() - worked,
        ),
    )


def _population(asked: "Recorded", settings: CalibrateSettings) -> "Population | None":
    """The population that the method needs. Raises UsageError where there is none."""
    if "population" not in METHODS[settings.method].needs:
        return None
    from dynreg.verbs.populations import ready

    try:
        return ready(asked, settings.population)
    except NoMatchError as error:
        raise UsageError(
            f"method {settings.method!r} needs a population of {asked.robot.name!r}: {error.problem}",
            expected=error.expected,
            do=error.do,
        ) from None


def _begin(asked: "Recorded", settings: CalibrateSettings, robot: "Robot") -> "Simulator | None":
    """The simulator to begin from, None for the nominal one.

    Raises UsageError for one that has effects, which a search would leave out, or none of the robot's parameters.
    """
    if settings.start == NOMINAL:
        return None
    found = simulator(asked.registry, settings.start, robot, asked.recording.id)
    if found.config.effects:
        raise UsageError(
            f"simulator {found.name!r} has effects ({', '.join(found.config.effects)})",
            expected="one without: a calibration fits parameters",
            do="write them into a robot with `dynreg export`, or begin with another simulator",
        )
    if not _shared(found, robot):
        raise UsageError(
            f"simulator {found.name!r} has none of the parameters of {robot.name!r}",
            expected=f"some of {', '.join(robot.space.names)}",
            do="begin with another",
        )
    return found


def _plan_file(given: Path) -> Path:
    """The file itself, or that of a packaged robot's plan: "aibo/air" is plans/air.toml in the folder of `aibo`."""
    from dynreg.folder import PLANS
    from dynreg.sim.robot import packaged_robots

    folder = packaged_robots().get(str(given.parent))
    if folder is None or given.exists():
        return given
    return folder / PLANS / f"{given.name}.toml"


def _shared(begin: "Simulator", robot: "Robot") -> dict[str, float]:
    """{parameter: value} of a simulator that the robot has, too."""
    return {name: value for name, value in begin.config.values.items() if name in robot.space.names}


def _posed(
    asked: "Recorded",
    settings: CalibrateSettings,
    robot: "Robot",
    begin: "Simulator | None",
    population: "Population | None",
    progress: Progress | None,
) -> "tuple[Question, Evidence, Limits]":
    from dynreg.adapt.plan import read_plan
    from dynreg.methods.calibrator import Evidence, Limits, Question
    from dynreg.replay.data import data
    from dynreg.search.journal import Journal

    plan = None if settings.plan is None else read_plan(_plan_file(settings.plan))
    key = {
        "calibrate": settings.method,
        "robot": robot.hash,
        "recording": asked.recording.id,
        "hold_out": settings.hold_out,
        "start": begin and begin.id,
        "plan": plan and [stage.model_dump() for stage in plan],
    }
    told = {**key, "seed": settings.seed, "budget": settings.budget}

    def journal(stage: str) -> Journal:
        name = hashlib.sha256(json.dumps({**key, "stage": stage}, sort_keys=True).encode()).hexdigest()[:24]
        return Journal(asked.registry.journal_path(name), {**told, "stage": stage}, resume=settings.resume)

    space = robot.space
    start = begin and space.from_dict(space.as_dict(space.nominal) | _shared(begin, robot))
    question = Question(data(robot, asked.recording, settings.hold_out), start, settings.hold_out)
    evidence = Evidence(population, plan, asked.registry)
    limits = Limits(settings.budget, settings.seed, settings.threads, journal, progress)
    return question, evidence, limits


def _register(
    asked: "Recorded", method: str, found: "Fitted", configs: "list[SimConfig]", begin: str | None
) -> tuple[str, ...]:
    """Ids of the versions' simulators, registered with what they came from."""
    ids: list[str] = []
    for version, config in zip(found.versions, configs, strict=True):
        lineage = {
            "made_by": f"calibrate {method}",
            "stage": version.stage,
            "recording": asked.recording.id,
            "episodes": list(version.episodes),
        }
        if (parent := begin if version.parent is None else ids[version.parent]) is not None:
            lineage["parent"] = parent
        if asked.each:
            lineage["recordings"] = [one.recording.id for one in asked.each]
        ids.append(asked.registry.put_simulator(config.as_dict() | {"lineage": lineage}))
    return tuple(ids)


def _version(asked: "Recorded", version: "Version", identity: str, ids: tuple[str | None, ...]):
    """A version as the document tells it; ids : of all versions, and last of the simulator that the first came from."""
    from dynreg.results.calibration import CalibrationVersion

    of = {one.name: one.recording.id for one in asked.each}
    named = {episode: episode.split("/")[0] for episode in version.episodes}
    recordings = dict.fromkeys(of.get(named[e], asked.recording.id) for e in version.episodes)
    return CalibrationVersion(
        simulator=identity,
        stage=version.stage,
        parent=ids[-1 if version.parent is None else version.parent],
        recordings=tuple(recordings),
        episodes=version.episodes,
        before=version.before,
        after=version.after,
    )


def _parameters(robot: "Robot", found: "Fitted"):
    from dynreg.results.calibration import Fitted as Told

    values = found.answer.values
    edge = robot.space.at_bound(robot.space.to_unit(values))
    out = {}
    for p, v, at in zip(robot.space.parameters, values.tolist(), edge, strict=True):
        low, high = found.intervals.get(p.name, (None, None))
        out[p.name] = Told(
            value=v,
            low=low,
            high=high,
            unit=p.unit,
            nominal=p.nominal,
            at_bound=bool(at),
            limits=(p.low, p.high),
        )
    return out
