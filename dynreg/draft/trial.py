"""A drafted robot simulated: its time step, its engines, and what the check of a folder finds about its ranges."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from dynreg.draft.drives import Drive
from dynreg.draft.entry import Entry, Notes
from dynreg.draft.opened import Opened
from dynreg.draft.tables import Tables, keyframe_of
from dynreg.errors import DynregError
from dynreg.sim.effects.contact import touching_geoms
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.extremes import stiff_drive, try_out, try_step
from dynreg.sim.robot import Robot
from dynreg.sim.stiff import EXPLICIT, free_inertias

FINER = 8.0  # times that a time step may be divided by, at most: a finer one makes every answer take minutes
SWING = 0.5  # rad of a drive's own swing in a time step, above which it is not followed
LAGS = 0.5  # time constants of a drive's damping in a time step, above which an explicit integrator is off
ROUNDS = 6  # of trials until the ranges are sound
NEARER = 0.25  # of the way from the nominal value at which the end of a range is put that diverges
APART = 0.02  # share of its motion by which a joint alone may differ from the joint in its robot
NARROWER = 4.0  # times finer a time step, with which engines that differ by their integrators alone agree
Range = tuple[str, str]  # a parameter, and the end of its range: "low" or "high"
Make = Callable[[Tables], Robot]  # a robot of tables, with the model as it is now


@dataclass(frozen=True)
class Stiff:
    """How fast the drive of one joint acts on it: inertia with all other joints free [kg*m^2 or kg], gain and rate gain
    of the drive, with the joint's own damping.
    """

    joint: str
    inertia: float
    gain: float
    rate: float

    @property
    def damping_time(self) -> float:
        """Time constant [s] with which the drive damps its joint."""
        return self.inertia / self.rate if self.rate > 0 else np.inf

    @property
    def swing(self) -> float:
        """How often the drive swings its joint where nothing damps it [Hz]."""
        return float(np.sqrt(self.gain / self.inertia) / (2 * np.pi))

    def step(self) -> float:
        """The longest time step [s] at which an implicit integrator follows the drive."""
        if self.gain <= 0:
            return np.inf
        # dt^2 gain / (inertia + dt rate) = SWING^2
        half = SWING**2 * self.rate / (2.0 * self.gain)
        return float(half + np.sqrt(half**2 + SWING**2 * self.inertia / self.gain))

    def armature(self, step: float) -> float:
        """The inertia [kg*m^2 or kg] that the joint lacks for a time step."""
        return self.gain * (step / SWING) ** 2 - step * self.rate - self.inertia


def stiffest(model: mujoco.MjModel, drives: tuple[Drive, ...]) -> list[Stiff]:
    """How fast each drive acts, in the pose that episodes begin from."""
    free, out = free_inertias(model, keyframe_of(model)), []
    for drive in drives:
        dof = int(model.joint(drive.joint).dofadr[0])
        rate = drive.kt**2 / drive.resistance if drive.kind == "dcmotor" else drive.rate_gain
        gain = drive.gain if drive.kind == "position" else 0.0
        out.append(Stiff(drive.joint, float(free[dof]), gain, rate + float(model.dof_damping[dof])))
    return out


def with_time_step(opened: Opened, drives: tuple[Drive, ...], head: Entry, notes: Notes) -> Entry:
    """[robot] with a time step and an integrator that follow all drives; joints get a rotor where none would.

    Says in a line what was chosen, and why.
    """
    model, longest, values = opened.compiled(), float(head.values["timestep"]), dict(head.values)
    stiff = stiffest(model, drives)
    damped = min(stiff, key=lambda one: one.damping_time)
    if model.opt.integrator in EXPLICIT and longest > LAGS * damped.damping_time:
        values["integrator"] = "implicitfast"
        notes.add(
            f"integrator implicitfast: the drive of {damped.joint} damps it within {damped.damping_time:.2g} s. An "
            f"explicit integrator with a time step of {longest:g} s is too slow for that"
        )
    least = longest / FINER
    for one in stiff:
        if one.step() < least:
            lacking = float(f"{one.armature(2.0 * least):.2g}")
            next(j for j in opened.spec.joints if j.name == one.joint).armature += lacking
            notes.add(
                f"joint {one.joint} got armature {lacking:g}: with a gain of {one.gain:g} on an inertia of "
                f"{one.inertia:.2g} it would swing at {one.swing:.0f} Hz, which no geared joint does. Better write the "
                "inertia of its rotor times the gear ratio squared"
            )
    wanted = min(one.step() for one in stiff)
    step, worst = longest, min(stiff, key=Stiff.step)
    while step > wanted and step > 1.01 * least:
        step /= 2.0
    if step < longest:
        notes.add(f"time step {step:g} s: the drive of {worst.joint} is too fast for {longest:g} s")
    return replace(head, values={**values, "timestep": step})


def with_finer_step(make: Make, tables: Tables, longest: float, notes: Notes) -> Tables:
    """The tables with the longest time step, down from their own, of which half changes little.

    longest : that of the model [s].
    """
    while True:
        robot, step = make(tables), float(tables.robot.values["timestep"])
        found = try_step(robot, robot.running())
        if found is None:
            return tables
        if robot.model.opt.integrator in EXPLICIT:
            notes.add(
                f"integrator implicitfast: with the model's own, the motion was another at half of {step:g} s"
            )
            tables = tables.changed("robot", integrator="implicitfast")
            continue
        finer = max(found.would_do or step / 2.0, longest / FINER)
        if finer > 0.99 * step:
            why = stiff_drive(robot, robot.running()) or "contacts, or a pose that tips over"
            notes.add(f"half the time step still changes {found.channel}: {why}")
            return tables
        notes.add(
            f"time step {finer:g} s: at {step:g} s, half the step still changed the motion of {found.channel}"
        )
        tables = tables.changed("robot", timestep=finer)


def with_sound_ranges(make: Make, tables: Tables, notes: Notes) -> Tables:
    """The tables without parameters that change nothing and without ends of ranges that diverge."""
    whole = tables
    for _ in range(ROUNDS):
        robot = make(tables)
        tried = try_out(robot, robot.running(), whole=True)
        found = [said for said, _ in (*tried.errors, *tried.warnings)]
        wild = [(at[1], at[2]) for at in found if at[0] == "parameters" and at[2] in ("low", "high")]
        idle = [at[1] for at in found if at[0] == "parameters" and at[2] == "sets"]
        if wild or idle:
            tables = replace(tables, parameters=tuple(_kept(tables.parameters, wild, idle, notes)))
        elif ("fall",) in found:
            notes.add("the robot falls while its drives hold its first pose: the draft has no [fall]")
            tables = replace(tables, fall=None)
        else:
            break
    else:
        notes.add(f"{ROUNDS} trials were not enough for sound ranges: robots check tells what is left")
    _say_narrowed(whole, tables, notes)
    return tables


def _say_narrowed(before: Tables, after: Tables, notes: Notes) -> None:
    """A line about each range that was narrowed."""
    ends = {e.values["name"]: (e.values["low"], e.values["high"]) for e in before.parameters}
    for entry in after.parameters:
        name, (low, high) = entry.values["name"], ends[entry.values["name"]]
        now = entry.values["low"], entry.values["high"]
        if now != (low, high):
            notes.add(
                f"range of parameter {name} narrowed to {now[0]:.4g} to {now[1]:.4g}: simulations diverge between "
                f"{low:.4g} and {high:.4g}"
            )


def _kept(parameters: tuple[Entry, ...], wild: list[Range], idle: list[str], notes: Notes) -> Iterator[Entry]:
    """The parameters that change something, their ranges narrowed where an end diverges."""
    for entry in parameters:
        name = entry.values["name"]
        if name in idle:
            notes.add(f"parameter {name} changes nothing in this robot's motion and is left out")
            continue
        ends = {end: _nearer(entry, end) for which, end in wild if which == name}
        yield replace(entry, values={**entry.values, **ends})


def _nearer(entry: Entry, end: str) -> float:
    """An end of a parameter's range a quarter as far from the nominal value."""
    value, nominal = entry.values[end], entry.values["nominal"]
    if entry.values["scale"] == "log":
        return float(nominal * (value / nominal) ** NEARER)
    return float(nominal + NEARER * (value - nominal))


def with_engines(make: Make, tables: Tables, notes: Notes) -> Tables:
    """The tables with engine joint first, where that does what the mujoco engine does; a note says so, or why not.

    No note where joints move each other: nobody would look for the engine there.
    """
    robot = make(tables)
    model = robot.model
    alone = model.ntree == model.nv == len(robot.actions) and not model.neq and not model.ntendon
    if not alone or len(touching_geoms(robot)):
        return tables
    apart = _engines_apart(robot)
    if not (apart > APART).any():
        notes.add("engine joint simulates every joint alone. It fits this robot, and is much faster")
        return tables.changed("robot", engines=["joint", "mujoco"])
    worst = int(np.argmax(apart))
    said = f"engine joint, the faster one, is left out: {robot.channels[worst]} differs from mujoco's"
    said += f" by {100 * apart[worst]:.2g} %" if np.isfinite(apart[worst]) else ", or diverges"
    if not (_engines_apart(robot.stepped(NARROWER)) > APART).any():
        # MuJoCo's step is of first order, that of the joint engine of second
        said += f"; with a time step of {float(tables.robot.values['timestep']) / NARROWER:g} s they agree"
    notes.add(said)
    return tables


def _engines_apart(robot: Robot) -> np.ndarray:
    """(S,) share of its motion by which each channel differs between the engines, its noise aside; infinite where one
    of them fails.
    """
    both = robot.stepped(1.0, engines=["mujoco", "joint"])
    steps = int(min(200, max(20, 0.5 * robot.rate)))
    run = excitation(both, seed=1, name="engines", episodes=4, steps=steps)
    try:
        first, second = (
            rollout(both, both.space.nominal[None], run, engine=engine).states for engine in both.engines
        )
    except DynregError:
        return np.full(len(robot.channels), np.inf)
    motion = np.sqrt(((first - first[:, :, :1]) ** 2).mean(axis=(0, 1, 2)))
    apart = np.sqrt(((first - second) ** 2).mean(axis=(0, 1, 2)))
    unseen = np.maximum(apart - robot.sensor_noise, 0.0)
    return np.where(np.isfinite(apart), unseen / np.maximum(motion, 1e-300), np.inf)
