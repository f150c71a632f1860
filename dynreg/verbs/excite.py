"""Excite: commands that separate two causes, or with which legs hang free in turn."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynreg.errors import UsageError
from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, option, seed

if TYPE_CHECKING:
    from dynreg.data.recording import Recording
    from dynreg.excite.legs import HangingLegs
    from dynreg.results.experiment import Experiment
    from dynreg.results.protocol import LegProtocol
    from dynreg.sim.robot import Robot


@dataclass(frozen=True)
class ExciteSettings(Settings):
    """The settings of `excite`. Raises UsageError unless `between` has two different effects, or `legs` some legs."""

    between: tuple[str, ...] = option(
        (),
        "The two effects to separate.",
        flag="--for",
        metavar="A,B",
        complete="effect_names",
    )
    legs: tuple[str, ...] = option(
        (), "In place of effects: legs that hang free in turn and reverse, or all.", metavar="LEG,...|all"
    )
    seconds: float | None = option(None, "Length [s].", usual="10, or 25 of each leg", above=0.0)
    seed: int = seed()

    def __post_init__(self) -> None:
        super().__post_init__()
        pair = self.between
        if self.legs and pair:
            raise UsageError(
                f"between {','.join(pair)!r} and legs {','.join(self.legs)!r}",
                expected="one of the two",
                do="leave one out",
                setting="between",
            )
        if not self.legs and (len(pair) != 2 or pair[0] == pair[1]):
            raise UsageError(
                f"between {','.join(pair)!r}",
                expected="two different effects, A,B",
                do="see `dynreg effects`, or name --legs",
                setting="between",
            )


def excite(
    robot: "Robot", settings: ExciteSettings, *, progress: Progress | None = None
) -> "tuple[Recording, Experiment]":
    """Commands within the robot's limits that separate the effects `settings.between`, and the expected evidence.

    The commands are a recording whose channels are the robot's actions. Raises the errors of `excite.excite`.
    """
    from dynreg.excite.excite import SECONDS
    from dynreg.excite.excite import excite as choose
    from dynreg.verbs.experiment import experiment

    seconds = settings.seconds or SECONDS
    chosen = choose(robot, settings.between, seconds=seconds, seed=settings.seed, progress=progress)
    return chosen.recording, experiment(chosen)


def excite_legs(
    robot: "Robot", settings: ExciteSettings, *, progress: Progress | None = None
) -> "tuple[HangingLegs, LegProtocol]":
    """Commands with which `settings.legs` hang free in turn and reverse, and what the operator does.

    Raises the errors of `legs.hanging_legs`.
    """
    from dynreg.excite.legs import SECONDS, hanging_legs
    from dynreg.verbs.protocol import protocol

    seconds = settings.seconds or SECONDS
    made = hanging_legs(robot, settings.legs, seconds=seconds, seed=settings.seed, progress=progress)
    return made, protocol(made, robot.name)
