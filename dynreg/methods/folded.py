"""A displacement table's corrections as a simulator: a gain of each wheel and one of turns."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from dynreg.methods.displaced import Displaced, Samples, Simulators, off
from dynreg.replay.velocity import pose_columns
from dynreg.sim.effects.wheels import WheelGain
from dynreg.timed.commands import FINE
from dynreg.timed.table import DisplacementTable

GAIN, DIFFERENCE, MOST = WheelGain.id, WheelGain.parameters[0].name, WheelGain.parameters[0].most
# what a gain of both wheels, and one of turns, is called in robot.toml
SETS = ("base.wheel_radius", "base.track")
# Our choices:
STEP = 0.01  # of a coordinate, for slopes
SMALL = 1e-3  # a step of no coordinate is longer: it is there
ROUNDS = 6  # of Gauss and Newton at most
SURE = 2.0  # standard errors by which the wheels must differ


@dataclass(frozen=True, eq=False)
class Folded:
    """A simulator made of a table: parameters (P,) in the unit cube and how much the wheels differ (`WheelGain`).

    explained : share of the squared corrections, each in units of its standard error, that it brings; None of one that
    the budget did not let be tried. whole : whether the budget lasted.
    """

    unit: np.ndarray
    difference: float
    explained: float | None
    whole: bool


@dataclass(frozen=True, eq=False)
class Folder:
    """Fits simulators to tables of what a simulator with parameters (P,) in the unit cube, `begin`, leaves.

    Coordinates (F+1,) are by how much the free parameters differ from `begin`, and the difference of the wheels in
    units of `MOST`. most : simulators at most, of all fits.
    """

    simulators: Simulators
    begin: np.ndarray
    most: int | None = None

    @property
    def free(self) -> np.ndarray:
        """Numbers (F,) of the fitted parameters: radius of the wheels and track, where the log does not tell them."""
        data = self.simulators.data
        own = [any(a.root == "port" and a.path in SETS for a in sets) for sets in data.robot.setters]
        return np.flatnonzero(np.array(own) & np.isnan(data.known))

    def fold(
        self,
        table: DisplacementTable,
        pieces: Displaced,
        samples: Samples,
        begun: np.ndarray,
        near: Folded | None,
    ) -> Folded:
        """By least squares over the cells of a table whose rows are `samples` of the pieces.

        begun : (n, 3) what the simulator that is corrected moves in the pieces. near : where the fit sets out. What the
        table says nothing of stays as it began. Wheels that do not differ by `SURE` standard errors are alike.
        """
        wanted = _Wanted.of(table, self._noise)
        begin = np.zeros(len(self.free) + 1)
        if near is not None:
            begin = np.append(near.unit[self.free] - self.begin[self.free], near.difference / MOST)

        def brought(x: np.ndarray) -> np.ndarray:
            return wanted.of_cells(self._moved_more(x, pieces, samples, begun))

        found = self._fit(wanted, brought, begin, np.ones(len(begin), dtype=bool))
        if found.whole and abs(found.x[-1]) < SURE * found.error:
            alike = np.arange(len(begin)) < len(begin) - 1
            found = self._fit(wanted, brought, np.where(alike, found.x, 0.0), alike)
        unit, first = self.begin.copy(), wanted.squared
        unit[self.free] += found.x[:-1]
        explained = None
        if found.loss is not None:
            explained = 1.0 - found.loss / first if first > 0.0 else 0.0
        return Folded(unit, float(MOST * found.x[-1]), explained, found.whole)

    @property
    def _noise(self) -> np.ndarray:
        """(3,) the least scatter of a sample [m, m, rad]: that of the sensors, in the two poses of a piece."""
        robot = self.simulators.data.robot
        x, y, yaw = robot.sensor_noise[pose_columns(robot)]
        return np.maximum(np.sqrt(2.0) * np.array([max(x, y), max(x, y), yaw]), FINE)

    def _fit(
        self,
        wanted: "_Wanted",
        brought: Callable[[np.ndarray], np.ndarray],
        x: np.ndarray,
        moves: np.ndarray,
    ) -> "_Fit":
        """By Gauss and Newton from x (F+1,), along the coordinates that move (a mask).

        brought : (B, C) corrections that simulators x (B, F+1) bring.
        """
        found = _Fit(x, None if x.any() else wanted.squared, 0.0, True)
        low = np.append(-self.begin[self.free], -1.0)[moves]
        high = np.append(1.0 - self.begin[self.free], 1.0)[moves]
        for number in range(ROUNDS if moves.any() else 0):
            if self.most is not None and self.simulators.ran + moves.sum() + 1 > self.most:
                return replace(found, whole=False)
            # inwards at a bound: nothing moves beyond it
            steps = np.where(x[moves] + STEP > high, -STEP, STEP)
            tried = brought(np.concatenate([x[None], x + steps[:, None] * np.eye(len(x))[moves]]))
            residual = tried[0] - wanted.value
            loss = float(residual @ residual)
            if number and loss >= found.loss:
                break
            # a whole range is one standard deviation of what is known before
            slopes = np.concatenate([(tried[1:] - tried[0]).T / steps, np.eye(moves.sum())])
            loose = max(loss / max(len(residual) - moves.sum(), 1), 1.0)
            found = _Fit(x, loss, float(np.sqrt(loose * np.linalg.inv(slopes.T @ slopes)[-1, -1])), True)
            rest = np.concatenate([residual, x[moves]])
            step = lsq_linear(slopes, -rest, (low - x[moves], high - x[moves])).x
            if np.abs(step).max() < SMALL:
                break
            x = x.copy()
            x[moves] += step
        return found

    def _moved_more(
        self, x: np.ndarray, pieces: Displaced, samples: Samples, begun: np.ndarray
    ) -> np.ndarray:
        """(B, s, 3) what simulators x (B, F+1) move more than what is corrected, in each sample."""
        unit = np.tile(self.begin, (len(x), 1))
        unit[:, self.free] += x[:, :-1]
        values = self.simulators.data.values_of(unit)
        moved = self.simulators.moved(pieces, values, {GAIN: MOST * x[:, -1:]})
        return np.array([samples.mean(off(one, begun)) for one in moved])


@dataclass(frozen=True, eq=False)
class _Fit:
    """Coordinates x (F+1,), the squared rest there, the standard error of the last, and whether the budget lasted.

    loss : None where it was not tried.
    """

    x: np.ndarray
    loss: float | None
    error: float
    whole: bool


@dataclass(frozen=True, eq=False)
class _Wanted:
    """The corrections of a table (C,), in units of their standard errors: of each axis of each cell that has any.

    value : (C,). at : (C, 2) cell and axis of each. scale : (C,) standard errors [m, m, rad].
    """

    table: DisplacementTable
    value: np.ndarray
    at: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(cls, table: DisplacementTable, least: np.ndarray) -> "_Wanted":
        """By the scatter of all cells; least : (3,) of a sample, which a few of them may tell too small."""
        count, mean, deviation = table.moments()
        more = np.where(count >= 2, count - 1.0, 0.0)
        square = np.where(more > 0, more * np.nan_to_num(deviation) ** 2, 0.0).sum(axis=0)
        plain = np.sqrt(np.array([np.mean(table.values[table.counts[:, i], i] ** 2) for i in range(3)]))
        with np.errstate(divide="ignore", invalid="ignore"):
            pooled = np.where(more.sum(axis=0) > 0, np.sqrt(square / more.sum(axis=0)), plain)
        at = np.argwhere(count > 0)
        cell, axis = at.T
        scale = np.maximum(pooled, least)[axis] / np.sqrt(count[cell, axis])
        return cls(table, mean[cell, axis] / scale, at, scale)

    @property
    def squared(self) -> float:
        """What there is to explain."""
        return float(self.value @ self.value)

    def of_cells(self, brought: np.ndarray) -> np.ndarray:
        """(B, C) the same of values (B, s, 3) of the table's samples: means over those that count."""
        table = self.table
        out = []
        for values in brought:
            mean = DisplacementTable(table.cells, table.cell, values, table.born, table.counts).moments()[1]
            out.append(mean[tuple(self.at.T)] / self.scale)
        return np.array(out)
