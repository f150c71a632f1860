"""What rollouts do from other starts within the noise of the measured ones."""

from dataclasses import replace

import numpy as np

from dynreg.replay.residual import scaled
from dynreg.rng import stream
from dynreg.sim.run import Run

STARTS = 8  # other starts of each window


def from_other_starts(run: Run, chosen: np.ndarray, noise: np.ndarray) -> Run:
    """Episodes `chosen` (m,) of a run, first from their own starts, then from others with `noise` (S,), m at a time."""
    off = stream(0, "start noise").standard_normal((1 + STARTS, len(chosen), run.initial.shape[1]))
    off[0] = 0.0
    initial = run.initial[chosen] + off * noise
    return replace(run.take(np.tile(chosen, 1 + STARTS)), initial=initial.reshape(-1, initial.shape[2]))


def changes(states: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """(`STARTS`, m, T, S) rollouts from other starts less those from the episodes' own, in units of `spread` (S,).

    states : ((1 + `STARTS`) m, T+1, S) of a run that `from_other_starts` made.
    """
    found = states.reshape(1 + STARTS, -1, *states.shape[1:])[..., 1:, :]
    return scaled(found[1:], found[0], spread)
