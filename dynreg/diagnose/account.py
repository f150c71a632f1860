"""The evaluation of a diagnosis: errors of its simulators on the judged windows, gains, and parameter intervals."""

from dataclasses import dataclass, replace

import numpy as np

from dynreg.diagnose.diagnose import Diagnosed
from dynreg.diagnose.examine import Examined, examine
from dynreg.diagnose.identifiability import Unidentified, same_as_parameters, unidentified
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.residual_fit import ResidualFit
from dynreg.diagnose.unexplained import unexplained
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
from dynreg.sim.effects import Terms


@dataclass(frozen=True)
class Account:
    """The evaluation of a diagnosis on the judged windows (the test part; without one the select part).

    states : (3, W, T+1, S) of the initial, the calibrated and the extended simulator. where : errors of the calibrated
    simulator by regime. shares : (P',) of what calibration gains on the fit and select parts, what each free parameter
    makes alone; None where it gains nothing there.
    causes : parameters of each cause. draws : posterior draws of the extended simulator. simulators : {kind: parameters
    (P,) and effects}. unidentified : parameters that the recording does not identify. same :
    (key of a cause, parameter) that do the same. examined : the cause with its
    rivals. residuals : fits of the unexplained acceleration; None if the causes explain everything.
    """

    states: np.ndarray
    where: tuple[ErrorRow, ...]
    shares: np.ndarray | None
    causes: tuple[dict[str, Estimate], ...]
    draws: Posterior
    simulators: dict[str, tuple[np.ndarray, Terms | None]]
    unidentified: Unidentified
    same: tuple[tuple[str, str], ...]
    examined: Examined | None
    residuals: tuple[ResidualFit, ...] | None


def with_account(search: Search[Diagnosed], options: DiagnosisOptions) -> Search[tuple[Diagnosed, Account]]:
    """The result of a search for causes, and its evaluation."""
    made = yield from search
    return made, (yield from account(made, options))


def account(made: Diagnosed, options: DiagnosisOptions) -> Search[Account]:
    """What the judged windows and the posterior of a diagnosis say."""
    found, problem, judged, seed = made.found, made.problem, made.judged, options.seed
    model, data, posed = found.model, found.data, problem.data
    given, chosen = found.current.hypothesis.given, posed.parts.chosen
    three = judged.states[[judged.START, judged.CALIBRATED, judged.last]]
    sample = data.sample(chosen)
    draws = yield from posterior(model, found.current, sample, seed=seed)
    (residual,), (slope,) = yield from sensitivities(model, [found.current], sample)
    curvature, _ = information(found.current, residual, slope, sample.reweighted(residual))
    # of the log posterior; effect sizes have no prior, so an effect without influence has no curvature
    covariance = np.linalg.pinv(curvature + 1e-9 * np.eye(len(curvature)))
    names = [model.robot.space.parameters[i].name for i in model.coordinates.free]
    kinds = {"calibrated": found.base} | ({"extended": found.current} if found.accepted else {})
    return Account(
        states=three,
        where=split_errors(model.robot, posed.windows.take(judged.windows), three[1]),
        shares=(yield from _shares(made)),
        causes=tuple(estimates(model, found.current, given + i, draws) for i in range(found.accepted)),
        draws=draws,
        simulators={kind: simulator(model, posed, one, options) for kind, one in kinds.items()},
        unidentified=unidentified(model.coordinates, covariance),
        same=same_as_parameters(found.current, names, curvature),
        examined=(yield from examine(found, draws, sample, options)),
        residuals=(yield from unexplained(found, made.verdict, seed)),
    )


def _shares(made: Diagnosed) -> Search[np.ndarray | None]:
    """(P',) what each parameter of the calibrated simulator makes alone in that at the start, as a share of its gain.

    On the fit and select parts: the test part tells nothing of which parameter it was.
    """
    model, posed = made.problem.model, made.problem.data
    start, calibrated, chosen = model.start, made.found.base, posed.parts.chosen
    alone = np.diag(calibrated.nominal - start.nominal) + start.nominal
    points = [start, calibrated, *(replace(start, nominal=one) for one in alone)]
    states = yield from model.states(points, posed.windows.run.take(chosen))
    began, ended, *each = (posed.window_errors(one, chosen).mean() for one in states)
    return (began - np.array(each)) / (began - ended) if began > ended else None


def simulator(
    model: Model, data: Data, point: Point, options: DiagnosisOptions
) -> tuple[np.ndarray, Terms | None]:
    """Parameters (P,) of the point's simulator, and its effects (one row; None without).

    Its motor noise is estimated from the fit and select windows, because no fit sees it; see `replay.jitter`.
    """
    values, own = model.coordinates.values(point.nominal), point.hypothesis.terms
    sizes = model.coordinates.effect_values(point.hypothesis, point.effect[None])
    terms = Terms(own, tuple(sizes)) if own else None
    where = {"engine": model.engine, "threads": options.threads, "seed": options.seed}
    return jitter(model.robot, data.windows, values, terms, data.parts.chosen, **where)[0], terms
