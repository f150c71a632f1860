"""Calibrate: adapt a robot's simulator to a recording by one of many methods, with one answer for all of them."""

import hashlib
import json
import re
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynreg.errors import Assumed, NoMatchError, UsageError
from dynreg.methods.table import METHODS
from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, hold_out, option, seed, threads
from dynreg.verbs.simulators import NAMES, NOMINAL, OLD, simulator

if TYPE_CHECKING:
    from dynreg.distance.population import Population
    from dynreg.methods.calibrator import Evidence, Limits, Question
    from dynreg.registry import Registry
    from dynreg.results.calibration import Calibration
    from dynreg.search.journal import Journal
    from dynreg.sim.robot import Robot
    from dynreg.verbs.simulators import Simulator
    from dynreg.verbs.subjects import Recorded


@dataclass(frozen=True)
class CalibrateSettings(Settings):
    """The settings of `calibrate`.

    Raises UsageError for a setting that means nothing to the method, and for a method without what it needs.
    """

    method: str = option(
        "cma", "How the simulator is found.", choices=tuple(METHODS), old={"cmaes": "cma", "genetic": "ga"}
    )
    seed: int = seed()
    budget: int | None = option(
        None, "Most simulations.", usual="600 of a search, else its own number", least=1
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
        kind = METHODS[self.method]
        for name in ("plan", "population", "start", "budget", "resume"):
            given = getattr(self, name)
            if given == getattr(CalibrateSettings, name) or name in (*kind.needs, *kind.reads):
                continue
            able = [other.name for other in METHODS.values() if name in (*other.needs, *other.reads)]
            shown = "" if given is True else f" {str(given)!r}"
            raise UsageError(
                f"{name}{shown} with method {self.method!r}, to which it means nothing",
                expected=f"it with {', '.join(able)}",
                do="leave it out, or choose one of these methods",
                setting=name,
            )
        if "plan" in kind.needs and self.plan is None:
            raise UsageError(
                f"method {self.method!r} without a plan",
                expected="the TOML file of its stages",
                do="name it with --plan; see `dynreg calibrate --help`",
                setting="plan",
            )


def calibrate(
    asked: "Recorded", settings: CalibrateSettings, progress: Progress | None = None
) -> "Calibration":
    """Adapt a simulator to a recording by one of many methods.

    A search fits all parameters at once and begins at the nominal values, or where --start says; its answer is never
    worse than these on the train part. `staged` fits them in stages, by a plan. `nearest` and `synthesis` take
    registered simulators.
    `diagnose` also looks for physical causes. `ttest` fits wheels by a table that follows a robot which changes. The
    answer has the same form for all, so that they can be compared.

    Every simulator on the way is registered, with its parent and what shaped it. An interrupted search resumes with
    --resume.

    Example: dynreg calibrate monday --method cma --hold-out kp=400
    """
    from dynreg.methods.judged import replay_errors
    from dynreg.results.calibration import CalibrationCost
    from dynreg.sim.config import SimConfig
    from dynreg.verbs.calibration import document, register

    began, worked = time.perf_counter(), time.process_time()
    _require_wheels(asked.robot, settings)
    population = _population(asked, settings)
    robot = asked.robot if population is None else population.shared.robot
    begin = _begin(asked, settings, robot)
    question, evidence, limits, journals = _posed(asked, settings, robot, begin, population, progress)
    cut = question.data
    if begin is not None:
        _tell_seen(begin, cut.named["test"])
    found = METHODS[settings.method].made().fit(question, evidence, limits)
    configs = [SimConfig.of(robot, v.values, v.effects) for v in found.versions]
    errors = replay_errors(cut, [SimConfig.of(robot, cut.start), configs[-1]], settings.threads)
    ids = register(asked, settings.method, found, configs, begin and begin.id)
    journals.end()
    cost = CalibrationCost(
        evaluations=found.evaluations,
        rollouts=found.rollouts,
        test_rollouts=2 if cut.parts.test.any() else 0,
        resumed=found.resumed,
        seconds=time.perf_counter() - began,
        simulated_seconds=found.simulated,
        core_seconds=time.process_time() - worked,
    )
    return document(asked, settings, question, population, found, ids, errors, cost)


def _require_wheels(robot: "Robot", settings: CalibrateSettings) -> None:
    """UsageError for a robot without wheels, where the method needs them."""
    from dynreg.replay.velocity import pose_columns
    from dynreg.sim.effects.wheels import WheelGain

    if "wheels" not in METHODS[settings.method].needs:
        return
    lack = WheelGain().why_not(robot)
    if lack is None and pose_columns(robot) is None:
        lack = "no channels of a base's x, y and yaw"
    if lack:
        raise UsageError(
            f"method {settings.method!r} needs a robot on wheels; {robot.name!r}: {lack}",
            expected="[base] and the pose of the base in robot.toml, as diffdrive has them",
            do="choose another method",
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
    """The file itself, or that of a packaged robot's plan: "aibo/air" is plans/air.toml in the folder of `aibo`.

    Raises UsageError for a plan that the robot does not bring.
    """
    from dynreg.folder import PLANS
    from dynreg.sim.robot import packaged_robots

    folder = packaged_robots().get(str(given.parent))
    if folder is None or given.exists():
        return given
    own = {path.stem: path for path in sorted((folder / PLANS).glob("*.toml"))}
    name = given.name.removesuffix(".toml")
    if name not in own:
        raise UsageError(
            f"plan {str(given)!r}",
            expected=f"a file{''.join(f', {given.parent}/{one}' for one in own)}",
            do="correct it",
            setting="plan",
        )
    return own[name]


def _tell_seen(begin: "Simulator", held_out: Sequence[str]) -> None:
    """Say where the simulator to begin from was shaped by what is held out: the test error is too low then."""
    whole = {re.sub(r"\[\d+\]$", "", name) for name in held_out}
    seen = {*begin.lineage.get("episodes", ())}
    both = sorted(one for one in whole if one in seen or one.split("/")[-1] in seen)
    if both:
        warnings.warn(
            f"the simulator to begin from was shaped by {', '.join(both)}, which is held out: the test error is too"
            " low",
            Assumed,
            2,
        )


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
) -> "tuple[Question, Evidence, Limits, _Journals]":
    from dynreg.adapt.plan import read_plan
    from dynreg.methods.calibrator import Evidence, Limits, Question
    from dynreg.replay.data import data

    plan = None if settings.plan is None else read_plan(_plan_file(settings.plan))
    question = {"calibrate": settings.method, "robot": robot.hash, "recording": asked.recording.id}
    how = {
        "hold_out": settings.hold_out,
        "start": begin and begin.id,
        "plan": plan and [stage.model_dump() for stage in plan],
        "seed": settings.seed,
        "budget": settings.budget,
    }
    journals = _Journals(asked.registry, question, how, settings.resume)
    space = robot.space
    start = begin and space.from_dict(space.as_dict(space.nominal) | _shared(begin, robot))
    posed = Question(data(robot, asked.recording, settings.hold_out), start, settings.hold_out)
    evidence = Evidence(population, plan, asked.registry)
    limits = Limits(settings.budget, settings.seed, settings.threads, journals.of, progress)
    return posed, evidence, limits, journals


@dataclass(frozen=True)
class _Journals:
    """The journals of one calibration: what makes it this question, and how it is run.

    Runs with other seeds or budgets have journals of their own, so that none overwrites another's.
    """

    registry: "Registry"
    question: Mapping[str, Any]
    how: Mapping[str, Any]
    resume: bool
    paths: list[Path] = field(default_factory=list)

    def end(self) -> None:
        """Take the journals away: the calibration has ended."""
        for path in self.paths:
            path.unlink(missing_ok=True)

    def of(self, stage: str) -> "Journal":
        """The journal of a stage. Raises UsageError for one to resume where only runs in other ways have left one."""
        from dynreg.search.journal import Journal

        question = {**self.question, "stage": stage}
        begins, ends = (_hash(part) for part in (question, self.how))
        path = self.registry.journal_path(f"{begins}-{ends}")
        if self.resume and not path.exists() and any(path.parent.glob(f"{begins}-*.jsonl")):
            raise UsageError(
                f"nothing to resume with seed {self.how['seed']} and these settings: what was interrupted had others",
                expected=f"the same {', '.join(self.how)}",
                do="give those, or begin anew without --resume",
            )
        self.paths.append(path)
        return Journal(path, {**question, **self.how}, resume=self.resume)


def _hash(told: Mapping[str, Any]) -> str:
    """12 hexadecimal digits of plain JSON."""
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:12]
