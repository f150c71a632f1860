"""The nouns of hidden robots: a truth, the commands that it is given, and what its sensors add."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dynreg.errors import UsageError


@dataclass(frozen=True)
class Truth:
    """One hidden robot.

    kind : of `table.KINDS`. parameters : true values by name [SI], all that the kind has. cause : id of what is
    hidden, of `causes.CAUSES`; None for nothing. values : of the cause, by name [SI]. joints : where it sits; all of
    them by default. seed : of disturbances and sensor noise. exact : no disturbance, noise and quantisation.
    """

    kind: str
    parameters: Mapping[str, float]
    cause: str | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    joints: tuple[str, ...] = ()
    seed: int = 0
    exact: bool = False


@dataclass(frozen=True, eq=False)
class Commands:
    """E episodes of commands (E, T, A) for a truth, each held for `period` [s], in the order of the robot's actions.

    begin : (E,) seconds from the start of the log to each episode; they follow each other in time. initial : (E, S)
    readings of the channels at the start, NaN where the truth may choose; None for its reset pose. inputs : {name:
    (E, T)} measured signals; settings : {name: (E,)} known constants.
    """

    actions: np.ndarray
    period: float
    begin: np.ndarray
    initial: np.ndarray | None = None
    inputs: Mapping[str, np.ndarray] = field(default_factory=dict)
    settings: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self):
        shape = self.actions.shape
        if len(shape) != 3 or len(self.begin) != shape[0] or self.period <= 0:
            raise UsageError(
                f"commands of shape {shape}, {len(self.begin)} beginnings and a period of {self.period} s",
                expected="(episodes, steps, actions), one beginning an episode, and a period above 0",
                do="reshape them",
            )

    def input(self, name: str, usual: float) -> np.ndarray:
        """(E, T) of an input; `usual` where the commands have none."""
        return self.inputs.get(name, np.full(self.actions.shape[:2], usual))


@dataclass(frozen=True)
class Sensor:
    """A channel as it is logged: noise [1 sigma] and quantum, in the channel's unit; 0 for none."""

    channel: str
    noise: float
    quantum: float = 0.0


def read(sensors: tuple[Sensor, ...], true: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(..., S) what sensors say of true values: white noise, then the nearest step of the quantum."""
    noisy = true + np.array([s.noise for s in sensors]) * rng.standard_normal(true.shape)
    quantum = np.array([s.quantum for s in sensors])
    steps = np.where(quantum > 0, quantum, 1.0)
    return np.where(quantum > 0, np.rint(noisy / steps) * steps, noisy)
