"""The result of a comparison, from what was found."""

from collections.abc import Iterator, Mapping

import numpy as np

from dynreg.compare.compare import Compared
from dynreg.compare.contenders import Made, Plan, Predicts
from dynreg.compare.rollouts import Errors, Scored
from dynreg.results.comparison import Commands, Comparison, Contender
from dynreg.results.result import Cost, Gain
from dynreg.results.rollouts import ComparedTrace, Horizon, Rollouts, Score
from dynreg.sim.robot import Robot
from dynreg.verbs.simulator import Simulator, made
from dynreg.verbs.subjects import Recorded

SHORT = 0.1  # s: the shortest command of the published ones


def document(
    asked: Recorded,
    plan: Plan,
    simulators: Mapping[str, Simulator],
    scored: Scored | None,
    found: Compared | None,
    notes: tuple[str, ...],
    seconds: float,
) -> Comparison:
    """All that was found, with notes. simulators : by the names under which they were compared."""
    models = {} if found is None else {n: c for n, c in found.contenders.items() if n not in simulators}
    told = () if found is None else (*_seen(asked, simulators, found), *_notes(found))
    return Comparison(
        robot=asked.robot.name,
        recording=asked.recording.id,
        recording_name=asked.name,
        seed=plan.seed,
        contenders=(
            *(_simulator(name, one) for name, one in simulators.items()),
            *(_model(name, one) for name, one in models.items()),
        ),
        rollouts=None if scored is None else rollouts(asked.robot, tuple(simulators), scored),
        commands=None if found is None else _commands(plan, found),
        notes=(*told, *notes),
        cost=Cost(evaluations=0, rollouts=len(simulators), seconds=seconds),
    )


def rollouts(robot: Robot, names: tuple[str, ...], scored: Scored) -> Rollouts:
    """Errors at every horizon with their intervals, and what the longest says: the best, and those that tie with it."""
    longest = scored.errors[-1]
    best = int(np.argmin(longest.mean[:, -1]))
    ties = {i: longest.tie(best, i) for i in range(len(names)) if i != best}
    return Rollouts(
        episodes=scored.episodes,
        left_out=scored.left_out,
        names=names,
        horizons=tuple(Horizon(seconds=e.seconds, rollouts=e.rollouts, whole=e.whole) for e in scored.errors),
        best=names[best],
        alike=tuple(names[i] for i, tie in ties.items() if tie[-1]),
        within=longest.within,
        unscored=tuple(robot.channels[c] for c in longest.channels[~longest.scored]),
        scores=tuple(score for errors in scored.errors for score in _scores(robot, names, errors)),
        traces=tuple(
            ComparedTrace(
                episode=t.episode,
                channel=t.channel,
                unit=t.unit,
                time=t.time,
                measured=t.measured,
                simulators=dict(zip(names, t.simulated, strict=True)),
            )
            for t in scored.traces
        ),
    )


def _scores(robot: Robot, names: tuple[str, ...], errors: Errors) -> Iterator[Score]:
    mean, every = errors.mean, range(len(names))
    bounds, left = ([of(i) for i in every] for of in (errors.bounds, errors.ratio_to))
    ties = [None if i == 0 else errors.tie(i, 0) for i in every]
    labels = [(None, "spread"), *((robot.channels[c], robot.file.channels[c].unit) for c in errors.channels)]
    for at, (channel, unit) in enumerate(labels, start=-1):  # all channels together are the last column
        for i, name in enumerate(names):
            yield Score(
                simulator=name,
                channel=channel,
                seconds=errors.seconds,
                error=float(mean[i, at]),
                low=None if bounds[i] is None else float(bounds[i][0, at]),
                high=None if bounds[i] is None else float(bounds[i][1, at]),
                unit=unit,
                gain=None if i == 0 else _gain(mean[:, at], None if left[i] is None else left[i][:, at], i),
                tie=None if i == 0 else ties[i][at],
            )


def _gain(mean: np.ndarray, left: np.ndarray | None, one: int) -> Gain | None:
    """How much less simulator `one` errs than the first; None where that one errs by nothing.

    left : (2,) the interval of its error over that of the first.
    """
    if not mean[0] > 0:
        return None
    low = high = None
    if left is not None and np.isfinite(left).all():
        low, high = float(1.0 - left[1]), float(1.0 - left[0])
    return Gain(value=float(1.0 - mean[one] / mean[0]), low=low, high=high)


def _commands(plan: Plan, found: Compared) -> Commands:
    fit, validation, test = found.parts
    return Commands(
        parts={"fit": fit.stop, "validation": validation.stop - fit.stop, "test": test.stop - test.start},
        names=tuple(found.contenders),
        track=found.told.track,
        longest=plan.longest,
        starts=plan.starts,
        generations=plan.generations,
        best=found.errors.best,
        errors=found.errors,
        paths=found.paths,
        driven=found.driven,
        paces=found.paces,
    )


def _model(name: str, contender: Predicts) -> Contender:
    kind, fitted = (contender.kind, dict(contender.parameters)) if isinstance(contender, Made) else ("", {})
    return Contender(name=name, kind=kind, parameters=fitted)


def _simulator(name: str, simulator: Simulator) -> Contender:
    config = simulator.config
    how = made(simulator.lineage)
    return Contender(
        name=name,
        kind="simulator of a population" if how == "entry" else f"{how} simulator".strip(),
        simulator=simulator.id,
        parameters=dict(config.values),
        effects={key: dict(values) for key, values in config.effects.items()},
    )


def _seen(asked: Recorded, simulators: Mapping[str, Simulator], found: Compared) -> tuple[str, ...]:
    """Which simulators have seen commands to test, and how many of these their episodes hold."""
    names = np.array([e.name for e in asked.recording.episodes])[found.told.episode[found.parts[-1]]]
    out = []
    for name in found.errors.seen:
        one, fitted = simulators[name], "this recording, and it is not known to which part"
        if one.fitted_to is not None:
            many = int(np.isin(names, sorted(one.fitted_to | one.inherited)).sum())
            fitted = f"episodes that hold {many} of the {len(names)} test commands"
        out.append(
            f"{name} was fitted to {fitted}. It may have seen them, which models made here have not, so it is in"
            " no pair, and cannot come first"
        )
    return tuple(out)


def _notes(found: Compared) -> tuple[str, ...]:
    told, out = found.told, []
    if told.left_out:
        out.append(f"commands left out because no pose was measured at their begin or end: {told.left_out}")
    if told.on_the_way:
        out.append(
            "first commands of episodes left out because the robot seems to move already, at unknown speeds:"
            f" {told.on_the_way}"
        )
    usual = float(np.median(told.commands.seconds))
    if usual < SHORT:
        out.append(
            f"half of the commands last {usual:.2g} s or less. The models made here know only the last two commands,"
            " and paths of ten commands are short"
        )
    if found.paths is None:
        out.append("no paths are compared: the test part has no ten commands in a row without a gap")
    return tuple(out)
