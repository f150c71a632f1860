"""One-step predictions from every measured row, and the residual acceleration of each joint."""

from collections.abc import Sequence

import numpy as np

from dynreg.data.names import joint_of
from dynreg.diagnose.residual_fit import Residuals
from dynreg.diagnose.signals import JointSignals, joint_signals, position_column, velocity_column
from dynreg.errors import UsageError
from dynreg.replay.windows import Windows
from dynreg.sim.effects.body import neighbours
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

STILL = (
    2.0  # standard deviations of velocity noise below which a joint counts as still: 95 % of its rows at rest
)


def one_step_run(robot: Robot, windows: Windows, lead: int = 0) -> Run:
    """Every command of W windows as an episode of its own, which starts from the measured row `lead` rows before it.

    Gives W T episodes of 1 + lead steps. Those of a window's first rows start from its first row. With a `lead`,
    effects that remember commands (a delay) see the commands before. Velocities that the log lacks are the slope of the
    positions. `predictions` reads the rollouts.
    """
    run, count = windows.run, len(windows) * windows.run.steps
    initial = _starts(robot, windows)
    begin = None
    start = np.maximum(np.arange(run.steps) - lead, 0)
    rows = np.minimum(start[:, None] + np.arange(1 + lead), run.steps - 1)  # (T, 1 + lead) commands of each
    if run.begin is not None:
        begin = (run.begin[:, None] + windows.period * start).reshape(count)
    return Run(
        run.actions[:, rows].reshape(count, 1 + lead, -1),
        inputs=None if run.inputs is None else run.inputs[:, rows].reshape(count, 1 + lead, -1),
        settings=None if run.settings is None else np.repeat(run.settings, run.steps, axis=0),
        initial=initial[:, start].reshape(count, -1),
        period=run.period,
        begin=begin,
        joints=run.joints,
    )


def predictions(robot: Robot, windows: Windows, states: np.ndarray) -> np.ndarray:
    """(W, T, S) row t+1 from row t by rollouts (W T, 2 + lead, S) of `one_step_run`, NaN in a window's first `lead`.

    With a lead, the change of the last step is added to the measured row, so that errors of the steps before do not
    count.
    """
    shape = (len(windows), windows.run.steps, states.shape[-1])
    lead = states.shape[1] - 2
    last = states[:, -1].reshape(shape)
    if not lead:
        return last
    out = _starts(robot, windows) + last - states[:, -2].reshape(shape)
    out[:, :lead] = np.nan
    return out


def one_step_residuals(robot: Robot, windows: Windows, predicted: np.ndarray) -> tuple[Residuals, ...]:
    """The residual acceleration of each joint for one simulator: measured - predicted [unit of velocity / s].

    Of all driven joints, or of the joints of the windows' run. It comes from measured velocities, or else from the
    second difference of positions. Joints without a velocity channel are left out, because no simulator can start with
    their motion.

    predicted : (W, T, S) row t+1 from the measured row t (`one_step_run`).
    Raises UsageError if its shape does not fit the windows.
    """
    if predicted.shape != windows.measured[:, 1:].shape:
        raise UsageError(
            f"one-step predictions of shape {predicted.shape}",
            expected=f"{windows.measured[:, 1:].shape}",
            do="give one row for every command of every window",
        )
    out = []
    looked = windows.run.joints
    every = joint_signals(robot, windows)
    beside = beside_each(robot)
    for joint, signals in every.items():
        if looked is not None and joint_of(joint) not in looked:
            continue
        found = _accelerations(robot, windows, predicted, joint, signals.velocity)
        if found is None:
            continue
        values, unit = found
        shape = values.shape
        flat = {
            name: np.broadcast_to(s, shape).reshape(-1)
            for name, s in _signals(
                robot, windows, signals, [every[k] for k in beside.get(joint, ())]
            ).items()
        }
        trajectory = np.repeat(windows.episode, shape[1])
        out.append(Residuals(joint, unit, values.reshape(-1), flat, trajectory))
    return tuple(out)


def _starts(robot: Robot, windows: Windows) -> np.ndarray:
    """(W, T, S) measured rows, with velocities from positions where the log has none."""
    rows = windows.measured[:, :-1].copy()
    for joint, signals in joint_signals(robot, windows).items():
        column = velocity_column(robot, joint)
        if column is not None:
            rows[..., column] = signals.velocity
    return rows


def _accelerations(
    robot: Robot, windows: Windows, predicted: np.ndarray, joint: str, velocity: np.ndarray
) -> tuple[np.ndarray, str] | None:
    """(W, T) measured - predicted acceleration and its unit. velocity : (W, T) at the start of the predictions."""
    measured, period = windows.measured, windows.period
    p, v = position_column(robot, joint), velocity_column(robot, joint)
    if v is None:
        return None
    # the start counts too: a row whose own state was not measured was not predicted from it
    if np.isfinite(measured[..., v]).any():
        known = np.isfinite(measured[:, :-1, v])
        difference = np.where(known, measured[:, 1:, v] - predicted[..., v], np.nan) / period
    elif p is not None and np.isfinite(measured[..., p]).any():
        # a second difference is the mean acceleration of the steps before and after its row
        position, simulated = measured[..., p], (predicted[..., v] - velocity) / period
        difference = np.full(simulated.shape, np.nan)
        difference[:, 1:] = (
            np.diff(position, n=2, axis=1) / period**2 - (simulated[:, 1:] + simulated[:, :-1]) / 2
        )
    else:
        return None
    difference = np.where(np.isfinite(difference), difference, np.nan)
    return difference, f"{robot.file.channels[v].unit}/s".replace("/s/s", "/s^2")


def beside_each(robot: Robot) -> dict[str, tuple[str, ...]]:
    """{joint: the joints before and after it}: a cable or a gear that passes through one moves the other."""
    out: dict[str, tuple[str, ...]] = {}
    for first, second in neighbours(robot):
        out[first] = (*out.get(first, ()), second)
        out[second] = (*out.get(second, ()), first)
    return out


def _way(of: JointSignals) -> np.ndarray:
    """(W, T) sign of a joint's velocity, 0 where it is no more than noise."""
    with np.errstate(invalid="ignore"):
        sign = np.where(np.abs(of.velocity) > STILL * of.velocity_noise, np.sign(of.velocity), 0.0)
    return np.where(np.isfinite(of.velocity), sign, np.nan)


def _signals(
    robot: Robot, windows: Windows, own: JointSignals, beside: Sequence[JointSignals] = ()
) -> dict[str, np.ndarray]:
    """{name: array that broadcasts to (W, T)} of the signals that may predict a joint's residual.

    Those of the joints `beside` it have their names: "joint_5/velocity".
    """
    steps = np.arange(windows.run.steps) * windows.period
    begin = windows.run.begin
    out = {
        "position": own.position,
        "velocity": own.velocity,
        "sign_of_velocity": _way(own),
        "load": own.torque,
        "command": own.command,
        "command_error": own.command_error,
        "time": steps[None] + (0.0 if begin is None else begin[:, None]),
    }
    for other in beside:
        theirs = {"position": other.position, "velocity": other.velocity, "sign_of_velocity": _way(other)}
        out |= {f"{other.joint}/{name}": signal for name, signal in theirs.items()}
    run = windows.run
    if run.inputs is not None:
        out |= {name: run.inputs[..., i] for i, name in enumerate(robot.inputs)}
    if run.settings is not None:
        out |= {name: run.settings[:, i, None] for i, name in enumerate(robot.settings)}
    return out
