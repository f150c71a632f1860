"""Named random streams: every draw in dynreg comes from a seed and the names of what is drawn."""

import hashlib

import numpy as np


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """A generator that depends on `seed` and `names` alone.

    Streams with different names are independent, so adding a draw in one place moves no other.

    >>> stream(0, "excitation", 3).integers(100) == stream(0, "excitation", 3).integers(100)
    np.True_
    """
    return np.random.default_rng(stream_seed(seed, *names))


def stream_seed(seed: int, *names: str | int) -> int:
    """The 64-bit seed of a named stream, for libraries that bring a generator of their own."""
    text = "\x1f".join([str(int(seed)), *(f"{type(name).__name__}:{name}" for name in names)])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")
