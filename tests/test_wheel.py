"""The wheel, installed in an environment of its own: whole, and passing the tests that need no checkout."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "dynreg"
TESTS = ROOT / "tests"
OFFLINE = ("--no-deps", "--no-index", "--disable-pip-version-check", "-q")
# tests that are run each time: package data is read, a child process is begun, a log goes the whole way to its page
QUICK = (
    "results",
    "cli/test_choices.py",
    "cli/test_whole_way.py",
    "sim/test_film.py::test_a_strip_has_four_stills_side_by_side",
    "data/test_ingest.py",
)
SETTINGS = """[pytest]
addopts = -q -m "not slow" -p no:cacheprovider
markers = slow
filterwarnings = ignore:Do not use the .random. module inside strategies
"""
WHERE = '''"""That which is tested is what was installed."""

import sys

import dynreg


def test_what_is_tested_is_what_was_installed():
    assert dynreg.__file__.startswith(sys.prefix), dynreg.__file__
'''


def ran(*command: str | Path, cwd: Path, seconds: float = 300.0) -> str:
    """What a command says; it must end well. It sees no checkout by PYTHONPATH."""
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTEST_ADDOPTS")}
    environment = {k: v for k, v in environment.items() if not k.startswith("PYTEST_")}
    done = subprocess.run(
        [*map(str, command)], capture_output=True, text=True, timeout=seconds, cwd=cwd, env=environment
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-6000:]
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a fresh environment with the wheel, and all else from the environment that runs the tests."""
    pytest.importorskip("setuptools", minversion="77", reason="building needs setuptools >= 77")
    place = tmp_path_factory.mktemp("wheel")
    source = place / "source"  # a copy, so that no build product is left in the tree
    shutil.copytree(PACKAGE, source / "dynreg", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    pip = (sys.executable, "-m", "pip")
    ran(*pip, "wheel", source, "--no-build-isolation", "-w", place / "wheels", *OFFLINE, cwd=place)
    (wheel,) = (place / "wheels").glob("dynreg-*.whl")
    ran(sys.executable, "-m", "venv", "--without-pip", place / "environment", cwd=place)
    python = place / "environment" / "bin" / "python"
    ran(*pip, "--python", python, "install", wheel, *OFFLINE, cwd=place)
    packages = python.parents[1] / Path(sysconfig.get_path("purelib")).relative_to(sys.prefix)
    # its own .pth files are not followed there, that of an editable checkout among them
    (packages / "all_else.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    return python


def test_the_wheel_holds_robots_and_templates_and_works(installed: Path, tmp_path: Path) -> None:
    (home,) = installed.parents[1].glob("lib/python*/site-packages/dynreg")
    data = [
        p.relative_to(PACKAGE) for p in PACKAGE.rglob("*") if p.is_file() and p.suffix not in (".py", ".pyc")
    ]
    assert data and not [path for path in data if not (home / path).is_file()]
    use = "import dynreg\nfor name in dynreg.packaged_robots(): print(dynreg.load_robot(name).name)"
    robots = {path.parent.name for path in (PACKAGE / "robots").glob("*/robot.toml")}
    assert robots and set(ran(installed, "-c", use, cwd=tmp_path).split()) == robots
    version = ran(installed.with_name("dynreg"), "--version", cwd=tmp_path)
    assert version.startswith("dynreg ")


def test_some_tests_pass_without_a_checkout(installed: Path, tmp_path: Path) -> None:
    place = without_a_checkout(tmp_path)
    ran(installed, "-m", "pytest", "test_where.py", *QUICK, cwd=place)


@pytest.mark.slow
def test_all_tests_that_need_no_checkout_pass_without_one(installed: Path, tmp_path: Path) -> None:
    place = without_a_checkout(tmp_path)
    ran(installed, "-m", "pytest", ".", cwd=place, seconds=7200.0)


def without_a_checkout(place: Path) -> Path:
    """A copy of the tests, but for those that need a part of the checkout, and rooms whose conftest.py does."""
    lacking = [
        path for path in TESTS.rglob("*.py") if path != TESTS / "conftest.py" and _needs_checkout(path)
    ]
    rooms = [path.parent for path in lacking if path.name == "conftest.py"]
    for path in TESTS.rglob("*"):
        if path.is_dir() or path.suffix == ".pyc" or path in lacking or any(map(path.is_relative_to, rooms)):
            continue
        target = place / path.relative_to(TESTS)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, target)
    (place / "pytest.ini").write_text(SETTINGS, encoding="utf-8")
    (place / "test_where.py").write_text(WHERE, encoding="utf-8")
    return place


def _needs_checkout(path: Path) -> bool:
    """Whether a test looks for files of the checkout, or imports a study among the benchmarks."""
    text = path.read_text(encoding="utf-8")
    studies = "|".join(study.stem for study in (ROOT / "benchmarks").glob("*.py"))
    return "parents[" in text or bool(re.search(rf"^ *(from|import) ({studies})\b", text, re.MULTILINE))
