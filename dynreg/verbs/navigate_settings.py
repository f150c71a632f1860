"""What `navigate` can be told: places, the area around them, the commands and the search."""

from collections.abc import Iterable
from dataclasses import MISSING, dataclass
from math import isfinite
from numbers import Real
from typing import Any

from dynreg.errors import UsageError
from dynreg.timed.task import COMMANDS
from dynreg.verbs.compare import MODELS
from dynreg.verbs.settings import Settings, option, seed, threads


@dataclass(frozen=True)
class NavigateSettings(Settings):
    """What `navigate` can be told. Raises UsageError for places, an area or times that cannot be."""

    visit: tuple[tuple[float, float], ...] = option(
        MISSING,
        "A place to visit: metres ahead, metres to the left; repeat it for more.",
        metavar="X,Y",
        repeated=True,
        apart=True,
    )
    size: float = option(0.3, "Side of the square around a place [m].", above=0.0)
    back: bool = option(True, "Come back to the start; else end in a place.", flag="--back/--no-back")
    area: tuple[float, ...] | None = option(
        None,
        "Area to stay in [m]: lowest x and y, highest x and y.",
        usual="the smallest around places and start",
        metavar="X,Y,X,Y",
    )
    on: str = option("dynamic", "Model of the robot.", choices=MODELS)
    commands: int = option(COMMANDS, "At most so many commands.", least=1)
    seconds: tuple[float, ...] | None = option(
        None, "Shortest and longest command [s].", usual="as most of the recording", metavar="A,B"
    )
    # 2000 generations and 1000 drives are choices: enough for the plans of docs/wheeled.md, in a minute or two
    generations: int = option(2000, "Generations of the search.", least=1)
    drives: int = option(1000, "Simulated drives that judge the plan.", least=1)
    seed: int = seed()
    threads: int = threads()

    def __post_init__(self) -> None:
        object.__setattr__(self, "visit", _places(self.visit))
        for name in ("area", "seconds"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _numbers(getattr(self, name), name))
        super().__post_init__()
        if self.area is not None:
            self._hold()
        if self.seconds is not None and not 0.0 < self.seconds[0] <= self.seconds[1]:
            raise _wrong("seconds", (_told(self.seconds),))

    def _hold(self) -> None:
        """UsageError for an area that is none, or that leaves out the start or a place."""
        x, y, most_x, most_y = self.area
        if not (x < most_x and y < most_y):
            raise _wrong("area", (_told(self.area),))
        named = {"the start": (0.0, 0.0), **{f"the place {_told(place)}": place for place in self.visit}}
        for name, (ahead, left) in named.items():
            if not (x <= ahead <= most_x and y <= left <= most_y):
                raise UsageError(
                    f"area {_told(self.area)!r} leaves out {name}",
                    expected="an area with the start, which is 0,0, and every place in it",
                    do="ask for a larger area, or leave it out",
                    setting="area",
                )


_FORMS = {  # how many numbers, what they are, and an example for a command line and for Python
    "visit": (2, "metres ahead and metres to the left", "0.5,-0.2", "[(0.5, -0.2)]"),
    "area": (
        4,
        "lowest x and y, highest x and y [m], lowest below highest",
        "-1,-1,1,1",
        "(-1, -1, 1, 1)",
    ),
    "seconds": (2, "the shortest and the longest command [s], above 0, shortest first", "0.2,2", "(0.2, 2)"),
}


def _places(given: Any) -> tuple[tuple[float, float], ...]:
    """Pairs of numbers, of pairs as a command line or Python tells them, or of one bare pair.

    Raises UsageError for what is no pair of finite numbers.
    """
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise _wrong("visit", given)
    parts = tuple(given)
    if not parts:
        raise _wrong("visit", parts)
    bare = not any(isinstance(part, Iterable) and not isinstance(part, str) for part in parts)
    return tuple(_numbers(part, "visit") for part in ((parts,) if bare else parts))


def _numbers(given: Any, name: str) -> tuple[float, ...]:
    """As many finite numbers as a setting has; UsageError for anything else."""
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise _wrong(name, given)
    parts = tuple(given)
    if len(parts) != _FORMS[name][0] or not all(isinstance(one, str | Real) for one in parts):
        raise _wrong(name, parts)
    try:
        numbers = tuple(map(float, parts))
    except (ValueError, OverflowError):
        raise _wrong(name, parts) from None
    if any(isinstance(one, bool) for one in parts) or not all(map(isfinite, numbers)):
        raise _wrong(name, parts)
    return numbers


def _wrong(name: str, given: Any) -> UsageError:
    """An error that shows what was given, words as a command line has them, and an example in the same form."""
    _, what, typed, python = _FORMS[name]
    words = isinstance(given, tuple) and given and all(isinstance(one, str) for one in given)
    shown, example = (",".join(given), typed) if words else (given, python)
    return UsageError(
        f"{name} {shown!r}", expected=f"{what}, such as {example}", do=f"give {name} so", setting=name
    )


def _told(numbers: Iterable[float]) -> str:
    """Numbers as a command line has them."""
    return ",".join(f"{one:g}" for one in numbers)
