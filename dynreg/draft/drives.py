"""Drives: what the actuators of a model do to its joints, in the terms of robot.toml."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from dynreg.sim.excitation import FREE
from dynreg.sim.held import JOINT, switched_on

SAME = 1e-6  # of a gain of 1, with which a motor's command is its torque
QUICK = 30.0  # rad/s^2 or m/s^2 that a guessed drive can give its joint, besides holding it
OF_MODEL = "actuator of the model"

_FIXED, _AFFINE = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_AFFINE)
_NONE, _DCMOTOR = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtGain.mjGAIN_DCMOTOR)
_NO_STATE, _OF_DCMOTOR = int(mujoco.mjtDyn.mjDYN_NONE), int(mujoco.mjtDyn.mjDYN_DCMOTOR)
_FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


@dataclass(frozen=True)
class Drive:
    """The drive of one joint: force = gain (command - q) - rate_gain qd, and so on for its kind, within +-limit.

    kind : "position", "velocity", "torque" or "dcmotor". gain : of position and torque. rate_gain : of position and
    velocity. kt, resistance : of a dcmotor. limit : None where there is none. low, high : of the command; None where
    nothing limits it: a joint's stops do not. usual : whether these are a guess at what is usual, no limits. lag : time
    constant [s] of the actuator's own filter. holds : between which commands what that filter holds stays; None where
    nothing limits it. scale, offset : the command is scale * (what a log holds) + offset; those
    of the actuator's control where nothing tells otherwise.
    actuator : the name of the model's own; "" where it has none. said : where the numbers come from. guessed : whether
    its gains are guesses. measured : the gains that a log's torques follow, and "torque_limit" where they stop at it.
    """

    joint: str
    kind: str
    gain: float = 1.0
    rate_gain: float = 0.0
    kt: float = 0.0
    resistance: float = 1.0
    limit: float | None = None
    low: float | None = None
    high: float | None = None
    usual: bool = False
    lag: float = 0.0
    holds: tuple[float, float] | None = None
    scale: float = 1.0
    offset: float = 0.0
    actuator: str = ""
    said: str = OF_MODEL
    guessed: bool = False
    measured: frozenset[str] = frozenset()

    @property
    def plain(self) -> bool:
        """Whether its command is in the unit of the joint, not in one of its own."""
        return self.kind != "torque" or abs(self.gain - 1.0) < SAME

    @property
    def action(self) -> str:
        """The name of its action."""
        named = {"position": "target", "velocity": "velocity_command", "dcmotor": "voltage"}
        return f"{self.joint}/{named.get(self.kind) or ('torque' if self.plain else 'command')}"


def name_of(model: mujoco.MjModel, joint: int) -> str:
    """The joint's name."""
    return model.joint(joint).name


def is_hinge(model: mujoco.MjModel, joint: int) -> bool:
    """Whether the joint turns, as against slides."""
    return bool(model.jnt_type[joint] == _HINGE)


def understood(model: mujoco.MjModel, a: int, joint: int) -> Drive | None:
    """The drive that an actuator is; None where it is of a kind that robot.toml cannot say."""
    if model.actuator_dyntype[a] not in (_NO_STATE, *_FILTERS) and not _is_plain_dcmotor(model, a):
        return None
    gear, gain = float(model.actuator_gear[a, 0]), model.actuator_gainprm[a]
    if gear == 0:
        return None
    bias = model.actuator_biasprm[a] if model.actuator_biastype[a] == _AFFINE else np.zeros(3)
    lag = float(model.actuator_dynprm[a, 0]) if model.actuator_dyntype[a] in _FILTERS else 0.0
    drive = Drive(
        name_of(model, joint),
        "torque",
        limit=_limit(model, a, joint),
        lag=lag,
        holds=tuple(model.actuator_actrange[a].tolist()) if lag and model.actuator_actlimited[a] else None,
        actuator=model.actuator(a).name,
    )
    low, high = _control_range(model, a)
    if model.actuator_gaintype[a] == _DCMOTOR:
        resistance, kt = float(gain[0]), abs(gear) * float(gain[1])
        return replace(drive, kind="dcmotor", resistance=resistance, kt=kt, low=low, high=high)
    if (
        model.actuator_gaintype[a] != _FIXED
        or model.actuator_biastype[a] not in (_NONE, _AFFINE)
        or gain[0] == 0
    ):
        return None
    stiffness, rate = -float(bias[1]) * gear**2, -float(bias[2]) * gear**2
    if stiffness > 0:
        scale, offset = float(gain[0]) / (-float(bias[1]) * gear), float(bias[0]) / (-float(bias[1]) * gear)
        made = replace(drive, kind="position", gain=stiffness, rate_gain=max(rate, 0.0))
        return _ranged(made, low, high, scale, offset)
    if rate > 0:
        scale, offset = float(gain[0]) / (-float(bias[2]) * gear), float(bias[0]) / (-float(bias[2]) * gear)
        return _ranged(replace(drive, kind="velocity", rate_gain=rate), low, high, scale, offset)
    if stiffness < 0 or rate < 0 or bias[0] != 0:
        return None
    return replace(drive, gain=gear * float(gain[0]), low=low, high=high)


def _is_plain_dcmotor(model: mujoco.MjModel, a: int) -> bool:
    """Whether an actuator is a DC motor of a constant and a resistance alone: no inductance, no heat, no cogging."""
    more = (model.actuator_gainprm[a, 2:], model.actuator_biasprm[a], model.actuator_dynprm[a])
    plain = not model.actuator_actnum[a] and not any(numbers.any() for numbers in more)
    return bool(model.actuator_dyntype[a] == _OF_DCMOTOR and plain)


def _limit(model: mujoco.MjModel, a: int, joint: int) -> float | None:
    """Largest force on the joint [N*m or N]; of limits that differ by direction the larger."""
    gear, ends = abs(float(model.actuator_gear[a, 0])), []
    if model.actuator_forcelimited[a]:
        ends.append(float(np.abs(model.actuator_forcerange[a]).max()) * gear)
    return min([*ends, *joint_limit(model, joint)], default=None)


def joint_limit(model: mujoco.MjModel, joint: int) -> list[float]:
    """The largest force [N*m or N] that the model states for a joint's actuators together; none where it does not."""
    if not model.jnt_actfrclimited[joint]:
        return []
    most = float(np.abs(model.jnt_actfrcrange[joint]).max())
    return [most] if most > 0 else []


def force_range(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    """Between which forces [N*m or N] the model keeps the actuators of a joint; infinite where it does not."""
    mine = (model.actuator_trnid[:, 0] == joint) & np.isin(model.actuator_trntype, JOINT)
    limited = np.flatnonzero(mine & (model.actuator_forcelimited > 0) & switched_on(model))
    ends = [np.sort(model.actuator_gear[a, 0] * model.actuator_forcerange[a]) for a in limited]
    if joint_limit(model, joint):
        ends.append(model.jnt_actfrcrange[joint])
    return (
        float(max((low for low, _ in ends), default=-np.inf)),
        float(min((high for _, high in ends), default=np.inf)),
    )


def _control_range(model: mujoco.MjModel, a: int) -> tuple[float | None, float | None]:
    free = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    if free or not model.actuator_ctrllimited[a]:
        return None, None
    return float(model.actuator_ctrlrange[a, 0]), float(model.actuator_ctrlrange[a, 1])


def reach_of(model: mujoco.MjModel, drive: Drive) -> float:
    """How far [rad or m] the targets of a drive lie apart: by its own range, else its joint's stops, else freely."""
    joint = model.joint(drive.joint).id
    if drive.low is not None and drive.high is not None:
        return drive.high - drive.low
    if model.jnt_limited[joint]:
        return float(np.ptp(model.jnt_range[joint]))
    return 2.0 * FREE["rad" if is_hinge(model, joint) else "m"]


def _ranged(drive: Drive, low: float | None, high: float | None, scale: float, offset: float) -> Drive:
    """The drive whose command is scale * control + offset, controls being in [low, high]."""
    ends = lambda pair: tuple(sorted(scale * end + offset for end in pair))  # noqa: E731
    holds = None if drive.holds is None else ends(drive.holds)
    drive = replace(drive, scale=scale, offset=offset, holds=holds)
    if low is None or high is None:
        return drive
    low, high = ends((low, high))
    return replace(drive, low=low, high=high)


def effective_inertia(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    """(inertia [kg*m^2 or kg], load by its own weight [N*m or N], at most) of a joint, over a few poses."""
    data = mujoco.MjData(model)
    dof, at = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
    start = model.qpos0[at]
    inertia, load = 0.0, 0.0
    matrix = np.zeros((model.nv, model.nv))
    for turn in np.linspace(-np.pi / 2, np.pi / 2, 5) if is_hinge(model, joint) else (0.0,):
        data.qpos[:], data.qvel[:] = model.qpos0, 0.0
        data.qpos[at] = start + turn
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, matrix)
        inertia, load = max(inertia, float(matrix[dof, dof])), max(load, abs(float(data.qfrc_bias[dof])))
    return inertia, load
