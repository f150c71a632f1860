from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from arm_robot import ARM_XML, parameter

from dynreg.errors import RobotError, UsageError
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run, motor_noise
from dynreg.sim.spec import ChannelTable

STEPS, SUBSTEPS = 25, 10  # of the arm: 50 Hz, 2 ms

# The arm written out anew with every changed number in the text, its drives as actuators: the reference.
ORACLE_XML = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 {gravity}"/>
  <default><geom contype="0" conaffinity="0" mass="0"/></default>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" armature="0.01" damping="{damping1}" frictionloss="{coulomb1}"
             range="-120 120" limited="true"/>
      <inertial pos="{com1}" mass="{mass1}" diaginertia="{inertia1}"/>
      <body name="lower" pos="{length1} 0 0">
        <joint name="elbow" axis="0 1 0" armature="{armature2}" damping="{viscous2}"
               frictionloss="{coulomb2}"/>
        <inertial pos="0.08 0 0" mass="{mass2}" diaginertia="{inertia2}"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general joint="shoulder" biastype="affine" gainprm="{gain}" biasprm="0 -{gain} -{rate_gain}"
             forcerange="-{limit} {limit}"/>
    <general joint="elbow" gainprm="0.5" forcerange="-1.5 1.5"/>
  </actuator>
</mujoco>
"""
NOMINAL = dict(
    gravity="-9.81",
    damping1=0.02 + 4.0 / 8.0,  # the joint's own and the drive's torque_limit / speed_limit
    coulomb1=0,
    com1="0.1 0 -0.01",
    mass1=0.4,
    inertia1="0.001 0.003 0.003",
    length1=0.2,
    armature2=0.005,
    viscous2=0,
    coulomb2=0,
    mass2=0.25,
    inertia2="0.0005 0.001 0.001",
    gain=20.0,
    rate_gain=0.3,
    limit=4.0,
)
CHANGES = {  # a parameter at 1.3: what it changes in the reference
    "modifier.gravity *=": dict(gravity=-9.81 * 1.3),
    "modifier.gravity =": dict(gravity=-1.3),
    "modifier.mass[lower] *=": dict(mass2=0.25 * 1.3, inertia2="0.00065 0.0013 0.0013"),
    "modifier.link_length[upper] *=": dict(
        length1=0.26, com1="0.13 0 -0.013", mass1=0.52, inertia1="0.002197 0.006591 0.006591"
    ),
    "mj.body_mass[lower] +=": dict(mass2=1.55),
    "mj.body_inertia[lower][1] *=": dict(inertia2="0.0005 0.0013 0.001"),
    "mj.dof_armature[elbow] *=": dict(armature2=0.0065),
    "port.drive.gain[shoulder] *=": dict(gain=26.0),
    "port.drive.rate_gain[shoulder] =": dict(rate_gain=1.3),
    "port.drive.torque_limit[shoulder] =": dict(limit=1.3, damping1=0.02 + 1.3 / 8),
    "port.drive.speed_limit[shoulder] *=": dict(damping1=0.02 + 4.0 / 10.4),
    "port.friction.viscous[*] +=": dict(damping1=1.82, viscous2=1.3),
    "port.friction.viscous[shoulder] =": dict(damping1=1.3 + 4.0 / 8.0),
    "port.friction.viscous[shoulder] *=": dict(damping1=0.02 * 1.3 + 4.0 / 8.0),
    "port.friction.coulomb[shoulder] =": dict(coulomb1=1.3),
}


def _commands(seed: int, episodes: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    levels = rng.uniform(-1, 1, (episodes, STEPS // 5, 2)).repeat(5, axis=1)
    return levels * [1.8, 1.4]


def _reference(commands: np.ndarray, **changes) -> np.ndarray:
    """(T+1, 4) states of plain MuJoCo."""
    model = mujoco.MjModel.from_xml_string(ORACLE_XML.format(**(NOMINAL | changes)))
    data = mujoco.MjData(model)
    data.qpos[:] = [0.3, -0.4]
    states = [np.concatenate([data.qpos, data.qvel])]
    for command in commands:
        data.ctrl[:] = command
        mujoco.mj_step(model, data, SUBSTEPS)
        states.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(states)


@pytest.mark.parametrize("entry", CHANGES)
def test_values_reach_mujoco_as_a_hand_written_model_would_hold_them(
    entry: str, write_robot: Callable[..., Path]
):
    robot = load_robot(write_robot(parameters=parameter("p", entry)))
    commands = _commands(0)
    states = rollout(robot, np.array([[1.3]]), Run(commands)).states[0, 0]
    reference = _reference(commands[0], **CHANGES[entry])
    np.testing.assert_allclose(states, reference, atol=1e-9)
    assert np.abs(reference - _reference(commands[0])).max() > 1e-4  # the change shows


def test_settings_differ_between_episodes(write_robot: Callable[..., Path]):
    robot = load_robot(write_robot())
    commands = _commands(1, episodes=2)
    run = Run(commands, settings=np.array([[0.0], [0.4]]))
    states = rollout(robot, robot.space.nominal[None], run).states[0]
    np.testing.assert_allclose(states[0], _reference(commands[0]), atol=1e-9)
    np.testing.assert_allclose(states[1], _reference(commands[1], mass2=0.65), atol=1e-9)


@pytest.fixture(scope="module")
def quadruped() -> Robot:
    return load_robot("quadruped")


@pytest.fixture(scope="module")
def so101() -> Robot:
    return load_robot("so101")


@pytest.mark.parametrize("name", ["quadruped", "so101", "servo_pendulum"])
def test_a_simulation_is_the_same_bits_in_any_company(name: str):
    robot = load_robot(name)
    run = excitation(robot, seed=0, episodes=4, steps=12)
    run = replace(run, noise=motor_noise(np.arange(3), 4, 12, len(robot.actions)))
    values = robot.space.sample(0, 3, 0)
    states = rollout(robot, values, run, engine="mujoco", threads=1).states
    assert np.isfinite(states).all()
    np.testing.assert_array_equal(rollout(robot, values, run, engine="mujoco", threads=2).states, states)
    alone = rollout(robot, values[1:2], replace(run, noise=run.noise[1:2]), engine="mujoco", threads=1)
    np.testing.assert_array_equal(alone.states[0], states[1])
    some = rollout(robot, values, run.take(np.array([3, 1])), engine="mujoco", threads=1)
    np.testing.assert_array_equal(some.states, states[:, [3, 1]])


def test_commands_of_their_own_are_those_of_a_run_alone(write_robot: Callable[..., Path]):
    robot = load_robot(write_robot())
    own = np.stack([_commands(2), _commands(3)])
    values = np.array([[10.0], [30.0]])
    states = rollout(robot, values, Run(own)).states
    for i in range(2):
        np.testing.assert_array_equal(rollout(robot, values[i : i + 1], Run(own[i])).states[0], states[i])


def test_each_simulator_keeps_its_own_command_rate(write_robot: Callable[..., Path]):
    robot = load_robot(
        write_robot(parameters=parameter("rate", "control.rate =", nominal=50, low=20, high=90))
    )
    commands = _commands(4)
    states = rollout(robot, np.array([[25.0], [70.0]]), Run(commands)).states
    for i, rate in enumerate((25.0, 70.0)):
        fixed = rollout(robot, np.array([[50.0]]), Run(commands, period=1 / rate)).states[0]
        np.testing.assert_array_equal(states[i], fixed)
    assert np.abs(states[0] - states[1]).max() > 1e-3


def test_known_states_are_placed_and_unknown_ones_left_at_the_reset_pose(write_robot: Callable[..., Path]):
    robot = load_robot(write_robot())
    initial = np.array([[0.7, np.nan, np.nan, -2.0], [np.nan] * 4])
    states = rollout(robot, robot.space.nominal[None], Run(_commands(5, episodes=2), initial=initial)).states
    np.testing.assert_allclose(states[0, :, 0], [[0.7, -0.4, 0.0, -2.0], [0.3, -0.4, 0.0, 0.0]], atol=1e-15)


def test_settling_ends_where_the_drives_hold_the_load(so101: Robot):
    hold = np.tile(so101.model.key("home").qpos, (1, 50, 1))
    states = rollout(so101, so101.space.nominal[None], Run(hold), engine="mujoco").states[0, 0]
    elbow = so101.channels.index("elbow/position")
    droop = states[0, elbow] - 0.5
    assert 0.01 < droop < 0.08  # gravity lowers the forearm; the real arm droops by 0.04 to 0.06
    assert abs(states[-1, elbow] - states[0, elbow]) < 0.005


def test_a_joint_of_the_so101_that_sticks_under_load_stays_where_it_is(so101: Robot):
    """MuJoCo's usual dry friction lets the forearm creep until its drive alone holds it."""
    friction = Terms((term("coulomb_friction"),), (np.array([[0.0], [0.6]]),))  # N m
    home, count = so101.model.key("home").qpos, len(so101.actions)
    run = Run(np.tile(home, (1, 500, 1)), initial=np.concatenate([home, np.zeros(count)])[None])
    nominal = np.tile(so101.space.nominal, (2, 1))
    states = rollout(so101, nominal, run, engine="mujoco", terms=friction).states[:, 0, -1, :count]
    fell, stayed = np.abs(states - home).max(axis=1)
    assert fell > 0.04 and stayed < 5e-4


def test_episodes_with_other_settings_settle_on_their_own(write_robot: Callable[..., Path]):
    robot = load_robot(write_robot(("[excitation]", "settle = 1.0\n\n[excitation]")))
    run = Run(_commands(6, episodes=2), settings=np.array([[0.4], [0.0]]))
    states = rollout(robot, robot.space.nominal[None], run).states[0]
    light = rollout(robot, robot.space.nominal[None], run.take(np.array([1]))).states[0, 0]
    np.testing.assert_array_equal(states[1], light)
    assert abs(states[0, 0, 0] - states[1, 0, 0]) > 0.01  # the heavier arm hangs lower


def test_what_diverges_is_nan_from_then_on(write_robot: Callable[..., Path], tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    robot = load_robot(write_robot(parameters=parameter("p", "mj.body_inertia[lower] *=")))
    states = rollout(robot, np.array([[1.0], [-30.0]]), Run(_commands(7))).states[:, 0]
    lost = np.isnan(states[1]).any(axis=1)
    first = int(lost.argmax())
    assert 0 < first <= 3 and np.isnan(states[1, first:]).all() and np.isfinite(states[1, :first]).all()
    np.testing.assert_allclose(states[0], _reference(_commands(7)[0]), atol=1e-9)  # its neighbour goes on
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists() and capfd.readouterr().err == ""


def _standing(robot: Robot, steps: int) -> np.ndarray:
    return np.tile(robot.model.key("stance").qpos[7:], (1, steps, 1))


def _with_height(robot: Robot) -> Robot:
    heights = [ChannelTable(name=f"base/{axis}", unit="m") for axis in "xyz"]
    return replace(robot, file=robot.file.model_copy(update={"channels": [*robot.file.channels, *heights]}))


def _foot_depths(robot: Robot, values: np.ndarray, states: np.ndarray) -> list[float]:
    """Height [m] of the lowest foot above the ground in each state (N, S), links as long as in `values`."""
    model = mujoco.MjModel.from_xml_path(str(robot.folder / "model.xml"))
    data, at = mujoco.MjData(model), {name: i for i, name in enumerate(robot.channels)}
    feet = [i for i in range(model.ngeom) if model.geom(i).name.endswith("_foot")]
    lowers = [i for i in range(model.nbody) if model.body(i).name.endswith("_lower")]
    lengths = robot.space.as_dict(values)
    model.body_pos[lowers, 2], model.geom_pos[feet, 2] = -lengths["upper_length"], -lengths["lower_length"]
    joints = [at[f"{model.joint(j).name}/position"] for j in range(1, model.njnt)]
    depths = []
    for state in states:
        data.qpos[:3] = state[[at[f"base/{axis}"] for axis in "xyz"]]
        angles = state[[at["base/yaw"], at["base/pitch"], at["base/roll"]]]
        mujoco.mju_euler2Quat(data.qpos[3:7], angles, "zyx")
        data.qpos[7:] = state[joints]
        mujoco.mj_kinematics(model, data)
        depths.append((data.geom_xpos[feet, 2] - model.geom_size[feet, 0]).min())
    return depths


def test_feet_never_sink_more_than_5_mm(quadruped: Robot):
    robot = _with_height(quadruped)
    values = robot.space.sample(0, 6, 3)
    states = rollout(robot, values, excitation(robot, seed=1, episodes=4, steps=30)).states
    depths = [
        _foot_depths(robot, row, out.reshape(-1, out.shape[-1])[::2])
        for row, out in zip(values, states, strict=True)
    ]
    assert np.min(depths) > -0.005
    assert np.abs(np.median(depths, axis=1)).max() < 0.005  # and they do stand on the ground


def test_a_fall_is_the_first_step_that_tilts_or_sinks_too_far(quadruped: Robot):
    robot = _with_height(quadruped)
    run = excitation(robot, seed=2, episodes=6, steps=40)
    out = rollout(robot, robot.space.sample(0, 6, 1), run)
    at = {name: i for i, name in enumerate(robot.channels)}
    roll, pitch, height = (out.states[..., at[f"base/{q}"]] for q in ("roll", "pitch", "z"))
    down = (np.cos(roll) * np.cos(pitch) < np.cos(robot.file.fall.tilt)) | (height < robot.file.fall.height)
    expected = np.where(down.any(axis=-1), down.argmax(axis=-1), run.steps + 1)
    np.testing.assert_array_equal(out.fell, expected)
    assert 0 < (out.fell <= run.steps).mean() < 1
    still = rollout(robot, robot.space.nominal[None], Run(_standing(robot, 40)))
    assert still.fell[0, 0] == 41


def test_no_time_step_reads_the_clock(quadruped: Robot):
    """It costs a quarter of a small robot's rollout."""
    rollout(quadruped, quadruped.space.nominal[None], Run(np.zeros((1, 1, 12))))
    data = mujoco.MjData(quadruped.model)
    mujoco.mj_step(quadruped.model, data, nstep=10)
    assert data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration == 0.0


def test_a_robot_that_lacks_the_engine_says_so(quadruped: Robot):
    with pytest.raises(UsageError, match="no engine 'joint'.*mujoco"):
        rollout(quadruped, quadruped.space.nominal[None], Run(np.zeros((1, 1, 12))), engine="joint")


def test_a_joint_without_an_actuator_is_told(write_robot: Callable[..., Path]):
    robot = load_robot(write_robot(xml=ARM_XML.replace('<motor joint="elbow"/>', "")))
    with pytest.raises(RobotError, match="no actuator of the model moves joint 'elbow'"):
        rollout(robot, robot.space.nominal[None], Run(_commands(0)))


def test_a_robot_without_actions_swings_freely(write_robot: Callable[..., Path]):
    folder = write_robot()
    text = (folder / "robot.toml").read_text()
    drives, actions, channels = (text.index(t) for t in ("[[drives]]", "[[actions]]", "[[channels]]"))
    reset = text.index("[reset]")
    passive = text[:drives] + text[reset:actions] + text[channels : text.index("[[settings]]")]
    (folder / "robot.toml").write_text(passive + parameter("gravity", "modifier.gravity ="))
    robot = load_robot(folder)
    states = rollout(robot, np.array([[9.81]]), Run(np.zeros((1, STEPS, 0)))).states[0, 0]
    reference = _reference(np.zeros((STEPS, 2)), damping1=0.02, gain=0, rate_gain=0)
    np.testing.assert_allclose(states, reference, atol=1e-9)
