"""What a robot's MJCF or URDF model reads: XML files and what they name, all of its own folder."""

import posixpath
import re
import reprlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import product

from dynreg.errors import RobotError
from dynreg.limits import limits, refuse

MANY = 64  # folders of a model and its includes: each file that they name is looked for in all of them
SOME = 3  # of the places at which a missing file was looked for

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


@dataclass(frozen=True)
class _Named:
    """A file that an XML file names, by which tag, and where that stands."""

    name: str
    tag: str
    at: int


@dataclass(frozen=True)
class _Xml:
    """What an XML file of a robot's folder names.

    folders : where its files may lie, as paths below the robot's: beside it, and where it says that meshes lie.
    strips : whether folders in names may be passed over. URDF names files of ROS packages.
    """

    path: str
    named: tuple[_Named, ...]
    folders: frozenset[str]
    strips: bool


@dataclass(frozen=True)
class _Places:
    """Where the files that XML files name are looked for."""

    folders: tuple[str, ...]
    strips: bool

    @classmethod
    def of(cls, read: Collection[_Xml]) -> "_Places":
        folders = sorted(frozenset[str]().union(*(xml.folders for xml in read)))
        if len(folders) > MANY:
            raise RobotError(
                f"a model whose files lie in {len(folders)} folders, {folders[0]!r} to {folders[-1]!r}",
                expected=f"at most {MANY}",
                do="put the files into fewer folders",
            )
        return cls(tuple(folders), any(xml.strips for xml in read))

    def find(self, files: Mapping[str, bytes], xml: _Xml, one: _Named) -> list[str]:
        """The paths at which the file that an XML file names may lie; RobotError where the robot's folder has none."""
        names = (one.name, posixpath.basename(one.name)) if self.strips else (one.name,)
        paths = dict.fromkeys(
            posixpath.normpath(posixpath.join(folder, name)) for folder, name in product(self.folders, names)
        )
        if found := [path for path in paths if path in files]:
            return found
        looked = " or ".join(reprlib.repr(path) for path in [*paths][::-1][:SOME]) if len(paths) > 1 else ""
        raise RobotError(
            f"{_line(xml.path, files[xml.path], one.at)}: <{one.tag}> reads {reprlib.repr(one.name)}, "
            "which is not in the robot's folder",
            expected=f"a file of the folder{f', as {looked}' if looked else ''}, which its hash covers",
            do="copy it there, and name it by its path from the model",
        )


def check_closed(files: Mapping[str, bytes], model: str) -> list[str]:
    """The paths of all files that a model and what it includes name, the model first.

    Raises RobotError, with the line, where they name a file that `files` does not hold.
    """
    read: dict[str, _Xml] = {}
    waiting, seen = [model], {model}
    left = limits().xml_bytes
    while waiting:
        path = waiting.pop()
        left -= len(files[path])
        if left < 0:
            refuse(RobotError, f"{path}: too long for a model, in bytes", len(files[path]), "xml_bytes")
        xml = read[path] = _xml(path, files[path])
        places = _Places.of((read[model], xml))
        further = dict.fromkeys(
            p for one in xml.named if one.tag in _XML for p in places.find(files, xml, one)
        )
        waiting += [path for path in further if path not in seen]
        seen.update(further)
    places = _Places.of(read.values())
    named = (path for xml in read.values() for one in xml.named for path in places.find(files, xml, one))
    return list(dict.fromkeys((*read, *named)))


def _xml(path: str, data: bytes) -> _Xml:
    named: list[_Named] = []
    home = posixpath.dirname(path)
    folders = {home}
    strips = False
    for tag, at, said in _tags(path, data):
        strips |= tag == "robot" or ("strippath", "true") in said
        for key, value in said:
            if key in _FOLDERS:
                folders.add(posixpath.join(home, value))
            elif key.startswith("file") and value and (key != "filename" or tag in _URDF):
                named.append(_Named(value, tag, at))
    if len(named) > limits().robot_files:
        refuse(RobotError, f"{path} names too many files", len(named), "robot_files")
    return _Xml(path, tuple(named), frozenset(folders), strips)


def _tags(path: str, data: bytes) -> Iterator[tuple[str, int, list[tuple[str, str]]]]:
    """(name, where it stands, attributes) of each tag with attributes. Entities such as &amp; stay as written."""
    at = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    while at < len(data):
        part = _PART.match(data, at)
        if part is None:
            raise RobotError(
                f"{_line(path, data, at)}: no XML at {reprlib.repr(data[at : at + 20].decode(errors='replace'))}",
                expected="a model in XML without a document type",
                do="mend that line",
            )
        if part["said"]:
            try:
                said = [(_text(key), _text(one or other)) for key, one, other in _SAID.findall(part["said"])]
                yield _text(part["tag"]), at, said
            except UnicodeDecodeError:
                raise RobotError(
                    f"{_line(path, data, at)}: an attribute is no text in UTF-8",
                    expected="names in UTF-8",
                    do="save the file as UTF-8",
                ) from None
        at = part.end()


def _text(data: bytes) -> str:
    return data.decode().replace("\\", "/")


def _line(path: str, data: bytes, at: int) -> str:
    line = 1 + data.count(b"\n", 0, at)
    return f"{path}, line {line}"
