"""A planar arm of two links that hangs in a vertical plane, with position drives."""

from collections.abc import Mapping

import numpy as np

from dynreg.truths.arms import Arm, joint_sensors, of_positions
from dynreg.truths.causes import Units
from dynreg.truths.chain import Chain

JOINTS = ("shoulder", "elbow")


def _chain(parameters: Mapping[str, float], settings: Mapping[str, float]) -> Chain:
    return Chain(
        at=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.3]]),
        axis=np.array([[0.0, 1.0, 0.0]] * 2),
        mass=np.array([parameters["upper_mass"], parameters["fore_mass"]]),
        centre=np.array([[0.0, 0.0, -0.15], [0.0, 0.0, -0.14]]),
        inertia=np.array([np.diag([0.009, 0.009, 0.0008]), np.diag([0.0045, 0.0045, 0.0004])]),
        gravity=np.array([0.0, 0.0, -9.80665]),
    )


def _drives(parameters: Mapping[str, float], settings: Mapping[str, float]) -> np.ndarray:
    own = lambda name: np.array([parameters[f"{joint}_{name}"] for joint in JOINTS])  # noqa: E731
    limit = parameters["torque"] * np.array([12.0, 6.0])
    return of_positions(
        own("gain"), np.array([2.0, 0.5]), limit, own("rotor"), own("damping"), own("friction")
    )


TWO_JOINT_ARM = Arm(
    joints=JOINTS,
    home=np.zeros(2),
    chain=_chain,
    drives=_drives,
    tilts=np.array([0.0, 1.0, 0.0]),
    carrier=(0, np.array([-1.0, 0.0, 0.0])),
    tool=(1, np.array([0.0, 0.0, -0.25])),
    # means of both joints: torque limits, 1 / gains, what a torque on a joint alone speeds up; the mass of the fore arm
    units=Units(torque=9.0, stiffness=0.0375, inertia=0.0638, length=0.15, mass=0.8),
    sensors=joint_sensors(JOINTS, (0.0005, 0.001534), (0.05, 0.0)),
)
