"""Rows of simulated populations and of recordings, normalised as one population's models expect them."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.transitions import Transitions
from dynreg.models.normaliser import Normaliser
from dynreg.rng import stream

HELD_OUT_EVERY = 5  # one episode in five of a population's bank is held out, for every entry the same ones


@dataclass(frozen=True)
class Rows:
    """Normalised model inputs (..., N, D) and targets (..., N, S), and which rows are held out (N,).

    follows : (N,) whether the next row begins where this one ends.
    """

    inputs: np.ndarray
    targets: np.ndarray
    held_out: np.ndarray
    follows: np.ndarray

    @property
    def train(self) -> tuple[np.ndarray, np.ndarray]:
        """Inputs and targets of the rows to train on."""
        return self.inputs[..., ~self.held_out, :], self.targets[..., ~self.held_out, :]

    @property
    def held(self) -> tuple[np.ndarray, np.ndarray]:
        """Inputs and targets of the held-out rows."""
        return self.inputs[..., self.held_out, :], self.targets[..., self.held_out, :]


def bank_rows(states: np.ndarray, actions: np.ndarray, context: np.ndarray, normaliser: Normaliser) -> Rows:
    """Rows of entries that ran the same bank: states (M, E, T+1, S), actions (E, T, A), context (E, T, K).

    Every fifth episode is held out, by trajectory.
    """
    m, e, steps = states.shape[0], states.shape[1], states.shape[2] - 1
    now, after = states[:, :, :-1], states[:, :, 1:]
    spread = lambda a: np.broadcast_to(a, (m, *a.shape))  # noqa: E731
    inputs = normaliser.inputs(now, spread(actions), spread(context)).reshape(m, e * steps, -1)
    targets = normaliser.targets(now, after).reshape(m, e * steps, -1)
    held = np.repeat(np.arange(e) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1, steps)
    follows = np.arange(e * steps) % steps != steps - 1
    return Rows(inputs, targets, held, follows)


def recording_rows(rows: Transitions, normaliser: Normaliser) -> Rows:
    """Rows of a recording; every fifth of its episodes is held out, every fifth tenth of a single one."""
    episodes = np.unique(rows.episode)
    if len(episodes) >= HELD_OUT_EVERY:
        held = np.isin(rows.episode, episodes[HELD_OUT_EVERY - 1 :: HELD_OUT_EVERY])
    else:
        block = np.arange(len(rows)) * 10 // max(len(rows), 1)
        held = block % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    inputs = normaliser.inputs(rows.states, rows.actions, rows.context)
    follows = np.zeros(len(rows), dtype=bool)
    follows[:-1] = (rows.next_states[:-1] == rows.states[1:]).all(axis=1)
    follows[:-1] &= rows.episode[:-1] == rows.episode[1:]
    return Rows(inputs, normaliser.targets(rows.states, rows.next_states), held, follows)


def thin(count: int, most: int, seed: int, name: str) -> np.ndarray:
    """At most `most` of `count` row numbers, drawn once, in order."""
    if count <= most:
        return np.arange(count)
    return np.sort(stream(seed, "rows", name).choice(count, most, replace=False))
