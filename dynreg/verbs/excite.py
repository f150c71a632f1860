"""Excite: commands for the experiment that tells two causes apart."""

from dataclasses import MISSING, dataclass
from typing import TYPE_CHECKING

from dynreg.errors import UsageError
from dynreg.verbs.settings import Settings, option, seed
from dynreg.verbs.verb import Progress

if TYPE_CHECKING:
    from dynreg.data.recording import Recording
    from dynreg.results.experiment import Experiment
    from dynreg.sim.robot import Robot


@dataclass(frozen=True)
class ExciteSettings(Settings):
    """What an experiment can be told. Raises UsageError where it is not between two effects."""

    between: tuple[str, ...] = option(
        MISSING,
        "The two effects.",
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
    """Commands within the robot's limits that tell the effects `settings.between` apart, and how well they should.

    The commands are a recording whose channels are the robot's actions. Raises as `excite.excite`.
    """
    from dynreg.excite.excite import excite as choose
    from dynreg.verbs.experiment import experiment

    chosen = choose(robot, settings.between, seconds=settings.seconds, seed=settings.seed, progress=progress)
    return chosen.recording, experiment(chosen)
