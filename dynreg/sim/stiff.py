"""Drives that are too fast for a time step: how quickly each damps its joint."""

from dataclasses import dataclass

import mujoco
import numpy as np

from dynreg.sim.layout import layout_of
from dynreg.sim.ports import ServoLaw
from dynreg.sim.robot import Robot

FOLLOWED = (
    0.5  # of rate * time step / inertia, up to which a step leaves a speed its sign and most of its size
)
EXPLICIT = (int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtIntegrator.mjINT_RK4))


@dataclass(frozen=True)
class StiffDrive:
    """A drive that takes more than half of its joint's speed in a time step.

    gain, rate : torque for an angle and for a speed, by its law. inertia : of the joint with all others free
    [kg*m^2 or kg]. step : [s]. explicit : whether the integrator takes the torque from before the step.
    """

    joint: str
    gain: float
    rate: float
    inertia: float
    step: float
    explicit: bool

    @property
    def ratio(self) -> float:
        """Share of the joint's speed that a time step takes: from 1 on it swings, from 2 on it diverges if explicit."""
        return self.rate * self.step / self.inertia

    def __str__(self) -> str:
        swings = ", swings from 1 on, diverges from 2 on" if self.explicit else ""
        lower, raised, finer = (
            f"{x:.1g}"
            for x in (
                FOLLOWED * self.inertia / self.step,
                self.rate * self.step / FOLLOWED,
                FOLLOWED * self.inertia / self.rate,
            )
        )
        return (
            f"the drive of joint {self.joint!r} is too fast: gain {self.gain:.3g}, rate gain {self.rate:.3g}, "
            f"inertia {self.inertia:.2g}, rate gain * time step / inertia = {self.ratio:.2g} (followed to "
            f"{FOLLOWED:g}{swings}); lower the rate gain to {lower}, give the joint the armature of its rotor and "
            f"gear, to {raised} in all, or take a time step of {finer} s"
        )


def free_inertias(model: mujoco.MjModel, keyframe: int) -> np.ndarray:
    """(nv,) inertia [kg*m^2 or kg] of each degree of freedom with all others free, in a keyframe's pose (-1: qpos0)."""
    data, matrix = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    if keyframe >= 0:
        mujoco.mj_resetDataKeyframe(model, data, keyframe)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, matrix)
    return 1.0 / np.maximum(np.diag(np.linalg.pinv(matrix)), 1e-12)


def stiffest(robot: Robot, law: ServoLaw, engine: str) -> StiffDrive | None:
    """The drive that damps its joint fastest, by the law (1, A); None where the time step follows it."""
    explicit = engine == "joint" or robot.model.opt.integrator in EXPLICIT
    step = 1.0 / robot.rate / robot.substeps(1.0 / robot.rate)
    dofs = layout_of(robot).action_dof
    inertia = free_inertias(robot.model, robot.keyframe)[dofs]
    rate = law.rate[0]
    worst = int(np.argmax(rate / inertia))
    if rate[worst] * step <= FOLLOWED * inertia[worst]:
        return None
    numbers = (float(x[worst]) for x in (law.stiffness[0], rate, inertia))
    return StiffDrive(robot.joints[worst], *numbers, float(step), explicit)
