"""The stand that a fixed robot is bolted to gives: a hinge between ground and base, which the plain model lacks."""

from dataclasses import replace
from functools import lru_cache
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from dynreg.errors import SimulationError
from dynreg.sim.effects.body import at_reset, driven_dofs, tilt_axis, tilt_hinge
from dynreg.sim.effects.effect import Effect, EffectParameter, Site, Values, drives
from dynreg.sim.mjcf import compile_model, model_files
from dynreg.sim.robot import Robot

STAND = "dynreg_stand"
LOSS = 0.05  # damping ratio of the stand with the robot on it: bolted steel has 0.02, a clamped table 0.1
REACH = 0.5  # of a time step times the stand's natural frequency, up to which the step follows it
LIGHT = 1e-6  # kg, kg m^2 of the body between ground and base: MuJoCo wants more than nothing
SETTLES = 12  # rounds: the weight's moment changes with the tilt, by less than half of what the spring gives


class StandCompliance(Effect):
    """A fixed base tilts under the moment that the robot makes about the axis of its first joint that lifts.

    Ground and base have a hinge through the base's origin between them, with a spring and the damping `LOSS`. It starts
    where the robot's weight holds it. A simulator that has it runs on a model of its own.
    """

    id, acts_on, title = "stand_compliance", "body", "the stand under a fixed base gives"
    parameters = (
        EffectParameter("compliance", "rad/(N*m)", "tilt per moment", 0.01, 0.03, 0.1, 1.0, per="stiffness"),
    )
    near = ("joint_elasticity", "gravity_tilt", "inertia")
    separate_by = "log the stand's tilt, or clamp it and repeat"
    scope = "robot"

    def why_not(self, robot: Robot) -> str | None:
        if robot.planar or not drives(robot, "position", "duty_servo"):
            return "no servo whose stiffness could be compared"
        if robot.floating:
            return "its base floats"
        if tilt_hinge(robot) is None:
            return "no hinge lifts anything"
        if not _fixed(robot):
            return "its base moves"
        # of one joint it is a spring behind the encoder
        return "an engine of the robot moves each joint alone" if "joint" in robot.engines else None

    def remodel(self, robot: Robot) -> Robot:
        return with_stand_hinge(robot)

    def configure(self, site: Site, p: Values) -> None:
        joint, dof = _addresses(site.robot)[:2]
        stiffness = 1.0 / p["compliance"][:, 0]
        inertia = _inertia(site.robot)
        # a stand too stiff for the time step is as stiff, and so heavy that it follows: it does nothing, either way
        heavy = np.maximum(stiffness * (site.robot.file.robot.timestep / REACH) ** 2 - inertia, 0.0)
        for field, number, value in (
            ("jnt_stiffness", joint, stiffness),
            ("dof_armature", dof, heavy),
            ("dof_damping", dof, 2.0 * LOSS * np.sqrt(stiffness * (inertia + heavy))),
            ("dof_frictionloss", dof, 0.0),
        ):
            array = site.expand(field)
            array[site.rows, number] = np.reshape(value, (-1, *[1] * (array.ndim - 2)))

    def begin(self, robot: Robot, batch: Any, rows: Any) -> None:
        """Tilt the stand as far as the robot's weight holds it."""
        joint, dof, at = _addresses(robot)
        qpos, bias = batch.bind("qpos"), batch.bind("qfrc_bias")
        stiffness = batch.expand("jnt_stiffness")[rows, joint].reshape(-1)
        for _ in range(SETTLES):
            batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL)
            qpos[rows, at] = -bias[rows, dof] / stiffness


@lru_cache(maxsize=64)  # as the models of `engines.mujoco_model.compiled`
def with_stand_hinge(robot: Robot) -> Robot:
    """The robot with a model in which a hinge named `STAND` lies between the ground and its base.

    Raises SimulationError where the model cannot be taken apart.
    """
    files, name = dict(model_files(robot.files).files), robot.file.robot.model
    plain = robot.model
    root = plain.body(plain.body_rootid[plain.dof_bodyid[driven_dofs(robot)[0]]])
    try:
        spec = mujoco.MjSpec.from_string(files[name].decode(), include=files, assets=files)
        spec.compile()
        tree = ElementTree.fromstring(spec.to_xml())
    except (ValueError, RuntimeError, mujoco.FatalError) as problem:
        raise SimulationError(
            f"the model of robot {robot.name!r} cannot be put on a stand: {str(problem).splitlines()[0]}",
            expected="a model that MuJoCo can write out",
            do="leave stand_compliance out",
        ) from None
    world = tree.find("worldbody")
    body = next(one for one in world.findall("body") if one.get("name") == root.name)
    at = {"name": STAND, "pos": _row(at_reset(robot).xpos[root.id])}
    stand = ElementTree.Element("body", at)
    ElementTree.SubElement(stand, "inertial", pos="0 0 0", mass=str(LIGHT), diaginertia=_row([LIGHT] * 3))
    hinge = {"type": "hinge", "axis": _row(tilt_axis(robot)), "limited": "false"}
    own = dict.fromkeys(
        ("damping", "armature", "frictionloss", "stiffness"), "0"
    )  # whatever the defaults are
    ElementTree.SubElement(stand, "joint", {"name": STAND} | hinge | own)
    world.insert(list(world).index(body), stand)
    world.remove(body)
    body.set("pos", "0 0 0")
    stand.append(body)
    _keep_apart(tree, plain, root.id)
    moved = [j for j in range(plain.njnt) if plain.body_rootid[plain.jnt_bodyid[j]] == root.id]
    places = {"qpos": int(plain.jnt_qposadr[moved[0]]), "qvel": int(plain.jnt_dofadr[moved[0]])}
    for key in tree.iter("key"):
        for name_of, place in places.items():
            if key.get(name_of):
                numbers = key.get(name_of).split()
                key.set(name_of, " ".join([*numbers[:place], "0", *numbers[place:]]))
    files[name] = ElementTree.tostring(tree)
    model = compile_model(files, name)
    model.opt.timestep, model.opt.integrator = plain.opt.timestep, plain.opt.integrator
    standing = replace(robot)
    standing.__dict__["model"] = model
    return standing


def _fixed(robot: Robot) -> bool:
    """Whether no joint without a drive, but for the stand's, lies between the ground and the first driven one."""
    model = robot.model
    body, driven = (
        int(model.jnt_bodyid[model.joint(robot.driven[0]).id]),
        {model.joint(j).id for j in robot.driven},
    )
    below = set()
    while body:
        below |= {*range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])}
        body = int(model.body_parentid[body])
    return {j for j in below if model.joint(j).name != STAND} <= driven


def _keep_apart(tree: ElementTree.Element, plain: mujoco.MjModel, root: int) -> None:
    """Let the ground not touch what was fixed to it, and now is fixed to the stand."""
    fixed = [b for b in range(1, plain.nbody) if plain.body_weldid[b] == 0 and plain.body_rootid[b] == root]
    contact = tree.find("contact")
    contact = ElementTree.SubElement(tree, "contact") if contact is None else contact
    for body in fixed:
        ElementTree.SubElement(contact, "exclude", body1="world", body2=plain.body(body).name)


@lru_cache(maxsize=64)
def _inertia(standing: Robot) -> float:
    """[kg m^2] of the whole robot about the stand's hinge, at its reset pose."""
    model, data = standing.model, at_reset(standing)
    dof = _addresses(standing)[1]
    whole = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, whole)
    return float(whole[dof, dof])


def _addresses(standing: Robot) -> tuple[int, int, int]:
    """Numbers of the stand's joint, degree of freedom and position."""
    joint = standing.model.joint(STAND)
    return int(joint.id), int(joint.dofadr[0]), int(joint.qposadr[0])


def _row(numbers: Any) -> str:
    return " ".join(repr(float(n)) for n in numbers)
