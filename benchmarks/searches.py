"""The journals of a registry's searches, kept in a folder: a run of hours goes on in another registry."""

import json
import os
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

EVERY = 30.0  # s between two copies
SPENT = "spent.json"


@contextmanager
def kept_searches(journals: Path, folder: Path) -> Iterator[None]:
    """Copy what `folder` has to where a registry has its `journals` for the block, and back what its searches add.

    Those of a search that has ended stay in the folder. The longer of two is the later one. The folder also
    keeps the time of all runs that used it; see `spent`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    journals.mkdir(parents=True, exist_ok=True)
    _copy(folder, journals)
    before, began = spent(folder), (time.perf_counter(), time.process_time())
    ended = threading.Event()

    def keep() -> None:
        _copy(journals, folder)
        own = time.perf_counter() - began[0], time.process_time() - began[1]
        took = {name: value + more for (name, value), more in zip(before.items(), own, strict=True)}
        new = folder / f"{SPENT}.new"
        new.write_text(json.dumps(took) + "\n", encoding="utf-8")
        os.replace(new, folder / SPENT)

    def often() -> None:
        while not ended.wait(EVERY):
            keep()

    thread = threading.Thread(target=often, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        keep()


def spent(folder: Path) -> dict[str, float]:
    """What the runs took that used a folder [s]: by the clock, and of all processors."""
    path = folder / SPENT
    return (
        json.loads(path.read_text(encoding="utf-8"))
        if path.exists()
        else {"seconds": 0.0, "core seconds": 0.0}
    )


def _copy(source: Path, target: Path) -> None:
    for path in sorted(source.glob("*.jsonl")):
        there = target / path.name
        new = there.with_suffix(".new")
        try:
            if not there.exists() or there.stat().st_size < path.stat().st_size:
                shutil.copyfile(path, new)
                os.replace(new, there)
        except FileNotFoundError:  # the search has just ended
            continue
