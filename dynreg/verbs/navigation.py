"""A plan for a wheeled robot, sought in a model of it, and its document."""

from dataclasses import dataclass, fields, replace

import numpy as np

from dynreg.compare.compare import STILL, parts
from dynreg.compare.contenders import MODELS, Made, Making, made
from dynreg.compare.contenders import Plan as ModelPlan
from dynreg.data.recording import Recording
from dynreg.errors import LogError, UsageError
from dynreg.progress import Progress
from dynreg.results.comparison import Spread, Way
from dynreg.results.navigation import Navigation, Place, TimedCommand
from dynreg.results.result import Cost, Interval
from dynreg.rng import stream
from dynreg.sim.robot import Robot
from dynreg.timed.commands import AXES
from dynreg.timed.compare import FACTORS, UNITS, spread
from dynreg.timed.erring import Erring
from dynreg.timed.models import coarse
from dynreg.timed.navigation import CommandRange, Course, Path, Plan, driven, evolve, short, visited
from dynreg.timed.told import Told, told
from dynreg.timed.wheels import steering, wheels_of
from dynreg.verbs.compare import CompareSettings
from dynreg.verbs.navigate import NavigateSettings
from dynreg.verbs.subjects import Recorded

INNER = 0.5  # of a square, into which the search has a path get
POPULATION, TOURNAMENT = 200, 40
SHOWN = 6  # drives that are drawn
NINETY = (0.05, 0.95)


@dataclass(frozen=True, eq=False)
class Planned:
    """What was found: the recording's commands and their parts, the model, the course, the plan and its numbers.

    values : (n, 2) of the two actions. errors : (m, 3) of the model on the commands to test. alone : the path in the
    model; drives : with errors.
    """

    told: Told
    parts: tuple[slice, slice, slice]
    made: Made
    course: Course
    ranges: CommandRange
    plan: Plan
    values: np.ndarray
    errors: np.ndarray
    alone: Path
    drives: Path


def planned(
    robot: Robot, recording: Recording, settings: NavigateSettings, progress: Progress | None = None
) -> Planned:
    """Make the model, seek the plan in it, and drive the plan with the model's errors; raises as `navigate`."""
    usual = CompareSettings()
    found = told(robot, recording, longest=usual.longest)
    fit, validation, test = parts(len(found.commands))
    _require_enough(found, fit, settings.on)
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
        commands=settings.commands,
        generations=settings.generations,
        population=POPULATION,
        tournament=TOURNAMENT,
        within=0.5 * INNER * settings.size,
        seed=settings.seed,
        progress=progress and (lambda done, of: progress("plan", done, of)),
    )
    genes = best.genes[None]
    plan = Plan.of(genes, ranges)
    errors = found.moved[test] - model.model.predict(found.commands.take(test))
    each = max(int((~plan.null).sum()), 1)
    erring = Erring(model.model, errors, each, stream(settings.seed, "drives"))
    return Planned(
        told=found,
        parts=(fit, validation, test),
        made=model,
        course=course,
        ranges=ranges,
        plan=plan,
        values=ranges.told(genes)[0],
        errors=errors,
        alone=driven(plan, model.model),
        drives=driven(Plan.of(np.repeat(genes, settings.drives, 0), ranges), erring),
    )


def _require_enough(found: Told, fit: slice, name: str) -> None:
    """LogError where a model cannot be made from what there is to fit."""
    least = MODELS[name].least
    if least > fit.stop:
        raise LogError(
            f"{fit.stop} commands are there to fit model {name!r}",
            expected=f"at least {least}",
            do="record more, or name another model with --on",
        )
    if least and (np.ptp(found.moved[fit], axis=0) < STILL).any():
        raise LogError(
            f"the {fit.stop} commands to fit do not drive and turn in several ways",
            expected="displacements that differ on every axis",
            do="record others, or plan with --on kinematic",
        )


def _ranges(robot: Robot, recording: Recording, found: Told, settings: NavigateSettings) -> CommandRange:
    """What the plan's commands may say: what most of the recording's do, and the robot takes."""
    limits = np.array([(a.low, a.high) for a in map(robot.file.actions.__getitem__, _columns(robot))]).T
    rate = robot.file.robot.control_rate
    wheels = wheels_of(robot, recording.names).matrix
    ranges = CommandRange.used(found.commands, wheels, 1.0 / rate if rate else 0.0, limits)
    if settings.seconds is None:
        return ranges
    longest = float(found.commands.seconds.max())
    if settings.seconds[1] > longest + 1e-9:
        raise UsageError(
            f"seconds up to {settings.seconds[1]:g}, and the recording's longest command lasts {longest:.3g} s",
            expected=f"no more than {longest:.3g}",
            do="ask for shorter commands, or record longer ones",
            setting="seconds",
        )
    return replace(ranges, seconds=settings.seconds)


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
    low, high = np.quantile(off, NINETY)
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
        end=Interval(value=float(short(found.alone, course)[0]), low=float(low), high=float(high), unit="m"),
        drives=settings.drives,
        all_visited=int(there.all(axis=1).sum()),
        way=_way(found.alone, 0),
        ways=tuple(_way(found.drives, number) for number in range(min(SHOWN, settings.drives))),
        generations=settings.generations,
        seed=settings.seed,
        notes=_notes(found),
        cost=Cost(
            evaluations=0,
            rollouts=settings.generations * POPULATION,
            test_rollouts=settings.drives,
            seconds=seconds,
        ),
    )


def _notes(found: Planned) -> tuple[str, ...]:
    """What is not as it was asked for, and what the drives cannot know."""
    out, course = [], found.course
    if not visited(found.alone, course).all() or short(found.alone, course)[0] > course.side / 2:
        out.append(
            "this is the best plan found, and it does not do all that was asked: try more --generations, another"
            " --seed, more --commands, longer --seconds, or places that are nearer"
        )
    usual, longest = float(np.quantile(found.told.commands.seconds, NINETY[1])), found.ranges.seconds[1]
    if longest > usual + found.ranges.tick:
        out.append(
            f"19 of 20 commands of the recording last {usual:.2g} s or less, and those of the plan up to"
            f" {longest:.2g} s: the errors of such long ones are hardly known"
        )
    return tuple(out)


def _spread(errors: np.ndarray, unit: str) -> Spread:
    return Spread.model_validate(spread(errors, unit))


def _way(path: Path, number: int) -> Way:
    """Points of one path, from the start."""
    points = path.points[number, ..., :2].reshape(-1, 2)
    known = np.concatenate([np.zeros((1, 2)), points[np.isfinite(points).all(axis=1)]])
    return Way(x=tuple(map(_rounded, known[:, 0])), y=tuple(map(_rounded, known[:, 1])))


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")
