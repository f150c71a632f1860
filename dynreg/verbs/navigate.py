"""Navigate: timed commands with which a wheeled robot visits places, by a model made from its recording."""

import time
from typing import TYPE_CHECKING

from dynreg.progress import Progress
from dynreg.verbs.navigate_settings import NavigateSettings

if TYPE_CHECKING:
    from dynreg.results.navigation import Navigation
    from dynreg.verbs.subjects import Recorded


def navigate(asked: "Recorded", settings: NavigateSettings, progress: Progress | None = None) -> "Navigation":
    """Find timed commands that visit places, for a robot on wheels.

    A model is made from the first 84 % of the recording's commands, as `dynreg compare` makes it, and a genetic
    algorithm seeks the commands in it (Pretorius et al.). The robot drives them without looking: it begins at rest,
    x is ahead and y to the left of where it stands. Speeds and times stay within those of most commands of the
    recording.

    Simulated drives judge the plan. Each adds the model's errors on consecutive commands from the last 16 %, as many as
    the plan has.

    Exit status 0 whatever the plan misses; a note says what.

    Example: dynreg navigate monday --visit 0.5,0.2 --visit 0.5,-0.2 -o plan.csv

    Raises RobotError where the robot has no wheels, LogError for a recording with too few commands, UsageError for
    commands longer than any of the recording's, or times between which no multiple of the robot's time step lies.
    """
    from dynreg.verbs.navigation import document, planned

    began = time.perf_counter()
    found = planned(asked.robot, asked.recording, settings, progress)
    return document(asked, settings, found, time.perf_counter() - began)
