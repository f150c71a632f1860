"""The MuJoCo model that engines share: compiled once, with each simulation's own parameters in its fields."""

import copy
import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, lru_cache

import mujoco
import numpy as np
from mujoco.batch import Batch

from dynreg.errors import SimulationError
from dynreg.sim.commands import shaped_commands
from dynreg.sim.effects import Terms
from dynreg.sim.engines.acting import require
from dynreg.sim.fields import modify, set_field
from dynreg.sim.layout import Layout, layout_of
from dynreg.sim.ports import Ports, assigned, nominal_ports, takes_positions
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run
from dynreg.sim.sets import FRICTION_FIELDS, Assignment, matching


def by_model(terms: Terms | None, count: int) -> list[np.ndarray]:
    """Numbers of the simulations, out of so many, that share a model: with the same effects that make another."""
    other = [i for i, term in enumerate(terms.terms) if term.effect.remodel] if terms else []
    has = np.array([np.isfinite(terms.values[i]).all(axis=1) for i in other]).reshape(len(other), count)
    _, kind = np.unique(has, axis=1, return_inverse=True) if other else (None, np.zeros(count, dtype=int))
    return [np.flatnonzero(kind == one) for one in np.unique(kind)]


def modelled(robot: Robot, terms: Terms | None, count: int) -> Robot:
    """The robot with the model that the effects of so many simulations make of it.

    Raises SimulationError where some of them make another one than others.
    """
    if len(by_model(terms, count)) > 1:
        raise SimulationError(
            f"simulators of {robot.name!r} with and without an effect that makes another model of it",
            expected="simulators of one model",
            do="look at them one by one",
        )
    for term, values in zip(terms.terms, terms.values, strict=True) if terms else ():
        if term.effect.remodel and np.isfinite(values).all():
            require(robot, term)
            robot = term.effect.remodel(robot)
    return robot


def configure(robot: Robot, batch: Batch, model: mujoco.MjModel, values: np.ndarray, run: Run) -> Ports:
    """Write parameters (n, P) and the episodes' settings into the batch's fields and the returned ports."""
    ports = nominal_ports(robot, len(values))
    for assignment, column in assigned(robot, values, run):
        assign(batch, model, ports, assignment, column)
    return ports


def assign(
    batch: Batch, model: mujoco.MjModel, ports: Ports, assignment: Assignment, values: np.ndarray
) -> None:
    """Let values (n,) do to the batch's fields, or to the ports, what an entry of `sets` says."""
    if assignment.root == "mj":
        set_field(batch, model, assignment, values)
    elif assignment.root == "modifier":
        modify(batch, model, assignment, values)
    else:
        ports.apply(assignment, values)
        port, _, key = assignment.path.partition(".")
        if port == "friction" and assignment.op != "+=":
            _rub(batch, model, ports, assignment, FRICTION_FIELDS[key], values)


def _rub(
    batch: Batch, model: mujoco.MjModel, ports: Ports, assignment: Assignment, field: str, values: np.ndarray
) -> None:
    """Let what is set be the joint's whole friction: "=" leaves none of the model's own, "*=" scales it, too."""
    chosen = matching(ports.joints, assignment.elements, assignment.text)
    dofs = [model.joint(ports.joints[i]).dofadr[0] for i in chosen]
    array = batch.expand(field)
    array[:, dofs] = array[:, dofs] * (values[:, None] if assignment.op == "*=" else 0.0)


# Six robots in lockstep, each with two copies of finer time steps and a hidden one, are 24: with room for fewer than
# are in use, each is made anew (0.2 to 0.5 ms) in every rollout.
@lru_cache(maxsize=64)
def compiled(robot: Robot) -> tuple[mujoco.MjModel, Layout]:
    """The model with affine actuators (so that any drive is a choice of parameters) and its layout.

    Its actuators have no delays: their past would belong to where an episode starts, and only one engine would know it.
    """
    _untimed()
    layout = layout_of(robot)
    model = copy.copy(robot.model)
    at = layout.action_actuator
    model.actuator_gaintype[at] = mujoco.mjtGain.mjGAIN_FIXED
    model.actuator_biastype[at] = mujoco.mjtBias.mjBIAS_AFFINE
    model.actuator_biasprm[at] = 0.0
    model.actuator_forcelimited[at] = 1
    model.actuator_ctrllimited[at] = 0
    model.actuator_delay[:], model.actuator_history[:] = 0.0, 0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    # link lengths differ between simulations: bounding volumes of the midphase would be the base model's
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
    # to look for islands in one robot costs more than it saves
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    return model, layout


@cache
def _untimed() -> None:
    """Take away the clock that MuJoCo's Python package gives to its engine: it fills `MjData.timer` and nothing else.

    It is read many times in a time step: one of the leg takes 2.7 us with it and 2.1 us without, a diagnosis of
    bench_naming_leg in the air 10.7 s and 8.6 s. `mujoco.set_mjcb_time` can only install another. For good, not for
    the time of a rollout: another thread may be in the midst of one.
    """
    try:
        bindings = ctypes.CDLL(mujoco._callbacks.__file__)
        ctypes.c_void_p.in_dll(bindings, "mjcb_time").value = None
    except (OSError, ValueError):  # a system whose linker does not look in the libraries of a library
        pass


def episode_inputs(robot: Robot, run: Run) -> np.ndarray:
    """(n, T, I) inputs, defaults where the run has none or NaN."""
    defaults = robot.input_defaults
    if run.inputs is None:
        return np.broadcast_to(defaults, (run.episodes, run.steps, len(defaults)))
    return np.where(np.isnan(run.inputs), defaults, run.inputs)


def joint_inertia(batch: Batch, model: mujoco.MjModel, layout: Layout) -> np.ndarray:
    """(n, A) diagonal of the joint-space inertia matrix at the present pose."""
    matrix = batch.bind("M")  # outputs are filled by calls made after they are bound
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
    diagonal = model.M_rowadr + model.M_rownnz - 1
    return matrix[:, diagonal[layout.action_dof]].copy()


def told(layout: Layout, ports: Ports, run: Run, q: np.ndarray) -> np.ndarray:
    """(n, T, A) what the drives are told, from joints at q (n, A) on: the commands within the actions' limits.

    Targets beyond a joint's stops stay: the drive presses the joint on its stop, as a real one does.
    """
    low, high = (np.tile(layout.action_range[:, i], (len(q), 1)) for i in (0, 1))
    start = np.where(takes_positions(ports), q, 0.0)
    return shaped_commands(run.actions, start, low, high, ports, run.noise)


def told_before(layout: Layout, run: Run) -> np.ndarray | None:
    """(n, L, A) what the drives were told before, within the actions' limits; None where nothing is known."""
    return None if run.before is None else np.clip(run.before, *layout.action_range.T)


@contextmanager
def quiet() -> Iterator[None]:
    """Keep MuJoCo from writing to stderr and to a MUJOCO_LOG.TXT in the working folder; also a decorator.

    A configuration that diverges is a result here, not news.
    """
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
