"""What other systems have not, or write otherwise: modules, and newlines of files."""

import ast
import subprocess
import sys
from pathlib import Path

import dynreg
from dynreg.data.ingest import read_recording
from dynreg.data.maps import read_map
from dynreg.sim.robot import load_robot, packaged_robots

HIDDEN = """
import importlib, pkgutil, sys

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name in {"fcntl", "resource", "pwd", "grp", "termios"}:
            by = []
            frame = sys._getframe(1)
            while frame is not None and len(by) < 1:
                origin = frame.f_globals.get("__name__", "")
                if not origin.startswith("importlib") and "importlib" not in frame.f_code.co_filename:
                    by.append(origin)
                frame = frame.f_back
            if by and by[0].split(".")[0] == "dynreg":
                raise ImportError(f"{by[0]} imports {name}, which only one system has")
        return None

for name in ("fcntl", "resource", "pwd", "grp", "termios"):
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Hidden())
import dynreg
for found in pkgutil.walk_packages(dynreg.__path__, "dynreg."):
    if not found.name.endswith("__main__"):
        sys.modules.pop("fcntl", None), sys.modules.pop("resource", None)
        importlib.import_module(found.name)
print("all")
"""


def test_every_module_is_imported_where_those_of_one_system_are_hidden():
    """Of dynreg's own: what libraries import is theirs, and they know their systems."""
    ended = subprocess.run([sys.executable, "-c", HIDDEN], capture_output=True, text=True, check=False)
    assert ended.returncode == 0 and ended.stdout.strip() == "all", ended.stderr[-1000:]


ONE_SYSTEM = {"fcntl", "resource", "pwd", "grp", "termios", "msvcrt", "winreg"}


def unguarded(source: str) -> list[int]:
    """Lines that import a module of one system, in a function too, with no `except ImportError` about them."""
    tree = ast.parse(source)
    guarded = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.Try) and any("ImportError" in ast.unparse(h.type or h) for h in node.handlers)
        for one in node.body
        for inner in ast.walk(one)
    }
    found = []
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
        if {name.split(".")[0] for name in names} & ONE_SYSTEM and id(node) not in guarded:
            found.append(node.lineno)
    return found


def test_no_function_needs_a_module_of_one_system():
    assert unguarded("def lock():\n    import fcntl\n") == [2]
    assert unguarded("def lock():\n    from resource import setrlimit\n") == [2]
    assert not unguarded("try:\n    import resource\nexcept ImportError:\n    pass\n")
    root = Path(dynreg.__file__).parent
    found = {
        path.relative_to(root).as_posix(): lines
        for path in sorted(root.rglob("*.py"))
        if (lines := unguarded(path.read_text(encoding="utf-8")))
    }
    assert not found


def test_a_robot_folder_with_newlines_of_windows(tmp_path: Path):
    source = packaged_robots()["leg"]
    for name in ("robot.toml", "model.xml"):
        (tmp_path / name).write_bytes((source / name).read_bytes().replace(b"\n", b"\r\n"))
    robot, own = load_robot(tmp_path), load_robot("leg")
    assert robot.file == own.file and robot.model.nbody == own.model.nbody


MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def test_files_written_on_windows_are_read(tmp_path: Path):
    """Backslashes in the paths that robot.toml and the model name; newlines of two bytes in robot, map and log."""
    folder, source = tmp_path / "robot", packaged_robots()["servo_pendulum"]
    (folder / "sub" / "meshes").mkdir(parents=True)
    toml = (source / "robot.toml").read_text().replace('"model.xml"', r'"sub\\model.xml"')
    model = (source / "model.xml").read_text()
    model = model.replace(
        "<worldbody>", '<asset><mesh name="m" file="meshes\\a.obj"/></asset>\n<worldbody>', 1
    )
    told = '[map]\nrobot = "servo_pendulum"\n'
    told += "".join(
        f'[channels."arm/{n}"]\nsource = "{n[0]}"\nunit = "{u}"\n'
        for n, u in (("position", "rad"), ("velocity", "rad/s"), ("target", "rad"))
    )
    rows = "".join(f"{i / 100},{i / 100},1.0,{i / 99}\n" for i in range(100))
    (folder / "sub" / "meshes" / "a.obj").write_text(MESH, newline="\r\n")
    for path, text in {
        folder / "robot.toml": toml,
        folder / "sub" / "model.xml": model,
        tmp_path / "map.toml": told,
        tmp_path / "log.csv": "time,p,v,t\n" + rows,
    }.items():
        path.write_text(text, newline="\r\n")
    robot = load_robot(folder)
    assert robot.model.nmesh == 1
    recording = read_recording(tmp_path / "log.csv", robot.recording_spec, read_map(tmp_path / "map.toml"))
    assert len(recording.episodes[0].time) == 100


EVERYWHERE = {"O_RDONLY", "O_WRONLY", "O_RDWR", "O_CREAT", "O_EXCL"}


def test_files_are_opened_with_what_every_system_has():
    """`os.O_CLOEXEC` is not there on Windows: a flag of one system is asked for with `getattr`."""
    root = Path(dynreg.__file__).parent
    found = {
        (path.relative_to(root).as_posix(), node.attr)
        for path in sorted(root.rglob("*.py"))
        if "O_" in (text := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Attribute) and node.attr.startswith("O_") and node.attr not in EVERYWHERE
    }
    assert not found
