"""What a calibration did on the robot itself: its sentence, its tables, and its two curves."""

from typing import Any

from dynreg.adapt.differences import unit_of
from dynreg.data.units import suffix
from dynreg.report.drawing import Chart, chart
from dynreg.report.words import count, number
from dynreg.results.calibration import Calibration, OnRobot

GAITS = ("gait", "iteration", "step", "trials", "score", "in the simulator")


def verdict(result: Calibration) -> str:
    """The answer in one or two sentences."""
    told, cost = result.on_robot, result.cost
    best, first = told.tried[told.best - 1], told.tried[0]
    begun = "" if first is best or first.fell else f", after {number(first.score)} of the first one"
    falls = f"{count(cost.trials, 'trial')} on {result.robot}, {cost.falls} with a fall"
    text = f"{result.method} found a gait with a score of {number(best.score)}{suffix(told.unit)}{begun}, in {falls}."
    adapted = [v for v in result.versions if v.before is not None]
    if not adapted:
        return f"{text} The simulator was not adapted."
    changes = " and ".join(f"{number(v.before)} to {number(v.after)}" for v in adapted)
    what, unit = difference(told)
    return f"{text} {what[0].upper()}{what[1:]} went from {changes}{unit and f' {unit}'}."


def difference(told: OnRobot) -> tuple[str, str]:
    """What is said of the difference that an adaptation makes small, and its unit, "" for none."""
    unit = unit_of(told.difference, told.unit)
    if told.difference == "rank":
        return "1 - the rank correlation of simulated and real scores", unit
    kind = "mean signed difference" if told.difference == "signed" else "difference"
    return f"the {kind} of simulated and real scores", unit


def spent(result: Calibration) -> str:
    """What the trials cost, in words."""
    cost = result.cost
    lost = f", {count(cost.discarded, 'trial')} of gaits that were discarded" if cost.discarded else ""
    lost += f", {count(cost.lost, 'trial')} without an outcome" if cost.lost else ""
    return (
        f"on the robot: {count(cost.trials, 'trial')}, {cost.trial_seconds:.0f} s,"
        f" {count(cost.falls, 'fall')}{lost}; ended by: {result.ended}"
    )


def next_steps(result: Calibration) -> tuple[str, ...]:
    """What to do next."""
    told = result.on_robot
    out = (
        []
        if told.document is None
        else [f"Play it: dynreg export {told.document[:12]} --as python --to gait.py"]
    )
    if len(told.tried[told.best - 1].trials) == 1:
        out.append("The best score is of one trial, the luckiest of many: try the gait again.")
    if len(result.versions) > 1:
        out.append("Its parameters make scores alike, and need not be the robot's: a recording tells these.")
    return tuple(out)


def rows(told: OnRobot) -> list[tuple[Any, ...]]:
    """A row for each gait that came from the simulator or is the best: `GAITS`; other small steps are left out."""
    out: list[tuple[Any, ...]] = []
    for number_, one in enumerate(told.tried, 1):
        if one.step == "refine" and number_ != told.best:
            continue
        score = f"fell in trial {one.trials[-1]}" if one.fell else number(one.score)
        trials = str(one.trials[0]) if len(one.trials) == 1 else f"{one.trials[0]} to {one.trials[-1]}"
        mark = ", the best" if number_ == told.best else ""
        out.append((str(number_), one.iteration, one.step + mark, trials, score, number(one.simulated)))
    return out


def charts(result: Calibration) -> list[Chart]:
    """The score of every trial beside the simulated one, broken at each adaptation; the difference by iteration."""
    told = result.on_robot
    x: list[float] = []
    real: list[float | None] = []
    simulated: list[float | None] = []
    iteration, step = 1, "transfer"
    for one in told.tried:
        if (one.iteration, one.step) != (iteration, step):
            x, real, simulated = [*x, one.trials[0] - 0.5], [*real, None], [*simulated, None]
            iteration, step = one.iteration, one.step
        x += one.trials
        real += [0.0 if score is None else score for score in one.scores]
        simulated += [one.simulated] * len(one.trials)
    curves = {"nominal": simulated, "answer": real}
    beside = ", and simulated (dashed)" if any(one is not None for one in simulated) else ""
    scores = chart(f"score [{told.unit}] on the robot{beside}", "trial", x, curves)
    at: list[float] = []
    delta: list[float | None] = []
    for number_, one in enumerate((v for v in result.versions if v.before is not None), 1):
        at += [number_ - 1, number_, number_]
        delta += [one.before, one.after, None]
    what, unit = difference(told)
    title = f"{what.removeprefix('the ')}{unit and f' [{unit}]'}"
    apart = chart(title, "adaptations", at, {"answer": delta})
    return [one for one in (scores, apart) if one is not None]
