"""URDF: files of packages found beside it or left out, and what MuJoCo is to do with it."""

import re
import xml.etree.ElementTree as ET
from contextlib import suppress
from pathlib import PurePosixPath

from dynreg.draft.entry import Notes, listed
from dynreg.draft.held import ABOVE, Held, placed
from dynreg.errors import RobotError

_OPTENV = re.compile(r"\$\(optenv\s+(?P<name>\w+)(?P<default>[^()]*)\)")
_SIZES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "box": ("size",)}
_COMPILER = {
    "strippath": "false",
    "fusestatic": "false",
    "discardvisual": "false",
    "balanceinertia": "true",
}
_PACKAGE = re.compile(r"^(?:package|model)://(?P<package>[^/]+)/(?P<rest>.+)$")


def is_urdf(text: str) -> bool:
    """Whether the XML text is a URDF: its root is <robot>."""
    return re.search(r"<(mujoco|robot)\b", text)[1] == "robot"


def plain_urdf(text: str, held: Held, notes: Notes) -> tuple[str, dict[str, bytes]]:
    """The URDF for MuJoCo and its meshes: those that are missing left out, every link a body of its own.

    Raises RobotError where it is no XML, or names a mesh that lies outside its folder and its package.
    """
    text, unset = _OPTENV.subn(lambda found: found["default"].strip(), text)
    if unset:
        notes.add(
            f"{unset} values are the defaults of $(optenv ...): no environment variable was read for them"
        )
    try:
        root = ET.fromstring(text)
    except ET.ParseError as problem:
        raise RobotError(
            f"{held.model.name}: {problem}", expected="a URDF in XML", do="mend that line"
        ) from None
    assets = _with_meshes(root, held, notes)
    _without_flat(root, notes)
    _say_speeds(root, notes)
    for old in root.findall("mujoco"):
        root.remove(old)
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", _COMPILER)
    try:
        return ET.tostring(root, encoding="unicode"), assets
    except RecursionError:
        raise RobotError(
            f"{held.model.name}: elements in each other too deep",
            expected="a URDF",
            do="give the robot's own file",
        ) from None


def _with_meshes(root: ET.Element, held: Held, notes: Notes) -> dict[str, bytes]:
    """The meshes of a URDF, each renamed in it to its path in the new folder; shapes with a missing one are removed."""
    missing, assets = [], {}
    for link, part in _shapes(root):
        whole = True
        for mesh in part.iter("mesh"):
            name = mesh.get("filename", "").replace("\\", "/")
            data = _mesh(name, held)
            if data is None:
                missing.append(name)
                whole = False
            else:
                mesh.set("filename", placed(assets, PurePosixPath(name).name, data))
        if not whole:
            link.remove(part)
    if missing:
        names = listed(sorted(set(missing)), 3)
        notes.add(
            f"{len(missing)} meshes were not found and are left out ({names}); inertias are the URDF's own"
        )
    return assets


def _without_flat(root: ET.Element, notes: Notes) -> None:
    """Remove the shapes without a size."""
    flat = [(link, part) for link, part in _shapes(root) if _is_flat(part)]
    for link, part in flat:
        link.remove(part)
    if flat:
        links = sorted({link.get("name", "") for link, _ in flat})
        notes.add(f"{len(flat)} shapes of size 0 are left out (of {listed(links, 3)})")


def _say_speeds(root: ET.Element, notes: Notes) -> None:
    """A note about the speeds that a URDF allows its joints: MuJoCo reads none, and no drive's law has one."""
    said = []
    for joint in root.findall("joint"):
        limit, follows = joint.find("limit"), joint.find("mimic") is not None
        with suppress(ValueError):
            speed = 0.0 if limit is None or follows else float(limit.get("velocity", "0"))
            if speed > 0:
                unit = "m/s" if joint.get("type") == "prismatic" else "rad/s"
                said.append(f"{joint.get('name', '')}: {speed:g} {unit}")
    if said:
        notes.add(
            f"the URDF allows speeds ({listed(said, most=12)}), to which no command of dynreg keeps: compare the rates "
            "that `excite` tells with them before the robot moves"
        )


def _shapes(root: ET.Element) -> list[tuple[ET.Element, ET.Element]]:
    """(link, its visual or collision), of every link."""
    return [
        (link, part)
        for link in root.findall("link")
        for kind in ("visual", "collision")
        for part in link.findall(kind)
    ]


def _is_flat(part: ET.Element) -> bool:
    """Whether the shape of a link has no size, which MuJoCo refuses."""
    sizes = [shape.get(key, "1") for shape in part.iter() for key in _SIZES.get(shape.tag, ())]
    with suppress(ValueError):
        return any(float(number) == 0 for size in sizes for number in size.split())
    return False


def _mesh(name: str, held: Held) -> bytes | None:
    """The mesh that a URDF names; None where there is none that MuJoCo reads.

    package://NAME/REST is looked for in the folder NAME beside or above the URDF, and as REST above it, in folders of
    the URDF's own package. Raises RobotError for a file that lies elsewhere.
    """
    if PurePosixPath(name).suffix.lower() not in (".stl", ".obj", ".msh"):
        return None
    package, home = _PACKAGE.match(name), held.model.absolute().parent.resolve()
    if package is None:
        path = held.path_of(home / name.removeprefix("file://"))
        if path in held:
            return held[path]
        if held.outside:
            raise held.refused(name)
        return None
    above = [home, *list(home.parents)[:ABOVE]]
    packages = [Held(folder / package["package"], held.model) for folder in above]
    for root in (*packages, *(Held(f, held.model) for f in above if f.resolve().is_relative_to(held.root))):
        if package["rest"] in root:
            return root[package["rest"]]
    return None
