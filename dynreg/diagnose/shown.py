"""Effects that a log already shows: an input that was measured drives the simulators, its cause is not asked for."""

import numpy as np

from dynreg.replay.windows import Windows
from dynreg.sim.effects import applicable
from dynreg.sim.robot import Robot


def shown(robot: Robot, windows: Windows) -> dict[str, str]:
    """{effect id: input} of the effects that an input of the recording holds.

    Only an input that changes while the robot moves was measured where the effect acts: a supply voltage that was
    noted once a run tells its level, not its sag.
    """
    inputs = windows.run.inputs
    if inputs is None:
        return {}
    moves = (np.ptp(inputs, axis=1) > 0).any(axis=0)
    measured = {name for name, moved in zip(robot.inputs, moves, strict=False) if moved}
    out = {}
    for name, effect in applicable(robot).items():
        holds = effect.shown_by(robot)
        if holds and measured.issuperset(holds):
            out[name] = ", ".join(holds)
    return out
