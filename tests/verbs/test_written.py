"""Files and folders that a user named: whole or not there, and what a killed run left goes with the next."""

import os
import re
import shutil
import subprocess
import sys
import threading
from inspect import getsource
from pathlib import Path

import pytest

import dynreg
from dynreg.errors import UsageError
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot
from dynreg.verbs.written import new_file_of, new_folder, write_new, write_out

HOME = Path(dynreg.__file__).parent
KILLED = """
import os, signal
from pathlib import Path
os.replace = os.rename = lambda *names: os.kill(os.getpid(), signal.SIGKILL)
from dynreg import session
from dynreg.verbs.written import new_folder, write_out
"""


def a_file() -> None:
    write_out(Path("out"), b"new")


def a_folder() -> None:
    with new_folder(Path("out")) as folder:
        folder.mkdir()
        (folder / "file").write_text("new")


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def killed(code: str, place: Path) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED + code], cwd=place, capture_output=True, timeout=120)
    assert done.returncode == -9, done.stderr


@pytest.mark.parametrize("write", [a_file, a_folder])
def test_what_a_kill_leaves_is_no_answer_and_goes_with_the_next_run(
    write, tmp_path: Path, monkeypatch
) -> None:
    if write is a_file:
        (tmp_path / "out").write_text("old")
    before = left(tmp_path)
    killed(f"{getsource(write)}\n{write.__name__}()", tmp_path)
    hidden = set(left(tmp_path)) - set(before)
    assert len(hidden) == 1 and hidden.pop().startswith(".out.tmp-")
    assert not before or (tmp_path / "out").read_text() == "old"
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".other.tmp-1").write_text("of another name")
    write()
    assert left(tmp_path) == [".other.tmp-1", "out"]


def test_a_simulator_that_is_killed_on_its_way_to_a_folder_leaves_none(
    registry_folder: Path, tmp_path: Path
) -> None:
    robot = load_robot("servo_pendulum")
    config = SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal)).as_dict()
    registry = shutil.copytree(registry_folder, tmp_path / "registry")
    with dynreg.open(registry) as opened:
        simulator = opened.registry.put_simulator(config)
    killed(f"session.open('registry', create=False).export_robot({simulator!r}, 'out')", tmp_path)
    assert not (tmp_path / "out").exists() and len(left(tmp_path)) == 2
    with dynreg.open(registry, create=False) as opened:
        opened.export_robot(simulator, tmp_path / "out")
    assert left(tmp_path) == ["out", "registry"] and (tmp_path / "out" / "robot.toml").is_file()


def test_a_failure_on_the_way_leaves_what_was_there(tmp_path: Path, monkeypatch) -> None:
    def fails(*names: object) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "out").write_text("old")
    monkeypatch.setattr("os.fsync", fails)
    with pytest.raises(UsageError, match="cannot write .*out': No space left on device"):
        write_out(tmp_path / "out", b"new")
    monkeypatch.undo()
    assert left(tmp_path) == ["out"] and (tmp_path / "out").read_text() == "old"
    with pytest.raises(ZeroDivisionError), new_folder(tmp_path / "folder") as folder:
        folder.mkdir()
        raise ZeroDivisionError
    assert left(tmp_path) == ["out"]


@pytest.mark.parametrize("name", ["taken", "link", "no/folder", "file/below", "x" * 300])
def test_a_name_that_cannot_be_new_is_one_line(name: str, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    before = left(tmp_path)
    why = "exists already; expected a name" if name in before else "cannot write .*; expected a"
    with pytest.raises(UsageError, match=why):
        write_new(tmp_path / name, b"new")
    with pytest.raises(UsageError, match=why), new_folder(tmp_path / name):
        pass
    assert left(tmp_path) == before


@pytest.mark.parametrize("made", [new_folder, new_file_of])
def test_a_folder_that_may_not_be_written_is_what_a_user_named_wrongly(
    made, tmp_path: Path, monkeypatch
) -> None:
    def refused(*names: object, **options: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.mkdir", refused)  # root may write everywhere
    with pytest.raises(UsageError, match="cannot write .*out': Permission denied; .*; name another one"):
        with made(tmp_path / "out"):
            pass
    assert left(tmp_path) == []


def test_a_link_is_followed_and_a_pipe_is_written_to(tmp_path: Path) -> None:
    (tmp_path / "there").write_text("old")
    (tmp_path / "link").symlink_to("there")
    write_out(tmp_path / "link", b"new")
    assert (tmp_path / "there").read_bytes() == b"new" and (tmp_path / "link").is_symlink()
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Thread(target=write_out, args=(tmp_path / "pipe", b"new"))
    writer.start()
    assert (tmp_path / "pipe").read_bytes() == b"new"
    writer.join()
    with pytest.raises(UsageError, match="Is a directory"):
        write_out(tmp_path, b"new")


def test_no_verb_and_no_command_writes_a_named_file_in_another_way() -> None:
    other = re.compile(r"\.write_(text|bytes)\(|\bopen\([^)]*[\"'][wxa]b?[\"']|\.to_(parquet|csv)\(|mkdtemp")
    for room in ("verbs", "cli", "report"):
        for path in sorted((HOME / room).rglob("*.py")):
            if path.name not in ("written.py", "schemas.py"):  # the second writes files of the checkout
                assert not other.search(path.read_text(encoding="utf-8")), path
