"""What the simulators of a diagnosis do on the windows that it is judged by, and what is known of their parameters."""

from dataclasses import dataclass

import numpy as np

from dynreg.diagnose.diagnose import Diagnosed, Found
from dynreg.diagnose.estimate import Estimate, estimates
from dynreg.diagnose.fit import information, sensitivities
from dynreg.diagnose.interval import Posterior, posterior
from dynreg.diagnose.leftover import Leftover
from dynreg.diagnose.look import Look, look
from dynreg.diagnose.loose import Loose, loose_ends
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.problem import Point
from dynreg.diagnose.rest import rest
from dynreg.diagnose.where import ErrorRow, split_errors
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


def account(made: Diagnosed, options: DiagnosisOptions) -> Account:
    """Simulate the windows that the diagnosis is judged by, once, and say what follows."""
    problem, found, chosen, judged = made.problem, made.found, made.split.chosen, made.judged
    given = found.extended.hypothesis.given
    states = problem.states([problem.start, found.base, *_stages(found)], judged)
    three = np.stack([states[0], states[1], states[-1]])
    draws = posterior(found.problem, found.extended, chosen, seed=options.seed)
    kinds = {"calibrated": found.base} | ({"extended": found.extended} if found.accepted else {})
    residual, slopes = sensitivities(found.problem, [found.extended], chosen)
    effective = found.problem.effective(residual[0])
    curvature, _ = information(found.problem, found.extended, residual[0], slopes[0], effective)
    covariance = np.linalg.pinv(curvature + 1e-9 * np.eye(len(curvature)))  # of the log posterior
    left = [problem.window_errors(one, judged) for one in states] if made.tested else []
    gained = lambda i, j: gain(left[i], left[j]) if left else None  # noqa: E731
    return Account(
        states=three,
        errors=channel_errors(problem.windows, three, judged)[:, problem.use],
        where=split_errors(problem.robot, problem.windows.take(judged), three[1]),
        gains=tuple(gained(1 + i, 2 + i) for i in range(found.accepted)),
        gain=gained(1, -1) if found.accepted else None,
        causes=tuple(estimates(problem, found.extended, given + i, draws) for i in range(found.accepted)),
        draws=draws,
        simulators={kind: problem.simulator(one, chosen, seed=options.seed) for kind, one in kinds.items()},
        loose=loose_ends(problem.coordinates, covariance),
        look=look(found.problem, found, draws, chosen, options),
        rest=rest(found.problem, found.extended, chosen, made.verdict, options.seed),
        simulated=len(states),
    )


def _stages(found: Found) -> list[Point]:
    """The point after each accepted cause; the last is the extended simulator, refitted on fit and select."""
    after = [naming.chosen.point for naming in found.rounds[: found.accepted]]
    return [*after[:-1], found.extended] if after else [found.extended]
