"""One process that runs inputs, forked from the loop and watched by it: what it is at lies in shared memory."""

import faulthandler
import json
import mmap
import os
import resource
import struct
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynreg.limits import variable
from fuzzer.scratch import folder
from fuzzer.table import TARGETS
from fuzzer.target import Verdict, drawn, judge

_PLACE = struct.Struct("<qd")  # index of the input that is being read, and since when [s, monotonic]
IDLE = -1
_FEW = 20  # open files that libraries keep for themselves: a pool of threads needs some


LIMITS = {  # a hundredth of what is allowed otherwise, so that what is large is small enough to be tried often
    "rows": 1_000_000,
    "columns": 10_000,
    "numbers": 2_500_000,
    "messages": 1_000_000,
    "items": 100_000,
    "episodes": 2_000,
    "chunk_bytes": 4 << 20,
    "unpacked_bytes": 256 << 20,
    "whole_bytes": 64 << 20,
    "json_bytes": 1 << 20,
    "settings_bytes": 64 << 10,
    "pattern_seconds": 1,
    "entries": 10_000,
    "robot_bytes": 8 << 20,
    "toml_bytes": 64 << 10,
    "xml_bytes": 256 << 10,
    "bodies": 1_000,
    "model_bytes": 50_000_000,
    "robot_memory": 2_000_000_000,
    "compile_seconds": 1,
}


@dataclass(frozen=True)
class Bounds:
    """What one input may take: seconds of the processor, and megabytes on top of those held before it."""

    seconds: float = 5.0
    megabytes: int = 512


class Worker:
    """The parent's side of a forked worker: give it spans of inputs, read its reports, see where it stands."""

    def __init__(self, seed: int, bounds: Bounds, errors: Path):
        self._shared = mmap.mmap(-1, _PLACE.size)
        _PLACE.pack_into(self._shared, 0, IDLE, 0.0)
        orders, self._orders = os.pipe()
        self.reports, reports = os.pipe()
        self.target, self.span, self.errors = "", (0, 0), errors
        self.pid = os.fork()
        if self.pid == 0:
            os.close(self._orders)
            os.close(self.reports)
            _run(orders, reports, self._shared, seed, bounds, errors)
        os.close(orders)
        os.close(reports)
        self._lines = os.fdopen(self.reports, "rb")

    def give(self, target: str, first: int, count: int) -> None:
        """Have it run the inputs `first` to `first + count` of a target; one report follows."""
        self.target, self.span = target, (first, count)
        os.write(self._orders, json.dumps([target, first, count]).encode() + b"\n")

    def read(self) -> dict[str, Any]:
        """Its report; empty where it is gone."""
        line = self._lines.readline()
        return json.loads(line) if line.endswith(b"\n") else {}

    def at(self) -> tuple[int, float]:
        """The input that it is at (IDLE between spans), and for how long [s]."""
        index, since = _PLACE.unpack_from(self._shared, 0)
        return index, time.monotonic() - since if since else 0.0

    def close(self) -> None:
        """Let it end: it does when its orders end."""
        os.close(self._orders)
        self._lines.close()


def _run(orders: int, reports: int, shared: mmap.mmap, seed: int, bounds: Bounds, errors: Path) -> None:
    status = 1
    try:
        prepare(bounds, errors)
        for line in os.fdopen(orders):
            report = _span(*json.loads(line), seed, bounds, shared)
            os.write(reports, json.dumps(report).encode() + b"\n")
        status = 0
    except BaseException:
        traceback.print_exc()  # into the worker's log, from where the loop tells it
    finally:
        os._exit(status)  # nothing of the parent's is to be run again here


def prepare(bounds: Bounds, errors: Path) -> None:
    """Limits, a place for temporary files that is looked at after every input, and where a fatal error is told."""
    log = os.open(errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, 2)
    os.dup2(log, 1)
    faulthandler.enable(file=sys.__stderr__)
    settle()
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    limit = held + 4 * bounds.megabytes * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def settle() -> None:
    """Take the low limits, and a folder of this process for what is temporary."""
    warnings.simplefilter("ignore")
    tempfile.tempdir = str(folder(os.getpid()) / "tmp")
    os.mkdir(tempfile.tempdir)
    os.chdir(folder(os.getpid()))  # where MuJoCo leaves its log
    os.environ.update({variable(name): str(limit) for name, limit in LIMITS.items()})


def _span(name: str, first: int, count: int, seed: int, bounds: Bounds, shared: mmap.mmap) -> dict[str, Any]:
    target, kinds = TARGETS[name], Counter()
    findings: list[tuple[int, Verdict]] = []
    longest, most, begun = (0.0, first), _resident(), time.process_time()
    before, files = _resident(), _open_files()
    _forget_peak()
    for index in range(first, first + count):
        _PLACE.pack_into(shared, 0, index, time.monotonic())
        data = drawn(target, seed, index)
        start, held = time.process_time(), peak()
        verdict = judge(target, data, bounds.seconds)
        took, grown = time.process_time() - start, peak() - held
        if verdict.good and grown > bounds.megabytes:
            verdict = Verdict("memory", name, f"{grown:.0f} MB more for {len(data)} bytes")
        kinds[verdict.kind] += 1
        longest, most = max(longest, (took, index)), max(most, peak())
        if not verdict.good and len(findings) < 50:
            findings.append((index, verdict))
        if grown > 20:
            _forget_peak()
    _PLACE.pack_into(shared, 0, IDLE, 0.0)
    if (more := _open_files() - files) > _FEW:
        findings.append(
            (first, Verdict("leak", f"{name}: open files", f"{more} more files open after {count} inputs"))
        )
        kinds["leak"] += 1
    return {
        "target": name,
        "first": first,
        "count": count,
        "cpu": round(time.process_time() - begun, 3),
        "kinds": kinds,
        "peak_mb": round(most),
        "grown_kb": round((_resident() - before) * 1024),
        "longest": [round(longest[0], 4), longest[1]],
        "findings": [[index, v.kind, v.sign, v.text] for index, v in findings],
    }


def peak() -> float:
    """Most memory held since the last `_forget_peak` [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _resident() -> float:
    """Memory held now [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


def _open_files() -> int:
    return len(os.listdir("/proc/self/fd"))


def _forget_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")
