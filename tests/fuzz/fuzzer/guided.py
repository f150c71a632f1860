"""Atheris as another engine behind the same targets: it keeps inputs that reach new lines, and changes those.

It is no dependency; `pip install atheris` where it has a wheel for this Python.
"""

import random
import sys
import zlib
from pathlib import Path

from fuzzer.mutate import raw

SEEDS = 300  # inputs that it begins with
FRESH = 0.1  # of its inputs are drawn anew, so that the form of the format is not lost


def run_guided(folder: Path, name: str, seed: int, seconds: float, limit: float, memory: int) -> int:
    """Follow the coverage of one target; the inputs that reach new lines stay in `FOLDER/reached/NAME`."""
    try:
        import atheris
    except ImportError:
        print("atheris is not installed: pip install atheris, or leave --engine out", file=sys.stderr)
        return 2
    with atheris.instrument_imports(include=["dynreg", "mcap", "rosbags"]):
        from fuzzer.findings import keep
        from fuzzer.table import TARGETS
        from fuzzer.target import drawn, judge
        from fuzzer.worker import settle
    if name not in TARGETS:
        print(f"one target for atheris: {', '.join(TARGETS)}", file=sys.stderr)
        return 2
    target, reached = TARGETS[name], folder.resolve() / "reached" / name
    reached.mkdir(parents=True, exist_ok=True)
    for index in range(SEEDS):
        data = drawn(target, seed, index)
        (reached / f"{zlib.crc32(data):08x}").write_bytes(data)

    settle()

    def try_one(data: bytes) -> None:
        verdict = judge(target, data, limit)
        if not verdict.good and (kept := keep(folder, name, data, verdict)):
            print(f"{name}: {verdict.kind}: {verdict.sign} -> {kept}", flush=True)

    def change(data: bytes, most: int, chance: int) -> bytes:
        rng = random.Random(zlib.crc32(data) ^ chance)
        return (target.make(rng) if rng.random() < FRESH else raw(rng, data))[:most]

    arguments = [sys.argv[0], f"-max_total_time={seconds:.0f}", f"-seed={seed + 1}", "-max_len=200000"]
    arguments += [f"-rss_limit_mb={4 * memory}", "-timeout=60", str(reached)]
    atheris.Setup(arguments, try_one, custom_mutator=change)
    atheris.Fuzz()  # ends the process
    return 0
