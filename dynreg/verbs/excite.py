"""Excite: commands of an experiment that separates two causes."""

from dataclasses import MISSING, dataclass
from typing import TYPE_CHECKING

from dynreg.errors import UsageError
from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, option, seed

if TYPE_CHECKING:
    from dynreg.data.recording import Recording
    from dynreg.results.experiment import Experiment
    from dynreg.sim.robot import Robot


@dataclass(frozen=True)
class ExciteSettings(Settings):
    """The settings of `excite`. Raises UsageError unless `between` has two different effects."""

    between: tuple[str, ...] = option(
        MISSING,
        "The two effects to separate.",
        flag="--for",
        metavar="A,B",
        complete="effect_names",
        some="effects",
        see="effects",
    )
    seconds: float = option(10.0, "Length [s].", above=0.0)
    seed: int = seed()

    def __post_init__(self) -> None:
        super().__post_init__()
        pair = self.between
        if len(pair) != 2 or pair[0] == pair[1]:
            raise UsageError(
                f"between {','.join(pair)!r}",
                expected="two different effects, A,B",
                do="see `dynreg effects`",
                setting="between",
            )


def excite(
    robot: "Robot", settings: ExciteSettings, *, progress: Progress | None = None
) -> "tuple[Recording, Experiment]":
    """Commands within the robot's limits that separate the effects `settings.between`, and the expected evidence.

    The commands are a recording whose channels are the robot's actions. Raises the errors of `excite.excite`.
    """
    from dynreg.excite.excite import excite as choose
    from dynreg.verbs.experiment import experiment

    chosen = choose(robot, settings.between, seconds=settings.seconds, seed=settings.seed, progress=progress)
    return chosen.recording, experiment(chosen)
