"""Calibrate: the model without a cause at its maximum a posteriori."""

from dataclasses import dataclass

from dynreg.evidence.data import Data, Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.rng import stream

# bench_constants names 16 of 21 with half and with twice of all, `Short.draws` too; with twice, in 1.1 times the time,
# the calibrated model leaves a cause less to gain, 2335 nats of 2646.
BEGUN = 3  # iterations of all starts,
CLOSER, FINALISTS = 3, 2  # then so many more of the best few,
ITERATIONS = 8  # and of the best alone, once more where the time step's part is taken off;
ENOUGH = 0.05  # nats that an iteration must gain for another one


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The simulator that a search for causes begins with.

    model : with what the time step does to it taken off. point : where it lies. sample : the windows to fit, by the
    independent samples of its residual.
    """

    model: Model
    point: Point
    sample: Sample


def calibrate(model: Model, data: Data, *, draws: int, seed: int = 0) -> Search[Calibrated]:
    """Fit the simulator that the model begins with a posteriori, on the windows to fit.

    Starts at the nameplate and at `draws` from its tolerances: dry friction makes local optima.
    """
    start, sample = model.start, data.sample(data.fit)
    apart = stream(seed, "calibrate").standard_normal((draws, len(model.coordinates)))
    points = [Point(start.hypothesis, z, start.effect) for z in (start.nominal, *apart)]
    if model.accuracy.fine:  # what the time step does to contacts leads the fit astray from its start
        model = yield from model.corrected(points[:1], data)
    points, cost = yield from fit(model, points, sample, iterations=BEGUN)
    for rounds, kept in ((CLOSER, FINALISTS), (ITERATIONS, 1)) if draws else ((ITERATIONS, 1),):
        points = best_of(points, cost, kept)
        sample = sample.reweighted((yield from model.residuals(points[:1], sample))[0])
        points, cost = yield from fit(model, points, sample, iterations=rounds, tolerance=ENOUGH)
    if model.accuracy.order == 1:
        model = yield from model.corrected(points, data)
        points, cost = yield from fit(model, points, sample, iterations=ITERATIONS, tolerance=ENOUGH)
    (residual,) = yield from model.residuals(points, sample)
    return Calibrated(model, points[0], sample.reweighted(residual))
