"""A stranger's model as one plain MJCF: includes flattened, files beside it, names for what has none."""

import posixpath
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import count
from typing import Any

import mujoco

from dynreg.draft.entry import DraftOptions, Notes
from dynreg.draft.held import placed
from dynreg.draft.source import Source
from dynreg.draft.urdf import is_urdf
from dynreg.errors import RobotError, UsageError
from dynreg.sim.mjcf import ROOT

BASE, KEY = "base", "key"  # the names of a free joint and of a keyframe that have none
# Words in the names of sites where makers of arms mark what carries a tool: those of MuJoCo Menagerie and robosuite.
TOOLS = frozenset("flange tool tcp ee eef effector attachment gripper grasp pinch grip hand".split())
TIP = "tip"  # an arm has one, legs and fingers have several
# words that name something else, even on a hand
OTHERS = frozenset("foot toe leg finger thumb imu camera".split())
_ODD = re.compile(r"[,\[\]*?/\s]+")  # letters that `sets` entries and channel names cannot hold
_NAMED_BY = {  # attributes that hold the name of a joint, a body or a geom
    "joint": ("joint", "joint1", "joint2", "jointinparent"),
    "body": ("body", "body1", "body2", "target"),
    "geom": ("geom", "geom1", "geom2"),
}


@dataclass(frozen=True, eq=False)
class Opened:
    """A model in memory: `spec` as MuJoCo's, `assets` the files that it names, by their path beside it."""

    spec: mujoco.MjSpec
    assets: dict[str, bytes]

    def compiled(self) -> mujoco.MjModel:
        """The compiled model; RobotError where MuJoCo refuses it."""
        return compiled(self.spec)

    def xml(self) -> str:
        """The whole as MJCF."""
        return self.spec.to_xml()


def open_model(source: Source, options: DraftOptions, notes: Notes) -> Opened:
    """The model of a source, an MJCF or a URDF.

    Raises RobotError where MuJoCo does not read or compile it; UsageError for an MJCF with an option for its base.
    """
    spec = _spec(source)
    assets = _gather(spec, source)
    spec.assets = dict(assets)
    model, urdf = compiled(spec), is_urdf(source.files[source.model].decode("utf-8", errors="replace"))
    if urdf:
        _mark_tools(spec, model)
    if options.free_base is not None:
        _set_base(spec, source.name, options.free_base, urdf)
    if not options.visuals:
        _discard_visual(spec, source.name, notes)
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    _name_keys(spec, notes)
    assets = {path: assets[path] for path in _named(spec)}
    spec.assets = dict(assets)
    return Opened(_read(_with_names(spec.to_xml()), assets, source.name), assets)


def _discard_visual(spec: mujoco.MjSpec, name: str, notes: Notes) -> None:
    """Leave out what touches nothing. No mass changes: MuJoCo writes down inertias that it read off such geoms.

    Raises RobotError where the model forbids that, as inertiafromgeom "true" does.
    """
    try:
        dropped = spec.discard_visual()
    except ValueError as error:
        raise RobotError(
            f"the visual parts of {name!r} cannot be left out: {error}",
            expected='a model without inertiafromgeom="true", or one that keeps these parts',
            do="add --visuals",
        ) from None
    if dropped:
        parts, them = ("1 visual part is", "it") if dropped == 1 else (f"{dropped} visual parts are", "them")
        notes.add(f"{parts} left out. All masses and inertias stay as they were; --visuals keeps {them}")


def tools_among(names: Iterable[str]) -> list[str]:
    """Those of a model's names by which makers of arms mark what carries a tool.

    >>> tools_among(["tool0", "stool", "hand_camera", "arm-tip", "finger_tip"]), tools_among(["fl_tip", "fr_tip"])
    (['tool0', 'arm-tip'], [])
    """
    words = {name: {*re.split(r"[\W\d_]+", name.lower())} for name in names}
    words = {name: own for name, own in words.items() if not own & OTHERS}
    tips = [name for name, own in words.items() if TIP in own]
    return [name for name, own in words.items() if own & TOOLS or tips == [name]]


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The compiled model of a spec; RobotError where MuJoCo refuses it."""
    try:
        return spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as problem:
        raise _refused("the model", problem) from None


def _spec(source: Source) -> mujoco.MjSpec:
    try:
        with mujoco.MjVfs() as given:
            for name, data in source.files.items():
                given[f"{ROOT}/{name}"] = data
            return mujoco.MjSpec.from_file(f"{ROOT}/{source.model}", vfs=given)
    except (ValueError, RuntimeError, mujoco.FatalError) as problem:
        raise _refused(source.name, problem) from None


def _refused(name: str, problem: Exception) -> RobotError:
    told = " ".join(str(problem).replace(f"{ROOT}/", "").split())
    return RobotError(
        f"MuJoCo does not read {name}: {told}",
        expected="a model that MuJoCo compiles",
        do="mend it, or give the file of the whole scene",
    )


def _set_base(spec: mujoco.MjSpec, name: str, free: bool, urdf: bool) -> None:
    if not urdf:
        flag = "--free-base" if free else "--fixed-base"
        do = "write <freejoint/> into" if free else "leave <freejoint/> out of"
        raise UsageError(
            f"{flag} for {name}, an MJCF",
            expected="a URDF, which cannot say that its base moves freely",
            do=f"{do} the first body, or leave {flag} out",
        )
    if not free:
        return
    first = spec.worldbody.first_body()
    if first is None:
        raise RobotError(
            f"{name} has no body that could move freely", expected="a link", do="leave --free-base out"
        )
    first.add_freejoint(name=BASE)


def _mark_tools(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """A site on each frame of a URDF that carries a tool: an empty link at the end of a chain, named for it."""
    parents, ends = {*model.body_parentid[1:].tolist()}, []
    for i in range(1, model.nbody):
        empty = not (model.body_mass[i] or model.body_jntnum[i] or model.body_geomnum[i])
        if empty and i not in parents and model.body_weldid[i]:
            ends.append(model.body(i).name)
    for name in tools_among(ends):
        spec.body(name).add_site(name=name)


def _files_of(spec: mujoco.MjSpec) -> Iterator[tuple[Any, str, str]]:
    """(element, attribute, folder) of all that may name a file; of a texture also the list of six for a cube."""
    for element in (*spec.meshes, *spec.skins, *spec.hfields):
        yield element, "file", element.compiler.meshdir
    for texture in spec.textures:
        yield texture, "file", texture.compiler.texturedir
        yield texture, "cubefiles", texture.compiler.texturedir


def _named(spec: mujoco.MjSpec) -> list[str]:
    """The files that the model names."""
    found = [getattr(element, key) for element, key, _ in _files_of(spec)]
    return [name for told in found for name in ([told] if isinstance(told, str) else told) if name]


def _gather(spec: mujoco.MjSpec, source: Source) -> dict[str, bytes]:
    """The files that the model names, each renamed in the model to its path in the new folder."""
    assets: dict[str, bytes] = {}
    for element, key, folder in _files_of(spec):
        told = getattr(element, key)
        if isinstance(told, str):
            if told:
                setattr(element, key, _moved(assets, source, folder, told))
            continue
        for i, name in enumerate(told):
            if name:
                told[i] = _moved(assets, source, folder, name)
    spec.meshdir = spec.texturedir = ""
    spec.strippath = False
    return assets


def _moved(assets: dict[str, bytes], source: Source, folder: str, name: str) -> str:
    """The path in the new folder of a file that the model names by `name`, in the folder that it says."""
    home, name = posixpath.dirname(source.model), name.replace("\\", "/")
    plain = posixpath.basename(name)
    for place in ((home, folder, name), (home, name), (home, folder, plain), (home, plain)):
        path = posixpath.normpath(posixpath.join(*place))
        if path in source.files:
            return placed(assets, plain, source.files[path])
    for path, data in source.files.items():  # beside an include, in a folder of its own
        if posixpath.basename(path) == plain:
            return placed(assets, plain, data)
    raise RobotError(
        f"{source.name} names {name!r}, which is not there",
        expected=f"a file such as {posixpath.join(folder, name)!r}",
        do="put it there, or take it out of the model",
    )


def _with_names(text: str) -> str:
    """The MJCF with a name for each joint and body and each geom that touches, fit for channels and `sets`."""
    root = ET.fromstring(text)
    for kind, tags in (("body", ("body",)), ("joint", ("joint", "freejoint")), ("geom", ("geom",))):
        taken = {e.get("name") for e in _elements(root, tags) if e.get("name")}
        for parent, element in _with_parents(root, tags):
            old = element.get("name")
            if old and not _ODD.search(old):
                continue
            wanted = _ODD.sub("_", old).strip("_") if old else _wanted(kind, parent, element)
            new = next(n for n in _numbered(wanted or kind) if n not in taken)
            taken.add(new)
            element.set("name", new)
            if old:
                _rename(root, kind, old, new)
    return ET.tostring(root, encoding="unicode")


def _name_keys(spec: mujoco.MjSpec, notes: Notes) -> None:
    """Name the keyframes of a model in which none has a name: robot.toml names the one that episodes begin from."""
    if not spec.keys or any(key.name for key in spec.keys):
        return
    for key, name in zip(spec.keys, _numbered(KEY), strict=False):
        key.name = name
    several = len(spec.keys) > 1
    notes.add(
        f"no keyframe of the model has a name: {'the first' if several else 'it'} is called {KEY}, and episodes begin "
        "from it"
    )


def _wanted(kind: str, parent: ET.Element, element: ET.Element) -> str:
    if kind == "joint" and (element.tag == "freejoint" or element.get("type") == "free"):
        return BASE
    if kind == "geom" and parent.tag == "worldbody":
        return "ground" if element.get("type") == "plane" else "scene"
    return (parent.get("name") or "world") + {"joint": "", "geom": "_geom", "body": "_part"}[kind]


def _rename(root: ET.Element, kind: str, old: str, new: str) -> None:
    for element in root.iter():
        for key in _NAMED_BY[kind]:
            if element.get(key) == old:
                element.set(key, new)
        if element.get("objtype") == kind and element.get("objname") == old:
            element.set("objname", new)


def _elements(root: ET.Element, tags: tuple[str, ...]) -> Iterator[ET.Element]:
    return (element for _, element in _with_parents(root, tags))


def _with_parents(root: ET.Element, tags: tuple[str, ...]) -> list[tuple[ET.Element, ET.Element]]:
    """(parent, element) of all that stand in the tree of bodies, with these tags."""
    world = root.find("worldbody")
    return [] if world is None else [(p, e) for p in world.iter() for e in p if e.tag in tags]


def _numbered(name: str) -> Iterator[str]:
    yield name
    yield from (f"{name}_{number}" for number in count(2))


def free_name(wanted: str, elements: Iterable[Any]) -> str:
    """A name that none of the elements has: the one that is wanted, or that with a number behind it."""
    taken = {element.name for element in elements}
    return next(name for name in _numbered(wanted) if name not in taken)


def _read(text: str, assets: dict[str, bytes], name: str) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_string(text, assets=dict(assets))
    except (ValueError, RuntimeError, mujoco.FatalError) as problem:
        raise _refused(name, problem) from None
