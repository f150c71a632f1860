"""A hidden quadruped in MuJoCo alone: what is worn are the pads of its left feet.

It shares the MJCF with the library, and nothing of how the library simulates: feet have a friction of their own by
MuJoCo's `priority`, drives are MuJoCo's actuators, the time step is eight times finer. Its parts differ from the
nameplate as scales and rulers would tell them (`measured_quadruped.KNOWN`); its lengths, limits and gravity do not.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from measured_quadruped import KNOWN
from scipy.spatial.transform import Rotation

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.rng import stream
from dynreg.sim.robot import Robot
from dynreg.sim.space import ParameterSpace

RATE = 36.0  # Hz
STEPS = 56  # physics steps of a command
SETTLE = 0.3  # s at rest before a trial
LEFT = ("fl", "rl")
DIFFER = ("friction", "torque", "joint_speed", "torso_mass", "leg_mass", "inertia")
MOTOR_NOISE = 0.003  # rad
PUSHED = 0.005  # of the torque limit, 1 sigma, drawn anew for every command
TILT, HEIGHT = 1.0, 0.06  # rad, m: beyond them it fell
COUNTS = 4096  # of a turn


def drawn(space: ParameterSpace, seed: int) -> dict[str, float]:
    """True parameters: those of `DIFFER` off by what a person's scales and rulers are off."""
    rng, out = stream(seed, "plain quadruped"), space.as_dict(space.nominal)
    for name in DIFFER:
        out[name] *= float(np.exp(KNOWN[name] * np.clip(rng.standard_normal(), -2.0, 2.0)))
    return out | {"motor_noise": MOTOR_NOISE, "action_rate": RATE}


@dataclass(frozen=True, eq=False)
class PlainQuadruped:
    """One robot: `robot` describes it to the library, `parameters` are true, `loss` is of its left feet's friction."""

    robot: Robot
    parameters: Mapping[str, float]
    loss: float
    seed: int

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The MJCF with what this robot has."""
        p, model = self.parameters, mujoco.MjModel.from_xml_path(str(self.robot.folder / "model.xml"))
        model.opt.timestep = 1.0 / (RATE * STEPS)
        model.opt.integrator, model.opt.iterations = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, 20
        for body in range(1, model.nbody):
            torso = model.body(body).name == "torso"
            factor = p["torso_mass"] / model.body_mass[body] if torso else p["leg_mass"]
            model.body_mass[body] *= factor
            model.body_inertia[body] *= factor * p["inertia"]
        for geom in range(model.ngeom):
            name = model.geom(geom).name
            foot = name.endswith("_foot")
            worn = foot and name.startswith(LEFT)
            model.geom_friction[geom, 0] = p["friction"] * (1.0 - self.loss if worn else 1.0)
            model.geom_priority[geom] = int(foot)  # a foot's friction counts, whatever the ground's
        joints = model.actuator_trnid[:, 0]
        model.actuator_forcerange[:] = np.array([-1.0, 1.0]) * p["torque"]
        model.dof_damping[model.jnt_dofadr[joints]] += p["torque"] / p["joint_speed"]  # a motor's back-EMF
        model.jnt_range[joints] *= p["joint_limits"]
        model.opt.gravity[2] = -p["gravity"]
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def run(self, actions: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """(T+1, nq), (T+1, nv) from rest under commands (T, A); disturbances are those of the trial's name."""
        model, data, rng = self.model, mujoco.MjData(self.model), stream(self.seed, "plain trial", name)
        joints = model.jnt_dofadr[model.actuator_trnid[:, 0]]
        self._rest(model, data)
        q, v, last = [data.qpos.copy()], [data.qvel.copy()], data.ctrl.copy()
        for command in actions:
            within = np.clip(command, *self.robot.action_ranges.T)
            last = last + np.clip(within - last, *(np.array([-1.0, 1.0]) * self.parameters["largest_step"]))
            data.ctrl[:] = last + self.parameters["motor_noise"] * rng.standard_normal(model.nu)
            data.qfrc_applied[joints] = PUSHED * self.parameters["torque"] * rng.standard_normal(model.nu)
            mujoco.mj_step(model, data, STEPS)
            q.append(data.qpos.copy())
            v.append(data.qvel.copy())
        return np.array(q), np.array(v)

    def _rest(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """The stance, with the lowest foot on the ground, and a while to settle."""
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        feet = [g for g in range(model.ngeom) if model.geom(g).name.endswith("_foot")]
        data.qpos[2] -= (data.geom_xpos[feet, 2] - model.geom_size[feet, 0]).min()
        mujoco.mj_step(model, data, round(SETTLE / model.opt.timestep))

    def score(self, actions: np.ndarray, rate: float, name: str) -> float | None:
        """Metres ahead less metres to the side, by a tape measure; None for a fall."""
        q, _ = self.run(actions, name)
        turned = Rotation.from_quat(q[:, 3:7], scalar_first=True)
        if (turned.as_matrix()[:, 2, 2] < np.cos(TILT)).any() or (q[:, 2] < HEIGHT).any():
            return None
        yaw, (east, north) = turned[0].as_euler("ZYX")[0], q[-1, :2] - q[0, :2]
        ahead, left = (
            np.cos(yaw) * east + np.sin(yaw) * north,
            np.cos(yaw) * north - np.sin(yaw) * east,
        )
        return float(ahead - abs(left))

    def log(self, commands: Mapping[str, np.ndarray]) -> Recording:
        """What its sensors wrote under commands {episode: (T, A)}, each from rest, one after the other."""
        channels, episodes, begin = self.robot.file.channels, [], 0.0
        noise = np.array([c.noise for c in channels])
        counted = np.array([c.name.endswith("/position") for c in channels])
        for name, actions in commands.items():
            states = self._measured(*self.run(actions, name))
            states = states + noise * stream(self.seed, "plain sensors", name).standard_normal(states.shape)
            states[:, counted] = np.round(states[:, counted] * COUNTS / (2 * np.pi)) * 2 * np.pi / COUNTS
            told = np.concatenate([actions, actions[-1:]])
            time = begin + np.arange(len(states)) / RATE
            episodes.append(Episode(name, time, np.concatenate([states, told], axis=1)))
            begin = float(time[-1]) + 1.0 / RATE
        named = (*channels, *self.robot.file.actions)
        return Recording(tuple(Channel(c.name, c.unit) for c in named), tuple(episodes), measured=False)

    def _measured(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(T+1, S) joints, then the base: angles in the world, speeds in its own frame."""
        turned = Rotation.from_quat(q[:, 3:7], scalar_first=True)
        base = np.concatenate([turned.as_euler("ZYX")[:, ::-1], turned.inv().apply(v[:, :3]), v[:, 3:6]], 1)
        return np.concatenate([q[:, 7:], v[:, 6:], base], axis=1)
