"""The servo bench: a duty servo that swings a point mass; numbers of an XL330-M288 (Rhoban/bam's bench)."""

from collections.abc import Mapping

import numpy as np

from dynreg.truths.arms import Arm, joint_sensors
from dynreg.truths.causes import Units
from dynreg.truths.chain import Chain
from dynreg.truths.rows import ROWS, plain

LENGTH = 0.10  # m
ROD = 0.0001  # kg
SUPPLY = 7.4  # V
DUTY_GAIN = 0.002877  # 1/rad, for each unit of kp
KP = 400.0
GRAVITY = 9.80665  # m/s^2


def _chain(parameters: Mapping[str, float], settings: Mapping[str, float]) -> Chain:
    mass = parameters["tip_mass"] + settings.get("added_mass", 0.0)
    # a rod of 8 mm, and a point mass at its end
    rod = np.diag([ROD * LENGTH**2 / 12.0] * 2 + [0.0])
    link = Chain(
        np.zeros((1, 3)),
        np.array([[0.0, 1.0, 0.0]]),
        np.array([ROD]),
        np.array([[0.0, 0.0, -LENGTH / 2.0]]),
        rod[None],
        np.array([0.0, 0.0, -GRAVITY]),
    )
    return link.carrying(0, mass, np.array([0.0, 0.0, -LENGTH]))


def _drives(parameters: Mapping[str, float], settings: Mapping[str, float]) -> np.ndarray:
    """The firmware's law: duty = clip(DUTY_GAIN kp (u - q), +-1), current = (duty supply - kt v) / resistance."""
    kt, resistance = parameters["torque_constant"], parameters["resistance"]
    stall = kt / resistance * SUPPLY
    rows = {
        "gain": DUTY_GAIN * settings.get("kp", KP) * stall,
        "limit": stall,
        "back_emf": kt**2 / resistance,
        "armature": parameters["rotor_inertia"],
        "viscous": parameters["viscous_friction"],
        "coulomb": parameters["coulomb_friction"],
        "offset": parameters["zero_offset"],
    }
    x = plain(1)
    for name, value in rows.items():
        x[ROWS.index(name)] = value
    return x


SERVO = Arm(
    joints=("arm",),
    home=np.zeros(1),
    chain=_chain,
    drives=_drives,
    tilts=np.array([0.0, 1.0, 0.0]),
    carrier=(0, np.array([-1.0, 0.0, 0.0])),
    tool=(0, np.array([0.0, 0.0, -LENGTH])),
    # stall torque, 1 / stiffness at kp 400, the mass on its rod, the rod, the mass
    units=Units(torque=0.5756, stiffness=1.510, inertia=0.0049, length=0.1, mass=0.49),
    sensors=joint_sensors(("arm",), (0.0005, 0.001534), (0.02, 0.024)),
    supply=SUPPLY,
)
