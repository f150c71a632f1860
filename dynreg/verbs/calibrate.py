"""Calibrate: adapt a robot's simulator to a recording by one of many methods, with one answer for all of them."""

import time
import warnings
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dynreg.errors import Assumed, NoMatchError, UsageError, command
from dynreg.methods.table import METHODS, USUAL
from dynreg.progress import Progress
from dynreg.search.table import FORMER
from dynreg.verbs.settings import Settings, hold_out, option, seed, threads
from dynreg.verbs.simulator import NAMES, NOMINAL, OLD

if TYPE_CHECKING:
    from dynreg.distance.population import Population
    from dynreg.methods.calibrator import Evidence, Limits, Question
    from dynreg.registry import Registry, ResultRecord
    from dynreg.results.calibration import Calibration
    from dynreg.sim.robot import Robot
    from dynreg.verbs.journals import Journals
    from dynreg.verbs.simulator import Simulator
    from dynreg.verbs.subjects import Recorded

TRIALS = 190  # on a robot, as in paper B
TRYING = " or ".join(f"`{kind.name}`" for kind in METHODS.values() if kind.tries)

# Settings that mean nothing to some methods.
OPTIONAL = (
    *("plan", "population", "start", "budget", "resume", "hold_out"),
    *("task", "trials", "seconds", "falls", "goal", "search"),
)


@dataclass(frozen=True)
class CalibrateSettings(Settings):
    """The settings of `calibrate`.

    Raises UsageError for a setting that means nothing to the method, and for a method without what it needs.
    """

    method: str = option("cma", "How the simulator is found.", choices=tuple(METHODS), old=FORMER)
    seed: int = seed("; `nearest`, `synthesis` and `ttest` do not use it")
    budget: int | None = option(
        None,
        "Most simulations. What ranks simulators for `nearest` and `synthesis`, or describes the gait that `btr` "
        "found, is not counted.",
        usual=f"{USUAL} for a search; other methods have numbers of their own",
        least=1,
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
    task: str | None = option(
        None, f"Task of the gaits of {TRYING}: one of the robot's [[tasks]].", usual="its first"
    )
    trials: int | None = option(
        None, f"Most trials of {TRYING} on the robot.", usual=f"{TRIALS}, as in paper B", least=1
    )
    seconds: float | None = option(None, "Most seconds of its trials in all.", usual="no limit", above=0.0)
    falls: int | None = option(None, f"End {TRYING} after this many falls.", usual="never", least=1)
    goal: float | None = option(
        None, f"End {TRYING} once a gait scores so much on the robot, in the task's unit.", usual="never"
    )
    search: str | None = option(
        None,
        f"How {TRYING} seeks gaits in the simulator. With `cma` it finds faster ones.",
        choices=("roulette", "cma"),
        usual="`roulette`, as in paper B",
    )
    resume: bool = option(False, "Continue an interrupted calibration.")
    threads: int = threads()

    def __post_init__(self) -> None:
        super().__post_init__()
        kind = METHODS[self.method]
        for name in OPTIONAL:
            given = getattr(self, name)
            if given == getattr(CalibrateSettings, name) or kind.takes(name):
                continue
            raise unfit(name, "" if given is True else f" {str(given)!r}", self.method, name)
        if "plan" in kind.needs and self.plan is None:
            raise UsageError(
                f"method {self.method!r} without a plan",
                expected="the TOML file of its stages",
                do="name it with --plan; see `dynreg calibrate --help`",
                setting="plan",
            )

    @property
    def tries(self) -> bool:
        """Whether the method tries the robot itself, and reads no recording."""
        return METHODS[self.method].tries


def unfit(name: str, shown: str, method: str, setting: str) -> UsageError:
    """The error for an argument that has no meaning for a method, but for those that take a setting."""
    return UsageError(
        f"{name}{shown} has no meaning for method {method!r}",
        expected=f"method {' or '.join(able(setting))}",
        do="leave it out, or choose another method",
        setting=name,
    )


def require_door(method: str, door: object, robot: object) -> None:
    """UsageError where a method that tries a robot gets none to try, or a second one; before anything is loaded."""
    if robot is not None:
        name = getattr(robot, "name", "") if not isinstance(robot, str | Path) else str(robot)
        raise UsageError(
            f"robot {name!r} with method {method!r}, which is asked about a robot alone",
            expected=f"the robot in the recording's place: {command('calibrate', name, '--method', method)}",
            do="leave this argument out",
            setting="robot",
        )
    if door is None:
        raise no_door(f"method {method!r} without a robot to try")


def no_door(problem: str) -> UsageError:
    """The error for what is no robot that can be tried."""
    return UsageError(
        problem,
        expected="a folder for its trials; in Python also a RealRobot, or a function that plays commands",
        do="name a folder with --trial, or give `robot_door` in Python",
    )


def able(setting: str) -> tuple[str, ...]:
    """Names of the methods to which a setting means something."""
    return tuple(kind.name for kind in METHODS.values() if kind.takes(setting))


def calibrate(
    asked: "Recorded", settings: CalibrateSettings, progress: Progress | None = None
) -> "Calibration":
    """Adapt a simulator to a recording by one of many methods.

    A search fits all parameters at once and begins at the nominal values, or where --start says; its answer is never
    worse than these on the train part. `random` tries these and draws from the whole range. `staged` fits them in
    stages, by a plan. `nearest` and `synthesis` take registered simulators. `diagnose` also looks for physical causes.
    `ttest` fits wheels by a table that follows a robot which changes. The answer has the same form for all, so that
    they can be compared. `btr` is asked about a robot instead: it tries gaits there, and needs no recording, just a
    score of each trial.

    Every simulator on the way is registered, with its parent and what shaped it. An interrupted search resumes with
    --resume; of one that has ended the stored result is given.

    Example: dynreg calibrate monday --method cma --hold-out kp=400
    """
    from dynreg.verbs.accepted import accept
    from dynreg.verbs.calibration_start import begun_with

    began = time.perf_counter(), time.process_time()
    accept(asked.registry, asked.robot)  # before time is spent on a robot that is refused
    _require_wheels(asked.robot, settings)
    population = _population(asked, settings)
    robot = asked.robot if population is None else population.shared.robot
    begin = begun_with(asked.registry, settings.start, robot, asked.recording.id)
    posed, journals = _posed(asked, settings, robot, begin, population, progress)
    stages = [stage.name for stage in posed[1].plan or ()] or [settings.method]
    key = journals.key_of()
    if settings.resume and not any(map(journals.begun, stages)):
        if (ended := stored_answer(asked.registry, asked.recording.id, key)) is not None:
            return ended
    resumes = METHODS[settings.method].takes("resume")
    with journals.held(stages[0]) if resumes else nullcontext():
        made = _fitted(asked, settings, posed, begin, key, began)
        asked.keep(made)
        journals.end()
    return made


def _fitted(
    asked: "Recorded",
    settings: CalibrateSettings,
    posed: "tuple[Question, Evidence, Limits]",
    begin: "Simulator | None",
    key: str,
    began: tuple[float, float],
) -> "Calibration":
    """The document of what the method finds, with every simulator on the way registered.

    began : when the command was, by the clock and by processor time [s].
    """
    from dynreg.methods.judged import replay_errors
    from dynreg.results.calibration import CalibrationCost
    from dynreg.sim.config import SimConfig
    from dynreg.verbs.calibration import document, register
    from dynreg.verbs.calibration_start import shaped_by, tell_seen
    from dynreg.verbs.shaped import origin_of

    question, evidence, limits = posed
    cut = question.data
    shaped = () if begin is None else shaped_by(asked, begin, cut.named)
    if shaped:
        tell_seen("the start was shaped by", shaped)
    found = METHODS[settings.method].made().fit(question, evidence, limits)
    if found.saw:
        tell_seen(f"{settings.method} cuts the recording in its own way, and saw", found.saw)
    configs = [SimConfig.of(cut.robot, v.values, v.effects) for v in found.versions]
    errors = replay_errors(cut, [SimConfig.of(cut.robot, cut.start), configs[-1]], settings.threads)
    asked.register()
    origin = origin_of(asked, f"calibrate {settings.method}")
    ids = register(asked.registry, found, configs, begin and begin.id, origin)
    cost = CalibrationCost(
        evaluations=found.evaluations,
        rollouts=found.rollouts,
        test_rollouts=2 if cut.parts.test.any() else 0,
        resumed=found.resumed,
        seconds=time.perf_counter() - began[0],
        simulated_seconds=found.simulated,
        core_seconds=time.process_time() - began[1],
    )
    made = document(asked, settings, question, evidence.population, found, ids, errors, cost)
    return made.model_copy(update={"question": key, "seen": tuple(dict.fromkeys((*shaped, *found.saw)))})


def answered(registry: "Registry", recording: str | None, key: str | None) -> "ResultRecord | None":
    """The stored result of a calibration, its newest; None where there is none.

    recording : id of that which it was asked about; None of a robot. key : see `Journals.key_of`.
    """
    from dynreg.verbs.newest import about

    every = about(registry, "calibration", recording)
    return next((record for record in every if record.document.get("question") == key), None)


def stored_answer(registry: "Registry", recording: str | None, key: str) -> "Calibration | None":
    """The stored result of the same calibration, which has ended and is told so; None where there is none.

    recording, key : see `answered`.
    """
    from dynreg.results.calibration import Calibration

    record = answered(registry, recording, key)
    if record is None:
        return None
    told = f"this calibration has ended: its result {record.id[:12]} is given, and nothing is computed"
    warnings.warn(told, Assumed, 3)
    return Calibration.model_validate(record.document)


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
            do="correct it" if own else f"write one: robot {str(given.parent)!r} brings none",
            setting="plan",
        )
    return own[name]


def _posed(
    asked: "Recorded",
    settings: CalibrateSettings,
    robot: "Robot",
    begin: "Simulator | None",
    population: "Population | None",
    progress: Progress | None,
) -> "tuple[tuple[Question, Evidence, Limits], Journals]":
    from dynreg.adapt.plan import read_plan
    from dynreg.methods.calibrator import Evidence, Limits, Question
    from dynreg.replay.data import data
    from dynreg.verbs.calibration_start import values_of
    from dynreg.verbs.journals import Journals

    plan = None if settings.plan is None else read_plan(_plan_file(settings.plan))
    question = {"calibrate": settings.method, "robot": robot.hash, "recording": asked.recording.id}
    how = {
        "hold_out": settings.hold_out,
        "start": begin and begin.id,
        "plan": plan and [stage.model_dump() for stage in plan],
        "seed": settings.seed,
        "budget": settings.budget,
    }
    journals = Journals(asked.registry, question, how, settings.resume)
    cut = data(robot, asked.recording, settings.hold_out)
    posed = Question(cut, values_of(begin, robot), settings.hold_out)
    evidence = Evidence(population, plan, asked.registry)
    limits = Limits(settings.budget, settings.seed, settings.threads, journals.of, progress)
    return (posed, evidence, limits), journals
