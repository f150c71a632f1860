"""Effects that a measured input already contains: the input drives the simulators, so its cause is no candidate."""

import numpy as np

from dynreg.replay.windows import Windows
from dynreg.sim.effects import applicable
from dynreg.sim.robot import Robot


def measured_effects(robot: Robot, windows: Windows) -> dict[str, str]:
    """{effect id: input} of the effects that a measured input contains in these windows.

    Only an input that changes within an episode counts: a supply voltage noted once per run gives its level, not its
    sag.
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
