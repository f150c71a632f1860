"""A plan for a wheeled robot, sought in a model of it, and its document."""

from dataclasses import dataclass, fields, replace

import numpy as np

from dynreg.compare.compare import parts, require_enough
from dynreg.compare.contenders import Made, Making, made
from dynreg.compare.contenders import Plan as ModelPlan
from dynreg.data.recording import Recording
from dynreg.errors import UsageError
from dynreg.evidence.interval import NINETY
from dynreg.progress import Progress
from dynreg.results.comparison import Spread, Way
from dynreg.results.navigation import CommandLimits, Navigation, Place, TimedCommand
from dynreg.results.result import Cost, Interval
from dynreg.sim.robot import Robot
from dynreg.timed.commands import AXES
from dynreg.timed.compare import FACTORS, UNITS, spread
from dynreg.timed.erring import Erring, consecutive
from dynreg.timed.models import coarse
from dynreg.timed.navigation import (
    MOST,
    PLANNING,
    CommandRange,
    Course,
    Path,
    Plan,
    driven,
    evolve,
    short,
    visited,
)
from dynreg.timed.told import Told, told
from dynreg.timed.wheels import steering, wheels_of
from dynreg.verbs.compare import CompareSettings
from dynreg.verbs.navigate_settings import NavigateSettings
from dynreg.verbs.subjects import Recorded

_MOSTLY = f"{20 * MOST[1]:g} of 20"  # commands of a recording, as notes say it
INNER = 0.5  # of a square, into which the search has a path get: a choice
SHOWN = 6  # drives that are drawn
LONG = (0.5, 2.0)  # s: commands that are advised where those of a recording are shorter and lead nowhere


@dataclass(frozen=True, eq=False)
class Planned:
    """What was found: the recording's commands and their parts, the model, the course, the plan and its numbers.

    values : (n, 2) of the two actions. errors : (m, 3) of the model on the commands to test; runs : (R, r) numbers of
    those that follow each other, of which drives take theirs. alone : the path in the model; drives : with errors.
    """

    told: Told
    parts: tuple[slice, slice, slice]
    made: Made
    course: Course
    ranges: CommandRange
    plan: Plan
    values: np.ndarray
    errors: np.ndarray
    runs: np.ndarray
    alone: Path
    drives: Path


def planned(
    robot: Robot, recording: Recording, settings: NavigateSettings, progress: Progress | None = None
) -> Planned:
    """Make the model, seek the plan in it, and drive the plan with the model's errors; raises as `navigate`."""
    usual = CompareSettings()
    found = told(robot, recording, longest=usual.longest)
    fit, validation, test = parts(len(found.commands))
    require_enough(
        found,
        fit,
        (settings.on,),
        without=lambda _: "name another model with --on",
        unfitted="plan with --on kinematic",
    )
    ranges = _ranges(robot, recording, found, settings)
    models = {one.name: getattr(usual, one.name) for one in fields(ModelPlan)}
    how = ModelPlan(**models | {"models": (settings.on,), "seed": settings.seed, "threads": settings.threads})
    model = made(settings.on, Making(found, fit, validation, how), progress)
    area = None if settings.area is None else np.reshape(settings.area, (2, 2))
    course = Course.around(settings.visit, settings.size, area, settings.back)
    best = evolve(
        coarse(model.model),
        course,
        ranges,
        generations=settings.generations,
        within=0.5 * INNER * settings.size,
        seed=settings.seed,
        progress=progress and (lambda done, of: progress("plan", done, of)),
    )
    genes = best.genes[None]
    plan = Plan.of(genes, ranges)
    errors = found.moved[test] - model.model.predict(found.commands.take(test))
    each = max(int((~plan.null).sum()), 1)
    runs = consecutive(found.follows[test], each)
    drives = Plan.of(np.repeat(genes, settings.drives, 0), ranges)
    return Planned(
        told=found,
        parts=(fit, validation, test),
        made=model,
        course=course,
        ranges=ranges,
        plan=plan,
        values=ranges.told(genes)[0],
        errors=errors,
        runs=runs,
        alone=driven(plan, model.model),
        drives=driven(drives, Erring(model.model, errors, runs, each, settings.seed)),
    )


def _ranges(robot: Robot, recording: Recording, found: Told, settings: NavigateSettings) -> CommandRange:
    """What the plan's commands may say: what most of the recording's do, and the robot takes."""
    limits = robot.action_ranges[_columns(robot)].T
    rate = robot.file.robot.control_rate
    wheels = wheels_of(robot, recording.names).matrix
    ranges = CommandRange.used(found.commands, wheels, 1.0 / rate if rate else 0.0, limits)
    ranges = replace(ranges, commands=settings.commands)
    if settings.seconds is None:
        return ranges
    longest = float(np.floor(1000.0 * found.commands.seconds.max() + 1e-6) / 1000.0)  # as it is written
    if settings.seconds[1] > longest + 1e-9:
        raise UsageError(
            f"seconds up to {settings.seconds[1]:g}, and the recording's longest command lasts {longest:g} s",
            expected=f"no more than {longest:g}",
            do="ask for shorter commands, or record longer ones",
            setting="seconds",
        )
    return ranges.lasting(*settings.seconds)


def _columns(robot: Robot) -> list[int]:
    """Numbers of the two actions that drive the base."""
    return [robot.actions.index(name) for name in steering(robot)]


def document(asked: Recorded, settings: NavigateSettings, found: Planned, seconds: float) -> Navigation:
    """The result; numbers are rounded as they are written to a file."""
    robot, course, plan = asked.robot, found.course, found.plan
    fit, validation, test = found.parts
    alone, there = visited(found.alone, course)[0], visited(found.drives, course)
    off = short(found.drives, course)
    actions = [robot.file.actions[column] for column in _columns(robot)]
    used = ~plan.null[0]
    lasts = plan.seconds[0][used]
    begins = np.concatenate([[0.0], np.cumsum(lasts)])
    places = zip(course.centres.tolist(), alone.tolist(), there.sum(axis=0).tolist(), strict=True)
    low, median, high = map(float, np.quantile(off, (NINETY[0], 0.5, NINETY[1])))
    return Navigation(
        robot=robot.name,
        recording=asked.recording.id,
        recording_name=asked.name,
        on=settings.on,
        kind=found.made.kind,
        parameters=dict(found.made.parameters),
        parts={"fit": fit.stop, "validation": validation.stop - fit.stop, "test": test.stop - test.start},
        errors=dict(zip(AXES, map(_spread, (np.abs(found.errors) * FACTORS).T, UNITS), strict=True)),
        size=settings.size,
        area=tuple(course.area.ravel().tolist()),
        back=course.back,
        places=tuple(Place(x=x, y=y, visited=one, drives=many) for (x, y), one, many in places),
        actions=tuple(a.name for a in actions),
        units=tuple(a.unit for a in actions),
        commands=tuple(
            TimedCommand(time=_rounded(begin), seconds=_rounded(last), values=tuple(map(_rounded, told)))
            for begin, last, told in zip(begins[:-1], lasts, found.values[used], strict=True)
        ),
        seconds=_rounded(begins[-1]),
        end=float(short(found.alone, course)[0]),
        drives=settings.drives,
        drive_ends=Interval(value=median, low=low, high=high, unit="m"),
        all_visited=int(there.all(axis=1).sum()),
        way=_way(found.alone, 0),
        ways=tuple(_way(found.drives, number) for number in range(min(SHOWN, settings.drives))),
        limits=_limits(found),
        generations=settings.generations,
        seed=settings.seed,
        notes=_notes(found),
        cost=Cost(
            evaluations=0,
            rollouts=settings.generations * PLANNING.population,
            test_rollouts=settings.drives,
            seconds=seconds,
        ),
    )


def _notes(found: Planned) -> tuple[str, ...]:
    """What is not as it was asked for, and what the drives cannot know."""
    out, course = [], found.course
    if not visited(found.alone, course).all() or short(found.alone, course)[0] > course.side / 2:
        out.append(f"this is the best plan found, and it does not do all that was asked: {_why(found)}")
    out += [
        f"the start already lies in the place {x:g},{y:g}"
        for x, y in course.centres
        if max(abs(x), abs(y)) <= course.side / 2
    ]
    usual, longest = _usual(found), found.ranges.seconds[1]
    if _beyond(found):
        out.append(
            f"{_MOSTLY} commands of the recording last {usual:.2g} s or less, and those of the plan up to"
            f" {longest:.2g} s: the errors of such long ones are hardly known"
        )
    used, length = int((~found.plan.null).sum()), found.runs.shape[1]
    if length < used:
        out.append(
            f"the plan has {used} commands, and no more than {length} of those to test follow each other without a"
            " gap: each drive strings together the errors of several such runs"
        )
    return tuple(out)


def _why(found: Planned) -> str:
    """Why a plan may miss what was asked, and what to try."""
    way, ranges = found.course.least_way, found.ranges
    reach = ranges.commands * ranges.seconds[1] * ranges.fastest
    if way > reach:
        out = (
            f"the places ask for a way of at least {way:.3g} m, and these commands go at most {reach:.3g} m; try more"
            " --commands, longer --seconds, or places that are nearer"
        )
    else:
        out = "try more --generations, another --seed, more --commands, longer --seconds, or places that are nearer"
    usual, longest = _usual(found), min(float(found.told.commands.seconds.max()), LONG[1])
    longest = np.floor(100.0 * longest + 1e-6) / 100.0  # as it is written, and no longer than the recording's
    if usual < LONG[0] and longest > usual + ranges.tick and not _beyond(found):
        out += (
            f"; {_MOSTLY} commands of the recording last {usual:.2g} s or less, so try"
            f" --seconds {min(LONG[0], longest / 2):g},{longest:g}"
        )
    return out


def _usual(found: Planned) -> float:
    """How long most commands of the recording last at most [s]."""
    return float(np.quantile(found.told.commands.seconds, MOST[1]))


def _beyond(found: Planned) -> bool:
    """Whether commands of the plan may last longer than most of the recording's."""
    return found.ranges.seconds[1] > _usual(found) + found.ranges.tick


def _limits(found: Planned) -> CommandLimits:
    ranges = found.ranges
    return CommandLimits(
        commands=ranges.commands,
        seconds=tuple(map(_rounded, ranges.seconds)),
        low=tuple(map(_rounded, ranges.low)),
        high=tuple(map(_rounded, ranges.high)),
        beyond=_beyond(found),
    )


def _spread(errors: np.ndarray, unit: str) -> Spread:
    return Spread.model_validate(spread(errors, unit))


def _way(path: Path, number: int) -> Way:
    """Points of one path, from the start."""
    points = path.points[number, ..., :2].reshape(-1, 2)
    known = np.concatenate([np.zeros((1, 2)), points[np.isfinite(points).all(axis=1)]])
    return Way(x=tuple(map(_rounded, known[:, 0])), y=tuple(map(_rounded, known[:, 1])))


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")
