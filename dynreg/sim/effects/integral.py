"""The integral part of a `pid` drive: no cause that anybody looks for, and so not in the table of effects."""

import numpy as np

from dynreg.sim.effects.effect import EffectParameter, Moment, OfAnyDrive, Values
from dynreg.sim.ports import Ports


class IntegralPart(OfAnyDrive):
    """The target is moved by `rate` times the integral of the error, rate = integral_gain / gain.

    So the drive's own law, that of a `position` drive, gives the torque of the integral beside its own: it is clipped,
    weakened, delayed and integrated with it, and every effect meets both. The error is that of the encoder's reading.
    The integral does not grow while the drive gives all that it can in its direction, and begins anew when the drive
    is switched on.
    """

    id, acts_on, title = "integral_part", "command", "the integral part of a drive"
    parameters = (
        EffectParameter("rate", "1/s", "of the target, for one unit of error", 1.0, 1.0, 1.0, 1.0),
        EffectParameter("gain", "N*m/rad", "the loop's", 1.0, 1.0, 1.0, 1.0),
    )

    def command(self, u: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        before = x.memory.get("integral")
        before = np.zeros_like(u) if before is None else before
        error = u - x.q
        asked = p["gain"] * (error + p["rate"] * before) - x.rate * x.v
        side = np.copysign(1.0, error)
        most = x.limit * np.minimum(np.maximum(1.0 - x.fade * (side * x.v), 0.0), 1.0)  # on that side
        after = before + np.where(side * asked > most, 0.0, x.h * error)
        x.memory["integral"] = np.where(x.stiffness > 0.0, after, 0.0)
        return u + p["rate"] * 0.5 * (before + after)  # the mean over the time step


INTEGRAL = IntegralPart()


def integral_values(ports: Ports, joints: np.ndarray) -> Values:
    """{name: (n, A')} its values for drives (A',) by their numbers, of n simulations, by their ports."""
    drive = {key: value[:, joints] for key, value in ports.drive.items()}
    rate = drive["integral_gain"] / np.maximum(drive["gain"], 1e-9)
    return {"rate": rate, "gain": drive["gain"] * drive["gain_factor"]}
