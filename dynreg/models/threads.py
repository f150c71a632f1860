"""Work spread over threads that each run torch on one core.

One thread for each product is what makes results the same bytes on any number of threads, and it is faster:
the matrices of one model are too small to be worth cutting up.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def available_threads() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def single_threaded() -> Iterator[None]:
    """Torch on one thread for the calling thread; its own setting comes back at the end."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def worker_pool(threads: int) -> Iterator[ThreadPoolExecutor]:
    """A pool whose workers run torch on one thread each."""
    with single_threaded(), ThreadPoolExecutor(threads, initializer=_one_core) as pool:
        yield pool


def in_threads(
    function: Callable[[Item], Result], items: Sequence[Item], threads: int | None = None
) -> list[Result]:
    """`function` of every item, in order, on `threads` threads (default: the cores of this process)."""
    threads = min(threads or available_threads(), len(items))
    if threads <= 1:
        with single_threaded():
            return [function(item) for item in items]
    with worker_pool(threads) as pool:
        return list(pool.map(function, items))


def _one_core() -> None:
    import torch

    torch.get_num_threads()  # torch sets up a new thread on first use; only what comes after that stays
    torch.set_num_threads(1)
