"""Parts that a machine may lack: each verb that would use one works without, or ends in a line that says what to do."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from dynreg.cli.main import main

# a part that is hidden is not found: no finder of modules tells of it
PROGRAM = """
import sys
hidden = {hidden!r}
class Without:
    def __init__(self, finder):
        self.finder = finder
    def __getattr__(self, name):
        return getattr(self.finder, name)
    def find_spec(self, name, *where):
        return None if name.partition(".")[0] in hidden else self.finder.find_spec(name, *where)
sys.meta_path[:] = map(Without, sys.meta_path)
from dynreg.cli.main import run
{first}
run()
"""
# without the packaged effects, which a query does not need, the kernel is compiled in less time
SMALL = "from dynreg.sim.engines import compiling; compiling._table = tuple"
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "MUJOCO_GL", "DYNREG_GL", "PYOPENGL_PLATFORM")
DRAWING = ("OpenGL", "glfw", "matplotlib", "IPython", "PIL")
QUERY = ("query", "bench", "-k", "2", "--budget", "8", "--hold-out", "kp=400", "--json")


@pytest.fixture
def place(tmp_path: Path, registry_folder: Path) -> Path:
    shutil.copytree(registry_folder, tmp_path / "dynreg-registry")
    shutil.copy(registry_folder.parent / "bench.csv", tmp_path)
    (tmp_path / "file").write_text("no folder")
    return tmp_path


def ran(
    place: Path,
    *line: str,
    hidden: tuple[str, ...] = (),
    without: tuple[str, ...] = (),
    first: str = "",
    **variables: str,
) -> subprocess.CompletedProcess[str]:
    """A command in a process from which parts are hidden, without some variables and with others, after `first`."""
    there = {k: v for k, v in os.environ.items() if k not in (*without, "DYNREG_REGISTRY")} | variables
    code = PROGRAM.format(hidden=hidden, first=first)
    return subprocess.run(
        [sys.executable, "-c", code, *line], capture_output=True, text=True, timeout=300, cwd=place, env=there
    )


def answer(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    """The document that a query printed, without the time that it took."""
    assert done.returncode in (0, 4) and "Traceback" not in done.stderr, done.stderr
    return timeless(done.stdout)


def timeless(document: str) -> dict[str, Any]:
    """A document without the time that it took."""
    found = json.loads(document)
    del found["cost"]
    return found


@pytest.fixture
def usual(place: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., dict[str, Any]]:
    """The document that a query prints where nothing is missing: in this process."""

    def asked(*line: str) -> dict[str, Any]:
        capsys.readouterr()
        assert main(["--registry", str(place / "dynreg-registry"), *line]) in (0, 4)
        return timeless(capsys.readouterr().out)

    return asked


def test_without_hnswlib_a_query_searches_exactly(place: Path, usual: Callable[..., dict[str, Any]]) -> None:
    line = (*QUERY, "--distance", "embedding")
    found = answer(ran(place, *line, hidden=("hnswlib",)))
    assert len(found["neighbours"]) == 2
    if find_spec("hnswlib"):  # among eight, approximate search finds the same
        assert [n["entry"] for n in usual(*line)["neighbours"]] == [n["entry"] for n in found["neighbours"]]


def test_without_a_graphics_processor_models_are_evaluated_all_the_same(place: Path) -> None:
    dark = {"CUDA_VISIBLE_DEVICES": "", "HIP_VISIBLE_DEVICES": ""}
    done = ran(place, "info", "--json", **dark)
    assert done.returncode == 0 and json.loads(done.stdout)["device"] == "cpu", done.stderr
    done = ran(
        place, "query", "bench", "-k", "2", "--distance", "cross_loss", "--no-synthesise", "--json", **dark
    )
    assert len(answer(done)["neighbours"]) == 2


@pytest.mark.parametrize(
    "line", ["robots check quadruped", "effects quadruped", "query bench -k 2 --report page.html"]
)
def test_without_a_screen_or_anything_that_draws_nothing_else_is_missed(line: str, place: Path) -> None:
    done = ran(place, *line.split(), hidden=DRAWING, without=SCREENS)
    assert done.returncode in (0, 4) and done.stdout and "Traceback" not in done.stderr, done.stderr
    assert "--report" not in line or (place / "page.html").stat().st_size > 10_000


@pytest.mark.parametrize("first", [SMALL, pytest.param("", marks=pytest.mark.slow)], ids=["small", "whole"])
def test_without_a_home_a_cache_and_a_compiler_the_answer_is_the_same(
    first: str, place: Path, usual: Callable[..., dict[str, Any]]
) -> None:
    """Nothing can be written but the registry, no program can be found, and there is no home folder."""
    nowhere = str(place / "file")
    folders = dict.fromkeys(
        ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR", "NUMBA_CACHE_DIR", "HOME"), nowhere
    )
    bare = ran(
        place, *QUERY, hidden=("hnswlib",), first=first, PATH=nowhere, CC=nowhere, CXX=nowhere, **folders
    )
    assert answer(bare) == usual(*QUERY)
    assert Path(nowhere).read_text() == "no folder"


@pytest.mark.parametrize("line", ["list", "doctor bench.csv --robot servo_pendulum", "robots check ~/none"])
def test_without_any_variable_a_verb_says_what_it_says_with_them(line: str, place: Path) -> None:
    """Not even HOME and PATH; and no word of a library about a place that it cannot use."""
    every = tuple(name for name in os.environ if name not in ("PYTHONPATH", "LD_LIBRARY_PATH"))
    bare, usual = ran(place, *line.split(), without=every), ran(place, *line.split(), HOME="/nowhere")
    assert bare.returncode == usual.returncode and "Traceback" not in bare.stderr
    assert bare.stderr.count("\n") <= 1 and (bare.returncode or bare.stdout == usual.stdout)


def test_a_terminal_that_lacks_letters_gets_others(place: Path) -> None:
    done = ran(
        place, "ingest", "bench.csv", "--robot", "servo_pendulum", "--name", "übung", PYTHONIOENCODING="ascii"
    )
    assert done.returncode == 0 and "\\xfcbung" in done.stdout, done.stderr
