"""Refit: an answer fitted anew to each of several recordings, and which of its sizes are the same in all of them.

First everything is taken for the same in all recordings. Then sizes and parameters may differ, one after the other,
that with most evidence first, while this passes the threshold of a cause: what chance makes of a robot without any
effect must not pass for a change. The fits to single recordings stand for the likelihood, as normal distributions.

The nameplate says what a robot of this kind is, not that it stays so. It pulls at what all recordings share, and not
at a difference between them: each fit goes on about the point that it has found until it moves no further, and of
values that differ only the mean has a prior.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.diagnose import Diagnosed, offered, search
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import planned
from dynreg.diagnose.refitted import Fitted, Left, Refits
from dynreg.diagnose.shared import Shared
from dynreg.diagnose.threshold import Threshold, known
from dynreg.diagnose.zeros import zeroed
from dynreg.errors import LogError, UsageError
from dynreg.evidence.fit import fit
from dynreg.evidence.interval import posterior
from dynreg.evidence.lockstep import Search, together
from dynreg.evidence.point import Point
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import Robot

ROUNDS = 3  # of fits at most: each about what the last one found to differ
TURNS = 12  # fits about the point that the last one found, at most
NEAR = 0.25  # standard deviations of the nameplate that the last of them may move a parameter


def fit_alone(
    robot: Robot, recordings: Mapping[str, Recording], options: DiagnosisOptions, answer: SimConfig
) -> tuple[dict[str, Recording], dict[str, str]]:
    """The recordings that `with_own_effects` and `refits` can fit each alone, and {name: why not} of the others.

    One may be too short, or a measured input of its own may contain all effects that were asked for.
    """
    alone, able, why = replace(options, hold_out="0"), {}, {}
    for name, one in recordings.items():
        try:
            offered(*pose(robot, one, alone, answer), alone)
        except (LogError, UsageError) as error:
            why[name] = error.problem
        else:
            able[name] = one
    return able, why


def refits(
    robot: Robot,
    recordings: Mapping[str, Recording],
    options: DiagnosisOptions,
    answer: SimConfig,
    limit: float,
) -> Search[Refits]:
    """The answer fitted to each recording alone, on all of it, and what that says of each size and parameter.

    limit : nats from which values are said to differ. Where some do, the fits begin again where these were found to be,
    with all else shared: what one recording alone does not tell is then taken from the others. Raises as `pose`.
    """
    begun = dict.fromkeys(recordings, answer)
    for _ in range(ROUNDS):
        each = [fitted_to(robot, one, options, begun[name], answer) for name, one in recordings.items()]
        found = dict(zip(recordings, (yield from together(each)), strict=True))
        shared = Shared.of(found).parted(limit)
        if not shared.apart:
            break
        begun = shared.simulators(answer)
    left = {name: Left(one.left, one.noise) for name, one in found.items()}
    return Refits(tuple(shared.refit(axis) for axis in shared.axes if not axis.shape), left)


def with_own_effects(
    robot: Robot,
    recordings: Mapping[str, Recording],
    options: DiagnosisOptions,
    answer: SimConfig,
    limit: float,
) -> Search[SimConfig]:
    """The answer plus, for each recording, at most one more effect.

    That is the one that a diagnosis of this recording alone, starting from the answer, accepts. limit : nats that a
    cause needs.
    """
    alone = replace(options, hold_out="0", max_causes=1)

    def one(recording: Recording) -> Search[Diagnosed]:
        model, data = pose(robot, recording, alone, answer)
        problem = yield from planned(model, data, offered(model, data, alone))
        return (yield from search(problem, recording, known(Threshold(limit, ())), alone))

    effects = dict(answer.effects)
    for made in (yield from together([one(recording) for recording in recordings.values()])):
        if made.found.accepted:
            point = made.found.current
            term = point.hypothesis.terms[-1]
            values = made.found.model.coordinates.effect_values(point.hypothesis, point.effect[None])[-1][0]
            sizes = zip(term.effect.parameters, values, strict=True)
            effects.setdefault(term.key, {p.name: float(v) for p, v in sizes})
    return replace(answer, effects=effects)


def fitted_to(
    robot: Robot, recording: Recording, options: DiagnosisOptions, begun: SimConfig, answer: SimConfig
) -> Search[Fitted]:
    """The parameters of a simulator, and the sizes of its effects, fitted to a recording.

    begun : where the fit begins; answer : the middle of the frame, with the same effects.
    """
    model, data = pose(robot, recording, replace(options, hold_out="0"), begun)
    frame = model.coordinates.about(robot.space.from_dict(dict(answer.values)))
    model = (yield from planned(model, data, ())).model
    begun = yield from calibrate(model, data, draws=0, seed=options.seed)
    state = yield from zeroed(State(begun.model, begun.sample, begun.point, begun.point), data)
    state = yield from _unpulled(state)
    sample, point = state.data.sample(data.parts.chosen), state.current
    draws = yield from posterior(state.model, point, sample, seed=options.seed)
    (residual,) = yield from state.model.residuals([point], sample)
    left = float(np.sqrt(np.nanmean(residual**2)))
    noise = float(np.sqrt(np.mean(data.floor)))
    return Fitted(state.model, point, draws, frame, left, noise)


def _unpulled(state: State) -> Search[State]:
    """The state fitted on, each time about the point that the last fit found, until it moves no further.

    So the nameplate holds back what the recording does not tell, and nothing that it tells. What is far from the start
    leaves a large residual with few independent samples: these are counted anew each time.
    """
    for _ in range(TURNS):
        model, point = state.model, state.current
        coordinates = model.coordinates.about(model.coordinates.values(point.nominal))
        model = replace(model, coordinates=coordinates)
        point = Point(point.hypothesis, np.zeros(len(coordinates)), point.effect)
        (residual,) = yield from model.residuals([point], state.sample)
        state = replace(state, model=model, current=point, sample=state.sample.reweighted(residual))
        (point,), _ = yield from fit(model, [point], state.pooled)
        state = replace(state, current=point)
        if np.abs(point.nominal).max(initial=0.0) <= NEAR:
            break
    return state
