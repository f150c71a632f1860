"""Simulators as robot folders: the folder rolls out as the simulator does, in dynreg and in MuJoCo alone."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.evidence.hypothesis import Coordinates
from dynreg.extend.carry import carries
from dynreg.extend.robot_folder import export_robot
from dynreg.extend.traced import ENGINE, traced
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.effects import applicable, term
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.inspection import check_robot
from dynreg.sim.lint import doubts
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.verbs.export_robot import _told

EXACT = 1e-12  # of rollouts of the folder and of the simulator
DIGITS = 1e-5  # an MJCF file has six digits
STATIC = (
    "coulomb_friction",
    "payload",
    "com_offset",
    "gravity_tilt",
    "torque_limit",
    "duty_limit",
    "drive_gain",
    "inertia",
)
MOVING = (
    "load_friction",
    "backlash",
    "stribeck_friction",
    "voltage_sag",
    "sensor_delay",
    "speed_limit",
    "feedback_delay",
    "torque_lag",
    "profile_speed",
    "motor_backlash",
    "motor_elasticity",
)


def config(robot: Robot, *keys: str, sign: float = 1.0) -> SimConfig:
    """A simulator away from the nominal one, with effects of medium size."""
    rng = np.random.default_rng(1)
    unit = robot.space.to_unit(robot.space.nominal) + 0.05 * rng.standard_normal(len(robot.space))
    values = robot.space.as_dict(robot.space.from_unit(unit))
    coordinates = Coordinates(robot, np.full(len(robot.space), np.nan))
    effects = {}
    for key in keys:
        one = term(key)
        signs = {p.name: sign if p.signed else 1.0 for p in one.effect.parameters}
        effects[key] = {p.name: signs[p.name] * coordinates.scale(one, p) for p in one.effect.parameters}
    return SimConfig(robot.hash, robot.name, values, effects)


def states(robot: Robot, made: SimConfig, run: Run, engine: str | None = None) -> np.ndarray:
    values = robot.space.from_dict(made.values)[None]
    return rollout(robot, values, run, engine=engine, terms=terms_of(made, robot)).states[0]


def bank(robot: Robot, steps: int = 40) -> Run:
    return excitation(robot, seed=0, name="export", episodes=4, steps=steps)


@pytest.mark.parametrize("name", ["servo_pendulum", "leg", "quadruped", "so101", "double_pendulum"])
def test_a_folder_moves_as_the_simulator_and_passes_the_check(name: str, tmp_path: Path) -> None:
    robot = load_robot(name)
    keys = [key for key, effect in applicable(robot).items() if carries(effect)]
    keys = [
        key for key in keys if (name, key) != ("double_pendulum", "torque_limit")
    ]  # it cannot reach its limit
    made = config(robot, *keys, sign=-1.0)
    exported = export_robot(robot, made, tmp_path / "taken")
    assert all(effect.parameters for effect in exported.effects) and exported.problem is None
    assert not check_robot(tmp_path / "taken")
    before = {text for _, text in doubts(robot)}
    assert not [text for _, text in doubts(exported.robot) if text not in before], "no new warning"
    run = bank(robot, 15)
    for engine in robot.file.robot.engines:
        ours = states(robot, made, run, engine)
        again = rollout(exported.robot, exported.robot.space.nominal[None], run, engine=engine).states[0]
        np.testing.assert_allclose(again, ours, rtol=EXACT, atol=EXACT)
        assert np.abs(ours - states(robot, replace(made, effects={}), run, engine)).max() > 1e-3


def test_settings_still_do_what_they_did(tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    made = config(robot, *STATIC, "encoder_scale", "clock_error")
    exported = export_robot(robot, made, tmp_path / "taken").robot
    run = bank(robot)
    settings = np.array([[100.0, 0.15], [800.0, 0.0], [200.0, 0.3], [400.0, 0.1]])
    run = replace(run, settings=settings)
    again = rollout(exported, exported.space.nominal[None], run).states[0]
    np.testing.assert_allclose(again, states(robot, made, run), rtol=EXACT, atol=EXACT)


def test_an_effect_of_one_joint_is_carried_for_that_joint(tmp_path: Path) -> None:
    robot = load_robot("leg")
    made = config(robot, "coulomb_friction[knee]", "torque_limit[hip_roll,knee]")
    exported = export_robot(robot, made, tmp_path / "taken")
    first, second = (effect.parameters[0] for effect in exported.effects)
    assert first.sets == ("port.friction.coulomb[knee] +=",)
    assert second.sets == ("port.drive.limit_factor[hip_roll,knee] *=",) and second.value == 0.75
    run = bank(robot, 15)
    again = rollout(exported.robot, exported.robot.space.nominal[None], run).states[0]
    np.testing.assert_allclose(again, states(robot, made, run), rtol=EXACT, atol=EXACT)


def test_units_on_a_slide_are_those_of_forces_and_metres(tmp_path: Path) -> None:
    made = config(load_robot("emps"), "coulomb_friction", "encoder_offset", "inertia")
    exported = export_robot(load_robot("emps"), made, tmp_path / "taken")
    units = {p.name: p.unit for p in exported.robot.file.parameters if p.name.startswith("effect_")}
    assert units == {
        "effect_coulomb_friction": "N",
        "effect_encoder_offset": "m",
        "effect_inertia": "kg",
    }
    told = (tmp_path / "taken" / "README.md").read_text()
    (row,) = [line for line in told.splitlines() if line.startswith("| coulomb_friction")]
    assert " N |" in row and "N*m" not in told and "rad" not in row
    assert {tuple(_told(one, load_robot("emps")).units.values()) for one in exported.effects} == {
        ("N",),
        ("m",),
        ("kg",),
    }


def test_nominal_values_are_the_simulators_and_effects_can_vary(tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    made = config(robot, "coulomb_friction", "gravity_tilt")
    space = export_robot(robot, made, tmp_path / "taken").robot.space
    assert space.as_dict(space.nominal).items() >= made.values.items()
    added = [p for p in space.parameters if p.name not in robot.space.names]
    assert added[0].name == "effect_coulomb_friction", "the robot has a parameter coulomb_friction of its own"
    assert added[0].nominal == made.effects["coulomb_friction"]["torque"] and added[0].unit == "N*m"
    assert all(p.low < p.nominal < p.high for p in added)
    # what stood in robot.toml still stands there
    text = (tmp_path / "taken" / "robot.toml").read_text()
    assert "# firmware: duty = clip" in text and f'name = "servo_pendulum_{made.id[:8]}"' in text


def test_an_exported_robot_can_be_extended_again(tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    once = export_robot(robot, config(robot, "payload"), tmp_path / "once").robot
    made = SimConfig(
        once.hash, once.name, once.space.as_dict(once.space.nominal), {"payload": {"share": 0.1}}
    )
    twice = export_robot(once, made, tmp_path / "twice").robot
    assert len(twice.space) > len(once.space) > len(robot.space)
    run = bank(robot)
    again = rollout(twice, twice.space.nominal[None], run).states[0]
    np.testing.assert_allclose(again, states(once, made, run), rtol=EXACT, atol=EXACT)


@pytest.mark.parametrize(
    "key", ["", *STATIC, "command_delay", "command_gain", "force_offset", "viscous_friction"]
)
def test_mujoco_alone_moves_as_the_simulator(key: str, tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    made = config(robot, *([key] if key else []))
    exported = export_robot(robot, made, tmp_path / "taken")
    assert all(effect.in_mjcf for effect in exported.effects)
    run = _from_rest(robot)
    played = _play(tmp_path / "taken" / "mujoco.xml", run, int(robot.substeps(1 / robot.rate)))
    ours = states(robot, made, run, "mujoco")[..., 0]
    np.testing.assert_allclose(played, ours, atol=DIGITS)
    if key:
        assert np.abs(ours - states(robot, replace(made, effects={}), run, "mujoco")[..., 0]).max() > 0.01


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_constant_torque_is_in_the_mjcf_beside_the_limit_of_the_drive(sign: float, tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    made = config(robot, "force_offset", "torque_limit", sign=sign)
    plain = config(robot, "torque_limit")
    export_robot(robot, made, tmp_path / "taken")
    export_robot(robot, plain, tmp_path / "without")
    ours, without = (
        mujoco.MjModel.from_xml_path(str(tmp_path / name / "mujoco.xml")) for name in ("taken", "without")
    )
    assert ours.nu == without.nu, "no command is added"
    torque = made.effects["force_offset"]["torque"]
    np.testing.assert_allclose(ours.actuator_forcerange - without.actuator_forcerange, torque, atol=DIGITS)
    for command in (-1e3, 0.0, 1e3):  # at both limits and between them
        forces = []
        for model in (ours, without):
            data = mujoco.MjData(model)
            model.actuator_ctrllimited[:] = 0
            data.ctrl[:] = command
            mujoco.mj_forward(model, data)
            forces.append(data.qfrc_actuator[0])
        assert forces[0] - forces[1] == pytest.approx(torque, abs=DIGITS)


def test_a_constant_torque_of_one_joint_is_no_other_joints(tmp_path: Path) -> None:
    source = tmp_path / "held"
    shutil.copytree(load_robot("leg").folder, source)
    text = (source / "model.xml").read_text()
    limited = text.replace('name="knee" ', 'name="knee" actuatorfrcrange="-2 2" ', 1)
    assert limited != text
    (source / "model.xml").write_text(limited)
    robot = load_robot(source)
    torque = 0.5
    made = replace(config(robot), effects={"force_offset[knee]": {"torque": torque}})
    (written,) = export_robot(robot, made, tmp_path / "taken").effects
    assert written.in_mjcf and not written.parameters
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "taken" / "mujoco.xml"))
    knee = model.joint("knee").id
    pushed = model.actuator_biasprm[:, 0] != 0
    np.testing.assert_array_equal(model.actuator_trnid[pushed, 0], [knee])
    np.testing.assert_allclose(model.jnt_actfrcrange[knee], [torque - 2, torque + 2], atol=DIGITS)


def test_a_model_called_as_the_plain_file_stays_uncorrected(tmp_path: Path) -> None:
    source = tmp_path / "named"
    shutil.copytree(load_robot("servo_pendulum").folder, source)
    (source / "model.xml").rename(source / "mujoco.xml")
    toml = source / "robot.toml"
    toml.write_text(toml.read_text().replace('"model.xml"', '"mujoco.xml"'))
    robot = load_robot(source)
    made = config(robot, "payload")
    exported = export_robot(robot, made, tmp_path / "taken").robot
    assert (tmp_path / "taken" / "mujoco.xml").read_bytes() == (source / "mujoco.xml").read_bytes()
    assert (tmp_path / "taken" / "mujoco_corrected.xml").is_file()
    run = bank(robot, 15)
    again = rollout(exported, exported.space.nominal[None], run).states[0]
    np.testing.assert_allclose(again, states(robot, made, run), rtol=EXACT, atol=EXACT)


def test_the_readme_says_which_file_to_open(tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    export_robot(robot, config(robot), tmp_path / "taken")
    readme = (tmp_path / "taken" / "README.md").read_text()
    assert "In plain MuJoCo open `mujoco.xml`, not `model.xml`" in readme
    assert "`model.xml` is the uncorrected model" in readme


def test_mujoco_alone_steps_as_robot_toml_says(tmp_path: Path) -> None:
    source = tmp_path / "stepped"
    shutil.copytree(load_robot("servo_pendulum").folder, source)
    text = (source / "robot.toml").read_text()
    told = re.sub(r"(?m)^timestep = .*$", 'timestep = 0.001\\nintegrator = "implicitfast"', text)
    (source / "robot.toml").write_text(told)
    robot = load_robot(source)
    export_robot(robot, config(robot), tmp_path / "taken")
    for path in (tmp_path / "taken" / "mujoco.xml", source / "model.xml"):
        option = mujoco.MjModel.from_xml_path(str(path)).opt
        same = (option.integrator, option.timestep) == (mujoco.mjtIntegrator.mjINT_IMPLICITFAST, 0.001)
        assert same == (path.name == "mujoco.xml")


def test_the_readme_says_which_ctrl_takes_a_command(tmp_path: Path) -> None:
    """The model has its actuators in another order than robot.toml its actions, and one that no command sets."""
    model, toml = _arm_of_two(tmp_path / "turned")
    text = model.read_text().replace("<actuator>", '<actuator>\n    <general name="lift" tendon="both"/>')
    both = '<tendon><fixed name="both"><joint joint="elbow" coef="1"/></fixed></tendon>\n  <actuator>'
    model.write_text(text.replace("<actuator>", both))
    first, second = (f'[[actions]]\nname = "{name}/target"' for name in ("shoulder", "elbow"))
    told = toml.read_text().replace(first, "FIRST").replace(second, first).replace("FIRST", second)
    toml.write_text(told)
    robot = load_robot(tmp_path / "turned")
    assert robot.actions == ("elbow/target", "shoulder/target")
    export_robot(robot, config(robot), tmp_path / "taken")
    readme = (tmp_path / "taken" / "README.md").read_text()
    assert "`ctrl[2]` takes elbow/target, `ctrl[1]` takes shoulder/target, held for 0.01 s each." in readme
    assert (
        "`data.ctrl[[2, 1]] = commands`" in readme
        and "No command sets `ctrl[0]` (lift): keep 0 there" in readme
    )
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "taken" / "mujoco.xml"))
    assert [plain.actuator(number).name for number in (2, 1, 0)] == ["elbow", "shoulder", "lift"]


def test_commands_in_the_order_of_the_models_actuators_need_no_second_line(tmp_path: Path) -> None:
    robot = load_robot("two_joint_arm")
    export_robot(robot, config(robot), tmp_path / "taken")
    readme = (tmp_path / "taken" / "README.md").read_text()
    assert "`ctrl[0]` takes shoulder/target, `ctrl[1]` takes elbow/target" in readme
    assert "= commands" not in readme and "No command" not in readme


def test_a_lag_before_a_drive_that_smooths_its_commands_is_not_in_the_mjcf(tmp_path: Path) -> None:
    """MuJoCo's actuators have one filter: that of the model stays what it was."""
    model, _ = _arm_of_two(tmp_path / "smooth")
    text = model.read_text().replace(
        'joint="elbow"/>\n  </act', 'joint="elbow" dyntype="filterexact" dynprm="0.05"/>\n  </act'
    )
    assert "filterexact" in text
    model.write_text(text)
    robot = load_robot(tmp_path / "smooth")
    for at, there in (("", False), ("[elbow]", False), ("[shoulder]", True)):
        made = config(robot, f"command_lag{at}")
        folder = tmp_path / f"taken{at}"
        (written,) = export_robot(robot, made, folder).effects
        assert written.in_mjcf == there
        smoothing = mujoco.MjModel.from_xml_path(str(folder / "mujoco.xml")).actuator_dynprm[:, 0]
        assert smoothing[1] == pytest.approx(0.05)
        readme = (folder / "README.md").read_text()
        assert ("MJCF has one filter for each" in readme) == (not there)
        does = traced(robot, robot.space.nominal, terms_of(made, robot), {})
        assert ([where for _, where in does.held.values()] == [ENGINE]) == (not there)


@pytest.mark.parametrize("key, share", [("command_lag", 0.2), ("quadratic_drag", 0.05)])
def test_what_mujoco_steps_otherwise_is_most_of_the_effect(key: str, share: float, tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    made, run = config(robot, key), _from_rest(robot)
    export_robot(robot, made, tmp_path / "taken")
    played = _play(tmp_path / "taken" / "mujoco.xml", run, int(robot.substeps(1 / robot.rate)))
    ours = states(robot, made, run, "mujoco")[..., 0]
    effect = np.abs(ours - states(robot, replace(made, effects={}), run, "mujoco")[..., 0]).max()
    assert np.abs(played - ours).max() < share * effect


def test_encoders_that_are_off_are_felt_by_the_drives_of_the_mjcf(tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    made, run = config(robot, "encoder_offset"), _from_rest(robot)
    (written,) = export_robot(robot, made, tmp_path / "taken").effects
    assert written.parameters and not written.in_mjcf
    played = _play(tmp_path / "taken" / "mujoco.xml", run, int(robot.substeps(1 / robot.rate)))
    read = played + made.effects["encoder_offset"]["offset"]
    np.testing.assert_allclose(read, states(robot, made, run, "mujoco")[..., 0], atol=DIGITS)
    assert "`qpos` is the truth" in (tmp_path / "taken" / "README.md").read_text()


@pytest.mark.parametrize("key", MOVING)
def test_what_no_file_can_say_is_told_with_its_values(key: str, tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    made = config(robot, key)
    (written,) = export_robot(robot, made, tmp_path / "taken").effects
    assert not written.parameters and not written.in_mjcf
    readme = (tmp_path / "taken" / "README.md").read_text()
    assert f"**{key}** (in neither)" in readme
    for name, value in made.effects[key].items():
        assert f"{name} = {value:.6g}" in readme


def test_a_folder_that_leaves_effects_out_passes_the_check(tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    written = export_robot(robot, config(robot, *MOVING), tmp_path / "taken").effects
    assert len(written) == len(MOVING) and not any(one.parameters or one.in_mjcf for one in written)
    assert not check_robot(tmp_path / "taken")


def test_what_the_drives_do_and_no_mjcf_says_is_told(tmp_path: Path) -> None:
    """Torque that falls with speed, and a profile of the target: robot.toml has both, the MJCF neither."""
    source = tmp_path / "current"
    shutil.copytree(load_robot("leg").folder, source)
    text = (source / "robot.toml").read_text()
    line = next(line for line in text.splitlines(keepends=True) if line.startswith("back_emf = true"))
    (source / "robot.toml").write_text(text.replace(line, "profile_speed = 3.0\n"))
    robot = load_robot(source)
    export_robot(robot, config(robot), tmp_path / "taken")
    export_robot(load_robot("leg"), config(load_robot("leg")), tmp_path / "usual")
    told = "leaves out what MJCF cannot say of the drives: torque that falls with speed (`speed_limit`) of "
    assert told + "hip_roll, hip_pitch, knee, `profile_speed` of hip_roll" in (
        (tmp_path / "taken" / "README.md").read_text()
    )
    assert "leaves out" not in (tmp_path / "usual" / "README.md").read_text()


@pytest.mark.parametrize("key", ["command_lag", "command_delay"])
def test_mujoco_alone_begins_at_a_keyframe_with_commands_that_hold_it(key: str, tmp_path: Path) -> None:
    """What is late or smoothed is the keyframe's pose at first; for a delay the README says how."""
    source = tmp_path / "posed"
    shutil.copytree(load_robot("servo_pendulum").folder, source)
    text = (source / "model.xml").read_text()
    (source / "model.xml").write_text(
        text.replace("</mujoco>", '<keyframe><key name="out" qpos="1.0"/></keyframe></mujoco>')
    )
    with (source / "robot.toml").open("a") as file:
        file.write('\n[reset]\nkeyframe = "out"\n')
    robot = load_robot(source)
    made = config(robot, key)
    run = Run(np.ones((1, 15, 1)), period=1 / robot.rate)
    export_robot(robot, made, tmp_path / "taken")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "taken" / "mujoco.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    if key == "command_delay":
        assert (
            "`mujoco.mj_initCtrlHistory(model, data, ACTUATOR"
            in (tmp_path / "taken" / "README.md").read_text()
        )
        many = model.actuator_history[0, 0]
        mujoco.mj_initCtrlHistory(model, data, 0, None, np.full((many, 1), 1.0))
    played = [data.qpos[0]]
    for _ in range(run.steps):
        data.ctrl[:] = 1.0
        mujoco.mj_step(model, data, nstep=int(robot.substeps(run.period)))
        played.append(data.qpos[0])
    np.testing.assert_allclose(played, states(robot, made, run, "mujoco")[0, :, 0], atol=1e-4)


def test_the_readme_tells_of_the_simulator_and_not_of_the_robot_that_it_is_of(tmp_path: Path) -> None:
    source = tmp_path / "paced"
    shutil.copytree(load_robot("servo_pendulum").folder, source)
    with (source / "robot.toml").open("a") as file:
        for name, unit, nominal in (("rate", "Hz", 100.0), ("max_step", "rad", 0.5)):
            file.write(f'\n[[parameters]]\nname = "its_{name}"\nunit = "{unit}"\nnominal = {nominal}\n')
            file.write(f'low = {0.1 * nominal}\nhigh = {2 * nominal}\nsets = ["control.{name} ="]\n')
    robot = load_robot(source)
    values = robot.space.as_dict(robot.space.nominal) | {"its_rate": 40.0, "its_max_step": 0.25}
    export_robot(robot, SimConfig(robot.hash, robot.name, values), tmp_path / "taken")
    told = (tmp_path / "taken" / "README.md").read_text()
    assert "held for 0.025 s each" in told and "a command moves by 0.25 at most" in told


def test_mujoco_alone_steps_at_the_rate_of_the_simulator(tmp_path: Path) -> None:
    """Its commands come at 40 Hz by a clock that is 2 % off, not at the 100 Hz of robot.toml; noise is told."""
    source = tmp_path / "paced"
    shutil.copytree(load_robot("servo_pendulum").folder, source)
    with (source / "robot.toml").open("a") as file:
        for name, unit, nominal in (("rate", "Hz", 100.0), ("clock", "1", 1.0), ("noise", "rad", 0.1)):
            file.write(f'\n[[parameters]]\nname = "its_{name}"\nunit = "{unit}"\nnominal = {nominal}\n')
            file.write(f'low = {0.1 * nominal}\nhigh = {2 * nominal}\nsets = ["control.{name} ="]\n')
    robot = load_robot(source)
    values = {"its_rate": 40.0, "its_clock": 1.02, "its_noise": 0.03}
    made = SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal) | values)
    export_robot(robot, made, tmp_path / "taken")
    path, period = tmp_path / "taken" / "mujoco.xml", 1.02 / 40.0
    count = period / mujoco.MjModel.from_xml_path(str(path)).opt.timestep
    assert count == pytest.approx(round(count), abs=1e-4) and round(count) == robot.substeps(period)
    run = replace(_from_rest(robot), period=None)
    np.testing.assert_allclose(
        _play(path, run, round(count)), states(robot, made, run, "mujoco")[..., 0], atol=DIGITS
    )
    told = (tmp_path / "taken" / "README.md").read_text()
    assert "held for 0.0255 s each" in told
    assert "noise on each command, of standard deviation 0.03 (`noise`)" in told
    assert "a log of the robot counts 1 s in 1.02 s (`clock`)" in told


@pytest.mark.parametrize("effects", [{"payload": {"mass": 0.0}}, {"drive_gain": {"gain": -1.0}}])
def test_an_effect_that_does_nothing_or_all_can_be_exported(effects: dict, tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    made = SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal), effects)
    exported = export_robot(robot, made, tmp_path / "taken").robot
    run = bank(robot)
    again = rollout(exported, exported.space.nominal[None], run).states[0]
    np.testing.assert_allclose(again, states(robot, made, run), rtol=EXACT, atol=EXACT)


def test_elements_without_names_are_told(tmp_path: Path) -> None:
    source = tmp_path / "nameless"
    source.mkdir()
    robot = load_robot("leg")
    text = (robot.folder / "model.xml").read_text()
    (source / "model.xml").write_text(text.replace('<geom name="ground" ', "<geom "))
    (source / "robot.toml").write_text((robot.folder / "robot.toml").read_text())
    nameless = load_robot(source)
    exported = export_robot(nameless, config(nameless, "ground_friction"), tmp_path / "taken")
    (written,) = exported.effects
    assert not written.parameters and written.in_mjcf
    assert "have no name" in (tmp_path / "taken" / "README.md").read_text()


def test_a_robot_that_mujoco_does_not_move_has_no_mjcf(tmp_path: Path) -> None:
    robot = load_robot("husky")
    exported = export_robot(robot, config(robot), tmp_path / "taken")
    assert "kinematic" in exported.problem and not (tmp_path / "taken" / "mujoco.xml").exists()
    assert not check_robot(tmp_path / "taken") and exported.robot.space.names == robot.space.names


def test_a_folder_of_a_base_has_the_effects_of_its_wheels(tmp_path: Path) -> None:
    robot = load_robot("diffdrive")
    keys = [key for key, effect in applicable(robot).items() if carries(effect)]
    assert keys == ["wheel_gain", "drive_inertia", "encoder_scale"]
    made = config(robot, *keys)
    exported = export_robot(robot, made, tmp_path / "taken")
    assert all(effect.parameters for effect in exported.effects) and not check_robot(tmp_path / "taken")
    for engine in robot.file.robot.engines:
        ours = states(robot, made, bank(robot), engine)
        nominal = exported.robot.space.nominal[None]
        again = rollout(exported.robot, nominal, bank(robot), engine=engine).states[0]
        np.testing.assert_allclose(again, ours, rtol=EXACT, atol=EXACT)


def test_what_exists_is_not_overwritten_and_failures_leave_nothing(tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    (tmp_path / "there").mkdir()
    with pytest.raises(UsageError, match="there"):
        export_robot(robot, config(robot), tmp_path / "there")
    with pytest.raises(UsageError, match="not there"):
        export_robot(robot, config(robot), tmp_path / "not there" / "taken")
    foreign = SimConfig(robot.hash, robot.name, {}, {"ground_friction": {"change": 0.3}})
    with pytest.raises(UsageError, match="ground_friction"):
        export_robot(robot, foreign, tmp_path / "taken")
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


def _arm_of_two(folder: Path) -> tuple[Path, Path]:
    """A copy of the arm of two joints, to be changed: its model and its robot.toml."""
    shutil.copytree(load_robot("two_joint_arm").folder, folder)
    return folder / "model.xml", folder / "robot.toml"


def _from_rest(robot: Robot) -> Run:
    """Commands that start where the robot rests, as a plain simulation does."""
    run = bank(robot)
    actions = run.actions.copy()
    actions[:, :4] = 0.0
    return Run(actions, period=run.period)


def _play(path: Path, run: Run, substeps: int) -> np.ndarray:
    """(E, T+1) positions of the arm in MuJoCo, without any of dynreg."""
    model = mujoco.MjModel.from_xml_path(str(path))
    out = np.empty((run.episodes, run.steps + 1))
    for e in range(run.episodes):
        data = mujoco.MjData(model)
        out[e, 0] = data.joint("arm").qpos[0]
        for t in range(run.steps):
            data.ctrl[:] = run.actions[e, t]
            mujoco.mj_step(model, data, nstep=substeps)
            out[e, t + 1] = data.joint("arm").qpos[0]
    return out
