"""An arm of six joints and 21 kg with position drives, and a tool at its flange."""

from collections.abc import Mapping

import numpy as np

from dynreg.truths.arms import Arm, joint_sensors, of_positions
from dynreg.truths.causes import Units
from dynreg.truths.chain import Chain

JOINTS = ("base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3")
# each link: hinge in the link before [m], axis, mass [kg], centre [m], principal inertia [kg m^2]
_LINKS = (
    ((0.0, 0.0, 0.10), "z", 3.7, (0.0, 0.02, 0.03), (0.010, 0.009, 0.010)),
    ((0.0, 0.13, 0.06), "y", 8.0, (0.0, 0.0, 0.20), (0.140, 0.135, 0.018)),
    ((0.0, -0.12, 0.42), "y", 2.8, (0.0, 0.0, 0.17), (0.042, 0.041, 0.004)),
    ((0.0, 0.10, 0.39), "y", 1.3, (0.0, 0.02, 0.01), (0.0024, 0.0018, 0.0022)),
    ((0.0, 0.0, 0.09), "z", 1.3, (0.0, 0.02, 0.02), (0.0024, 0.0020, 0.0020)),
    ((0.0, 0.09, 0.02), "y", 0.4, (0.0, 0.03, 0.0), (0.0003, 0.0004, 0.0003)),
)
_AXES = {"y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def _chain(parameters: Mapping[str, float], settings: Mapping[str, float]) -> Chain:
    at, axis, mass, centre, inertia = zip(*_LINKS, strict=True)
    masses = np.array(mass)
    masses[1:3] = parameters["upper_arm_mass"], parameters["forearm_mass"]
    return Chain(
        np.array(at),
        np.array([_AXES[name] for name in axis]),
        masses,
        np.array(centre),
        np.array([np.diag(principal) for principal in inertia]),
        np.array([0.0, 0.0, -9.80665]),
    )


def _drives(parameters: Mapping[str, float], settings: Mapping[str, float]) -> np.ndarray:
    own = lambda name: np.array([parameters[f"{joint}_{name}"] for joint in JOINTS])  # noqa: E731
    rate_gain = np.array([200.0, 200.0, 120.0, 12.0, 10.0, 6.0])
    limit = parameters["torque"] * np.array([150.0, 150.0, 100.0, 28.0, 28.0, 28.0])
    return of_positions(own("gain"), rate_gain, limit, own("rotor"), own("damping"), own("friction"))


SIX_JOINT_ARM = Arm(
    joints=JOINTS,
    home=np.array([0.0, 0.4, 1.2, -0.4, 0.3, 0.0]),
    chain=_chain,
    drives=_drives,
    tilts=np.array([0.0, 1.0, 0.0]),
    carrier=(1, np.array([1.0, 0.0, 0.0])),
    tool=(5, np.array([0.0, 0.05, 0.0])),
    # means of the joints: torque limits, 1 / gains, what a torque on a joint alone speeds up; the stated payload
    units=Units(torque=80.67, stiffness=0.00153, inertia=1.66, length=0.2, mass=7.0),
    sensors=joint_sensors(JOINTS, (0.0005, 0.0001), (0.01, 0.0)),
)
