"""`robots check` tells everything at once: all errors with their lines, and warnings that do not stop anyone."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from arm_robot import ARM_TOML, ARM_XML, parameter

from dynreg.errors import RobotError
from dynreg.folder import read_folder
from dynreg.sim import check
from dynreg.sim.check import findings
from dynreg.sim.engines import rollout
from dynreg.sim.inspection import check_robot, inspect_robot
from dynreg.sim.lint import doubts
from dynreg.sim.robot import load_robot, packaged_robots
from dynreg.sim.run import Run

# the small arm with noise, drives and ranges about which nobody could have a doubt
GOOD = re.sub(r'(/position"\nunit = "rad")', r"\1\nnoise = 0.0005", ARM_TOML)
GOOD = re.sub(r'(/velocity"\nunit = "rad/s")', r"\1\nnoise = 0.01", GOOD)
WRONG = {  # what is said: (text that stands there, wrong text)
    "Expected '=' after a key": ("cpisodes = 8\n", "cpisodes 8\n"),
    "unknown key 'excitation.amplitud'": ("amplitude = 0.6", "amplitud = 0.6"),
    "'drives.1.torque_limit' = -1.5": ("torque_limit = 1.5", "torque_limit = -1.5"),
    "'gain': 'parameters.0.scale' = 'logarithmic'": ('scale = "log"', 'scale = "logarithmic"'),
    "'shoulder/position' is named twice": ('name = "spare/position"', 'name = "shoulder/position"'),
    "sets entry 'mj.body_mass[lower] ++'": ("mj.body_mass[lower] +=", "mj.body_mass[lower] ++"),
    "channel 'elbow/speed' is not in the model": ('name = "elbow/velocity"', 'name = "elbow/speed"'),
    "keyframe 'hme' is not in the model": ('keyframe = "home"', 'keyframe = "hme"'),
    "unit 'deg/s' of 'shoulder/velocity' is not SI": ('unit = "rad/s"', 'unit = "deg/s"'),
    "parameter 'bad_mass': sets entry 'mj.body_mass[uper] ='": ("mj.body_mass[upper]", "mj.body_mass[uper]"),
    "parameter 'inertia' at -30 1 diverges": ("low = -30.5", "low = -30.0"),
}


def many_faults() -> str:
    """A robot.toml that is wrong in all of these ways."""
    text = GOOD.replace("[excitation]\n", "[excitation]\ncpisodes = 8\n")
    text = text.replace(
        "[[settings]]", '[[channels]]\nname = "spare/position"\nunit = "rad"\n\n[[settings]]', 1
    )
    text += parameter("bad_mass", "mj.body_mass[upper] =")
    text += parameter("inertia", "mj.body_inertia[lower] *=", low=-30.5)
    for old, new in WRONG.values():
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def test_all_errors_of_a_folder_are_told_in_one_run_each_with_its_line(write_robot: Callable[..., Path]):
    folder, text = write_robot(), many_faults()
    (folder / "robot.toml").write_text(text, encoding="utf-8")
    found = [finding for finding in inspect_robot(folder) if finding.severity == "error"]
    lines = text.split("\n")
    for said, (_, wrong) in WRONG.items():
        (one,) = [finding for finding in found if said in finding.message] or [None]
        assert one is not None, (said, [str(f) for f in found])
        assert one.line is not None and wrong.strip() in lines[one.line - 1], (said, one.line)
    assert len(found) == len(WRONG), [str(f) for f in found]
    assert [finding.line for finding in found] == sorted(finding.line for finding in found)


def test_a_misspelt_key_is_not_also_a_missing_one(write_robot: Callable[..., Path]):
    (line,) = check_robot(write_robot(("timestep = 0.002", "time_step = 0.002")))
    assert "line 6: unknown key 'robot.time_step'" in line


def test_what_follows_from_an_error_is_no_error(write_robot: Callable[..., Path]):
    """A drive, an action and a parameter that are wrong leave no others behind that lead nowhere."""
    ranges = "\n[populations.slow]\nranges = { gain = [6.0, 7.0] }\n"
    folder = write_robot(
        ("gain = 0.5", 'gain = "half"'),
        ("high = 40.0", "high = 4.0"),
        ("[[settings]]", ranges + "\n[[settings]]"),
    )
    found = check_robot(folder)
    assert (
        len(found) == 2 and "'drives.1.gain' = 'half'" in found[0] and "low 5.0 is not below" in found[1]
    ), found


def test_errors_of_the_text_are_told_where_the_model_ends_mujoco(write_robot: Callable[..., Path]):
    found = check_robot(
        write_robot(("amplitude = 0.6", "amplitude = -1.0"), xml=ARM_XML.replace("<mujoco", "<mujoc"))
    )
    assert len(found) == 2 and "amplitude" in found[1] and "model.xml" in found[0], found


def test_the_small_arm_is_clean_when_its_noise_is_stated(write_robot: Callable[..., Path]):
    folder = write_robot()
    (folder / "robot.toml").write_text(GOOD)
    assert inspect_robot(folder) == []


NO_GROUND = ARM_XML.replace('<geom name="ground" type="plane" size="1 1 0.1"/>', "")
WARNED = {
    "tolerance": (
        [("high = 40.0\n", "high = 40.0\ntolerance = 0.01\n")],
        ARM_XML,
        r"tolerance = 0.01@parameter 'gain': its range ends 139 tolerances from nominal",
    ),
    "a mass's range": (
        [
            (
                "[[parameters]]",
                parameter("load", "modifier.mass[lower] *=", low=0.5, high=900.0) + "\n[[parameters]]",
            )
        ],
        ARM_XML,
        r"high = 900.0@parameter 'load': its range spans a factor of 1.8e\+03 in mass",
    ),
    "overwritten": (
        [
            ("mj.body_mass[lower] +=", "port.drive.gain[shoulder] ="),
            ("values = [0.0, 0.2, 0.4]", "values = [5.0, 20.0]"),
        ],
        ARM_XML,
        r"sets@setting 'added_mass' overwrites parameter 'gain': both set 'port.drive.gain\[shoulder\]'",
    ),
    "friction by two parameters": (
        [
            (
                "[[parameters]]",
                parameter("a", "port.friction.coulomb[shoulder] =", low=0.01, nominal=0.1)
                + parameter("b", "mj.dof_frictionloss[shoulder] =", low=0.01, nominal=0.1)
                + "\n[[parameters]]",
            )
        ],
        ARM_XML,
        r"sets@parameter 'a' and 'b' both set the frictionloss of joint 'shoulder'",
    ),
    "no noise": (
        [("noise = 0.01", "zero = 0.0")],
        ARM_XML,
        r"name@channel 'shoulder/velocity' has neither `noise`",
    ),
    "action range": (
        [("low = -2.0\nhigh = 2.0", "low = -115.0\nhigh = 115.0")],
        ARM_XML,
        r"name@action 'shoulder/target' goes from -115 to 115 rad, its joint from -2.09.*press the joint on its stop",
    ),
    "reset pose": (
        [("low = -2.0\nhigh = 2.0", "low = 0.5\nhigh = 2.0")],
        ARM_XML,
        r"name@action 'shoulder/target': the reset pose, 0.3 rad, is outside its limits 0.5 to 2 rad",
    ),
    "gravity": (
        [("torque_limit = 4.0", "torque_limit = 0.3")],
        ARM_XML,
        r"name@the drive of 'shoulder/target' cannot hold its start: with its largest torque, 0.3",
    ),
    "no ground": (
        [],
        NO_GROUND.replace('contype="0" conaffinity="0" ', ""),
        r"[robot]@geoms of the model can touch each other, but none of the world",
    ),
    "a packaged robot's name": (
        [('name = "arm"', 'name = "leg"')],
        ARM_XML,
        r"name@the name 'leg' is that of a robot",
    ),
    "coarse": (
        [
            ("timestep = 0.002", "timestep = 0.02"),
            ("rate_gain = 0.3", "rate_gain = 0.0"),
            ("torque_limit = 4.0\nspeed_limit = 8.0", "torque_limit = 40.0"),
            ("nominal = 20.0\nlow = 5.0\nhigh = 40.0", "nominal = 200.0\nlow = 190.0\nhigh = 210.0"),
        ],
        ARM_XML,
        r"timestep@\[robot\] timestep 0.02 s is too long: half of it changes .* of its motion; lower it to 0\.01$",
    ),
    "still": (
        [
            ('kinds = ["levels", "walk"]', 'kinds = ["levels", "walk"]'),
            ("amplitude = 0.6", "amplitude = 0.6"),
        ],
        ARM_XML.replace(
            '<body name="lower" pos="0.2 0 0">', '<body name="lower" pos="0.2 0 0" gravcomp="1">'
        ).replace(
            '<joint name="elbow" axis="0 1 0" armature="0.005"/>',
            '<joint name="elbow" axis="0 1 0" armature="1e9"/>',
        ),
        r"name@the excitation never moves channel 'elbow/position'",
    ),
}


@pytest.mark.parametrize("case", WARNED)
def test_each_doubt_is_a_warning_at_its_line(case: str, tmp_path: Path):
    changes, xml, said = WARNED[case]
    text = GOOD
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    (tmp_path / "robot.toml").write_text(text)
    (tmp_path / "model.xml").write_text(xml)
    found = findings(read_folder(tmp_path))
    at, message = said.split("@", 1)
    fitting = [f for f in found if f.severity == "warning" and re.search(message, f.message)]
    assert fitting, [str(f) for f in found]
    assert at in text.split("\n")[fitting[0].line - 1], fitting[0]


def test_a_folder_and_a_packaged_robot_of_one_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    source = packaged_robots()["create"]
    (tmp_path / "create").mkdir()
    for name in ("robot.toml", "model.xml"):
        (tmp_path / "create" / name).write_bytes((source / name).read_bytes())
    monkeypatch.chdir(tmp_path)
    (hidden,) = inspect_robot("create")
    assert hidden.severity == "warning" and "write './create' for the folder" in hidden.message
    (hiding,) = inspect_robot("./create")
    assert hiding.severity == "warning" and "'create' alone means the robot that comes with" in hiding.message


def test_a_free_robot_without_ground_is_warned_of(tmp_path: Path):
    source = packaged_robots()["quadruped"]
    text, model = (source / "robot.toml").read_text(), (source / "model.xml").read_text()
    ground = model[model.index('<geom name="ground"') :].split("/>")[0] + "/>"
    (tmp_path / "model.xml").write_text(model.replace(ground, ""))
    (tmp_path / "robot.toml").write_text(text.replace("[ground,", "["))
    said = [message for _, message in doubts(load_robot(tmp_path))]
    assert any("the model has no ground that it could touch: it falls for ever" in line for line in said), (
        said
    )


def test_names_that_are_all_right_are_tried_in_one_step(
    write_robot: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
):
    """One by one they cost half of a check; they are gone through only where one of them is wrong."""
    tried = []
    kept = check.rollout
    monkeypatch.setattr(check, "rollout", lambda *given, **named: tried.append(1) or kept(*given, **named))
    good = write_robot()
    (good / "robot.toml").write_text(GOOD)
    engines = len(load_robot(good).engines)
    assert findings(read_folder(good)) == [] and len(tried) == engines
    (good / "robot.toml").write_text(GOOD.replace("mj.body_mass[lower]", "mj.body_mass[lwer]"))
    (one,) = findings(read_folder(good))
    assert "lwer" in one.message and len(tried) > 2 * engines


def test_who_asks_for_a_check_loads_no_engine():
    code = (
        "import sys, dynreg.sim.inspection; print(*sorted({'mujoco', 'scipy', 'numba'} & set(sys.modules)))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == ""


def test_a_check_does_without_scipy():
    code = "import sys, dynreg.sim.check; print(*sorted({'scipy.spatial', 'scipy.stats'} & set(sys.modules)))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == ""


@pytest.mark.parametrize("rate_gain, said", [("0.3", None), ("18.0", "timestep"), ("60.0", "diverges")])
def test_a_drive_too_fast_for_the_time_step_is_named(
    rate_gain: str, said: str | None, write_robot: Callable[..., Path]
):
    """With its numbers and what would do: as a wrist of 1e-4 kg*m^2 under the gains of a shoulder."""
    step = 'timestep = 0.002\nintegrator = "euler"'
    faster = ("rate_gain = 0.3", f"rate_gain = {rate_gain}"), ("torque_limit = 4.0", "torque_limit = 400.0")
    found = [
        line
        for line in inspect_robot(write_robot(("timestep = 0.002", step), *faster))
        if "too fast" in str(line)
    ]
    if said is None:
        assert not found
        return
    (line,) = (" ".join(str(line).split()) for line in found)
    assert (
        said in line
        and f"joint 'shoulder' is too fast: gain 20, rate gain {float(rate_gain):g}, inertia 0.0" in line
    )
    ratio = float(re.search(r"time step / inertia = (\S+) \(followed to 0.5, swings from 1 on", line)[1])
    lower = float(re.search(r"lower the rate gain to (\S+),", line)[1])
    assert ratio > 1.0 and lower == pytest.approx(0.5 * float(rate_gain) / ratio, rel=0.1)


OFF = '<option><flag {}="disable"/></option><worldbody>'
TENDON = '</actuator><tendon><fixed {}><joint joint="elbow" coef="1"/></fixed></tendon>'


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('joint="elbow"', 'joint="elbow" gear="5"', "the actuator of action 'elbow/torque' has gear 5"),
        (
            "</actuator>",
            '<position joint="elbow" kp="1"/></actuator>',
            "the actuator of action 'elbow/torque' is not the only one on its joint",
        ),
        (
            "</worldbody>",
            '</worldbody><equality><joint joint1="elbow" joint2="shoulder"/></equality>',
            "engine joint leaves out equality constraints of the model",
        ),
        ("</actuator>", TENDON.format('stiffness="1"'), "leaves out tendons of the model"),
        ("</actuator>", TENDON.format('frictionloss="1"'), "leaves out tendons of the model"),
        ("</actuator>", TENDON.format('range="-1 1"'), "leaves out tendons of the model"),
        ('name="elbow" axis', 'name="elbow" stiffness="0 1" axis', "leaves out springs (stiffness) of"),
        ('name="elbow" axis', 'name="elbow" damping="0 1" axis', "leaves out damping that grows with speed"),
        ('joint="elbow"', 'joint="elbow" damping="1"', "engine joint leaves out damping of actuators"),
        ("gravity=", 'density="1.2" gravity=', "leaves out drag of air or water (density, viscosity)"),
        (
            "<worldbody>",
            OFF.format("frictionloss"),
            'engine joint leaves out the flag frictionloss="disable" of',
        ),
        ("<worldbody>", OFF.format("limit"), 'engine joint leaves out the flag limit="disable" of'),
        ("<worldbody>", OFF.format("damper"), 'engine joint leaves out the flag damper="disable" of'),
        (
            "<worldbody>",
            '<option actuatorgroupdisable="0"/><worldbody>',
            "'elbow/torque' is switched off by actuatorgroupdisable",
        ),
    ],
    ids=[
        "gear",
        "second actuator",
        "equality",
        "tendon spring",
        "tendon friction",
        "tendon limits",
        "hardening spring",
        "quadratic damping",
        "actuator damping",
        "fluid",
        "friction off",
        "stops off",
        "damping off",
        "actuators off",
    ],
)
def test_a_model_that_does_something_else_than_robot_toml_says_is_told(
    write_robot: Callable[..., Path], old: str, new: str, said: str
) -> None:
    """All of these were called sound, and moved the joint otherwise."""
    folder = write_robot()
    both = GOOD.replace('engines = ["mujoco"]', 'engines = ["joint", "mujoco"]')
    (folder / "robot.toml").write_text(both, encoding="utf-8")
    model = folder / load_robot(folder).file.robot.model
    text = model.read_text(encoding="utf-8")
    assert not any(said in message for _, message in doubts(load_robot(folder)))
    changed = text[: text.rindex(old)] + new + text[text.rindex(old) + len(old) :]
    model.write_text(changed, encoding="utf-8")
    assert any(said in message for _, message in doubts(load_robot(folder))), [*doubts(load_robot(folder))]


def test_a_tendon_that_does_nothing_is_no_matter(write_robot: Callable[..., Path]) -> None:
    xml = ARM_XML.replace("</actuator>", TENDON.format(""))
    folder = write_robot(('engines = ["mujoco"]', 'engines = ["joint"]'), xml=xml)
    assert not any("leaves out" in message for _, message in doubts(load_robot(folder)))


def test_a_second_action_on_a_joint_is_refused_at_its_line(write_robot: Callable[..., Path]) -> None:
    """Of two commands on one joint one was ignored, and the advice to keep one actuator did not help."""
    action = '[[actions]]\nname = "elbow/target"\nunit = "rad"\n\n'
    drive = '[[drives]]\njoint = "elbow/target"\ntype = "position"\ngain = 5.0\n\n'
    folder = write_robot(
        ('joint = "elbow"', 'joint = "elbow/torque"'),
        ("[reset]", f"{drive}[reset]"),
        ("[[settings]]", f"{action}[[settings]]"),
    )
    xml = ARM_XML.replace('<motor joint="elbow"/>', '<motor joint="elbow"/><position joint="elbow" kp="5"/>')
    (folder / "model.xml").write_text(xml, encoding="utf-8")
    robot = load_robot(folder)
    with pytest.raises(RobotError, match="keep one of 'elbow/torque' and 'elbow/target'"):
        rollout(robot, robot.space.nominal[None], Run(np.zeros((1, 3, 3))), threads=1)
    (found,) = [one for one in inspect_robot(folder) if one.severity == "error"]
    assert "action 'elbow/target': joint 'elbow' already has the action 'elbow/torque'" in found.message
    assert (folder / "robot.toml").read_text().split("\n")[found.line - 1] == 'name = "elbow/target"'


def test_only_what_an_active_constraint_binds_and_nobody_logs_is_told(tmp_path: Path) -> None:
    """A spare joint beside a weld elsewhere is no matter; a finger that mimics another begins with a jerk."""
    xml = """<mujoco><worldbody><geom type="plane" size="1 1 0.1" pos="0 0 {height}"/>
    <body name="hand" pos="0 0 1">{base}<geom size="0.05" mass="1"/>
      <body><joint name="arm" axis="0 1 0"/><geom size="0.02" pos="0.1 0 0" mass="0.1"/></body>
      <body><joint name="finger" axis="0 1 0"/><geom size="0.02" pos="0 0.1 0" mass="0.1"/></body>
      <body><joint name="spare" axis="0 1 0"/><geom size="0.02" pos="0 -0.1 0" mass="0.1"/></body>
    </body></worldbody><actuator><general joint="arm" biastype="affine"/></actuator>
    <equality><joint joint1="finger" joint2="arm" active="{active}"/></equality></mujoco>"""
    toml = """
[robot]
name = "hand"
engines = ["mujoco"]
control_rate = 50.0
timestep = 0.002

[[drives]]
joint = "arm"
type = "position"
gain = 5.0
rate_gain = 0.3
torque_limit = 3.0

[[actions]]
name = "arm/target"
unit = "rad"

[[channels]]
name = "arm/position"
unit = "rad"
noise = 0.001

[[parameters]]
name = "gain"
unit = "1"
nominal = 1.0
low = 0.9
high = 1.1
tolerance = 0.1
sets = ["port.drive.gain_factor *="]
"""
    (tmp_path / "robot.toml").write_text(toml, encoding="utf-8")

    def told(**said: object) -> list[str]:
        usual = {"active": "true", "height": 0, "base": ""}
        (tmp_path / "model.xml").write_text(xml.format(**usual | said), encoding="utf-8")
        return [message for _, message in doubts(load_robot(tmp_path))]

    (bound,) = [message for message in told() if "equality constraints bind joints" in message]
    assert "no channel tells finger:" in bound and "spare" not in bound
    assert 'under other names: see what its map lists as "Not used"' in bound
    assert not any("equality" in message for message in told(active="false"))
    high = [
        message
        for message in told(base='<freejoint name="base"/>', height=0.5)
        if "the ground is at" in message
    ]
    assert len(high) == 1 and "a height of 0.5 m" in high[0]
    assert not any("the ground is at" in message for message in told(base='<freejoint name="base"/>'))


BALL = """<worldbody><body name="arm"><joint name="ball" type="ball"/><geom size="0.1" mass="1"/></body>"""


@pytest.mark.parametrize("table", ["channels", "actions"])
def test_one_number_of_a_ball_joint_is_refused(write_robot: Callable[..., Path], table: str) -> None:
    """The first number of its quaternion was taken for an angle."""
    xml = ARM_XML.replace("<worldbody>", BALL).replace(
        "</actuator>", '<motor name="ball" joint="ball" gear="0 1 0"/></actuator>'
    )
    name, unit = ("ball/position", "rad") if table == "channels" else ("ball/torque", "N*m")
    entry = f'[[{table}]]\nname = "{name}"\nunit = "{unit}"\n\n'
    if table == "actions":
        entry += '[[drives]]\njoint = "ball"\ntype = "torque"\n\n'
    folder = write_robot(("[[settings]]", entry + "[[settings]]"), xml=xml)
    errors = [str(finding) for finding in inspect_robot(folder) if finding.severity == "error"]
    assert any(f"{table[:-1]} '{name}' is not in the model; expected one of " in line for line in errors), (
        errors
    )
