"""The tools beside which a diagnosis is put, on the same segments of a recording.

`identify`: mujoco.sysid fits parameters that a person chose to free; it names nothing. `sparse`: sparse regression
(pysindy) on the torque that the rigid-body model leaves unexplained; the terms that stay are its answer.
"""

import contextlib
import copy
import io
import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import mujoco
import numpy as np
from mujoco.batch import Batch
from open_loop import Segments
from scipy.signal import butter, sosfiltfilt

from dynreg.data.recording import Recording
from dynreg.sim.engines.mujoco_model import quiet
from dynreg.sim.robot import Robot

TERMS = ("1", "v", "sign(v)", "v|v|", "|v|", "a")  # what sparse regression may use of each joint's motion
THRESHOLDS = (0.01, 0.02, 0.05, 0.1, 0.2)  # of the torque's spread, below which it drops a term
SETTLES = 2.0  # periods of a filter
STILL = 1e-4  # rad/s (m/s) below which a joint counts as at rest


@dataclass(frozen=True)
class Knob:
    """A parameter that `identify` may move. apply : writes its value into a specification."""

    name: str
    nominal: float
    low: float
    high: float
    apply: Callable[[mujoco.MjSpec, float], None]


@dataclass(frozen=True)
class Peer:
    """A fitted peer. model : with the fitted parameters. values : what was fitted, by name. force : (A, TERMS)
    coefficients of the torque [N m or N] against motion that MuJoCo has no field for. gain : torque per command.
    """

    name: str
    model: mujoco.MjModel
    values: dict[str, float]
    seconds: float
    named: str
    force: np.ndarray | None = None
    gain: float = 1.0

    def run(self, segments: Segments) -> np.ndarray:
        """(W, T+1, 2 A) positions and velocities from the measured states under the measured commands."""
        with quiet():  # a regression can have a friction that pushes
            return _run(self.model, segments, self.gain, self.force)


@dataclass(frozen=True)
class Motion:
    """Filtered motion for regression, each (N, A): position, velocity, acceleration, torque of the drives."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    torque: np.ndarray

    @classmethod
    def of(
        cls,
        robot: Robot,
        recording: Recording,
        names: list[str],
        *,
        filter_hz: float,
        every: int,
        gain: float = 1.0,
    ) -> "Motion":
        """Of episodes, every `every`-th row: positions differentiated, all filtered alike without a lag.

        Where the filter has not settled, at both ends, rows are left out.
        """
        edge = round(SETTLES / filter_hz * robot.rate)
        sos, count = butter(4, filter_hz, fs=robot.rate, output="sos"), len(robot.actions)
        parts = []
        for e in recording.episodes:
            if e.name in names:
                values = e.values[:, recording.columns((*robot.channels[:count], *robot.actions))]
                q, torque = np.split(sosfiltfilt(sos, values, axis=0), 2, axis=1)
                v = np.gradient(q, 1 / robot.rate, axis=0)
                a = np.gradient(v, 1 / robot.rate, axis=0)
                parts.append([x[edge:-edge:every] for x in (q, v, a, gain * torque)])
        return cls(*(np.concatenate(p) for p in zip(*parts, strict=True)))

    def rows(self, start: int, stop: int | None = None) -> "Motion":
        """Only these rows."""
        return Motion(*(x[start:stop] for x in (self.q, self.v, self.a, self.torque)))


def identify(xml: str, knobs: Sequence[Knob], segments: Segments, *, gain: float = 1.0) -> Peer | None:
    """mujoco.sysid on the model `xml`, with `knobs` free, over all segments.

    Its own residual compares sensors that lag the state by one step and divides by the norm of every single window;
    here the states themselves are compared, each channel in units of its spread. None, with one line, where what
    mujoco.sysid needs is not installed.
    """
    from mujoco import sysid

    if not hasattr(sysid, "optimize"):
        print("mujoco.sysid: skipped, it lacks packages (pip install 'dynreg[peers]')")
        return None
    logging.getLogger("absl").setLevel(logging.ERROR)  # it warns of every segment whose sensors are states
    began = time.perf_counter()
    spread = segments.measured.std(axis=(0, 1))
    parameters = sysid.ParameterDict()
    for knob in knobs:
        write = lambda spec, p, knob=knob: knob.apply(spec, float(p.value[0]))  # noqa: E731
        parameters.add(sysid.Parameter(knob.name, knob.nominal, knob.low, knob.high, modifier=write))
    # edits of a specification outlive the fit: every model is compiled from a fresh copy
    build = lambda p, _: sysid.apply_param_modifiers(p, mujoco.MjSpec.from_string(xml))  # noqa: E731

    def residual(_params, _predicted, measured, _model, _everything, *, state, **_):
        return (state[:, 1:] - measured.data[1:]) / spread, measured, measured

    function = sysid.build_residual_fn(
        models_sequences=[_sequences(sysid, xml, segments, gain)],
        build_model=build,
        modify_residual=residual,
        n_threads=1,
        resample_true=False,
    )
    with contextlib.redirect_stdout(io.StringIO()):  # its optimizer prints every iteration
        fitted, _ = sysid.optimize(parameters, function, optimizer="mujoco", verbose=False)
    values = {knob.name: float(fitted[knob.name].value[0]) for knob in knobs}
    seconds = time.perf_counter() - began
    return Peer("mujoco.sysid", build(fitted, None), values, seconds, "no: told what to free", gain=gain)


def sparse(model: mujoco.MjModel, fit: Motion, select: Motion, *, gain: float = 1.0) -> Peer | None:
    """Sparse regression (sequentially thresholded least squares) of the torque that `model` leaves unexplained.

    The threshold is chosen on `select`. None, with one line, where pysindy is not installed.
    """
    if find_spec("pysindy") is None:
        print("sparse regression: skipped, pysindy is not installed (pip install 'dynreg[peers]')")
        return None
    from pysindy.optimizers import STLSQ

    began = time.perf_counter()
    trials = []
    for threshold in THRESHOLDS:
        force = np.zeros((model.nv, len(TERMS)))
        for joint in range(model.nv):
            rows, left = features(fit, joint), _unexplained(model, fit)[:, joint]
            scale = rows.std(axis=0) + (rows.std(axis=0) == 0)
            solver = STLSQ(threshold=threshold * fit.torque[:, joint].std(), alpha=1e-6)
            force[joint] = solver.fit(rows / scale, left[:, None]).coef_[0] / scale
        left = _unexplained(model, select)
        for joint in range(model.nv):
            left[:, joint] -= features(select, joint) @ force[joint]
        trials.append((float(np.mean(left**2 / select.torque.var(axis=0))), force))
    found = min(trials, key=lambda t: t[0])[1]
    seconds = time.perf_counter() - began
    said = [
        f"{name}: " + " ".join(f"{c:+.4g} {t}" for c, t in zip(row, TERMS, strict=True) if c)
        for name, row in zip(_joints(model), found, strict=True)
    ]
    values = {
        f"{name} {t}": float(c)
        for name, row in zip(_joints(model), found, strict=True)
        for c, t in zip(row, TERMS, strict=True)
    }
    carried, force = _carried(model, found)
    return Peer("sparse regression", carried, values, seconds, "terms: " + "; ".join(said), force, gain)


def features(motion: Motion, joint: int) -> np.ndarray:
    """(N, TERMS) of one joint's motion."""
    v, a = motion.v[:, joint], motion.a[:, joint]
    return np.stack([np.ones_like(v), v, np.sign(v), v * np.abs(v), np.abs(v), a], axis=1)


def _unexplained(model: mujoco.MjModel, motion: Motion) -> np.ndarray:
    """(N, A) torque of the drives less what the model needs for the motion."""
    data, out = mujoco.MjData(model), np.empty_like(motion.torque)
    for i in range(len(out)):
        data.qpos[:], data.qvel[:], data.qacc[:] = motion.q[i], motion.v[i], motion.a[i]
        mujoco.mj_inverse(model, data)
        out[i] = motion.torque[i] - data.qfrc_inverse
    return out


def _carried(model: mujoco.MjModel, force: np.ndarray) -> tuple[mujoco.MjModel, np.ndarray]:
    """The model with dry friction, damping and armature that MuJoCo integrates well, and the rest as forces."""
    model, rest = copy.copy(model), force.copy()
    fields = {"sign(v)": model.dof_frictionloss, "v": model.dof_damping, "a": model.dof_armature}
    for term, array in fields.items():
        column = TERMS.index(term)
        fits = array + rest[:, column] >= 0
        array[fits] += rest[fits, column]
        rest[fits, column] = 0.0
    return model, rest


def _run(
    model: mujoco.MjModel, segments: Segments, gain: float, force: np.ndarray | None = None
) -> np.ndarray:
    windows, steps = segments.commands.shape[:2]
    batch = Batch(model, windows, nthread=1)
    batch.reset()
    q, v, applied = batch.bind("qpos"), batch.bind("qvel"), batch.bind("qfrc_applied")
    q[:], v[:] = np.split(segments.measured[:, 0], 2, axis=1)
    nstep = max(round(segments.period / model.opt.timestep), 1)
    out = np.empty((windows, steps + 1, 2 * model.nv))
    out[:, 0] = np.concatenate([q, v], axis=1)
    for t in range(steps):
        applied[:] = gain * segments.commands[:, t]
        if force is not None:
            moving = np.where(np.abs(v) > STILL, np.sign(v), 0.0)
            terms = (np.ones_like(v), v, moving, v * np.abs(v), np.abs(v))
            applied[:] -= sum(force[:, k] * term for k, term in enumerate(terms))
        batch.step(nstep=nstep)
        out[:, t + 1] = np.concatenate([q, v], axis=1)
    return out


def _sequences(sysid, xml: str, segments: Segments, gain: float):
    """The segments as mujoco.sysid wants them: it does not apply the last command."""
    spec = mujoco.MjSpec.from_string(xml)
    model = spec.compile()
    times = np.arange(segments.measured.shape[1]) * segments.period
    columns = {"state": (sysid.SignalType.CustomObs, np.arange(segments.measured.shape[2]))}
    starts, controls, sensors = [], [], []
    for measured, commands in zip(segments.measured, segments.commands, strict=True):
        q, v = np.split(measured[0], 2)
        starts.append(sysid.create_initial_state(model, q, v, np.zeros(0)))
        held = gain * np.concatenate([commands, commands[-1:]])
        controls.append(sysid.TimeSeries.from_control_names(times, held, model))
        sensors.append(sysid.TimeSeries(times, measured, columns))
    names = [str(number) for number in range(len(starts))]
    return sysid.ModelSequences("robot", spec, names, starts, controls, sensors, allow_missing_sensors=True)


def _joints(model: mujoco.MjModel) -> list[str]:
    return [model.joint(j).name for j in range(model.njnt)]
