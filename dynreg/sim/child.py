"""Work on foreign robots in a process of its own, whose memory and time are limited and whose end is no harm."""

import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from dynreg.errors import DynregError, LogError, RobotError, UsageError
from dynreg.limits import limits, refuse

_CODE = "from dynreg.sim.child import answer; answer()"
_HOME = str(Path(__file__).parents[2])
# no display is opened, and no memory taken for each of many cores: a limit on memory counts what is merely reserved
_PLAIN = {
    "MUJOCO_GL": "disable",
    "MALLOC_ARENA_MAX": "2",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
}


class NotTried(RobotError):
    """A robot was not tried to the end on this machine, now: time or memory ran out, or no process could begin."""


# Errors of `work` that are raised as they are; all others are told as those of the robot.
KEPT = {kind.__name__: kind for kind in (UsageError, LogError)}
TWICE = 2  # seconds on the wall for one of the processor, where cores are shared


def in_child(work: str, files: Mapping[str, bytes], *texts: str, limit: str) -> Any:
    """What `work(files, *texts)`, a function told as "module:name", returns (as JSON), from a process of its own.

    limit : the name of the limit on its seconds; its memory is limited by `robot_memory`. Where a system has no such
    limits (Windows; memory on macOS), time is limited alone.
    Raises NotTried past them and where no process can begin; RobotError where the process ends by itself, and where
    `work` raises an error of dynreg, but for those of `KEPT`, which are raised as they are.
    """
    head = json.dumps(
        {
            "work": work,
            "texts": texts,
            "limit": limit,
            "files": [(name, len(data)) for name, data in files.items()],
        }
    )
    paths = [_HOME, *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | _PLAIN | {"PYTHONPATH": os.pathsep.join(paths)}
    try:
        with tempfile.TemporaryDirectory() as here:  # MuJoCo leaves a MUJOCO_LOG.TXT where it ends
            ended = subprocess.run(
                [sys.executable, "-P", "-c", _CODE],
                input=b"".join((head.encode(), b"\n", *files.values())),
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                cwd=here,
                env=environment,
                timeout=TWICE * getattr(limits(), limit),
            )
    except subprocess.TimeoutExpired:
        refuse(NotTried, "the robot's model takes too long, in seconds", "more", limit)
    except OSError as problem:
        raise NotTried(
            f"the robot's model cannot be tried: {problem.strerror or problem}",
            expected="a system that can begin a process, and a temporary folder that can be written to",
            do="end other processes, or set TMPDIR to another folder",
        ) from None
    try:
        told = json.loads(ended.stdout)
    except ValueError:
        told = {"ended": ended.returncode}
    return _read(told, limit)


def _read(told: dict[str, Any], limit: str) -> Any:
    if "value" in told:
        return told["value"]
    if "error" in told:
        problem, expected, do = told["error"]
        raise KEPT.get(told["kind"], RobotError)(problem, expected=expected, do=do)
    if "bug" in told:
        raise RuntimeError(told["bug"])
    if "memory" in told:
        refuse(NotTried, "the robot's model needs too much memory, in bytes", "more", "robot_memory")
    if _cause(told["ended"]) == "SIGXCPU":
        refuse(NotTried, "the robot's model takes too long, in seconds", "more", limit)
    if _cause(told["ended"]) == "SIGKILL":  # as systems end whoever takes their last memory
        raise NotTried(
            "the process that tried the robot's model was killed",
            expected="a machine with memory left for it",
            do="end other processes, and try again",
        )
    raise RobotError(
        f"MuJoCo ends on the robot's model ({_cause(told['ended'])})",
        expected="a model that it compiles",
        do="take parts out of the model until it does",
    )


def _cause(status: int) -> str:
    with suppress(ValueError):
        return signal.Signals(-status).name
    return f"exit status {status}"


def answer() -> NoReturn:
    """What the process does: read the task from standard input, do it within the limits, write what came of it."""
    head = json.loads(sys.stdin.buffer.readline())
    files = {name: sys.stdin.buffer.read(size) for name, size in head["files"]}
    out = os.dup(1)
    os.dup2(2, 1)  # what libraries print is no answer
    _limit(getattr(limits(), head["limit"]))
    try:
        module, _, name = head["work"].partition(":")
        work = getattr(importlib.import_module(module), name)
        told = {"value": work(files, *head["texts"])}
    except MemoryError:
        told = {"memory": True}
    except DynregError as error:
        told = {"error": (error.problem, error.expected, error.do), "kind": type(error).__name__}
    except Exception:
        told = {"bug": traceback.format_exc()}
    with open(out, "w", encoding="utf-8") as answers:
        json.dump(told, answers)
    os._exit(0)  # libraries may have threads left


def _limit(seconds: int) -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    memory = limits().robot_memory
    most = {"RLIMIT_AS": (memory, memory), "RLIMIT_CPU": (seconds, seconds + 5), "RLIMIT_CORE": (0, 0)}
    for name, pair in most.items():
        with suppress(ValueError, OSError):  # systems that cannot, and those that allow less already
            resource.setrlimit(getattr(resource, name), pair)
