"""What the simulators of a diagnosis do on the windows that it is judged by, and what is known of their parameters."""

from dataclasses import dataclass

import numpy as np

from dynreg.diagnose.diagnose import Diagnosed
from dynreg.diagnose.leftover import Leftover
from dynreg.diagnose.look import Look, look
from dynreg.diagnose.loose import Loose, loose_ends
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.rest import rest
from dynreg.diagnose.where import ErrorRow, split_errors
from dynreg.evidence.data import Data
from dynreg.evidence.estimate import Estimate, estimates
from dynreg.evidence.interval import Posterior, posterior
from dynreg.evidence.likelihood import information
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.slopes import sensitivities
from dynreg.replay.jitter import jitter
from dynreg.replay.judged import Gain, channel_errors, gain
from dynreg.sim.effects import Terms


@dataclass(frozen=True)
class Account:
    """Of a diagnosis, by the windows that it is judged by.

    states : (3, W, T+1, S) of the simulator that it began with, the calibrated and the extended one. errors : (3, C)
    their mean absolute errors in every weighted channel, in its unit. where : the calibrated one's by regime of motion.
    gains : of each cause over the causes before it; gain : of all together; None where nothing was held out.
    causes : parameters of each cause. draws : of the extended simulator. simulators : by kind, parameters (P,) and
    effects. rest : None where nothing is left. simulated : how many simulators were run through the judged windows.
    """

    states: np.ndarray
    errors: np.ndarray
    where: tuple[ErrorRow, ...]
    gains: tuple[Gain | None, ...]
    gain: Gain | None
    causes: tuple[dict[str, Estimate], ...]
    draws: Posterior
    simulators: dict[str, tuple[np.ndarray, Terms | None]]
    loose: Loose
    look: Look | None
    rest: tuple[Leftover, ...] | None
    simulated: int


def told(search: Search[Diagnosed], options: DiagnosisOptions) -> Search[tuple[Diagnosed, Account]]:
    """What a search for causes came to, and the account of it."""
    made = yield from search
    return made, (yield from account(made, options))


def account(made: Diagnosed, options: DiagnosisOptions) -> Search[Account]:
    """Simulate the windows that the diagnosis is judged by, once, and say what follows."""
    found, problem, judged, seed = made.found, made.problem, made.judged, options.seed
    model, data, posed = found.model, found.data, problem.data
    given, chosen = found.current.hypothesis.given, posed.parts.chosen
    points = [problem.model.start, found.base, *_stages(found)]
    states = yield from problem.model.states(points, posed.windows.run.take(judged))
    three = np.stack([states[0], states[1], states[-1]])
    sample = data.sample(chosen)
    draws = yield from posterior(model, found.current, sample, seed=seed)
    (residual,), (slope,) = yield from sensitivities(model, [found.current], sample)
    curvature, _ = information(found.current, residual, slope, sample.reweighted(residual))
    # of the log posterior; sizes have no prior, and one that does nothing no curvature
    covariance = np.linalg.pinv(curvature + 1e-9 * np.eye(len(curvature)))
    left = [posed.window_errors(one, judged) for one in states] if made.tested else []
    gained = lambda i, j: gain(left[i], left[j]) if left else None  # noqa: E731
    kinds = {"calibrated": found.base} | ({"extended": found.current} if found.accepted else {})
    return Account(
        states=three,
        errors=channel_errors(posed.windows, three, judged)[:, posed.use],
        where=split_errors(model.robot, posed.windows.take(judged), three[1]),
        gains=tuple(gained(1 + i, 2 + i) for i in range(found.accepted)),
        gain=gained(1, -1) if found.accepted else None,
        causes=tuple(estimates(model, found.current, given + i, draws) for i in range(found.accepted)),
        draws=draws,
        simulators={kind: simulator(model, posed, one, options) for kind, one in kinds.items()},
        loose=loose_ends(model.coordinates, covariance),
        look=(yield from look(found, draws, sample, options)),
        rest=(yield from rest(found, made.verdict, seed)),
        simulated=len(states),
    )


def simulator(
    model: Model, data: Data, point: Point, options: DiagnosisOptions
) -> tuple[np.ndarray, Terms | None]:
    """Parameters (P,) of the point's simulator, and its effects (of one row; None without).

    It has the motor noise that the windows to fit and to select by tell: no fit sees that; see `replay.jitter`.
    """
    values, own = model.coordinates.values(point.nominal), point.hypothesis.terms
    told = model.coordinates.effect_values(point.hypothesis, point.effect[None])
    terms = Terms(own, tuple(told)) if own else None
    where = {"engine": model.engine, "threads": options.threads, "seed": options.seed}
    return jitter(model.robot, data.windows, values, terms, data.parts.chosen, **where), terms


def _stages(found: State) -> list[Point]:
    """The point after each accepted cause; the last is the extended simulator, refitted on fit and select."""
    after = [naming.chosen.point for naming in found.rounds[: found.accepted]]
    return [*after[:-1], found.current] if after else [found.current]
