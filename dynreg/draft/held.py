"""The files that a stranger's model may name: those of one folder, read when they are asked for."""

from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

from dynreg.errors import RobotError
from dynreg.limits import limits, refuse

ABOVE = 4  # folders above a model in which its ROS package, and others that it names, are looked for
ASSETS = "assets"  # the folder of a drafted robot that holds meshes, textures and the like


class Held(Mapping[str, bytes]):
    """The files below a folder by their paths in it, each read when it is asked for.

    What lies elsewhere, be it by `..`, by an absolute path or by a link, is not among them; `outside` tells what was
    asked for.
    """

    def __init__(self, root: Path, model: Path):
        self.root, self.model = root, model
        self.outside: list[str] = []
        self._read: dict[str, bytes] = {}

    def path_of(self, place: Path) -> str:
        """The path below the root of a file that may lie there."""
        place = place.absolute()
        return (
            place.relative_to(self.root).as_posix()
            if place.is_relative_to(self.root)
            else str(place.resolve())
        )

    def __contains__(self, path: object) -> bool:
        try:
            place = (self.root / str(path)).resolve()
            if not place.is_file():
                return False
        except (OSError, ValueError, RuntimeError):  # names that no system has, links in a circle
            return False
        if not place.is_relative_to(self.root):
            self.outside.append(str(path))
            return False
        return True

    def __getitem__(self, path: str) -> bytes:
        if path not in self._read:
            if path not in self:
                raise KeyError(path)
            left = limits().robot_bytes - sum(map(len, self._read.values()))
            with (self.root / path).resolve().open("rb") as file:
                data = file.read(left + 1)
            if len(data) > left:
                refuse(RobotError, f"{self.model.name} names too many bytes", f"with {path!r}", "robot_bytes")
            self._read[path] = data
        return self._read[path]

    def __iter__(self) -> Iterator[str]:
        return iter(self._read)

    def __len__(self) -> int:
        return len(self._read)

    def refused(self, name: str) -> RobotError:
        """The error of a model that names what lies elsewhere."""
        return RobotError(
            f"{self.model.name} names {name!r}, which lies outside the folder {str(self.root)!r}",
            expected="a model that names files of its own folder, or of its ROS package, alone",
            do="give the folder that holds them all with --root, if you trust the model",
        )


def placed(assets: dict[str, bytes], name: str, data: bytes) -> str:
    """The path in a new folder of a file with these bytes; files alike are kept once."""
    stem, suffix = PurePosixPath(name).stem.lstrip("._") or "file", PurePosixPath(name).suffix
    for place in (
        f"{ASSETS}/{stem}{suffix}",
        *(f"{ASSETS}/{stem}_{n}{suffix}" for n in range(2, len(assets) + 3)),
    ):
        if assets.setdefault(place, data) == data:
            return place
    raise AssertionError
