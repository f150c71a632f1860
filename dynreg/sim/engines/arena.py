"""Robots set up and settled once on `mujoco.batch.Batch`, each simulation with its own model fields, then run often."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
from mujoco.batch import Batch

from dynreg.errors import SimulationError
from dynreg.sim.beside import own_geoms
from dynreg.sim.effects import Moment, Terms
from dynreg.sim.engines.acting import Clock, acting, clock_of, configure_terms, observed, on, with_drives
from dynreg.sim.engines.alone import Alone
from dynreg.sim.engines.diverged import diverged, too_fast
from dynreg.sim.engines.mujoco_model import (
    compiled,
    configure,
    episode_inputs,
    joint_inertia,
    modelled,
    quiet,
    told,
    told_before,
)
from dynreg.sim.engines.mujoco_reset import foot_spheres, named_geoms, reset
from dynreg.sim.engines.mujoco_steps import Drives, EffectSteps, Steps, busy_simulations
from dynreg.sim.fields import own_field
from dynreg.sim.layout import Layout, base_motion, filters, headed, observe, start_place
from dynreg.sim.ports import law_changes, servo_law
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, Simulated, Walk

TOUCHING = 1e-3  # m above the ground
_KEPT = ("qpos", "qvel", "act", "qacc_warmstart", "time", "ctrl", "qfrc_applied")  # what a start consists of


class Simulations:
    """N simulations, set up and settled once; every run starts there, with other commands.

    `run` has an episode for each; it gives all but the commands: settings, inputs, initial states, period, noise.
    slope : angle [rad] of the ground, rising ahead of the robot: gravity is turned. laid : (n, 2) where the first n of
    the tracked bodies lie [m], ahead and to the left of where the keyframe has the base; by default as the model has
    them.
    """

    def __init__(
        self,
        robot: Robot,
        values: np.ndarray,
        run: Run,
        *,
        threads: int = 0,
        terms: Terms | None = None,
        slope: float = 0.0,
        laid: np.ndarray | None = None,
    ):
        robot = modelled(robot, terms, len(values))
        model, self.layout = compiled(robot)
        self.robot = robot
        batch = Batch(model, len(values), nthread=threads)
        self._batch: Batch | Alone = batch
        self.ports = ports = configure(robot, batch, model, values, run)
        self._active = acting(robot, terms)
        configure_terms(robot, self._active, ports, batch.expand)
        self._active = with_drives(self._active, robot, ports)
        *place, heading = start_place(robot, self.layout)
        ahead = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        if slope:
            _tilt(batch.expand("opt.gravity"), slope, ahead)
        self._inputs = episode_inputs(robot, run)
        self._drives = Drives(batch, self.layout, ports)
        self.power(self._inputs[:, 0])
        batch.set_const()
        self._period, self._begin = clock_of(ports, run)
        self._h = self._period / robot.substeps(self._period)  # each divides its own period between commands
        batch.expand("opt.timestep")[:] = self._h.reshape(batch.expand("opt.timestep").shape)
        self._busy = busy_simulations(self._active, self._drives.law)
        batch.reset(keyframe=robot.keyframe)
        self._inertia = joint_inertia(batch, model, self.layout) if len(self._busy) else None
        told = [values, self._inputs[:, 0], *(terms.values if terms else ())]
        told += [] if run.settings is None else [run.settings]
        reset(robot, batch, model, self.layout, run, ports, told)
        if laid is not None:
            batch.bind("qpos")[:, self.layout.tracked[: len(laid), None] + np.arange(2)] = (
                place + laid @ ahead
            )
        for a in on(self._active, "begin"):
            a.effect.begin(robot, batch, a.rows)
        self._start = {name: batch.bind(name).copy() for name in _KEPT}
        self._memory = [copy.deepcopy(a.moment.memory) for a in self._active]
        self._filters, self._placed = filters(model, self.layout), run.initial is not None
        self._used = False

    def play(self, run: Run) -> Simulated:
        """The whole episodes under the commands and motor noise of `run`, as the log would hold them."""
        steps = self._steps(run)
        trace_q, trace_v = self._trace(steps, read=True)
        states = observe(
            self.layout, np.swapaxes(trace_q, 0, 1), np.swapaxes(trace_v, 0, 1), len(self.robot.channels)
        )
        headed(self.layout, states, run.initial)
        states = self.logged(states)
        states[diverged(np.swapaxes(trace_v, 0, 1))] = np.nan
        down = np.zeros(trace_q.shape[:2], dtype=bool)
        if self.layout.base_qpos >= 0:
            down = has_fallen(self.robot, trace_q[..., self.layout.base_qpos :])
        fell = np.where(down.any(axis=0), down.argmax(axis=0), run.steps + 1)
        return Simulated(states, fell, steps.clock.substeps * run.steps)

    @quiet()
    def poses(self, run: Run) -> np.ndarray:
        """(N, T+1, nq) where all joints of the model are at the command times, for drawing.

        Falls go on to the end; a simulation that diverges holds NaN from then on.
        """
        trace_q, trace_v = self._trace(self._steps(run))
        poses = np.swapaxes(trace_q, 0, 1)
        poses[diverged(np.swapaxes(trace_v, 0, 1))] = np.nan
        return poses

    def logged(self, states: np.ndarray) -> np.ndarray:
        """(n, T+1, S) what the log holds of true states since the start, by its sensors; may change `states`."""
        return observed(self.robot, self._active, states, self.ports, self._period)

    def power(self, inputs: np.ndarray) -> None:
        """Let the drives follow the law that inputs (n, I) make, from here on."""
        self._drives.apply(servo_law(self.ports, inputs))

    def alone(self, model: mujoco.MjModel | None = None, data: mujoco.MjData | None = None) -> Alone:
        """Move the one simulation, as it is, into a model and data of its own; `steps` and `power` go on there.

        model, data : to write it into, from an earlier `alone` of the same robot; new ones by default.
        """
        self._batch = Alone(self._batch.get_model(0, model), self._batch.get_data(0, data))
        self._drives = self._drives.on(self._batch)
        return self._batch

    def model(self, simulation: int) -> mujoco.MjModel:
        """A copy of the MuJoCo model of a simulation (its number), with its parameters and effects in the fields."""
        return self._batch.get_model(simulation)

    @quiet()
    def walk(self, run: Run, *, feet: bool = False) -> Walk:
        """How the base moves under the commands and motor noise of `run`; a simulation ends where it falls.

        feet : look at which feet (the robot's own spheres that can touch the ground) touch it, too: that is slower.
        Raises SimulationError for a robot without a floating base.
        """
        if self.layout.base_qpos < 0:
            raise SimulationError(
                f"robot {self.robot.name!r} has no floating base",
                expected="a model with a free joint: what stands on a bench does not walk",
                do="name another robot",
            )
        steps = self._steps(run)
        model = compiled(self.robot)[0]
        spheres = own_geoms(self.robot, foot_spheres(model)) if feet else np.zeros(0, dtype=int)
        heights = np.full((run.steps + 1, self._batch.nsim, len(spheres)), np.inf)
        tracked = self.layout.tracked
        places = np.empty((run.steps + 1, self._batch.nsim, len(tracked), 3)) if len(tracked) else None
        base, fell, taken = _walk(self.robot, self._batch, self.layout, steps, spheres, heights, places)
        bodies = None if places is None else np.swapaxes(places, 0, 1)
        radii = own_field(self._batch, model, "geom_size")[:, spheres, 0]
        touching = np.moveaxis(heights - radii < TOUCHING, 0, -1)
        names = named_geoms(model, spheres)
        return Walk(base, fell, taken, {name: touching[:, i] for i, name in enumerate(names)}, bodies)

    def _trace(self, steps: Steps, *, read: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """(T+1, n, nq), (T+1, n, nv) of whole episodes; read : with joints where their encoders stand."""
        qpos, qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        count = steps.clock.commands.shape[1]
        trace_q = np.empty((count + 1, *qpos.shape))
        trace_v = np.empty((count + 1, *qvel.shape))
        trace_q[0], trace_v[0] = qpos, qvel
        changed = law_changes(self.ports, self._inputs)
        for t in range(count):
            if t in changed:
                self.power(self._inputs[:, t])
            steps.hold(t)
            trace_q[t + 1], trace_v[t + 1] = steps.read(qpos, qvel) if read else (qpos, qvel)
        return trace_q, trace_v

    def _steps(self, run: Run) -> Steps:
        """Every simulation at its start, with the commands of `run` before it."""
        batch = self._batch
        if self._used:
            for name, values in self._start.items():
                batch.bind(name)[:] = values
            for a, memory in zip(self._active, self._memory, strict=True):
                a.moment = Moment(memory=copy.deepcopy(memory))
            self._drives.rub(self._drives.plain)
            self.power(self._inputs[:, 0])
        self._used = True
        q = batch.bind("qpos")[:, self.layout.action_qpos]
        commands = told(self.layout, self.ports, run, q)
        steps = self.steps(commands, run.draws, told_before(self.layout, run))
        if self._placed:  # on the way: a filter holds what was told before
            self._fill(steps.clock)
        return steps

    def _fill(self, clock: Clock) -> None:
        """Let the actuators' own filters hold what the commands before made of them, without effects on these."""
        drives, places = self._filters
        at = self.layout.action_actuator[drives]
        lag = self._batch.expand("actuator_dynprm")[:, at, 0] if len(at) else np.ones((1, 0))
        keep = np.exp(-self._period[:, None] / np.maximum(lag, 1e-9))
        first = 0 if clock.before is None else -clock.before.shape[1]
        held = clock.told[:, first, drives]
        for step in range(first, 0):
            told = clock.told[:, step, drives]
            held = told + keep * (held - told)
        self._batch.bind("act")[:, places] = held

    def steps(
        self, commands: np.ndarray, draws: np.ndarray | None = None, before: np.ndarray | None = None
    ) -> Steps:
        """Every simulation as it is, with commands (n, T, A) ahead of it, as the drives are told them.

        before : (n, L, A) what they were told until now, as in `Clock`.
        """
        batch = self._batch
        clock = Clock(commands, self._period, self._h, self._begin, draws, before)
        if not len(self._busy):
            return Steps(batch, self.layout, self._drives, clock, self._busy)
        effects = (self._active, self.ports, self._inertia)
        return EffectSteps(batch, self.layout, self._drives, clock, self._busy, *effects)


def _tilt(gravity: np.ndarray, slope: float, ahead: np.ndarray) -> None:
    """Turn gravity (n, 3), in place, as on ground that rises by `slope` [rad] along the first row of `ahead` (2, 2)."""
    level = gravity[:, :2] @ ahead.T  # a tilted base has some ahead already
    up = gravity[:, 2].copy()
    gravity[:, 2] = np.cos(slope) * up - np.sin(slope) * level[:, 0]
    level[:, 0] = np.cos(slope) * level[:, 0] + np.sin(slope) * up
    gravity[:, :2] = level @ ahead


def _walk(
    robot: Robot,
    batch: Batch,
    layout: Layout,
    steps: Steps,
    feet: np.ndarray,
    heights: np.ndarray,
    places: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, int]:
    """(n, T+1, 12) the base, (n,) the step at which each simulation fell or diverged, time steps taken.

    Simulations that fell stand still from then on, and are not advanced. The heights (T+1, n, F) [m] of the centres
    of the `feet` (geoms) are written from the first command on, where there are any. So are the
    places (T+1, n, N, 3) [m] of the tracked bodies, from the start.
    """
    qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
    centres = batch.bind("geom_xpos") if len(feet) else None
    commands = steps.clock.commands.shape[1]
    at, dof = layout.base_qpos, layout.base_dof
    trace_q, trace_v = np.empty((commands + 1, batch.nsim, 7)), np.empty((commands + 1, batch.nsim, 6))
    trace_q[0], trace_v[0] = qpos[:, at : at + 7], qvel[:, dof : dof + 6]
    beside = layout.tracked[:, None] + np.arange(3)
    if places is not None:
        places[0] = qpos[:, beside]
    fell, taken = np.full(batch.nsim, commands + 1), 0
    for t in range(commands):
        standing = fell > commands
        if not standing.any():
            trace_q[t + 1 :], trace_v[t + 1 :] = trace_q[t], trace_v[t]
            break
        steps.hold(t)
        if centres is not None:
            heights[t + 1] = np.where(standing[:, None], centres[:, feet, 2], np.inf)
        taken += int(steps.clock.substeps[standing].sum())
        trace_q[t + 1], trace_v[t + 1] = qpos[:, at : at + 7], qvel[:, dof : dof + 6]
        if places is not None:
            places[t + 1] = qpos[:, beside]
        down = standing & (has_fallen(robot, trace_q[t + 1]) | too_fast(qvel))
        if down.any():
            fell[down] = t + 1
            steps.keep(fell > commands)
    last = np.where(fell > commands, commands, fell - 1)
    still = np.minimum(np.arange(commands + 1)[:, None], last)
    rows = np.arange(batch.nsim)
    if places is not None:
        places[:] = places[still, rows]
    base = base_motion(replace(layout, base_qpos=0, base_dof=0), trace_q[still, rows], trace_v[still, rows])
    return np.swapaxes(base, 0, 1), fell, taken


def has_fallen(robot: Robot, base: np.ndarray) -> np.ndarray:
    """(...) whether a base (..., 7 or more: position, quaternion) tilts or sinks too far; never without [fall]."""
    if robot.file.fall is None:
        return np.zeros(base.shape[:-1], dtype=bool)
    x, y = base[..., 4], base[..., 5]
    upright = 1 - 2 * (x * x + y * y)
    return (upright < np.cos(robot.file.fall.tilt)) | (base[..., 2] < robot.file.fall.height)
