"""A simulator as one MJCF file for MuJoCo alone: parameters, drives and the effects that MJCF can say, written out."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dynreg.errors import RobotError
from dynreg.extend.carry import Fields, carries
from dynreg.sim.effects import Term, Terms
from dynreg.sim.layout import Layout, filters, layout_of
from dynreg.sim.mjcf import keep_general
from dynreg.sim.ports import Ports, ServoLaw, servo_law, takes_positions
from dynreg.sim.robot import Robot
from dynreg.sim.sets import is_limit

LARGEST = 1e5  # no command is larger
LINEAR = 1  # between the commands of two time steps: MuJoCo's `interp`
IN_DRIVES = (
    "command_delay",
    "command_gain",
    "command_lag",
    "force_offset",
    "quadratic_drag",
)  # effects on the move that MJCF can say
# (id of an effect, number of an action) -> its first value there; 0 without it
Size = Callable[[str, int], Any]


def says(robot: Robot, term: Term) -> bool:
    """Whether MJCF can say what an effect does while the robot moves.

    An actuator has one filter: where the model's own smooths the commands, there is none for a lag.
    """
    smoothed = set(filters(robot.model, layout_of(robot))[0]) if term.effect.id == "command_lag" else set()
    return term.effect.id in IN_DRIVES and smoothed.isdisjoint(robot.drives_of(term.joints))


def held_for(ports: Ports) -> float | None:
    """[s] that the first of these simulators holds a command, in its own time; None where each command tells it."""
    rate = float(ports.control["rate"][0])
    return float(ports.control["clock"][0]) / rate if rate else None


def step_of(robot: Robot, ports: Ports) -> float:
    """[s] of a time step, as engines take it: a whole share of the time between commands."""
    period = held_for(ports) or 1.0 / robot.rate
    return float(period / robot.substeps(period))


def write_mjcf(robot: Robot, values: np.ndarray, terms: Terms, path: Path) -> None:
    """Write the robot with parameters (P,) at nominal settings and inputs, and the effects that MJCF can say.

    path : beside a copy of the robot's model and what that names. `ctrl` is in the order of the model's actuators: that
    of action `a` is `layout_of(robot).action_actuator[a]`. Commands are `held_for` a time; encoders read the truth.
    Raises RobotError where MuJoCo cannot express a change in the model's file.
    """
    if robot.planar:
        raise RobotError(
            f"MuJoCo does not move the robot: its engine is {robot.running()}",
            expected="joints",
            do="use robot.toml",
        )
    layout = layout_of(robot)
    source = path.with_name(Path(robot.file.robot.model).name)
    spec = mujoco.MjSpec.from_file(str(source))
    fields = Fields.of(robot, values)
    step = step_of(robot, fields.ports)
    still = [i for i, term in enumerate(terms.terms) if carries(term.effect)]
    fields.apply(Terms(tuple(terms.terms[i] for i in still), tuple(terms.values[i] for i in still)))
    law = servo_law(fields.ports, robot.input_defaults[None])

    def size(key: str, action: int) -> float:
        return _value(robot, terms, key, action)

    _shape_actuators(robot, spec, layout, law, size, step)
    write_drives(robot, fields, law, size)
    model = spec.compile()
    if model.body_simple[1:].any():  # as the simulator's model, whose bodies parameters may move
        keep_general(spec)
        model = spec.compile()
    _begin_at_keyframes(spec, model, layout, fields)
    for name, array in fields.changed.items():
        owner, field = (model.opt, name[4:]) if name.startswith("opt.") else (model, name)
        getattr(owner, field)[...] = array[0].reshape(np.shape(getattr(owner, field)))
    model.opt.timestep, model.opt.integrator = step, robot.model.opt.integrator
    try:
        spec.copy_back(model)
    except ValueError as problem:
        raise RobotError(
            f"{source.name}: {str(problem).splitlines()[0]}",
            expected="a model whose file can say what the parameters and effects change",
            do="use robot.toml, which can",
        ) from None
    path.write_text(spec.to_xml(), encoding="utf-8")


def _shape_actuators(
    robot: Robot, spec: mujoco.MjSpec, layout: Layout, law: ServoLaw, size: Size, step: float
) -> None:
    """Make the drives' actuators affine servos with limits, late and smoothed where effects make them so."""
    for a, actuator in enumerate(layout.action_actuator):
        one = spec.actuators[int(actuator)]
        one.gaintype, one.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        one.forcelimited = int(is_limit(law.limit[0, a]))
        # what pushes whatever is commanded knows no limit of the drive: the ranges move along
        push = size("force_offset", a)
        joint = spec.joint(robot.joints[a])
        joint.actfrcrange = joint.actfrcrange + push * (joint.actfrcrange[0] < joint.actfrcrange[1])
        one.forcerange = [push - law.limit[0, a], push + law.limit[0, a]]
        low, high = layout.action_range[a]
        one.ctrllimited = int(np.isfinite(low) or np.isfinite(high))
        if one.ctrllimited:  # MuJoCo knows no range with one end
            one.ctrlrange = np.clip([low, high], -LARGEST, LARGEST)
        delay, lag = size("command_delay", a), size("command_lag", a)
        if lag:
            # late by half a time step: the force comes from the state before it, the effect's from its mean
            one.dyntype, one.dynprm[0], one.actdim = mujoco.mjtDyn.mjDYN_FILTEREXACT, lag, 1
        one.delay, one.nsample = delay, 0  # of the model's own there is none in a simulator either
        if delay:  # MuJoCo rounds those below one time step up to it
            one.interp, one.nsample = LINEAR, int(np.ceil(delay / step)) + 2


def _begin_at_keyframes(spec: mujoco.MjSpec, model: mujoco.MjModel, layout: Layout, fields: Fields) -> None:
    """What smooths commands holds a keyframe's pose there, as in an episode of the simulator, and not 0."""
    drives, places = filters(model, layout)
    kept = takes_positions(fields.ports)[drives]
    for number, key in enumerate(spec.keys if len(drives) else ()):
        pose = model.key_qpos[number, layout.action_qpos[drives]]
        model.key_act[number, places] = np.where(kept, pose, 0.0)
        key.act = model.key_act[number]


def write_drives(robot: Robot, fields: Fields, law: ServoLaw, size: Size) -> None:
    """Write the drives' law, friction and the effects on them that MJCF can say into the fields of one simulator."""
    layout, friction = layout_of(robot), fields.ports.friction
    at, dof, field = layout.action_actuator, layout.action_dof, lambda name: fields.expand(name)[0]
    more, push, drag, lag = (
        np.array([size(key, a) for a in range(len(at))])
        for key in ("command_gain", "force_offset", "quadratic_drag", "command_lag")
    )
    field("actuator_gainprm")[at, 0] = law.gain[0] * (1.0 + more)
    bias = field("actuator_biasprm")
    bias[at, 0], bias[at, 1], bias[at, 2] = law.bias[0] + push, -law.stiffness[0], -law.rate[0]
    limits = field("actuator_forcerange")
    limits[at, 0], limits[at, 1] = push - law.limit[0], push + law.limit[0]
    field("dof_damping")[dof] += law.damping[0] + friction["viscous"][0]
    field("dof_frictionloss")[dof] += friction["coulomb"][0]
    for a, d in enumerate(dof):
        joint = robot.model.dof_jntid[d]
        if robot.model.jnt_actfrclimited[joint]:
            field("jnt_actfrcrange")[joint] += push[a]
        if drag[a] != 0.0:
            field("dof_dampingpoly")[d, 0] += drag[a]
        if lag[a] != 0.0:
            field("actuator_dynprm")[at[a], 0] = lag[a]


def _value(robot: Robot, terms: Terms, key: str, action: int) -> float:
    """The first value of an effect on one drive; 0 where it does not have it, or MJCF cannot say it."""
    owner = robot.joints[action]
    found = [
        float(values[0, 0])
        for term, values in zip(terms.terms, terms.values, strict=True)
        if term.effect.id == key and (not term.joints or owner in term.joints) and says(robot, term)
    ]
    return sum(found)
