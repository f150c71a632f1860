"""Benches, sizes and rollouts that the tests of effects share."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from dynreg.sim.effects import Effect, Term, Terms, effects
from dynreg.sim.effects.body import at_reset, carrier, driven_dofs, lever
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation, reset_pose
from dynreg.sim.ports import largest_speeds, nominal_ports, servo_law
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.sim.spec import PidDrive

Row = Mapping[Effect, str | float]  # the effects of one simulator, with their sizes


@dataclass(frozen=True)
class Bench:
    """A robot, what it is made to do, and the engine."""

    name: str
    robot: Robot
    run: Run
    engine: str

    @property
    def columns(self) -> np.ndarray:
        """Channels that count in a diagnosis."""
        return np.flatnonzero([c.weight > 0 for c in self.robot.file.channels])

    def states(self, *rows: Row, threads: int = 1) -> np.ndarray:
        """(rows, E, T+1, S) states of the nominal robot with the effects of each row."""
        nominal = np.tile(self.robot.space.nominal, (len(rows), 1))
        terms = mixed(self.robot, rows) if any(rows) else None
        return rollout(self.robot, nominal, self.run, engine=self.engine, threads=threads, terms=terms).states

    def changes(self, *rows: Row) -> np.ndarray:
        """(rows, E, T+1, C) what the effects of each row change in the channels that count."""
        return (self.states(*rows) - plain(self))[..., self.columns]

    def __hash__(self) -> int:
        return hash(self.name)


@cache
def plain(bench: Bench) -> np.ndarray:
    """(E, T+1, S) states of the bench without effects."""
    return bench.states({})[0]


@cache
def together(bench: Bench, size: str | float) -> dict[Effect, np.ndarray]:
    """(E, T+1, C) of each effect of the library that the bench can have, at one size: all of them in one batch."""
    able = [e for e in effects().values() if e.why_not(bench.robot) is None]
    return dict(zip(able, bench.changes(*({e: size} for e in able)), strict=True))


@cache
def fine(bench: Bench) -> Bench:
    """The same in time steps of an eighth."""
    return replace(bench, name=f"{bench.name}, fine", robot=bench.robot.stepped(8.0))


@cache
def bench(name: str) -> Bench:
    """servo (lively: it saturates), servo_mujoco, servo_short, pid, pid_mujoco (the same on a pid drive), arm, air,
    stand (a leg), lean (a quadruped), wheels.

    The two on the ground move slowly, so that contacts neither open nor close by chance.
    """
    if name.startswith("servo"):
        robot = load_robot("servo_pendulum")
        episodes, steps = (2, 40) if name == "servo_short" else (4, 80)
        run = excitation(robot, seed=3, name="effects", episodes=episodes, steps=steps)
        settings = run.settings.copy()
        settings[:, robot.settings.index("kp")] = [800.0, 200.0, 400.0, 800.0][:episodes]
        run = replace(run, settings=settings, begin=20.0 * np.arange(episodes))
        if name == "servo_short":  # tiny gaps and ramps take a time step that resolves them
            fine = robot.file.robot.model_copy(update={"timestep": 0.002})
            robot = replace(robot, file=robot.file.model_copy(update={"robot": fine}))
        return Bench(name, robot, run, "mujoco" if name.endswith("mujoco") else "joint")
    if name.startswith("pid"):
        servo = bench("servo")
        loop = {
            "gain": 4.0,
            "integral_gain": 12.0,
            "rate_gain": 0.08,
            "torque_limit": 0.6,
            "speed_limit": 30.0,
        }
        (own,) = servo.robot.file.drives
        drives = [PidDrive(joint="arm", type="pid", enable=own.enable, **loop)]
        robot = replace(servo.robot, file=servo.robot.file.model_copy(update={"drives": drives}))
        settings = servo.run.settings.copy()
        settings[:, robot.settings.index("kp")] = [8.0, 4.0, 6.0, 8.0]  # which is the gain
        run = replace(servo.run, settings=settings)
        return Bench(name, robot, run, "mujoco" if name.endswith("mujoco") else "joint")
    if name == "wheels":
        robot = load_robot("diffdrive")
        return Bench(
            name, robot, excitation(robot, seed=3, name="effects", episodes=4, steps=60), "kinematic"
        )
    if name == "lean":
        robot = load_robot("quadruped")
        sway = np.sin(np.pi * np.arange(20) / 20)[:, None]
        return Bench(
            name, robot, Run((reset_pose(robot) + sway * np.tile([0.1, 0.15, -0.2], 4))[None]), "mujoco"
        )
    if name == "arm":
        robot = load_robot("so101")
        alone = robot.file.robot.model_copy(update={"engines": ["mujoco"]})
        robot = replace(robot, file=robot.file.model_copy(update={"robot": alone}))
        return Bench(name, robot, excitation(robot, seed=3, name="effects", episodes=2, steps=60), "mujoco")
    robot = load_robot("leg")
    if name == "stand":
        sway = np.sin(np.pi * np.arange(60) / 60)[:, None]
        run = Run((reset_pose(robot) + sway * [0.1, 0.25, -0.3])[None], settings=np.array([[0.2]]))
        return Bench(name, robot, run, "mujoco")
    run = excitation(robot, seed=3, name="effects", episodes=4, steps=30)
    return Bench(name, robot, replace(run, settings=np.full((4, 1), 0.5)), "mujoco")


def values_at(effect: Effect, robot: Robot, size: str | float) -> np.ndarray:
    """(K,) values of one called size, or of a multiple of the weak one; shapes stay typical, limits are divided."""
    out = []
    for p in effect.parameters:
        if isinstance(size, str):
            multiple = p.size(size)
        elif p.shape:
            multiple = p.medium
        else:
            multiple = p.weak / size if p.inverse else p.weak * size
        out.append(multiple * unit_of(robot, p.per))
    return np.array(out)


@cache
def unit_of(robot: Robot, per: str) -> float:
    """What sizes of one kind are multiples of, in SI units; the mean over the robot's drives."""
    if robot.planar:
        return {"1": 1.0, "command": float(largest_speeds(robot).mean())}[per]
    law = servo_law(nominal_ports(robot, 1), robot.input_defaults[None])
    if per == "inertia":
        model, data = robot.model, at_reset(robot)
        return float(data.M[model.M_rowadr + model.M_rownnz - 1][driven_dofs(robot)].mean())
    if per == "length":
        return lever(robot, carrier(robot))
    if per == "mass":
        return float(robot.model.body_mass[carrier(robot)])
    return {
        "1": 1.0,
        "command": 1.0,
        "torque": float(law.limit.mean()),
        "stiffness": 1.0 / float(law.stiffness.mean()),
    }[per]


def mixed(robot: Robot, rows: Sequence[Row]) -> Terms:
    """Terms of one simulator for each row."""
    every = list({e: None for row in rows for e in row})
    columns = []
    for e in every:
        absent = np.full(len(e.parameters), np.nan)
        columns.append(np.array([values_at(e, robot, row[e]) if e in row else absent for row in rows]))
    return Terms(tuple(Term(e, e.places(robot)[0]) for e in every), tuple(columns))


def rms(change: np.ndarray) -> float:
    return float(np.sqrt(np.mean(change**2)))
