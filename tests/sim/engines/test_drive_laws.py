"""Settings of drives: a speed limits the torque and damps nothing; duty limits and profiles are what effects of the
same names do.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from arm_robot import ARM_XML
from effect_benches import bench, rms

from dynreg.sim.effects import Term, Terms, effects
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.sim.spec import PositionDrive

ENGINES = ("joint", "mujoco")
PUSHING = {"joint": "arm", "type": "position", "gain": 4.0, "rate_gain": 0.15, "torque_limit": 1.0}


def servo(**drive: float) -> Robot:
    """The pendulum with another position drive, or with more settings of its own."""
    robot = load_robot("servo_pendulum")
    (own,) = robot.file.drives
    made = PositionDrive(**(PUSHING | drive)) if "speed_limit" in drive or not drive else None
    made = made or own.model_copy(update=drive)
    return replace(robot, file=robot.file.model_copy(update={"drives": [made]}))


def soft(run: Run) -> Run:
    """The run with the setting kp, which is the gain, at 4 N m/rad."""
    robot = load_robot("servo_pendulum")
    settings = np.array([[4.0 if s.name == "kp" else s.nominal for s in robot.file.settings]])
    return replace(run, settings=np.tile(settings, (run.episodes, 1)))


def states(robot: Robot, run: Run, engine: str, *terms: tuple[str, list[float]]) -> np.ndarray:
    """(E, T+1, S) of the nominal robot with effects of these values."""
    made = Terms(
        tuple(Term(effects()[key]) for key, _ in terms), tuple(np.array([values]) for _, values in terms)
    )
    nominal = robot.space.nominal[None]
    return rollout(robot, nominal, run, engine=engine, threads=1, terms=made if terms else None).states[0]


def gentle() -> Run:
    """Commands that no drive saturates on, from rest."""
    targets = 0.1 * np.sin(0.2 * np.arange(60)) * np.minimum(np.arange(60) / 20, 1.0)
    return soft(Run(targets[None, :, None], initial=np.zeros((1, 2))))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_speed_limit_takes_nothing_off_what_a_drive_can_give(engine: str):
    """Below the limit a drive that states a no-load speed moves as one without; its back-EMF would damp it."""
    free, limited, damped = (
        states(servo(speed_limit=speed, back_emf=back), gentle(), engine)
        for speed, back in ((1e6, False), (4.0, False), (4.0, True))
    )
    assert rms(limited - free) < 1e-9 * rms(free)
    assert rms(damped - free) > 0.1 * rms(free)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_drive_never_pushes_a_joint_beyond_its_no_load_speed(engine: str):
    """A high step: it is as fast as the speed at which nothing is left, and slower than without."""
    run = soft(Run(np.full((1, 80, 1), 3.0), initial=np.zeros((1, 2))))
    robot = servo(speed_limit=4.0)
    moved, free = (states(one, run, engine)[0, :, 1] for one in (robot, servo(speed_limit=1e6)))
    rising = slice(0, int(np.argmax(moved)) + 1)  # then it falls over the top
    assert 2.5 < moved[rising].max() < 4.0 < free.max()


def test_engines_agree_on_a_drive_that_fades_with_speed():
    run = soft(bench("servo").run)
    joint, whole = (states(servo(speed_limit=5.0), run, engine) for engine in ENGINES)
    free = states(servo(speed_limit=1e6), run, "joint")
    assert rms(joint - whole) < 0.1 * rms(joint - free)


def test_a_fading_drive_is_a_force_range_that_follows_the_speed(write_robot: Callable[..., Path]):
    """The reference sets MuJoCo's force range before each of its own time steps."""
    robot = load_robot(write_robot(("back_emf = true", "back_emf = false")))
    rng = np.random.default_rng(3)
    commands = rng.uniform(-1, 1, (1, 25, 2)) * [1.8, 1.4]
    (found,) = rollout(robot, robot.space.nominal[None], Run(commands)).states[0]
    spec = mujoco.MjSpec.from_string(ARM_XML)
    model = spec.compile()
    model.opt.timestep, model.opt.integrator = 0.002, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    shoulder, elbow = (model.joint(name) for name in ("shoulder", "elbow"))
    by_joint = {int(model.actuator_trnid[i, 0]): i for i in range(model.nu)}
    first, second = by_joint[shoulder.id], by_joint[elbow.id]
    model.actuator_gaintype[:], model.actuator_biastype[:] = 0, 1
    model.actuator_gainprm[:, 0], model.actuator_biasprm[:] = 0.0, 0.0
    model.actuator_gainprm[first, 0], model.actuator_biasprm[first, :3] = 20.0, [0.0, -20.0, -0.3]
    model.actuator_gainprm[second, 0] = 0.5
    model.actuator_forcelimited[:], model.actuator_ctrllimited[:] = 1, 0
    model.actuator_forcerange[second] = [-1.5, 1.5]
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    for step, command in enumerate(commands[0]):
        data.ctrl[[first, second]] = command
        for _ in range(10):
            slower = float(data.qvel[shoulder.dofadr[0]]) / 8.0
            model.actuator_forcerange[first] = [
                -4.0 * np.clip(1.0 + slower, 0.0, 1.0),
                4.0 * np.clip(1.0 - slower, 0.0, 1.0),
            ]
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(found[step + 1], [*data.qpos, *data.qvel], atol=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_duty_limit_of_the_drive_is_the_effect_of_that_name(engine: str):
    b = bench("servo")
    stated = states(servo(duty_limit=0.75), b.run, engine)
    hidden = states(b.robot, b.run, engine, ("duty_limit", [0.25]))
    np.testing.assert_array_equal(stated, hidden)
    assert rms(stated - states(b.robot, b.run, engine)) > 0.01


@pytest.mark.parametrize("engine", ENGINES)
def test_a_profile_of_the_drive_is_the_effect_of_that_name(engine: str):
    """An acceleration a with a speed v reaches it within v^2 / (2 a)."""
    b = bench("servo")
    stated = states(servo(profile_speed=4.0, profile_acceleration=80.0), b.run, engine)
    hidden = states(b.robot, b.run, engine, ("profile_speed", [4.0, 0.1]))
    np.testing.assert_array_equal(stated, hidden)
    alone = states(servo(profile_speed=4.0), b.run, engine)
    limited = states(b.robot, b.run, engine, ("rate_limit", [4.0]))
    plain = states(b.robot, b.run, engine)
    assert rms(alone - limited) < 1e-3 * rms(limited - plain)
    assert rms(stated - alone) > 0.05 * rms(limited - plain)


def test_what_is_set_as_friction_is_all_of_it(tmp_path: Path):
    """A parameter that is set as the joint's damping is all of it, whatever damping its model has; in both engines."""
    robot, b = load_robot("servo_pendulum"), bench("servo_short")
    for name, text in robot.files.files.items():
        text = text.replace(b'<joint name="arm"', b'<joint name="arm" damping="0.02" frictionloss="0.01"')
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(text)
    damped = load_robot(tmp_path)
    assert damped.model.dof_damping[0] == 0.02
    for engine in ENGINES:
        np.testing.assert_array_equal(states(damped, b.run, engine), states(robot, b.run, engine))
