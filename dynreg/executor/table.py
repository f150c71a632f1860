"""The executors by name."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from dynreg.errors import UsageError
from dynreg.executor.executor import Executor, Local

LOCAL, RAY = "local", "ray"


@contextmanager
def _local(address: str | None, threads: int) -> Iterator[Executor]:
    if address is not None:
        raise UsageError(
            f"address {address!r} without executor {RAY!r}",
            expected="an address of a Ray cluster together with what asks it",
            do=f"add --executor {RAY}, or leave --address out",
        )
    yield Local(threads)


def _on_ray(address: str | None, threads: int) -> AbstractContextManager[Executor]:
    from dynreg.executor.on_ray import connected

    return connected(address, threads)


_TABLE: dict[str, Callable[[str | None, int], AbstractContextManager[Executor]]] = {
    LOCAL: _local,
    RAY: _on_ray,
}
NAMES = tuple(_TABLE)


def opened(name: str, address: str | None = None, threads: int = 0) -> AbstractContextManager[Executor]:
    """The executor of this name, for the length of a block.

    address : of a Ray cluster; None for RAY_ADDRESS, else for workers on this machine. threads : of one job; 0 for all
    cores locally, and for one core on Ray.
    Raises UsageError where ray is not installed or an address fits nothing, ExecutorError as `on_ray.connected`.
    """
    return _TABLE[name](address, threads)
