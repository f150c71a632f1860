"""A stranger's model file and what it names, read from one folder alone, before anything compiles it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from dynreg.draft.entry import Notes
from dynreg.draft.held import ABOVE, Held
from dynreg.draft.urdf import is_urdf, plain_urdf
from dynreg.errors import RobotError
from dynreg.limits import limits, refuse
from dynreg.sim.closed import check_closed


@dataclass(frozen=True)
class Source:
    """A model in memory: `files` by their paths below its root, `model` the path of its XML, `name` as messages say."""

    name: str
    model: str
    files: Mapping[str, bytes]


def read_source(path: Path, root: Path | None, notes: Notes) -> Source:
    """The MJCF or URDF at `path` and the files that it names, all of which lie below `root`.

    root : None for the folder of the model's ROS package (that of its package.xml), else the model's own folder.
    Raises RobotError where the model cannot be read, and where it names a file that lies elsewhere or, in an MJCF, is
    not there.
    """
    home = (root or _package_of(path) or path.absolute().parent).resolve()
    held = Held(home, path)
    text = _text(path)
    if is_urdf(text):
        plain, meshes = plain_urdf(text, held, notes)
        return Source(path.name, "model.urdf", {"model.urdf": plain.encode(), **meshes})
    if held.path_of(path) not in held:
        raise held.refused(path.name)
    try:
        named = check_closed(held, held.path_of(path))
    except RobotError:
        if held.outside:
            raise held.refused(held.outside[0]) from None
        raise
    return Source(path.name, named[0], {name: held[name] for name in named})


def _package_of(path: Path) -> Path | None:
    """The folder of the ROS package that a model lies in."""
    above = list(path.absolute().parents)[:ABOVE]
    return next((folder for folder in above if (folder / "package.xml").is_file()), None)


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            data = file.read(limits().xml_bytes + 1)
    except OSError as problem:
        raise RobotError(
            f"{str(path)!r} cannot be read: {problem.strerror}",
            expected="an MJCF or URDF file",
            do="check the path",
        ) from None
    if len(data) > limits().xml_bytes:
        refuse(RobotError, f"{path.name}: too long for a model, in bytes", "more", "xml_bytes")
    text = data.decode("utf-8", errors="replace")
    if not re.search(r"<(mujoco|robot)\b", text):
        raise RobotError(
            f"{path.name!r} is no robot model",
            expected="an MJCF file (<mujoco>) or a URDF file (<robot>)",
            do="give the model's XML file",
        )
    return text
