"""Which model or simulator says best what a wheeled robot does?"""

import time
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from dynreg.errors import UsageError
from dynreg.verbs.settings import Settings, option, seed, threads
from dynreg.verbs.simulators import NAMES, OLD, simulator
from dynreg.verbs.verb import Progress

if TYPE_CHECKING:
    from dynreg.results.comparison import Comparison
    from dynreg.verbs.simulators import Simulator
    from dynreg.verbs.subjects import Recorded

MODELS = ("kinematic", "dynamic", "table", "network", "mlp")  # of `compare.contenders`


@dataclass(frozen=True)
class CompareSettings(Settings):
    """What `compare` can be told."""

    models: tuple[str, ...] = option(
        MODELS, "Models to make, one of these or several.", metavar="A,B", choices=MODELS
    )
    simulators: tuple[str, ...] = option(
        (),
        f"A simulator, an entry, a result that recommends one, or one of {', '.join(NAMES)}; may be repeated.",
        flag="--with",
        metavar="ID",
        repeated=True,
        old=OLD,
    )
    starts: int = option(30, "Random starts of the networks.", least=1)
    generations: int = option(60, "Generations of the search that fits the dynamic model.", least=1)
    longest: float = option(2.0, "Seconds after which a held command counts as another.", above=0.0)
    seed: int = seed()
    threads: int = threads()

    def __post_init__(self) -> None:
        super().__post_init__()
        many = len({*self.models}) + len({*self.simulators})
        if many < 2:
            raise UsageError(
                f"{many} to compare",
                expected="two models or simulators, or more",
                do="name more with --models and --with",
            )


def compare(asked: "Recorded", settings: CompareSettings, progress: Progress | None = None) -> "Comparison":
    """Compare models and simulators of a wheeled robot.

    kinematic: the closed form; dynamic: the unicycle, fitted; table: the closed form, put right in cells of wheel
    speeds; network: three small networks; mlp: one of three layers. They are made from the first 84 % of the
    recording's commands, and all are judged on the last 16 %. A simulator named by --with drives the whole recording; a
    note says if it may have seen that part.

    Example: dynreg compare monday --with nominal --report monday.html

    Raises NoMatchError where the registry lacks a simulator, and what `compare.compare` does.
    """
    from dynreg.compare.compare import compare as compare_all
    from dynreg.compare.contenders import Plan
    from dynreg.verbs.comparison import document

    began = time.perf_counter()
    chosen = named(asked, settings.simulators)
    plan = Plan(**{one.name: getattr(settings, one.name) for one in fields(Plan)})
    replayed = {name: (one.robot, one.config) for name, one in chosen.items()}
    found = compare_all(asked.robot, asked.recording, replayed, plan, progress)
    return document(asked, plan, chosen, found, time.perf_counter() - began)


def named(asked: "Recorded", refs: tuple[str, ...]) -> "dict[str, Simulator]":
    """The simulators that `refs` name, each once, however often it is named, and each by a name of its own."""
    found = [simulator(asked.registry, ref, asked.robot, asked.recording.id) for ref in refs]
    once = {one.config.id: one for one in found}
    names = [one.name for one in once.values()]
    return {
        one.name if names.count(one.name) == 1 else f"{one.name} {identity[:8]}": one
        for identity, one in once.items()
    }
