"""Effects in the joint engine, which compiles them: what it can, what it refuses, and where it keeps the code."""

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from effect_benches import bench, plain

from dynreg.errors import SimulationError
from dynreg.sim.effects import Effect, EffectParameter, Moment, Term, Terms
from dynreg.sim.engines import joint_kernel, rollout


class Made(Effect):
    """An effect on drives, by a function of the torque, the moment and its size."""

    id, acts_on, title = "made", "drive", "made up"
    parameters = (EffectParameter("size", "1", "size", 1.0, 1.0, 1.0, 1.0),)

    def __init__(self, drive):
        self.drive = lambda torque, x, p: drive(torque, x, p["size"])


def counted():
    """A port that goes on from call to call in a place of its own."""
    calls = []

    def drive(torque, x: Moment, size):
        calls.append(1)
        return torque + len(calls) * size

    return drive


def kept(use):
    """A port that uses a symbol of the call before."""
    last = []

    def drive(torque, x: Moment, size):
        now = torque + use(last.pop(), x, size) if last else torque
        last.append(np.sin(x.q))
        return now

    return drive


def states(b, drive, size: float = 0.01) -> np.ndarray:
    """(E, T+1, S) of the bench with that effect."""
    terms = Terms((Term(Made(drive)),), (np.array([[size]]),))
    return rollout(
        b.robot, b.robot.space.nominal[None], b.run, engine=b.engine, threads=1, terms=terms
    ).states[0]


REFUSED = {
    "an if": (lambda torque, x, s: torque if x.v > 0 else -torque, "np.where chooses"),
    "max": (lambda torque, x, s: max(torque, s), "np.where chooses"),
    "plain numbers": (lambda torque, x, s: torque * math.sin(x.q), "plain numbers"),
    "a sum over joints": (lambda torque, x, s: torque - s * x.v.sum(axis=1, keepdims=True), ".sum of it"),
    "a mean": (lambda torque, x, s: torque - np.mean(x.v), "np.mean of it"),
    "a single joint": (lambda torque, x, s: torque + x.q[:, :1], "single rows or joints"),
    "an array": (lambda torque, x, s: torque - s * np.asarray(x.q), "np.array of it"),
    "a table": (lambda torque, x, s: torque + np.arange(3.0), r"constant of shape \(3,\)"),
    "state elsewhere": (counted(), "else than x.memory"),
    "a symbol of the last call": (kept(lambda last, x, s: s * last), "else than x.memory"),
    "what was made of it": (
        kept(lambda last, x, s: np.where(x.v > 0, np.abs(last), s)),
        "else than x.memory",
    ),
    "the same numbers of it": (kept(lambda last, x, s: np.clip(last, 0, 1)), "else than x.memory"),
    "a mistake": (lambda torque, x, s: torque + x.nothing, "AttributeError.*nothing"),
    "nothing": (lambda torque, x, s: None, "constant"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_port_that_is_not_elementwise_is_refused_with_the_reason(name: str):
    drive, why = REFUSED[name]
    with pytest.raises(SimulationError, match=f"'made'.*'drive'.*{why}.*elementwise numpy.*mujoco engine"):
        states(bench("servo_short"), drive)


@pytest.mark.slow
def test_what_numba_does_not_know_is_refused():
    with pytest.raises(SimulationError, match="cannot be compiled.*numba knows.*mujoco engine"):
        states(bench("servo_short"), lambda torque, x, s: torque * np.heaviside(x.q, s))


@pytest.mark.parametrize("name", ["an array", "a sum over joints"])
def test_the_mujoco_engine_takes_any_numpy(name: str):
    assert np.isfinite(states(bench("servo_mujoco"), REFUSED[name][0])).all()


def many(torque, x: Moment, size):
    """Functions, operators and memory of all sorts, that come to the torque of the drive."""
    seen = x.memory.get("seen")
    x.memory["seen"] = (x.q, 2.0 * x.v) if seen is None else (x.q, x.memory["twice"] + 0.0 * x.v)
    x.memory["twice"] = 2.0 * x.v
    first, twice = x.memory["seen"]
    still = np.broadcast_to(np.zeros_like(x.v), x.v.shape) + np.ones_like(x.v) - np.full_like(x.v, 1.0)
    turned = np.arctan2(np.sin(first), np.cos(first)) - np.mod(first + np.pi, 2 * np.pi) + np.pi
    off = np.isfinite(x.v) & ~(np.abs(x.v) < 0.0) & np.logical_or(x.v < 1e9, x.v > 1e9)
    same = np.sqrt(np.square(torque)) * np.sign(torque) + (torque**3 - torque * torque * torque)
    return np.where(off, same, np.inf) + still + np.clip(turned, -1e-9, 1e-9) + np.float64(0.0) * twice * -1.0


@pytest.mark.usefixtures("own_effects_alone")
def test_numpy_says_the_same_to_a_joint_as_to_arrays():
    for name in ("servo_short", "servo_mujoco"):
        b = bench(name)
        np.testing.assert_allclose(states(b, many), plain(b), atol=1e-6)


def test_sines_and_exponentials_are_numpy_s():
    """To the last bits, and without surprises where a simulation diverges."""
    rng = np.random.default_rng(0)
    for most in (1e-3, 1.0, 30.0, 1e4, 1e7):
        x = rng.uniform(-most, most, 2000)
        assert np.abs([joint_kernel.sine(v) for v in x] - np.sin(x)).max() < 3e-16
    x = rng.uniform(-699.0, 699.0, 5000)
    np.testing.assert_allclose([joint_kernel.exponential(v) for v in x], np.exp(x), rtol=5e-16, atol=0.0)
    far = np.array([-1e300, -800.0, 0.0, 800.0, np.inf, -np.inf])
    np.testing.assert_array_equal(
        [joint_kernel.exponential(v) for v in far], [0.0, 0.0, 1.0, np.inf, np.inf, 0.0]
    )
    assert np.isnan([joint_kernel.exponential(np.nan), joint_kernel.sine(np.nan)]).all()
    assert joint_kernel.sine(1e300) == joint_kernel.sine(0.0) == 0.0


def test_numba_is_loaded_without_a_change_of_the_environment():
    code = (
        "import os; before = dict(os.environ); from dynreg.sim.engines.compiling import kernel; kernel([]);"
    )
    code += "import numba; assert os.environ == before; assert not numba.config.USING_SVML"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=300)


CODE = """
import time, numba, mujoco.batch
from dynreg.sim.engines.compiling import kernel
began = time.process_time()
kernel([])
print(time.process_time() - began)
"""


def started(cache: str, **variables: str) -> subprocess.Popen:
    """A process that prints the seconds until the kernel is ready."""
    there = os.environ | {"XDG_CACHE_HOME": cache, **variables}
    return subprocess.Popen([sys.executable, "-c", CODE], env=there, stdout=subprocess.PIPE, text=True)


def seconds(process: subprocess.Popen) -> float:
    told, _ = process.communicate(timeout=300)
    assert process.returncode == 0
    return float(told)


@pytest.mark.slow
def test_a_kernel_is_compiled_once_on_a_machine(tmp_path: Path):
    """Two processes at once agree, and a third starts without; below 0.3 s of processor time, in the best of three."""
    both = [started(str(tmp_path)) for _ in range(2)]
    assert all(seconds(process) > 1.0 for process in both)
    assert min(seconds(started(str(tmp_path))) for _ in range(3)) < 0.3


@pytest.mark.slow
def test_what_is_damaged_is_written_anew(tmp_path: Path):
    assert seconds(started(str(tmp_path))) > 1.0
    text, code = next(tmp_path.rglob("joint.py")), next(tmp_path.rglob("*.nbc"))
    whole = text.read_text()
    text.write_text("damaged")
    assert min(seconds(started(str(tmp_path))) for _ in range(3)) < 0.3 and text.read_text() == whole
    code.write_bytes(code.read_bytes()[:1000])
    for _ in range(2):  # compiled in memory, then anew
        assert seconds(started(str(tmp_path))) > 1.0
    assert min(seconds(started(str(tmp_path))) for _ in range(3)) < 0.3


@pytest.mark.slow
def test_each_processor_has_a_folder_of_its_own(tmp_path: Path):
    both = [started(str(tmp_path), **own) for own in ({}, {"NUMBA_CPU_NAME": "generic"})]
    assert all(seconds(process) > 1.0 for process in both)
    assert len([*tmp_path.rglob("joint.py")]) == len([*tmp_path.rglob("*.nbc")]) == 2


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="permissions of another kind")
def test_machine_code_that_others_may_write_is_not_run(tmp_path: Path):
    assert seconds(started(str(tmp_path))) > 1.0
    place = next(tmp_path.rglob("joint.py")).parent
    assert not place.stat().st_mode & 0o077
    place.chmod(0o777)
    assert seconds(started(str(tmp_path))) > 1.0
    place.chmod(0o700)
    assert min(seconds(started(str(tmp_path))) for _ in range(3)) < 0.3


@pytest.mark.slow
def test_where_nothing_can_be_written_it_is_compiled_in_memory(tmp_path: Path):
    (tmp_path / "file").write_text("no folder")
    assert seconds(started(str(tmp_path / "file"))) > 1.0
    assert (tmp_path / "file").read_text() == "no folder"
