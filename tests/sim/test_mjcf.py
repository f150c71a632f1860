"""What a robot's model may read, and what it may ask of the machine."""

import os
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from arm_robot import ARM_XML

from dynreg.errors import RobotError
from dynreg.registry import Registry
from dynreg.sim.inspection import check_robot
from dynreg.sim.robot import load_robot, packaged_robots

HEAVY = '<mujocoinclude><option gravity="0 0 -3"/></mujocoinclude>'
BOX = (
    "v -1 -1 -1\nv  1 -1 -1\nv  1  1 -1\nv -1  1 -1\nv -1 -1  1\nv  1 -1  1\nv  1  1  1\nv -1  1  1\n"
    "f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n"
)
GRID = struct.pack("<2i16f", 4, 4, *range(16))


def with_parts(*parts: str) -> str:
    """The arm's model with more in it."""
    return ARM_XML.replace("</mujoco>", "".join(parts) + "</mujoco>")


def mesh(file: str) -> str:
    return f'<asset><mesh name="box" file="{file}"/></asset>'


OUTSIDE = {  # what reads a file beside the folder or anywhere else
    "an include above": '<include file="../heavy.xml"/>',
    "an include of an absolute path": '<include file="{beside}/heavy.xml"/>',
    "an include by another way round": '<include file="meshes/../../heavy.xml"/>',
    "an include with a character reference": '<include file="&#46;&#46;/heavy.xml"/>',
    "an include behind an odd comment": '<!-- a -- b --><include file="../heavy.xml"/>',
    "an include behind a comment in CDATA": '<![CDATA[<!--]]><include file="../heavy.xml"/><![CDATA[-->]]>',
    "an include behind a comment in an attribute": (
        '<custom><text name="a" data="<!--"/></custom><include file="../heavy.xml"/>'
        '<custom><text name="b" data="-->"/></custom>'
    ),
    "a mesh": mesh("../box.obj"),
    "a mesh of an absolute path": mesh("{beside}/box.obj"),
    "a mesh's folder": '<compiler meshdir=".."/>' + mesh("box.obj"),
    "a mesh's absolute folder": '<compiler meshdir="{beside}"/>' + mesh("box.obj"),
    "a folder of all": '<compiler assetdir="{beside}"/>' + mesh("box.obj"),
    "a height field": '<asset><hfield name="h" file="../grid.bin" size="1 1 1 1"/></asset>',
    "a texture": '<asset><texture name="t" type="2d" file="../skin.png"/></asset>',
    "a side of a texture": '<asset><texture name="t" type="cube" fileup="../skin.png"/></asset>',
    "a skin": '<deformable><skin name="s" file="../skin.skn"/></deformable>',
    "a soft body": (
        '<worldbody><body name="b"><flexcomp name="f" type="mesh" file="../box.obj" dim="2"/></body></worldbody>'
    ),
    "a model to attach": '<asset><model name="m" file="../child.xml"/></asset>',
    "a package": mesh("package://robot/box.obj"),
    "an address": mesh("http://somewhere/box.obj"),
    "a file that is nowhere": mesh("box.obj"),
    "robot.toml, which it would not need": '<include file="robot.toml"/>',
}


@pytest.mark.parametrize("case", OUTSIDE)
def test_a_model_reads_nothing_outside_of_its_folder(
    case: str, write_robot: Callable[..., Path], tmp_path: Path
):
    for name, data in {"heavy.xml": HEAVY, "child.xml": "<mujoco/>", "box.obj": BOX}.items():
        (tmp_path / name).write_text(data)
    (tmp_path / "grid.bin").write_bytes(GRID)
    folder = write_robot(xml=with_parts(OUTSIDE[case].format(beside=tmp_path)))
    with pytest.raises(RobotError, match=r"model.xml, line \d+: <\w+> reads .* not in the robot's folder"):
        load_robot(folder)
    assert len(check_robot(folder)) == 1


def test_what_an_include_includes_is_looked_at_too(write_robot: Callable[..., Path], tmp_path: Path):
    (tmp_path / "heavy.xml").write_text(HEAVY)
    folder = write_robot(xml=with_parts('<include file="parts/a.xml"/>'))
    (folder / "parts").mkdir()
    (folder / "parts" / "a.xml").write_text(
        '<mujocoinclude><include file="../../heavy.xml"/></mujocoinclude>'
    )
    with pytest.raises(RobotError, match="parts/a.xml, line 1: <include> reads '../../heavy.xml'"):
        load_robot(folder)


def test_log_maps_and_hidden_files_are_not_read(write_robot: Callable[..., Path]):
    """A robot's hash leaves them out."""
    for place in ("maps", ".cache", "__old"):
        folder = write_robot(xml=with_parts(f'<include file="{place}/heavy.xml"/>'))
        (folder / place).mkdir()
        (folder / place / "heavy.xml").write_text(HEAVY)
        with pytest.raises(
            RobotError, match=f"reads '{place}/heavy.xml', which is not in the robot's folder"
        ):
            load_robot(folder)


@pytest.mark.parametrize("model", ["../model.xml", "{beside}/model.xml", "maps/model.xml", "robot.toml", "."])
def test_the_model_itself_is_in_the_folder(model: str, write_robot: Callable[..., Path], tmp_path: Path):
    (tmp_path / "model.xml").write_text(ARM_XML)
    model = model.format(beside=tmp_path)
    folder = write_robot(('name = "arm"', f'name = "arm"\nmodel = "{model}"'))
    (folder / "maps").mkdir()
    (folder / "maps" / "model.xml").write_text(ARM_XML)
    with pytest.raises(RobotError, match=r"does not exist in the robot's folder.*`model`"):
        load_robot(folder)


@pytest.fixture
def whole(write_robot: Callable[..., Path]) -> Path:
    """A robot in several folders: included, attached and in meshes, by ways that go up and down."""
    xml = with_parts(
        '<!-- ------ parts ------ --><include file="parts/option.xml"/>',
        '<compiler meshdir="../meshes/" texturedir="../meshes"/>',
        '<asset><mesh name="box" file="./box.obj" scale=".01 .01 .01"/>',
        '<hfield name="h" file="grid.bin" size="1 1 1 1"/><model name="hand" file="../hand/hand.xml"/></asset>',
        '<worldbody><body name="tip" pos="0 0 5"><geom type="mesh" mesh="box" mass="1"/></body>',
        '<frame><attach model="hand" body="palm" prefix="hand_"/></frame></worldbody>',
    )
    folder = write_robot(('name = "arm"', 'name = "arm"\nmodel = "mjcf/arm.xml"'), xml=xml)
    for place in ("mjcf/parts", "meshes", "hand/meshes"):
        (folder / place).mkdir(parents=True)
    (folder / "model.xml").rename(folder / "mjcf" / "arm.xml")
    (folder / "mjcf" / "parts" / "option.xml").write_text(HEAVY)
    (folder / "meshes" / "box.obj").write_text(BOX)
    (folder / "meshes" / "grid.bin").write_bytes(GRID)
    (folder / "hand" / "meshes" / "box.obj").write_text(BOX.replace("1", "2"))
    (folder / "hand" / "hand.xml").write_text(
        '<mujoco><compiler meshdir="meshes"/><asset><mesh name="palm" file="box.obj"/></asset>'
        '<worldbody><body name="palm"><geom type="mesh" mesh="palm" mass="1"/></body></worldbody></mujoco>'
    )
    return folder


def test_a_model_may_read_all_that_is_in_its_folder(whole: Path):
    import mujoco

    model = load_robot(whole).model
    assert model.opt.gravity[2] == -3.0 and (model.nmesh, model.nhfield) == (2, 1)
    from_disk = mujoco.MjModel.from_xml_path(str(whole / "mjcf" / "arm.xml"))
    np.testing.assert_array_equal(model.mesh_vert, from_disk.mesh_vert)
    np.testing.assert_array_equal(model.hfield_data, from_disk.hfield_data)
    np.testing.assert_array_equal(model.body_inertia, from_disk.body_inertia)


def test_the_registrys_copy_compiles_where_there_is_nothing_else(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    import mujoco

    robot = load_robot(whole)
    before = robot.model.body_inertia
    with Registry.open(tmp_path / "registry", create=True) as registry:
        registry.put_robot(robot.files, robot.hash, robot.name)
        alone = tmp_path / "alone"
        shutil.move(registry.robot_folder(robot.hash), alone)
    shutil.rmtree(whole)
    monkeypatch.chdir(alone)
    copy = load_robot(alone)
    assert copy.hash == robot.hash
    np.testing.assert_array_equal(copy.model.body_inertia, before)
    from_disk = mujoco.MjModel.from_xml_path(
        "mjcf/arm.xml"
    )  # plain MuJoCo needs no more than the copy either
    np.testing.assert_array_equal(from_disk.body_inertia, before)


def test_what_changes_on_the_disk_after_loading_changes_nothing(whole: Path):
    robot = load_robot(whole)
    (whole / "mjcf" / "parts" / "option.xml").write_text(HEAVY.replace("-3", "-1"))
    assert robot.model.opt.gravity[2] == -3.0 and load_robot(whole).hash != robot.hash


BOMBS = {  # a part of a model, a limit that is set lower, what is said of it
    "copies": (
        '<worldbody><replicate count="100"><body><freejoint/><geom size="1" mass="1"/></body></replicate></worldbody>',
        {"BODIES": "50"},
        "model.xml: too many bodies: 103; expected at most 50 (bodies)",
        "BODIES",
    ),
    "a texture": (
        '<asset><texture name="t" type="2d" builtin="flat" width="3000" height="3000"/></asset>',
        {"MODEL_BYTES": "20000000"},
        "model.xml: too many bytes when compiled: 4",
        "MODEL_BYTES",
    ),
    "a height field": (
        '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>',
        {},
        "needs too much memory",
        "ROBOT_MEMORY",
    ),
    "memory asked for": ('<size memory="900G"/>', {}, "needs too much memory", "ROBOT_MEMORY"),
    "a soft body": (
        '<worldbody><body name="b"><flexcomp name="f" type="grid" count="900 900 90" spacing="1 1 1" dim="3"/>'
        "</body></worldbody>",
        {"COMPILE_SECONDS": "1"},
        "takes too long, in seconds: more; expected at most 1 (compile seconds)",
        "COMPILE_SECONDS",
    ),
}


@pytest.mark.parametrize("case", BOMBS)
def test_a_model_that_asks_for_too_much_is_refused_with_its_setting(
    case: str, write_robot: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
):
    part, lower, said, setting = BOMBS[case]
    for name, value in lower.items():
        monkeypatch.setenv(f"DYNREG_MAX_{name}", value)
    robot = load_robot(write_robot(xml=with_parts(part)))
    with pytest.raises(RobotError) as caught:
        robot.model  # noqa: B018
    assert said in str(caught.value) and f"set DYNREG_MAX_{setting} higher" in str(caught.value)


def test_a_model_on_which_mujoco_ends_is_one_line(write_robot: Callable[..., Path]):
    itself = (
        '<asset><model name="m" file="model.xml"/></asset>'
        '<worldbody><frame><attach model="m" body="upper" prefix="p"/></frame></worldbody>'
    )
    (line,) = check_robot(write_robot(xml=with_parts(itself)))
    assert line.startswith("robot.toml, line 2: MuJoCo ends on the robot's model (SIG")


@pytest.mark.parametrize(
    "xml",
    [
        "",
        "no XML",
        "<mujoco",
        "<mujoco>\0</mujoco>",
        "<mujoco><option a=1/></mujoco>",
        '<!DOCTYPE m [<!ENTITY a "1"><!ENTITY b "&a;&a;">]><mujoco/>',
        "<mujoco>" + "<body>" * 100_000,
        "<mujoco>" + "<body>" * 100_000 + "</body>" * 100_000 + "</mujoco>",
        '<mujoco><include file="model.xml"/></mujoco>',
        ARM_XML.replace("shoulder", "sho\udcfflder"),
        with_parts('<extension><plugin plugin="of.nobody"/></extension>'),
        with_parts('<size memory="1"/>'),
    ],
    ids=lambda xml: xml[:30],
)
def test_xml_that_is_no_model_is_one_line(xml: str, write_robot: Callable[..., Path]):
    folder = write_robot()
    (folder / "model.xml").write_bytes(xml.encode(errors="surrogateescape"))
    (line,) = check_robot(folder)
    assert "model.xml" in line and "\n" not in line and len(line) < 500


def test_a_model_of_very_many_folders_is_refused(write_robot: Callable[..., Path]):
    many = "".join(f'<compiler meshdir="{number}"/>' for number in range(200))
    with pytest.raises(RobotError, match="files lie in 201 folders"):
        load_robot(write_robot(xml=with_parts(many)))


def test_a_long_model_is_refused_by_its_length(
    write_robot: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("DYNREG_MAX_XML_BYTES", "5000")
    with pytest.raises(RobotError, match=r"model.xml: too long.*xml bytes.*DYNREG_MAX_XML_BYTES"):
        load_robot(write_robot(xml=with_parts("<!--", "x" * 5000, "-->")))


def test_models_that_come_along_and_those_tried_before_need_no_other_process(
    write_robot: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = write_robot(xml=with_parts("<!-- once -->"))
    load_robot(folder).model  # noqa: B018
    shutil.copytree(packaged_robots()["leg"], tmp_path / "leg")
    monkeypatch.setattr("subprocess.run", lambda *_, **__: pytest.fail("a process was begun"))
    load_robot(folder).model  # noqa: B018
    load_robot(tmp_path / "leg").model  # noqa: B018
    assert os.listdir(tmp_path / "leg")
