"""Findings on disk: one folder a target, one input for each thing that went wrong, made small."""

import hashlib
import json
import os
import select
import signal
import time
from collections.abc import Callable
from pathlib import Path

from fuzzer.scratch import clear
from fuzzer.table import TARGETS
from fuzzer.target import WALL, Verdict, judge
from fuzzer.worker import Bounds, peak, prepare

BUDGET = 20.0  # [s] for making one finding small


def keep(folder: Path, target: str, data: bytes, verdict: Verdict) -> Path | None:
    """Write a finding that was not seen before; None where it was seen."""
    name = f"{verdict.kind}-{hashlib.sha256(verdict.sign.encode()).hexdigest()[:10]}"
    path = folder / target / f"{name}.bin"
    if path.exists():
        return None
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    path.with_suffix(".txt").write_text(
        f"{verdict.kind}: {verdict.sign}\n\n{verdict.text}\n", errors="backslashreplace"
    )
    return path


def make_small(path: Path, bounds: Bounds) -> None:
    """Take from a finding's input what it does not need, for as long as the budget lasts."""
    target, data = path.parent.name, path.read_bytes()
    first = alone(target, data, bounds)
    if first.good:  # it took the inputs before it, or more memory than a fresh process needs
        return

    def still(smaller: bytes) -> bool:
        seen = alone(target, smaller, bounds)
        return (seen.kind, seen.sign) == (first.kind, first.sign)

    path.write_bytes(minimized(data, still, time.monotonic() + BUDGET))


def minimized(data: bytes, still: Callable[[bytes], bool], until: float) -> bytes:
    """What is left when pieces are taken out, large ones first, for as long as `still` holds."""
    size = max(len(data) // 2, 1)
    while size and time.monotonic() < until:
        at, smaller = 0, False
        while at < len(data) and time.monotonic() < until:
            shorter = data[:at] + data[at + size :]
            if still(shorter):
                data, smaller = shorter, True
            else:
                at += size
        size = size // 2 if not smaller or size > 1 else size
        if size == 1 and not smaller:
            break
    return data


def alone(target: str, data: bytes, bounds: Bounds) -> Verdict:
    """The verdict on one input in a process of its own, which it may take down."""
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(receive)
            prepare(bounds, Path(os.devnull))
            held = peak()
            verdict = judge(TARGETS[target], data, bounds.seconds)
            if verdict.good and peak() - held > bounds.megabytes:
                verdict = Verdict("memory", target, f"{peak() - held:.0f} MB more for {len(data)} bytes")
            os.write(send, json.dumps([verdict.kind, verdict.sign, verdict.text[-4000:]]).encode())
        finally:
            os._exit(0)
    os.close(send)
    ready, _, _ = select.select([receive], [], [], 2 * WALL * bounds.seconds)
    with os.fdopen(receive, "rb") as pipe:
        told = pipe.read() if ready else b""
    if not ready:
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    clear(child)
    if told:
        return Verdict(*json.loads(told))
    return died(target, status) if ready else Verdict("hang", f"{target}: no answer, no Python")


def died(target: str, status: int, text: str = "") -> Verdict:
    """The verdict on an input that took its process down."""
    how = (
        signal.Signals(os.WTERMSIG(status)).name
        if os.WIFSIGNALED(status)
        else f"exit {os.WEXITSTATUS(status)}"
    )
    place = next((line.strip() for line in text.splitlines() if "/dynreg/" in line), "")
    return Verdict("died", f"{how} {place}", text[-4000:])
