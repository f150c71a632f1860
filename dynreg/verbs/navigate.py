"""Navigate: timed commands with which a wheeled robot visits places, by a model made from its recording."""

import time
from collections.abc import Iterable
from dataclasses import MISSING, dataclass
from math import isfinite
from numbers import Real
from typing import TYPE_CHECKING, Any

from dynreg.errors import UsageError
from dynreg.progress import Progress
from dynreg.timed.task import COMMANDS, POPULATION
from dynreg.verbs.compare import MODELS
from dynreg.verbs.settings import Settings, option, seed, threads

if TYPE_CHECKING:
    from dynreg.results.navigation import Navigation
    from dynreg.verbs.subjects import Recorded


@dataclass(frozen=True)
class NavigateSettings(Settings):
    """What `navigate` can be told. Raises UsageError for places, an area or times that cannot be."""

    visit: tuple[tuple[float, float], ...] = option(
        MISSING,
        "A place to visit: metres ahead, metres to the left; repeat it for more.",
        metavar="X,Y",
        repeated=True,
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
    generations: int = option(2000, f"Generations of the search, of {POPULATION} plans each.", least=1)
    drives: int = option(1000, "Simulated drives that judge the plan.", least=1)
    seed: int = seed()
    threads: int = threads()

    def __post_init__(self) -> None:
        for name, (many, _) in _LISTS.items():
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _numbers(getattr(self, name), name, many))
        super().__post_init__()
        object.__setattr__(self, "visit", tuple(zip(self.visit[::2], self.visit[1::2], strict=True)))
        if self.area is not None and not (self.area[0] < self.area[2] and self.area[1] < self.area[3]):
            raise _wrong("area", self.area)
        if self.seconds is not None and not 0.0 < self.seconds[0] <= self.seconds[1]:
            raise _wrong("seconds", self.seconds)


_LISTS = {  # how many numbers, 0 for pairs, and what is expected
    "visit": (0, "metres ahead and metres to the left, such as 0.5,-0.2"),
    "area": (4, "lowest x and y, highest x and y [m], lowest below highest, such as -1,-1,1,1"),
    "seconds": (2, "the shortest and the longest command [s], above 0, shortest first, such as 0.2,2"),
}


def _numbers(given: Iterable[Any], name: str, many: int) -> tuple[float, ...]:
    """Numbers, or pairs of them, as a command line or Python tells them."""
    flat = [one for part in given for one in ((part,) if isinstance(part, str | Real) else part)]
    try:
        out = tuple(float(one) for one in flat)
    except (TypeError, ValueError):
        raise _wrong(name, flat) from None
    right = len(out) == many if many else bool(out) and len(out) % 2 == 0
    if not right or not all(map(isfinite, out)):
        raise _wrong(name, flat)
    return out


def _wrong(name: str, given: Iterable[Any]) -> UsageError:
    told = ",".join(f"{one:g}" if isinstance(one, Real) else str(one) for one in given)
    return UsageError(f"{name} {told!r}", expected=_LISTS[name][1], do=f"give {name} so", setting=name)


def navigate(asked: "Recorded", settings: NavigateSettings, progress: Progress | None = None) -> "Navigation":
    """Find timed commands that visit places, for a robot on wheels.

    A model is made from the first 84 % of the recording's commands, as `dynreg compare` makes it, and a genetic
    algorithm seeks the commands in it (Pretorius et al.). The robot drives them without looking: it begins at rest,
    x is ahead and y to the left of where it stands. Speeds and times stay within those of most commands of the
    recording.

    Simulated drives judge the plan. Each adds the model's errors on consecutive commands from the last 16 %, as many as
    the plan has.

    Example: dynreg navigate monday --visit 0.5,0.2 --visit 0.5,-0.2 -o plan.csv

    Raises RobotError where the robot has no wheels, LogError for a recording with too few commands, UsageError for
    commands longer than any of the recording's.
    """
    from dynreg.verbs.navigation import document, planned

    began = time.perf_counter()
    found = planned(asked.robot, asked.recording, settings, progress)
    return document(asked, settings, found, time.perf_counter() - began)
