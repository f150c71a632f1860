"""What a reader must know of channels that no error counts in this recording, and of joints that are stuck."""

import numpy as np

from dynreg.replay.parts import Parts
from dynreg.replay.windows import MOVES, Windows, stuck
from dynreg.sim.robot import Robot


def unscored_notes(robot: Robot, windows: Windows, parts: Parts) -> tuple[str, ...]:
    """A line on channels that hold still, one on those whose sensor is too slow, and one on each joint that was told to
    move and does not; see `windows.scales`.
    """
    measured = windows.measured[parts.chosen]
    logged, after = (np.isfinite(rows).any(axis=(0, 1)) for rows in (measured, measured[:, 1:]))
    weighted = np.array([c.weight > 0 for c in robot.file.channels]) & (windows.weight == 0)
    still = [name for name, one in zip(robot.channels, weighted & after, strict=True) if one]
    slow = [name for name, one in zip(robot.channels, weighted & logged & ~after, strict=True) if one]
    out = []
    if still:
        holds = f"{', '.join(still)} {'moves' if len(still) == 1 else 'move'} by no more than {MOVES:g} times the noise"
        out.append(f"{holds} in robot.toml: no error counts {'it' if len(still) == 1 else 'them'}")
    if slow:
        has = f"{', '.join(slow)} {'has' if len(slow) == 1 else 'have'} no value after the start of a rollout"
        out.append(f"{has}: no error counts {'it' if len(slow) == 1 else 'them'}. Replay longer rollouts")
    out += [
        f"{robot.channels[c]} holds still though its commands move (their standard deviation is {size:.3g} "
        f"{robot.file.channels[c].unit}): its drive is off, the sensor is stuck, or the joint is"
        for c, size in stuck(robot, measured, windows.run.actions[parts.chosen]).items()
    ]
    return tuple(out)
