"""Commands as a robot plays them, episode after episode. A last row holds targets and sets all else to 0.

Targets end in the reset pose (`Limits.returned`), where they are held until the next episode begins there.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.sim.excitation import targets
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

PAUSE = 1.0  # s between episodes


def begins(run: Run) -> np.ndarray:
    """(E,) seconds from the start of the first episode to that of each."""
    return np.arange(run.episodes) * (run.steps * run.period + PAUSE)


def closed(robot: Robot, actions: np.ndarray) -> np.ndarray:
    """(E, T+1, A) commands (E, T, A) and one row more: zero torque, voltage and speed; targets are held.

    Players hold the last row through the pause and after the end.
    """
    rest = np.where(targets(robot), actions[:, -1], 0.0)
    return np.concatenate([actions, rest[:, None]], axis=1)


def played(robot: Robot, run: Run, names: Sequence[str], source: Mapping) -> Recording:
    """The commands of a run as a log without states, and the enable channels where drives are switched off.

    names : of the episodes. source : its provenance.
    """
    actions, inputs = closed(robot, run.actions), run.inputs
    channels = [Channel(a.name, a.unit) for a in robot.file.actions]
    if inputs is not None:
        first = len(robot.file.inputs)
        off = [i for i in range(first, len(robot.inputs)) if (inputs[..., i] != 1.0).any()]
        channels += [Channel(robot.inputs[i], "1") for i in off]
        enabled = np.concatenate([inputs, inputs[:, -1:]], axis=1)[..., off]
        actions = np.concatenate([actions, enabled], axis=2)
    time = np.arange(run.steps + 1) * run.period
    episodes = tuple(
        Episode(name, begin + time, values, dict(zip(robot.settings, settings, strict=True)))
        for name, begin, values, settings in zip(names, begins(run), actions, run.settings, strict=True)
    )
    return Recording(tuple(channels), episodes, False, {"made_by": "excite", "robot": robot.name, **source})
