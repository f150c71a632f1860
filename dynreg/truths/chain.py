"""A serial chain of hinges in the field of gravity: its links, and what is added to them."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Chain:
    """n links, each hanging on the one before by a hinge; lengths [m], masses [kg].

    at : (n, 3) of each hinge in the link before. axis : (n, 3) unit axes, links' frames are parallel where all angles
    are 0. mass : (n,). centre : (n, 3) of mass, from the hinge. inertia : (n, 3, 3) about it. gravity : (3,) [m/s^2].
    """

    at: np.ndarray
    axis: np.ndarray
    mass: np.ndarray
    centre: np.ndarray
    inertia: np.ndarray
    gravity: np.ndarray

    @property
    def parts(self) -> tuple[np.ndarray, ...]:
        """What `links.dynamics` takes of a chain."""
        return self.at, self.axis, self.mass, self.centre, self.inertia, self.gravity

    def carrying(self, link: int, mass: float, centre: np.ndarray) -> "Chain":
        """The chain with a point mass [kg] at `centre` (3,) [m] of a link's frame."""
        whole = self.mass[link] + mass
        middle = (self.mass[link] * self.centre[link] + mass * centre) / whole
        about = (
            self.inertia[link]
            + _point(self.mass[link], self.centre[link] - middle)
            + _point(mass, centre - middle)
        )
        masses, centres, inertias = self.mass.copy(), self.centre.copy(), self.inertia.copy()
        masses[link], centres[link], inertias[link] = whole, middle, about
        return replace(self, mass=masses, centre=centres, inertia=inertias)

    def shifted(self, link: int, by: np.ndarray) -> "Chain":
        """The chain with the centre of mass of a link moved by (3,) [m]."""
        centres = self.centre.copy()
        centres[link] += by
        return replace(self, centre=centres)

    def tilted(self, axis: np.ndarray, angle: float) -> "Chain":
        """The chain with gravity turned by `angle` [rad] about a unit axis (3,)."""
        g = self.gravity
        turned = (
            g * np.cos(angle) + np.cross(axis, g) * np.sin(angle) + axis * (axis @ g) * (1.0 - np.cos(angle))
        )
        return replace(self, gravity=turned)

    def on_stand(self, axis: np.ndarray, inertia: float) -> "Chain":
        """The chain on one more hinge at its foot, the first, whose link has only an inertia [kg m^2]."""
        joined = lambda first, rest: np.concatenate([np.asarray(first, dtype=float)[None], rest])  # noqa: E731
        return replace(
            self,
            at=joined(np.zeros(3), self.at),
            axis=joined(axis, self.axis),
            mass=joined(0.0, self.mass),
            centre=joined(np.zeros(3), self.centre),
            inertia=joined(inertia * np.eye(3), self.inertia),
        )


def _point(mass: float, r: np.ndarray) -> np.ndarray:
    """(3, 3) inertia of a point mass at r (3,)."""
    return mass * (r @ r * np.eye(3) - np.outer(r, r))
