"""What is fuzzed: how an input is made, and the reader that must answer it with a result or one plain line."""

import os
import random
import signal
import tempfile
import traceback
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from dynreg.errors import DynregError

SECONDS = 5.0  # of the processor; an input that takes longer is a hang. The longest sound one took 0.6 s
WALL = 4.0  # times as long may pass on the wall, where cores are shared
_OURS = ("/dynreg/",)


@dataclass(frozen=True)
class Target:
    """One reader of one format.

    make : draws one input; the same state of the generator gives the same bytes.
    check : hands the bytes to the reader; returns for a result, raises DynregError for a refusal.
    """

    name: str
    make: Callable[[random.Random], bytes]
    check: Callable[[bytes], None]


@dataclass(frozen=True)
class Verdict:
    """What became of one input: "read", "refused", or the kind of a finding with what tells it from others."""

    kind: str
    sign: str = ""
    text: str = ""

    @property
    def good(self) -> bool:
        """Whether the reader kept its word."""
        return self.kind in ("read", "refused")


class Hung(BaseException):
    """The input took too long. No Exception, so that no reader takes it for a fault of the file."""


def drawn(target: Target, seed: int, index: int) -> bytes:
    """Input number `index` of a target: the same for the same seed, whatever ran before it."""
    return target.make(random.Random(f"{seed}/{target.name}/{index}"))


def judge(target: Target, data: bytes, seconds: float = SECONDS) -> Verdict:
    """Hand `data` to the target's reader, and say what it did; `seconds` without an answer are a hang."""
    held = _left_behind()
    try:
        with _alarm(seconds):
            target.check(data)
        verdict = Verdict("read")
    except DynregError as error:
        verdict = _refused(error)
    except Hung as error:
        verdict = Verdict("hang", _place(error), traceback.format_exc())
    except MemoryError as error:
        verdict = Verdict("memory", f"MemoryError at {_place(error)}", traceback.format_exc())
    except BaseException as error:
        verdict = Verdict("crash", f"{type(error).__name__} at {_place(error)}", traceback.format_exc())
    left = _left_behind() - held
    if left and verdict.good:
        return Verdict("leftover", target.name, f"temporary files left behind: {sorted(left)}")
    return verdict


def _refused(error: DynregError) -> Verdict:
    line = str(error)
    if obeyed(line):
        return Verdict("control", f"{type(error).__name__} at {_place(error)}", repr(line))
    causes, cause = [], error
    while cause is not None and len(causes) < 20:
        causes.append(cause)
        cause = cause.__cause__ or cause.__context__
    starved = next((c for c in causes if isinstance(c, MemoryError)), None)
    if starved is not None:  # refused for want of memory, not for a limit
        return Verdict(
            "memory", f"MemoryError at {_place(starved)}", "".join(traceback.format_exception(error))
        )
    return Verdict("refused", type(error).__name__, line)


def obeyed(text: str) -> str:
    """What a terminal or a browser would obey in a text, not show."""
    return "".join(c for c in text if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp"))


def _place(error: BaseException) -> str:
    """The last line of dynreg's own on the way to an error, and the function that raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if any(part in f.filename for part in _OURS)]
    at = f"{ours[-1].filename.rpartition('/dynreg/')[2]}:{ours[-1].name}" if ours else "?"
    return at if not frames or frames[-1] is (ours or [None])[-1] else f"{at} > {frames[-1].name}"


def _left_behind() -> set[str]:
    return set(os.listdir(tempfile.gettempdir()))


@contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    def ring(number: int, frame: FrameType | None) -> None:
        raise Hung(f"no answer within {seconds:g} s")

    timers = {
        signal.SIGPROF: (signal.ITIMER_PROF, seconds),
        signal.SIGALRM: (signal.ITIMER_REAL, WALL * seconds),
    }
    before = {number: signal.signal(number, ring) for number in timers}
    for which, most in timers.values():
        signal.setitimer(which, most)
    try:
        yield
    finally:
        for which, _ in timers.values():
            signal.setitimer(which, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
