"""What a reader must know of channels with a weight that no error counts in this recording."""

import numpy as np

from dynreg.replay.parts import Parts
from dynreg.replay.windows import MOVES, Windows
from dynreg.sim.robot import Robot


def unscored_notes(robot: Robot, windows: Windows, parts: Parts) -> tuple[str, ...]:
    """A line on the channels that hold still, and one on those whose sensor is too slow; see `windows.scales`."""
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
    return tuple(out)
