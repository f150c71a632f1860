import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from arm_robot import ARM_XML, parameter

from dynreg.data.ingest import read_recording
from dynreg.data.maps import check_map, read_map
from dynreg.errors import LogError, MapError, RobotError, UsageError
from dynreg.sim.robot import load_robot, packaged_robots, require_commands

PACKAGED = tuple(packaged_robots())


@pytest.mark.parametrize("name", PACKAGED)
def test_packaged_robots_are_what_their_maps_ask_for(name: str):
    robot = load_robot(name)
    assert robot.name == name and re.fullmatch(r"[0-9a-f]{64}", robot.hash)
    maps = sorted((robot.folder / "maps").glob("*.toml")) if (robot.folder / "maps").is_dir() else []
    for path in maps:
        check_map(read_map(path), robot.recording_spec)


def test_maps_of_logs_do_not_change_a_robots_hash(write_robot: Callable[..., Path]):
    folder = write_robot()
    before = load_robot(folder).hash
    (folder / "maps").mkdir()
    (folder / "maps" / "log.toml").write_text("")
    assert load_robot(folder).hash == before
    (folder / "model.xml").write_text(ARM_XML.replace("0.25", "0.26"))
    assert load_robot(folder).hash != before


FAULTS = [  # what is changed, what the named line holds, what is said
    ("control_rate = 50.0", "control_rate = ", "control_rate = ", "TOML"),
    (
        "control_rate = 50.0",
        'control_rate = "50"',
        "control_rate",
        "'robot.control_rate' = '50'.*valid number",
    ),
    ("control_rate = 50.0", "control_rate = nan", "control_rate", "'robot.control_rate' = nan: .*finite"),
    (
        "control_rate = 50.0",
        "contol_rate = 50.0",
        "contol_rate",
        "unknown key 'robot.contol_rate'.*control_rate",
    ),
    ("control_rate = 50.0", "", "[robot]", "control_rate is missing"),
    (
        "timestep = 0.002",
        "timestep = 0",
        "timestep",
        "'robot.timestep' = 0: .*greater than or equal to 0.000001",
    ),
    ("timestep = 0.002", "timestep = 1e-12", "timestep", "= 1e-12: .*greater than or equal to 0.000001"),
    ("timestep = 0.002", "timestep = 1e9", "timestep", "= 1000000000.0: .*less than or equal to 0.05"),
    ("timestep = 0.002", "timestep = inf", "timestep", "= inf: .*finite"),
    ("timestep = 0.002", "timestep = 1e400", "timestep", "= inf: .*finite"),
    ("timestep = 0.002", f"timestep = 1{'0' * 400}", "timestep", "'robot.timestep': .*valid number"),
    ("control_rate = 50.0", "control_rate = 1e12", "control_rate", "less than or equal to 100000"),
    ("control_rate = 50.0", "control_rate = 1e-12", "control_rate", "greater than or equal to 0.01"),
    (
        "control_rate = 50.0\ntimestep = 0.002",
        "control_rate = 0.01\ntimestep = 1e-6",
        "[robot]",
        "more than 100000",
    ),
    ('keyframe = "home"', 'keyframe = "home"\nsettle = 1e12', "settle", "less than or equal to 60"),
    ("steps = 20", "steps = 1000000000000", "steps", "less than or equal to 100000"),
    (
        "episodes = 8\nsteps = 20",
        "episodes = 9999\nsteps = 99999",
        "[excitation]",
        "at most 10000000 should be",
    ),
    ('["levels", "walk"]', str(["walk"] * 2000), "kinds", "2000 entries, at most 1000"),
    ("high = 40.0", "high = 1e300", "high", "within"),
    ('unit = "N*m/rad"', 'unit = "' + "N" * 5000 + '"', "unit", "at most 1000 characters"),
    ('"elbow/velocity"', '"elbow\\u001b[31m/velocity"', "u001b", "the control character '.x1b' in it"),
    ("steps = 20", f"steps = 0x{'f' * 5000}", "steps", "'excitation.steps': .*less than or equal to 100000"),
    ("timestep = 0.002", "", "[robot]", "'robot.timestep' is missing"),
    ('["mujoco"]', '["bullet"]', "engines", "'bullet'.*'mujoco', 'joint'"),
    ('type = "torque"', 'type = "torqe"', "[[drives]]", "'torqe'.*'position', 'torque'"),
    ("speed_limit = 8.0", "speedlimit = 8.0", "speedlimit", "unknown key 'drives.0.speedlimit'.*speed_limit"),
    ("gain = 20.0", "gain = -1", "gain = -1", "'drives.0.gain' = -1: .*greater"),
    ("gain = 20.0", "", "[[drives]]", "'drives.0.gain' is missing"),
    ("gain = 20.0", 'enable = "elbow/torque"\ngain = 20', "enable", "enable 'elbow/torque' is already"),
    ("low = 5.0", "low = 50.0", "[[parameters]]", "'parameters.0': low 50.0 is not below high 40.0"),
    ("low = 5.0", "low = 25.0", "[[parameters]]", "'parameters.0': nominal 20.0 lies outside"),
    ("low = 5.0", "low = -5.0", "[[parameters]]", "'parameters.0': a log scale needs low > 0"),
    ("port.drive.gain[", "port.drve.gain[", "port.drve", "sets entry.*'drve'.*drive"),
    ('"elbow/velocity"', '"elbow/position"', '"elbow/position"', "'elbow/position' is named twice"),
    ('"elbow/velocity"', '"elbow/torque"', '"elbow/torque"', "'elbow/torque' is named twice"),
    ('"walk"]', '"walks"]', "kinds", "'excitation.kinds.1' = 'walks'.*'walk'"),
    ("[reset]", "[resets]", "[resets]", "unknown key 'resets'.*'reset'"),
    ("[reset]", "[populations.a]\nranges = {gian = [1, 2]}\n[reset]", "gian", "'gian'.*'gain'"),
    ("[reset]", "[populations.a]\nranges = {gain = [2, 1]}\n[reset]", "ranges", "gain: low 2.0"),
    ("[reset]", "[populations.a]\nranges = {gain = [0, 2]}\n[reset]", "ranges", "gain: low 0 on a log scale"),
    ('name = "shoulder/target"', "name = 3", "name = 3", "'actions.0.name' = 3.*string"),
]


@pytest.mark.parametrize(("old", "new", "at", "said"), FAULTS)
def test_faults_of_robot_toml_are_told_with_their_line(
    old: str, new: str, at: str, said: str, write_robot: Callable[..., Path]
):
    folder = write_robot((old, new))
    with pytest.raises(RobotError, match=said) as caught:
        load_robot(folder)
    (line,) = re.findall(r"line (\d+)", str(caught.value))
    assert at in (folder / "robot.toml").read_text().splitlines()[int(line) - 1], caught.value
    assert "\n" not in str(caught.value)


def test_a_supply_must_be_an_input(write_robot: Callable[..., Path]):
    duty = 'type = "duty_servo"\nduty_gain = 0.1\nkt = 1.0\nresistance = 1.0\nsupply = 12.0'
    gone = "rate_gain = 0.3\ntorque_limit = 4.0\nspeed_limit = 8.0\nback_emf = true"
    with pytest.raises(RobotError, match="supply_input 'volts' is no input"):
        load_robot(write_robot(('type = "position"', duty), (gone, 'supply_input = "volts"')))


def test_a_model_that_is_not_there(write_robot: Callable[..., Path]):
    with pytest.raises(RobotError, match="'other.xml' does not exist.*`model`"):
        load_robot(write_robot(('name = "arm"', 'name = "arm"\nmodel = "other.xml"')))


def test_a_folder_that_is_none_and_a_model_that_does_not_compile(
    tmp_path: Path, write_robot: Callable[..., Path]
):
    with pytest.raises(RobotError, match="no robot.*quadruped"):
        load_robot(tmp_path)
    (tmp_path / "robot.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(RobotError, match="UTF-8"):
        load_robot(tmp_path)
    broken = load_robot(write_robot(xml=ARM_XML.replace('mass="0.4"', 'mass="-1"')))
    with pytest.raises(RobotError, match=r"model.xml: .*mass"):
        broken.model  # noqa: B018


@pytest.mark.parametrize(
    ("ref", "do"),
    [
        ("arm", "write 'my_arm', which is nearest to it"),
        ("robots/my_arm", "write 'my_arm', which is nearest to it"),
        ("leg/", "write './leg', which is nearest to it"),
        ("quadrupet", "write 'quadruped', which is nearest to it"),
        ("xyzzy", "see `dynreg robots`"),
    ],
)
def test_a_name_of_no_robot_is_answered_with_the_nearest_folder_here_or_packaged_robot(
    ref: str, do: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("my_arm", "leg", "no_robot"):
        (tmp_path / name).mkdir()
        if name != "no_robot":
            (tmp_path / name / "robot.toml").touch()
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(RobotError, match="no robot") as error:
        load_robot(tmp_path / "elsewhere" / ref)
    assert "here:" not in error.value.expected
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RobotError, match="no robot") as error:
        load_robot(f"elsewhere/{ref}")
    assert error.value.do == do
    assert error.value.expected.endswith("MJCF model (here: './leg', 'my_arm')")
    with pytest.raises(RobotError, match="no robot") as error:
        load_robot("legs")
    assert error.value.do == "write 'leg', which is nearest to it", "the packaged one, as it was typed"
    with pytest.raises(
        RobotError, match=r"no robot.toml in folder 'no_robot'.*draft one with `dynreg robots init`"
    ):
        load_robot("no_robot")


def test_named_ranges_replace_the_parameters_own(write_robot: Callable[..., Path]):
    ranges = "[populations.weak]\nranges = { gain = [1.0, 10] }\n\n[reset]"
    folder = write_robot(("[reset]", ranges))
    weak = load_robot(folder, "weak")
    np.testing.assert_array_equal(weak.space.bounds, [[1.0, 10.0]])
    assert weak.hash == load_robot(folder).hash
    with pytest.raises(UsageError, match="'strong'.*weak"):
        load_robot(folder, "strong")
    with pytest.raises(
        UsageError, match=r"expected none: robot.toml has no named ranges; .*\[populations.NAME"
    ):
        load_robot(write_robot(), "wide")


def test_a_log_without_optional_commands_is_ingested_but_not_replayed(tmp_path: Path):
    robot = load_robot("husky")
    rows = [f"{0.1 * i},{0.5},{0.1 + 0.01 * i}" for i in range(30)]
    (tmp_path / "log.csv").write_text("\n".join(["time,base/speed,base/yaw_rate", *rows]))
    recording = read_recording(tmp_path / "log.csv", robot.recording_spec)
    assert recording.names == robot.channels
    with pytest.raises(LogError, match=r"no commands 'base/speed_command'.*nothing can be replayed"):
        require_commands(robot, recording)
    rows = [row + ",1,0" for row in rows]
    header = "time,base/speed,base/yaw_rate,base/speed_command,base/yaw_rate_command"
    (tmp_path / "whole.csv").write_text("\n".join([header, *rows]))
    require_commands(robot, read_recording(tmp_path / "whole.csv", robot.recording_spec))


def test_commands_that_are_not_optional_are_asked_for(tmp_path: Path, write_robot: Callable[..., Path]):
    robot = load_robot(write_robot())
    header = ",".join(["time", *robot.channels])
    (tmp_path / "log.csv").write_text("\n".join([header, *(f"{0.02 * i},0,0,0,0" for i in range(30))]))
    with pytest.raises(MapError, match="no column 'shoulder/target'"):
        read_recording(tmp_path / "log.csv", robot.recording_spec)


def test_one_parameter_may_set_several_things(write_robot: Callable[..., Path]):
    entries = ("mj.body_mass[lower] *=", "port.drive.gain[*] *=")
    robot = load_robot(write_robot(parameters=parameter("p", *entries)))
    assert [[a.path for a in group] for group in robot.setters] == [["body_mass", "drive.gain"]]
