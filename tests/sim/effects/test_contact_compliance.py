"""Softer contacts: the same change of their time constant, however a model states their stiffness."""

from types import SimpleNamespace

import numpy as np
import pytest

from dynreg.sim.effects import effects
from dynreg.sim.effects.contact import touching_geoms
from dynreg.sim.robot import Robot, load_robot

TOUCHING = ("geom_contype", "geom_conaffinity", "geom_bodyid", "pair_geom1", "pair_geom2", "pair_solref")


def test_a_direct_solref_becomes_softer_as_a_time_constant_does():
    """(0.02 s, 1) is a stiffness of 2500 and a damping of 100, which grew to 6250 with the constant."""
    robot = load_robot("quadruped")
    touching = touching_geoms(robot)
    for stated, softer in (((0.02, 1.0), (0.05, 1.0)), ((-2500.0, -100.0), (-1 / 0.05**2, -2 / 0.05))):
        geoms = np.tile(stated, (robot.model.ngeom, 1))
        solref = geoms[None].copy()
        of = SimpleNamespace(model=SimpleNamespace(geom_solref=geoms, **touches(robot)))
        site = SimpleNamespace(robot=of, rows=slice(None), expand={"geom_solref": solref}.get)
        effects()["contact_compliance"].configure(site, {"softening": np.array([[1.5]])})
        assert solref[0, touching] == pytest.approx(np.tile(softer, (len(touching), 1)))
        others = np.setdiff1d(np.arange(robot.model.ngeom), touching)
        np.testing.assert_array_equal(solref[0, others], geoms[others])


def touches(robot: Robot) -> dict[str, np.ndarray]:
    """Which of a robot's geoms touch which."""
    return {name: getattr(robot.model, name) for name in TOUCHING}
