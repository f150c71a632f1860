"""A simulator that a user steps by hand, one command after the other, on MuJoCo."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Integral, Real

import numpy as np

from dynreg.errors import UsageError, one_of, quoted
from dynreg.rng import stream
from dynreg.sim.commands import limited, noisy
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.effects import Effect
from dynreg.sim.engines.arena import Simulations
from dynreg.sim.engines.diverged import too_fast
from dynreg.sim.engines.mujoco_model import quiet
from dynreg.sim.engines.mujoco_steps import BETWEEN
from dynreg.sim.layout import headed, observe
from dynreg.sim.ports import log_periods, takes_positions
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

ENGINE = "mujoco"
ROOM = 64  # commands that there is room for at first; it doubles
Numbers = Mapping[str, float]


class LiveSimulator:
    """A robot in MuJoCo with a simulator's parameters and effects, one command at a time.

    The states are those of a rollout on the engine "mujoco" under the same commands, to the bit.

    Attributes
    ----------
    robot, config : the robot, and the simulator's parameters and effects.
    model : mujoco.MjModel with the parameters, the drives and the static effects in its fields.
    data : mujoco.MjData, the live state. What is written into `qpos`, `qvel` or `xfrc_applied` acts from the next step
        on; `ctrl` is the step's own. To render it or to call mj_forward on it changes nothing.
    period : [s] of the log that a command lasts.
    outside : keys of the effects that `model` lacks, or has in part: those on commands, drives, friction and sensors.
        They act in `step`, and mujoco.mj_step does without them.
    """

    def __init__(
        self,
        robot: Robot,
        config: SimConfig,
        *,
        settings: Numbers | None = None,
        inputs: Numbers | None = None,
        period: float | None = None,
        seed: int | None = None,
    ):
        """At its settled start.

        settings, inputs : by name, in their units; the robot's nominal ones where they are not named. period : [s]
        between commands; by default the simulator's own. seed : of the motor noise, as of a simulator with that seed in
        a population; None for none.
        Raises UsageError for a robot that cannot run on MuJoCo, an unknown name, a number that is none, no period where
        the robot states none, another seed than a whole number, and an effect that cannot act on the robot.
        """
        _require_mujoco(robot)
        _require_period(robot, period)
        if seed is not None and not isinstance(seed, Integral):
            raise UsageError(f"seed {seed!r}", expected="a whole number, or None", do="give another one")
        self.robot, self.config, self._seed = robot, config, seed
        self._values = robot.space.from_dict(dict(config.values))[None]
        self._terms = terms_of(config, robot)
        known = dict(zip(robot.settings, (s.nominal for s in robot.file.settings), strict=True))
        self._settings = _told("setting", settings, known)
        self._inputs = _told("input", inputs, dict(zip(robot.inputs, robot.input_defaults, strict=True)))
        self._run = Run(
            np.zeros((1, 1, len(robot.actions))),
            self._inputs[None, None],
            self._settings[None],
            period=period,
        )
        self.period = float(log_periods(robot, self._values, self._run)[0, 0])
        effects = self._terms.terms
        self.outside = tuple(term.key for term in effects if _outside(term.effect))
        self._looks_back = any(term.effect.observe is not None for term in effects)
        self.model, self.data = None, None
        self.reset()

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the state vector (S,)."""
        return self.robot.channels

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the commands (A,)."""
        return self.robot.actions

    @property
    def time(self) -> float:
        """[s] of the log since the start."""
        return self._count * self.period

    @property
    def state(self) -> np.ndarray:
        """(S,) the present state as the log would hold it, in the channels' units; NaN once it has diverged."""
        states = self._look()
        if self._diverged or too_fast(self.data.qvel):
            return np.full(len(self.channels), np.nan)
        return self._simulations.logged(states.copy())[0, -2]

    def reset(self, state: Sequence[float] | np.ndarray | None = None) -> np.ndarray:
        """Back to the settled start, the time to 0; the state (S,) there.

        The simulator's own numbers are written into `model` again, and the motor noise is the same again.
        state : (S,) what is known of the state to start from, as the log holds it; NaN where it is not known.
        Raises UsageError for a state of another length, or with an infinite number.
        """
        run = self._run if state is None else replace(self._run, initial=self._known(state)[None])
        terms = self._terms if self._terms.terms else None
        with quiet():
            self._simulations = made = Simulations(self.robot, self._values, run, threads=1, terms=terms)
            alone = made.alone(self.model, self.data)
            self.model, self.data = alone.model, alone.data
            alone.forward()  # for who draws it before the first step
            self._steps = made.steps(np.zeros((1, ROOM, len(self.actions))))
        self._count, self._diverged = 0, False
        self._last = run.initial  # (1, S) which tells the turn of a heading
        self._true = np.empty((1, ROOM, len(self.channels)))
        self._noise = None if self._seed is None else stream(self._seed, "motor noise")
        pose = self.data.qpos[made.layout.action_qpos]
        self._sent = np.where(takes_positions(made.ports), pose, 0.0)[None]
        self._present = self._inputs
        return self.state

    @quiet()
    def step(self, action: Sequence[float] | np.ndarray, *, inputs: Numbers | None = None) -> np.ndarray:
        """Apply one command (A,), in the actions' units, for one period; the state (S,) after it.

        inputs : those that change, by name; they hold from here until the next `reset`.
        Raises UsageError for a command of another length or with a number that is none, and for an unknown input.
        """
        command = _vector("an action", action, self.actions)
        if not np.isfinite(command).all():
            raise _no_number(f"an action with {command[~np.isfinite(command)][0]}")
        if inputs:
            self._present = _told("input", inputs, dict(zip(self.robot.inputs, self._present, strict=True)))
            self._simulations.power(self._present[None])
        self._look()  # what the log holds of this moment, with what a user has written into the data
        clock = self._steps.clock
        clock.commands = _with_room(clock.commands, self._count)
        clock.commands[:, self._count] = self._shaped(command)
        self._steps.hold(self._count)
        self._count += 1
        self._diverged = self._diverged or bool(too_fast(self.data.qvel))
        return self.state

    def _shaped(self, command: np.ndarray) -> np.ndarray:
        """(1, A) what the drives are told."""
        made = self._simulations
        low, high = made.layout.action_range.T[:, None]
        sent = limited(command[None, None], self._sent, low, high, made.ports)
        self._sent = sent[:, 0]  # without the noise: the largest step is one of what is commanded
        noise = None if self._noise is None else self._noise.standard_normal((1, 1, len(command)))
        return noisy(sent, made.ports, noise)[:, 0]

    def _look(self) -> np.ndarray:
        """(1, t+2, S) true states up to now, the last one twice; those before only where a sensor looks back.

        Twice, because sensors may ask for the period, and at the start there is nothing else to tell it by.
        """
        at = self._count if self._looks_back else 0
        self._true = _with_room(self._true, at + 1)
        pose = self._steps.read(self.data.qpos[None], self.data.qvel[None])
        self._true[:, at : at + 2] = observe(self._simulations.layout, *pose, len(self.channels))
        headed(self._simulations.layout, self._true[:, at : at + 2], self._last)
        self._last = self._true[:, at].copy()
        return self._true[:, : at + 2]

    def _known(self, state: Sequence[float] | np.ndarray) -> np.ndarray:
        known = _vector("a state", state, self.channels)
        if np.isinf(known).any():
            raise _no_number("a state with an infinite number", "; NaN where it is not known")
        return known


def _outside(effect: Effect) -> bool:
    """Whether a model's fields do not hold the whole effect; what encoders do to a log they never hold."""
    acting = any(getattr(effect, port) is not None for port in (*BETWEEN, "observe"))
    return acting or effect.acts_on == "sensor"


def _with_room(array: np.ndarray, at: int) -> np.ndarray:
    """(1, T, ...) array with a row number `at`: itself, or one of twice the length."""
    return array if at < array.shape[1] else np.concatenate([array, np.zeros_like(array)], axis=1)


def _vector(what: str, given: Sequence[float] | np.ndarray, names: Sequence[str]) -> np.ndarray:
    """(len(names),) numbers; UsageError where they are not as many numbers."""
    try:
        vector = np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise _no_number(f"{what} of {given!r}") from None
    if vector.shape != (len(names),):
        raise UsageError(
            f"{what} of shape {vector.shape}",
            expected=f"({len(names)},), one number for each of {', '.join(names)}",
            do="give these, in this order",
        )
    return vector


def _told(kind: str, told: Numbers | None, known: Mapping[str, float]) -> np.ndarray:
    """(len(known),) the known numbers by name, with those that were told in their place."""
    for name, value in (told or {}).items():
        if name not in known:
            raise UsageError(
                f"unknown {kind} {name!r}",
                expected=one_of(known, name) if known else f"none: the robot has no {kind}s",
                do="correct the name",
            )
        if not isinstance(value, Real) or not np.isfinite(value):
            raise _no_number(f"{kind} {name!r} of {value!r}")
    return np.array([float(value) for value in (dict(known) | dict(told or {})).values()])


def _no_number(problem: str, unless: str = "") -> UsageError:
    return UsageError(problem, expected=f"finite numbers{unless}", do="correct it")


def _require_mujoco(robot: Robot) -> None:
    offered = robot.file.robot.engines
    if ENGINE not in offered:
        raise UsageError(
            f"robot {robot.name!r} cannot be stepped by hand: it does not run on MuJoCo",
            expected=f"a robot with the engine {ENGINE!r}, not {quoted(offered)}",
            do="replay a recording's commands in its simulators with `dynreg compare`",
        )


def _require_period(robot: Robot, period: float | None) -> None:
    if period is None and not robot.file.robot.control_rate:
        raise UsageError(
            f"no period for robot {robot.name!r}",
            expected="the seconds that a command lasts: the robot's control is timed, and states none",
            do="give period=...",
        )
    if period is not None and not (isinstance(period, Real) and 0 < period < np.inf):
        raise UsageError(f"period {period!r}", expected="seconds, above 0", do="correct it")
