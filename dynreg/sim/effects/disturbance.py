"""Noise of hidden robots, which is no cause that anybody looks for: these effects are not in the table."""

import numpy as np

from dynreg.sim.effects.effect import EffectParameter, Moment, OfAnyDrive, Values


class Disturbance(OfAnyDrive):
    """Torque noise of a hidden robot, held for one command: 1 sigma of the run's draws."""

    id, acts_on, title = "disturbance", "drive", "torque noise"
    parameters = (EffectParameter("torque", "N*m", "1 sigma", 0.005, 0.005, 0.005, 1.0, per="torque"),)

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return torque + p["torque"] * x.draw


class Unsteadiness(OfAnyDrive):
    """Noise on the speeds that the drives of a hidden planar base are told, as `Disturbance`."""

    id, acts_on, title = "unsteadiness", "command", "noise on speeds"
    parameters = (EffectParameter("speed", "rad/s", "1 sigma", 0.005, 0.005, 0.005, 1.0, per="command"),)

    def command(self, u: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return u + p["speed"] * x.draw
