"""What a stranger's model may read, and what becomes of this process where MuJoCo ends on one."""

from pathlib import Path

import pytest
import strangers
from ros_log import JOINTS, truth, write_robot

from dynreg.data.ingest import read_log
from dynreg.draft.apart import draft_apart
from dynreg.draft.entry import DraftOptions, Notes
from dynreg.draft.source import read_source
from dynreg.errors import RobotError

SECRET = b"root:x:0:0"
MESH = """<mujoco><asset><mesh name="m" file="{file}"/></asset><worldbody><body><joint name="turn"/>
  <geom type="mesh" mesh="m" mass="1"/></body></worldbody></mujoco>"""
CORNERS = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
NAMED = {
    "above": "../secret.obj",
    "absolute": "{home}/secret.obj",
    "a link": "linked.obj",
    "through a folder": "meshes/../../secret.obj",
}


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder with a secret beside the folder of a model."""
    (tmp_path / "secret.obj").write_bytes(SECRET)
    (tmp_path / "robot" / "meshes").mkdir(parents=True)
    (tmp_path / "robot" / "linked.obj").symlink_to(tmp_path / "secret.obj")
    return tmp_path


@pytest.mark.parametrize("name", NAMED.values(), ids=NAMED)
@pytest.mark.parametrize("form", ["mjcf", "urdf"])
def test_a_file_outside_the_models_folder_is_refused(form: str, name: str, home: Path):
    name = name.format(home=home)
    texts = {
        "mjcf": MESH.format(file=name),
        "urdf": strangers.URDF.replace("package://two_link_description/meshes/upper.stl", name),
    }
    model = home / "robot" / f"robot.{form}"
    model.write_text(texts[form])
    with pytest.raises(RobotError, match=r"secret|linked") as refused:
        read_source(model, None, Notes())
    said = str(refused.value)
    assert "lies outside" in said and "--root" in said and "\n" not in said


def test_a_model_includes_nothing_of_other_folders(home: Path):
    (home / "other.xml").write_text("<mujoco/>")
    model = home / "robot" / "robot.xml"
    model.write_text('<mujoco><include file="../other.xml"/></mujoco>')
    with pytest.raises(RobotError, match=r"other\.xml'.* lies outside"):
        read_source(model, None, Notes())


def test_a_package_is_left_by_no_name_in_it(home: Path):
    model = home / "robot" / "robot.urdf"
    model.write_text(strangers.URDF.replace("two_link_description/meshes/upper.stl", "robot/../secret.obj"))
    source = read_source(model, None, notes := Notes())
    assert SECRET not in source.files.values() and any("not found" in note for note in notes.lines)


def test_files_of_a_ros_package_and_of_a_stated_root_come_along(home: Path):
    (home / "robot" / "mjcf").mkdir()
    (home / "robot" / "meshes" / "m.obj").write_text(CORNERS)
    model = home / "robot" / "mjcf" / "robot.xml"
    model.write_text(MESH.format(file="../meshes/m.obj"))
    with pytest.raises(RobotError, match="lies outside"):
        read_source(model, None, Notes())
    assert len(read_source(model, home / "robot", Notes()).files) == 2
    (home / "robot" / "package.xml").write_text("<package/>")
    assert len(strangers.draft(model, "robot").files) == 3


def test_a_package_behind_a_link_has_its_meshes(home: Path):
    """As in a workspace of ROS that was built with --symlink-install."""
    (home / "robot" / "urdf").mkdir()
    (home / "robot" / "package.xml").write_text("<package/>")
    (home / "robot" / "meshes" / "m.obj").write_text(CORNERS)
    text = strangers.URDF.replace("two_link_description/meshes/upper.stl", "my_arm/meshes/m.obj")
    (home / "robot" / "urdf" / "robot.urdf").write_text(text)
    (home / "share").mkdir()
    (home / "share" / "my_arm").symlink_to(home / "robot")
    source = read_source(home / "share" / "my_arm" / "urdf" / "robot.urdf", None, Notes())
    assert CORNERS.encode() in source.files.values()


def test_two_missing_meshes_of_one_shape_are_one_shape_less(tmp_path: Path):
    missing = '<mesh filename="package://two_link_description/meshes/upper.dae"/>'
    model = tmp_path / "robot.urdf"
    model.write_text(strangers.URDF.replace(missing, missing + missing.replace("upper", "lower")))
    source = read_source(model, None, notes := Notes())
    assert b"<visual>" not in source.files["model.urdf"]
    assert any("3 meshes were not found" in note for note in notes.lines)


def test_a_model_on_which_mujoco_ends_is_one_line(tmp_path: Path):
    model = tmp_path / "robot.xml"
    itself = (
        '<asset><model name="m" file="robot.xml"/></asset><worldbody><frame><attach model="m" body="upper" '
    )
    model.write_text(
        strangers.ARM.format(actuators="").replace("<worldbody>", itself + 'prefix="p"/></frame>')
    )
    with pytest.raises(RobotError, match=r"^MuJoCo ends on the robot's model \(SIG"):
        draft_apart(model, "robot", DraftOptions())


def table_of_arm(folder: Path) -> tuple[str, Path]:
    """A model and its log in a table."""
    log = folder / "run.csv"
    rows = [f"{n / 100},{n % 7 / 100},{n % 5 / 100},{n / 1000},{n / 999}" for n in range(300)]
    log.write_text("\n".join(["t_s,pos_shoulder,pos_elbow,cmd_shoulder,cmd_elbow", *rows]))
    return strangers.ARM.format(actuators=strangers.POSITION), log


def messages_of_arm(folder: Path) -> tuple[str, Path]:
    """The same with a free base, in messages of ROS, whose topics and types say how to read them."""
    text = strangers.ARM.format(actuators=strangers.POSITION)
    for name, logged in zip(("shoulder", "elbow"), JOINTS, strict=True):
        text = text.replace(f'"{name}"', f'"{logged}"')
    base = '<body name="base" pos="0 0 0.5"><freejoint/><geom size="0.1" mass="2"/><body name="upper">'
    text = text.replace('<body name="upper" pos="0 0 0.5">', base)
    write_robot(folder / "run.mcap", truth(1.0))
    return text.replace("</worldbody>", "</body></worldbody>"), folder / "run.mcap"


@pytest.mark.parametrize("made", [table_of_arm, messages_of_arm])
def test_a_draft_made_apart_is_the_same(made, tmp_path: Path):
    model = tmp_path / "arm.xml"
    text, log = made(tmp_path)
    model.write_text(text)
    read = read_log(log)
    apart, here = draft_apart(model, "arm", DraftOptions(), read), strangers.draft(model, "arm", log=read)
    assert apart.files == here.files and apart.notes == here.notes and apart.map == here.map
    assert apart.robot.hash == here.robot.hash and apart.joints == here.joints


def test_shapes_without_a_size_are_said_and_left_out(tmp_path: Path):
    flat = '<collision><geometry><sphere radius="0.0"/></geometry></collision></link>'
    model = tmp_path / "robot.urdf"
    model.write_text(strangers.URDF.replace("</link>", flat))
    made = strangers.draft(model, "robot")
    assert any("2 shapes of size 0 are left out" in note for note in made.notes)


@pytest.mark.parametrize(("velocity", "told"), [("3", True), ("0", False), ("fast", False)])
def test_the_speeds_that_a_urdf_allows_are_told(velocity: str, told: bool, tmp_path: Path):
    path = tmp_path / "robot.urdf"
    path.write_text(strangers.URDF.replace('velocity="3"', f'velocity="{velocity}"'))
    read_source(path, None, notes := Notes())
    said = [line for line in notes.lines if "allows speeds" in line]
    assert len(said) == told and all("(joint_a: 3 rad/s, joint_b: 3 rad/s)" in line for line in said)
