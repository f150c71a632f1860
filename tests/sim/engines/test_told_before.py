"""Delays, lags and limited rates look back beyond the start of a run, at the commands that were told before it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import one_arm
import pytest

from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import Arena, rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

CUT, KNOWN = 19, 10  # the command that a run is cut at, one after a change; commands before it that are known
BENCHES = (
    ("kinematic", "diffdrive", 0.1),
    ("unicycle", "diffdrive", 0.1),
    ("mujoco", "servo_pendulum", 0.025),
    ("joint", "servo_pendulum", 0.025),
)


def played(robot: Robot, run: Run, engine: str, delay: float) -> np.ndarray:
    """(T+1, S) states under commands that arrive late."""
    late = Terms((term("command_delay"),), (np.array([[delay]]),))
    return rollout(robot, robot.space.nominal[None], run, engine=engine, terms=late).states[0, 0]


@pytest.mark.parametrize("engine, name, delay", BENCHES)
def test_a_run_goes_on_as_it_would_have_and_begins_anew_where_nothing_is_known(
    engine: str, name: str, delay: float
) -> None:
    robot = load_robot(name)
    rng, most = np.random.default_rng(0), [min(a.high, 1.0) for a in robot.file.actions]
    told = (rng.uniform(-1.0, 1.0, (1, 8, len(most))) * most).repeat(6, axis=1)
    run = Run(told, period=1.0 / robot.rate)
    whole = played(robot, run, engine, delay)
    rest = replace(run, actions=told[:, CUT:], initial=whole[None, CUT])
    unknown = np.full((1, 5, len(most)), np.nan)
    before = np.concatenate([unknown, told[:, CUT - KNOWN : CUT]], axis=1)
    on = played(robot, replace(rest, before=before), engine, delay)
    np.testing.assert_allclose(on, whole[CUT:], rtol=0.0, atol=1e-12)
    anew = played(robot, rest, engine, delay)
    assert np.abs(anew - whole[CUT:]).max() > 0.05
    np.testing.assert_array_equal(played(robot, replace(rest, before=unknown), engine, delay), anew)


LAG = 0.05  # s
SIZES = {
    "command_delay": (0.025,),
    "command_gain": (0.1,),
    "rate_limit": (8.0,),
    "profile_speed": (12.0, 0.3),
    "command_lag": (LAG,),
}
REMEMBERING = tuple(
    (key, engine, name)
    for key in ("command_lag", "rate_limit", "profile_speed")
    for engine, name, _ in BENCHES
    if term(key).effect.why_not(load_robot(name)) is None
)
IN_ARENAS = tuple((key, "arena", "servo_pendulum") for key in ("command_lag", "rate_limit", "profile_speed"))
OF_ARMS = (
    ("own lag", "mujoco", "one_arm"),
    ("own profile", "mujoco", "one_arm"),
    ("own profile", "joint", "one_arm"),
)


def terms_of(*keys: str, rows: int = 1) -> Terms:
    return Terms(tuple(map(term, keys)), tuple(np.tile(SIZES[key], (rows, 1)) for key in keys))


def replayed(robot: Robot, run: Run, engine: str, terms: Terms | None) -> np.ndarray:
    """(B, T+1, S) of nominal robots."""
    values = np.tile(robot.space.nominal, (1 if terms is None else len(terms.values[0]), 1))
    if engine == "arena":
        return Arena(robot, values, run, terms=terms).rollout(run).states[:, 0]
    return rollout(robot, values, run, engine=engine, terms=terms).states[:, 0]


def commands(robot: Robot) -> np.ndarray:
    """(1, 48, A) steps from 0 on, of which one has just been taken where the run is cut."""
    most = [1.0 if a.high is None else min(a.high, 1.0) for a in robot.file.actions]
    steps = np.random.default_rng(0).uniform(-1.0, 1.0, (1, 8, len(most))) * most
    steps[:, 0] = 0.0
    return steps.repeat(6, axis=1)


def arm(folder: Path, key: str) -> Robot:
    """An arm whose actuator has a lag or a profile of its own."""
    lags = key == "own lag"
    kind = f'dyntype="filterexact" dynprm="{LAG}"' if lags else ""
    actuator = (
        f'<general name="arm" joint="arm" {kind} gainprm="10" biastype="affine" '
        'biasprm="0 -10 -0.5" forcelimited="true" forcerange="-3 3"/>'
    )
    robot = one_arm.written(folder, one_arm.model_of(actuator, 'qpos="0.3" ctrl="0.3"' + ' act="0.3"' * lags))
    if lags:
        return robot
    text = (folder / "robot.toml").read_text(encoding="utf-8")
    profile = "torque_limit = 3.0\nprofile_speed = 8.0\nprofile_acceleration = 150.0\n"
    (folder / "robot.toml").write_text(text.replace("torque_limit = 3.0\n", profile), encoding="utf-8")
    return load_robot(folder)


@pytest.mark.parametrize("key, engine, name", (*REMEMBERING, *IN_ARENAS, *OF_ARMS))
def test_a_window_from_the_middle_of_a_transient_is_the_middle_of_the_run(
    key: str, engine: str, name: str, tmp_path: Path
) -> None:
    robot = arm(tmp_path, key) if name == "one_arm" else load_robot(name)
    terms = terms_of(key) if name != "one_arm" else None
    told = commands(robot)
    # at rest on the first command until then, as what is not known is taken to have been
    run = Run(told, period=1.0 / robot.rate, initial=np.zeros((1, len(robot.channels))))
    whole = replayed(robot, run, engine, terms)
    rest = replace(run, actions=told[:, CUT:], initial=whole[:, CUT])
    on = replayed(robot, replace(rest, before=told[:, :CUT]), engine, terms)
    np.testing.assert_allclose(on, whole[:, CUT:], rtol=0.0, atol=1e-9)
    anew = replayed(robot, rest, engine, terms)
    assert np.abs(anew - whole[:, CUT:]).max() > 0.04
    unknown = np.full((1, 5, told.shape[2]), np.nan)
    np.testing.assert_array_equal(replayed(robot, replace(rest, before=unknown), engine, terms), anew)


@pytest.mark.parametrize("engine", ["mujoco", "joint"])
def test_effects_remember_what_effects_before_them_made_of_commands(engine: str) -> None:
    """A late, scaled command of a limited rate is what the lag smooths."""
    robot = load_robot("servo_pendulum")
    terms, told = terms_of(*SIZES), commands(robot)
    run = Run(told, period=1.0 / robot.rate, initial=np.zeros((1, len(robot.channels))))
    whole = replayed(robot, run, engine, terms)
    rest = replace(run, actions=told[:, CUT:], initial=whole[:, CUT])
    on = replayed(robot, replace(rest, before=told[:, :CUT]), engine, terms)
    np.testing.assert_allclose(on, whole[:, CUT:], rtol=0.0, atol=1e-9)
    anew = replayed(robot, rest, engine, terms)
    assert np.abs(anew - whole[:, CUT:]).max() > 0.04


@pytest.mark.parametrize("key, engine, name", REMEMBERING)
def test_what_an_effect_remembers_is_its_own_simulation_s(key: str, engine: str, name: str) -> None:
    """Windows that know more or less of what was before, beside others without the effect: each as it is alone."""
    robot = load_robot(name)
    told = commands(robot)
    before = np.repeat(told[:, :CUT], 3, axis=0)
    before[1, :12], before[2] = np.nan, np.nan
    run = Run(np.repeat(told[:, CUT:], 3, axis=0), period=1.0 / robot.rate, before=before)
    terms = terms_of("command_delay", key, rows=3)
    terms.values[0][0], terms.values[1][2] = np.nan, np.nan
    values = np.tile(robot.space.nominal, (3, 1))
    beside = rollout(robot, values, run, engine=engine, terms=terms, threads=1).states
    for b in range(3):
        for e in range(3):
            own = rollout(
                robot, values[:1], run.take(np.array([e])), engine=engine, terms=terms.take([b]), threads=1
            )
            np.testing.assert_array_equal(own.states[0, 0], beside[b, e])
