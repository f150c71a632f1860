"""The ways that a gait goes over the ground, as they are kept."""

from dataclasses import dataclass

import numpy as np

from dynreg.gait.seek import Simulated
from dynreg.gait.tasks import YAW, X, Y

POINTS = 100  # of a way that is kept


@dataclass(frozen=True)
class Way:
    """A gait in one simulator: its fitness (0 for a fall), and the body's way over the ground [m, rad].

    time [s] of the points of the way, before a fall. contacts : {foot: times [s] between which it is on the ground}.
    """

    fitness: float
    fell: bool
    time: list[float]
    x: list[float]
    y: list[float]
    yaw: list[float]
    contacts: dict[str, list[tuple[float, float]]]


def ways(simulated: Simulated, rate: float) -> tuple[Way, ...]:
    """Of a gait in every simulator, with so many commands a second."""
    return tuple(_way(simulated, i, rate) for i in range(len(simulated.fitness)))


def _way(simulated: Simulated, i: int, rate: float) -> Way:
    base = simulated.walk.base[i, 0]
    last = min(int(simulated.walk.fell[i, 0]), len(base)) - 1
    at = np.unique(np.linspace(0, max(last, 0), POINTS).astype(int))
    contacts = simulated.walk.contact.items()
    return Way(
        fitness=float(simulated.fitness[i]),
        fell=bool(simulated.fell[i]),
        time=(at / rate).tolist(),
        x=base[at, X].tolist(),
        y=base[at, Y].tolist(),
        yaw=base[at, YAW].tolist(),
        contacts={foot: _spans(touching[i, 0, : last + 1], rate) for foot, touching in contacts},
    )


def _spans(touching: np.ndarray, rate: float) -> list[tuple[float, float]]:
    """Times [s] between which (T,) flags are set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], touching.astype(int), [0]])))
    return [(float(a / rate), float(b / rate)) for a, b in edges.reshape(-1, 2)]
