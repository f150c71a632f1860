"""A robot's folder is plain files, read once: what is hashed is what the registry keeps."""

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from dynreg.errors import RegistryError, RobotError
from dynreg.folder import Folder, read_folder
from dynreg.registry import Registry
from dynreg.sim.robot import load_robot, packaged_robots


def _link(folder: Path, beside: Path) -> None:
    (beside / "secret").write_text("of the system")
    (folder / "notes.txt").symlink_to(beside / "secret")


def _folder_link(folder: Path, beside: Path) -> None:
    (beside / "elsewhere").mkdir()
    (folder / "meshes").symlink_to(beside / "elsewhere")


def _deep_link(folder: Path, beside: Path) -> None:
    (folder / "a" / "b").mkdir(parents=True)
    (folder / "a" / "b" / "loop").symlink_to(folder)


def _pipe(folder: Path, beside: Path) -> None:
    os.mkfifo(folder / "pipe")


def _socket(folder: Path, beside: Path) -> None:
    here = os.getcwd()
    os.chdir(folder)  # the names of sockets are short
    with socket.socket(socket.AF_UNIX) as one:
        one.bind("socket")
    os.chdir(here)


def _odd_name(folder: Path, beside: Path) -> None:
    with open(os.fsencode(folder) + b"/\xff.txt", "wb"):
        pass


NO_FILES = {
    "a link": (_link, "notes.txt' is a link; expected a robot folder of plain files"),
    "a link to a folder": (_folder_link, "meshes' is a link"),
    "a link that leads round": (_deep_link, "loop' is a link"),
    "a link to nothing": (lambda folder, _: (folder / "x").symlink_to("nothing"), "x' is a link"),
    "a pipe": (_pipe, "pipe' is no file"),
    "a socket": (_socket, "socket' cannot be read"),
    "a name that is no text": (_odd_name, "has a name that is no text"),
}


@pytest.mark.parametrize("case", NO_FILES)
def test_what_is_no_file_is_refused(case: str, write_robot: Callable[..., Path], tmp_path: Path):
    put, said = NO_FILES[case]
    folder = write_robot()
    put(folder, tmp_path)
    with pytest.raises(RobotError) as caught:
        load_robot(folder)
    assert said in str(caught.value)
    with Registry.open(tmp_path / "registry", create=True) as registry:
        with pytest.raises(RegistryError, match="cannot register"):
            registry.put_robot(folder, "ab" * 32, "arm")
    assert not list((tmp_path / "registry").rglob("notes.txt"))


def test_hidden_files_are_none_of_a_robots(write_robot: Callable[..., Path]):
    folder = write_robot()
    before = load_robot(folder)
    (folder / ".#model.xml").symlink_to("editor@host")  # an editor's lock
    (folder / ".git").mkdir()
    (folder / "__pycache__").mkdir()
    (folder / "__pycache__" / "x.pyc").write_text("x")
    assert load_robot(folder).hash == before.hash
    assert load_robot(folder).files.files == before.files.files


@pytest.mark.parametrize(("name", "limit"), [("robot_files", "3"), ("robot_bytes", "4000")])
def test_a_folder_past_a_limit_is_refused_with_its_setting(
    name: str, limit: str, write_robot: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
):
    folder = write_robot()
    for number in range(3):
        (folder / f"mesh{number}.stl").write_bytes(bytes(1000))
    monkeypatch.setenv(f"DYNREG_MAX_{name.upper()}", limit)
    with pytest.raises(
        RobotError, match=rf"expected at most {limit} \({name.replace('_', ' ')}\).*DYNREG_MAX"
    ):
        load_robot(folder)


def test_a_registry_keeps_the_files_that_were_hashed(write_robot: Callable[..., Path], tmp_path: Path):
    folder = write_robot()
    robot = load_robot(folder)
    (folder / "model.xml").write_text("changed since")
    (folder / "late.xml").write_text("came since")
    with Registry.open(tmp_path / "registry", create=True) as registry:
        registry.put_robot(robot.files, robot.hash, robot.name)
        kept = registry.robot_folder(robot.hash)
        assert load_robot(kept).hash == robot.hash
        assert not (kept / "late.xml").exists()


def test_the_order_of_names_that_a_hash_takes_is_that_of_their_parts():
    """As it was when folders were hashed path by path: a registered robot keeps its hash."""
    folder = Folder({"a.xml": b"1", "a/b.xml": b"2", "maps/x": b"3", "__a/b": b"4", ".git/x": b"5"})
    assert list(folder.hashed) == ["a/b.xml", "a.xml"]
    assert folder.hash == "917023775c6cb95738c5a1ea782a8e1b4d8dc719ee4a1d6d6d3f1de38c893908"


def test_packaged_robots_may_be_links(tmp_path: Path):
    """Some installers link the files of a package."""
    source = packaged_robots()["leg"]
    for file in source.iterdir():
        (tmp_path / file.name).symlink_to(file)
    assert read_folder(tmp_path, links=True).hash == read_folder(source).hash
