"""A leg of three joints, as the robot's MuJoCo model has it, and its kinematics in closed form.

The rotor turns the leg about the lateral axis, the elevator lifts it sideways about the fore-aft axis, the knee bends
it about the lateral axis again. All vectors are in the frame of the body that carries the leg: x ahead, y left, z up.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from dynreg.errors import RobotError, quoted
from dynreg.sim.engines.mujoco_reset import foot_spheres
from dynreg.sim.robot import Robot

ROLES = ("rotor", "elevator", "knee")
AXES = np.eye(3)[[1, 0, 1]]  # of the three joints: lateral, fore-aft, lateral
STRAIGHT = 1e-6  # by which an axis may miss its direction, and a length [m] its place
BRANCHES = tuple((knee, elevator) for knee in (1.0, -1.0) for elevator in (-1.0, 1.0))


@dataclass(frozen=True, eq=False)
class Leg:
    """A leg, with all of its joints unturned.

    hip : (3,) where the rotor is [m]. elevator, knee, foot : (3,) from the joint before [m]. signs, zero : (3,) a
    joint's angle is zero + sign * turn [rad]. rest : (3,) its angles in the reset pose. branch : which of the solutions
    is taken, of the knee and of the elevator.
    """

    hip: np.ndarray
    elevator: np.ndarray
    knee: np.ndarray
    foot: np.ndarray
    signs: np.ndarray
    zero: np.ndarray
    rest: np.ndarray
    branch: tuple[float, float]

    @property
    def length(self) -> float:
        """Of the upper and the lower part [m]."""
        return float(np.linalg.norm(self.knee) + np.linalg.norm(self.foot))

    def reaches(self, angles: np.ndarray) -> np.ndarray:
        """(..., 3) where the foot is at joint angles (..., 3)."""
        turns = self.signs * (angles - self.zero)
        lower = self.knee + _about_y(self.foot, turns[..., 2])
        return self.hip + _about_y(self.elevator + _about_x(lower, turns[..., 1]), turns[..., 0])

    def angles(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) joint angles that bring the foot to points (..., 3); where it cannot get there, as near as may be.

        Turns about y keep the distance from the lateral axis, and the elevator's axis crosses the rotor's. So the
        distance of the foot tells the knee, its place to the side then the elevator, and what is left is the rotor.
        """
        to_knee, to_elevator = self.branch
        away = points - self.hip - self.elevator
        aside = self.knee[1] + self.foot[1]
        (upper, lower), (leans, bends) = _polar(np.stack([self.knee, self.foot]))
        flat = np.square(away).sum(axis=-1) - aside**2
        bend = np.arccos(np.clip((flat - upper**2 - lower**2) / (2 * upper * lower), -1.0, 1.0))
        knee = leans - bends + to_knee * bend
        straight = self.knee + _about_y(self.foot, knee)
        radius, stands = np.hypot(aside, straight[..., 2]), np.arctan2(straight[..., 2], aside)
        share = np.clip(away[..., 1] / np.maximum(radius, STRAIGHT), -1.0, 1.0)
        elevator = to_elevator * np.arccos(share) - stands
        lifted = _about_x(straight, elevator)
        rotor = np.arctan2(away[..., 0], away[..., 2]) - np.arctan2(lifted[..., 0], lifted[..., 2])
        turns = np.stack([rotor, elevator, knee], axis=-1)
        rest = self.signs * (self.rest - self.zero)
        turns = rest + np.mod(turns - rest + np.pi, 2 * np.pi) - np.pi
        return self.zero + self.signs * turns


def legs_of(robot: Robot, joints: list[tuple[str, str, str]]) -> list[Leg]:
    """The legs whose rotor, elevator and knee have these names, as the model has them in the reset pose.

    Raises RobotError where the joints do not make such a leg.
    """
    model = robot.model
    data = mujoco.MjData(model)
    if robot.keyframe >= 0:
        mujoco.mj_resetDataKeyframe(model, data, robot.keyframe)
    rest = data.qpos.copy()
    numbers = [[model.joint(name).id for name in names] for names in joints]
    addresses = model.jnt_qposadr[numbers]
    data.qpos[addresses] = model.qpos0[addresses]
    mujoco.mj_kinematics(model, data)
    return [
        _leg(model, data, three, rest[at], names)
        for three, at, names in zip(numbers, addresses, joints, strict=True)
    ]


def _leg(
    model: mujoco.MjModel, data: mujoco.MjData, joints: list[int], rest: np.ndarray, names: tuple[str, ...]
) -> Leg:
    trunk = model.body_parentid[model.jnt_bodyid[joints[0]]]
    turned = data.xmat[trunk].reshape(3, 3)
    spheres = foot_spheres(model)
    own = spheres[
        model.body_weldid[model.geom_bodyid[spheres]] == model.body_weldid[model.jnt_bodyid[joints[2]]]
    ]
    if not len(own):
        raise _unlike(names, "it has no foot", "a sphere that can touch the ground, on what the knee moves")
    away = np.linalg.norm(data.geom_xpos[own] - data.xanchor[joints[2]], axis=1)
    places = [*data.xanchor[joints], data.geom_xpos[own[away.argmax()]]]
    hip, elevator, knee, foot = (np.array(places) - data.xpos[trunk]) @ turned
    signs = ((data.xaxis[joints] @ turned) * AXES).sum(axis=1)
    crooked = np.flatnonzero(np.abs(np.abs(signs) - 1.0) > STRAIGHT)
    if len(crooked):
        axis = "fore-aft" if crooked[0] == 1 else "lateral"
        raise _unlike(
            names, f"{names[crooked[0]]!r} does not turn about the {axis} axis", "rotor, elevator, knee"
        )
    if np.abs((elevator - hip)[[0, 2]]).max() > STRAIGHT:
        raise _unlike(names, "its first two axes do not cross", "an elevator beside its rotor, at most")
    vectors = (hip, elevator - hip, knee - elevator, foot - knee)
    zero = model.qpos0[model.jnt_qposadr[joints]]
    made = [Leg(*vectors, np.sign(signs), zero, rest, branch) for branch in BRANCHES]
    return min(made, key=lambda leg: np.abs(leg.angles(leg.reaches(rest)) - rest).max())


def _unlike(names: tuple[str, ...], what: str, expected: str) -> RobotError:
    return RobotError(
        f"the joints {quoted(names)} do not make a leg for a gait of kind 'locus': {what}",
        expected=expected,
        do="correct [[gait.legs]] in robot.toml or the MJCF, or choose kind = 'sines'",
    )


def _polar(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) length in the sagittal plane, and (n,) angle about y from z."""
    return np.hypot(vectors[:, 0], vectors[:, 2]), np.arctan2(vectors[:, 0], vectors[:, 2])


def _about_y(vector: np.ndarray, angle: np.ndarray) -> np.ndarray:
    x, y, z = np.moveaxis(vector, -1, 0)
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack(np.broadcast_arrays(x * cos + z * sin, y, z * cos - x * sin), axis=-1)


def _about_x(vector: np.ndarray, angle: np.ndarray) -> np.ndarray:
    x, y, z = np.moveaxis(vector, -1, 0)
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack(np.broadcast_arrays(x, y * cos - z * sin, y * sin + z * cos), axis=-1)
