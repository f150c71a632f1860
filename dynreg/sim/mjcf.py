"""A robot's MJCF or URDF model, compiled from the files of its folder and no others."""

import posixpath
import re
import reprlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from dynreg.errors import RobotError
from dynreg.folder import TOML, Folder, read_folder
from dynreg.limits import limits, refuse
from dynreg.sim.child import in_child

# MuJoCo looks for a file among those that it is given, by its path or else its name alone, and then on the disk. The
# folder's are given under a path that no disk has, and a model that names others is refused before.
ROOT = "/robot-folder"
MANY = 100  # folders that a model may name: each file that it names is looked for in all of them

# What tinyxml2, by which MuJoCo reads XML, takes for a comment, text in CDATA, a declaration, a tag or text, one after
# the other. Expat is stricter (`--` in comments, `&` in values); models that MuJoCo reads would be refused.
_PART = re.compile(
    rb"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|"
    rb"<(?P<tag>/?[\w:.\x80-\xff-]++)(?P<said>(?:\s*+[\w:.\x80-\xff-]++\s*+=\s*+(?:\"[^\"]*+\"|'[^']*+'))*+)\s*+/?>|"
    rb"[^<\0]++",
    re.DOTALL,
)
_SAID = re.compile(rb"([\w:.\x80-\xff-]++)\s*+=\s*+(?:\"([^\"]*+)\"|'([^']*+)')")
_FOLDERS = ("meshdir", "texturedir", "assetdir")
_XML = ("include", "model")  # tags that name further XML
_URDF = ("mesh", "texture")  # tags of URDF that name files; those of other programs are passed over


_COMPILED: set[tuple[str, str]] = set()  # (hash of the files, model) of those that did so before


@dataclass(frozen=True)
class _Named:
    """A file that an XML file names, by which tag, and where that stands."""

    name: str
    tag: str
    at: int


@dataclass(frozen=True)
class _Xml:
    """What an XML file of a robot's folder names.

    folders : where it says that meshes and textures lie, as paths below the robot's folder.
    strips : whether folders in names may be passed over. URDF names files of ROS packages.
    """

    path: str
    named: tuple[_Named, ...]
    folders: frozenset[str]
    strips: bool


def check_closed(files: Mapping[str, bytes], model: str) -> None:
    """Raise RobotError, with the line, where a model or what it includes names a file that `files` does not hold."""
    read = {model: _xml(model, files[model])}
    waiting = [model]
    while waiting:
        xml = read[waiting.pop()]
        for one in xml.named:
            if one.tag in _XML:
                found = _found(files, one, (read[model], xml))
                if found is None:
                    raise _outside(files, xml, one)
                if found not in read:
                    read[found] = _xml(found, files[found])
                    waiting.append(found)
    for xml in read.values():
        for one in xml.named:
            if _found(files, one, read.values()) is None:
                raise _outside(files, xml, one)


def model_files(folder: Folder) -> Folder:
    """The files that a robot's model may name: those that its hash covers, but robot.toml."""
    return Folder({name: data for name, data in folder.hashed.items() if name != TOML})


def try_model(files: Folder, model: str, packaged: Iterable[Path]) -> None:
    """Compile a foreign model in a process of its own, once for the same files; those of packaged robots need none.

    Raises RobotError where MuJoCo refuses the model or ends on it, and where it asks for more than the limits allow.
    """
    if (files.hash, model) in _COMPILED:
        return
    if files.hash not in (model_files(read_folder(folder, links=True)).hash for folder in packaged):
        in_child(measure, files.files, model, limit="compile_seconds")
    trust_model(files, model)


def trust_model(files: Folder, model: str) -> None:
    """Let a model compile in this process."""
    _COMPILED.add((files.hash, model))


def compile_model(files: Mapping[str, bytes], model: str):
    """The mujoco.MjModel of a closed folder; RobotError where MuJoCo refuses it."""
    import mujoco

    try:
        with mujoco.MjVfs() as given:
            for name, data in files.items():
                given[f"{ROOT}/{name}"] = data
            return mujoco.MjModel.from_xml_path(f"{ROOT}/{model}", vfs=given)
    except (ValueError, RuntimeError, mujoco.FatalError) as problem:
        raise _refused(model, str(problem)) from None


def _refused(model: str, told: str) -> RobotError:
    if "unknown exception" in told or "allocate memory" in told:  # of C++, which had none
        raise MemoryError
    return RobotError(f"{model}: {told.replace(f'{ROOT}/', '')}", expected="a valid MJCF model", do="mend it")


def measure(files: Mapping[str, bytes], model: str) -> None:
    """Compile a model and look at its first pose; RobotError for more bodies or bytes than the limits allow."""
    import mujoco

    made = compile_model(files, model)
    if made.nbody > limits().bodies:
        refuse(RobotError, f"{model}: too many bodies", made.nbody, "bodies")
    try:
        data = mujoco.MjData(made)
        size = mujoco.mj_sizeModel(made) + made.narena + data.nbuffer
        if size > limits().model_bytes:
            refuse(RobotError, f"{model}: too many bytes when compiled", size, "model_bytes")
        mujoco.mj_forward(made, data)
    except mujoco.FatalError as problem:
        raise _refused(model, str(problem)) from None


def _found(files: Mapping[str, bytes], one: _Named, beside: Collection[_Xml]) -> str | None:
    """The file that is named, seen from XML files and the folders that these name."""
    folders = {posixpath.dirname(xml.path) for xml in beside}.union(*(xml.folders for xml in beside))
    names = (one.name, posixpath.basename(one.name)) if any(xml.strips for xml in beside) else (one.name,)
    paths = (posixpath.normpath(posixpath.join(folder, name)) for name in names for folder in sorted(folders))
    return next((path for path in paths if path in files), None)


def _outside(files: Mapping[str, bytes], xml: _Xml, one: _Named) -> RobotError:
    return RobotError(
        f"{_place(xml.path, files[xml.path], one.at)}: <{one.tag}> reads {reprlib.repr(one.name)}, "
        "which is not in the robot's folder",
        expected="a file of the folder, which its hash covers",
        do="copy it there, and name it by its path from the model",
    )


def _xml(path: str, data: bytes) -> _Xml:
    if len(data) > limits().xml_bytes:
        refuse(RobotError, f"{path}: too long for a model, in bytes", len(data), "xml_bytes")
    named: list[_Named] = []
    folders: set[str] = set()
    strips = False
    for tag, at, said in _tags(path, data):
        strips |= tag == "robot" or ("strippath", "true") in said
        for key, value in said:
            if key in _FOLDERS:
                folders.add(posixpath.join(posixpath.dirname(path), value))
            elif key.startswith("file") and value and (key != "filename" or tag in _URDF):
                named.append(_Named(value, tag, at))
    if len(folders) > MANY:
        raise RobotError(
            f"{path} names {len(folders)} folders",
            expected=f"at most {MANY}",
            do="put the files into fewer folders",
        )
    return _Xml(path, tuple(named), frozenset(folders), strips)


def _tags(path: str, data: bytes) -> Iterator[tuple[str, int, list[tuple[str, str]]]]:
    """(name, where it stands, attributes) of each tag with attributes. Entities such as &amp; stay as written."""
    at = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    while at < len(data):
        part = _PART.match(data, at)
        if part is None:
            raise RobotError(
                f"{_place(path, data, at)}: no XML at {reprlib.repr(data[at : at + 20].decode(errors='replace'))}",
                expected="a model in XML without a document type",
                do="mend that line",
            )
        if part["said"]:
            try:
                said = [(_text(key), _text(one or other)) for key, one, other in _SAID.findall(part["said"])]
                yield _text(part["tag"]), at, said
            except UnicodeDecodeError:
                raise RobotError(
                    f"{_place(path, data, at)}: an attribute is no text in UTF-8",
                    expected="names in UTF-8",
                    do="save the file as UTF-8",
                ) from None
        at = part.end()


def _text(data: bytes) -> str:
    return data.decode().replace("\\", "/")


def _place(path: str, data: bytes, at: int) -> str:
    line = 1 + data.count(b"\n", 0, at)
    return f"{path}, line {line}"
