"""A controller of pulsed neurons: 128 inputs, two motor neurons and a hidden one, which hear each other (396 numbers).

Paper C. Neurons follow the spike response model (Gerstner): what comes in adds up through the kernel `HEARD`, a spike
of its own silences a neuron for a while, and it spikes where the sum is above its threshold. An input that is
on spikes at every tick; the spikes of a motor neuron in one window are the number of its command.
"""

from dataclasses import dataclass

import numpy as np

INPUTS, NEURONS, MOTORS = 128, 3, 2
GENES = INPUTS * NEURONS + NEURONS**2 + NEURONS
TICKS = 20  # ms in a window
MEMBRANE, SYNAPSE, DELAY = 4.0, 10.0, 2.0  # ms
THRESHOLD = 3.9  # the highest
SPEEDS = 20  # commands of a motor
SINCE = np.arange(TICKS) - DELAY
# (ticks,) what a spike adds so many ticks later to who hears it; to the neuron itself it adds -exp(-ticks / MEMBRANE)
HEARD = np.where(SINCE >= 0, np.exp(-SINCE / MEMBRANE) * (1.0 - np.exp(-SINCE / SYNAPSE)), 0.0)
FADES = np.exp([-1.0 / MEMBRANE, -1.0 / MEMBRANE - 1.0 / SYNAPSE])  # a tick, of the two exponentials of HEARD


@dataclass(frozen=True, eq=False)
class Controllers:
    """B controllers: weights of inputs (B, 3, 128) and of neurons (B, 3, 3) in [-1, 1], thresholds (B, 3).

    The first two neurons drive the left and the right wheel.
    """

    inputs: np.ndarray
    neurons: np.ndarray
    thresholds: np.ndarray

    @classmethod
    def of(cls, unit: np.ndarray) -> "Controllers":
        """Of genes (B, 396) in the unit cube."""
        many, first = len(unit), INPUTS * NEURONS
        weights = 2.0 * unit - 1.0
        return cls(
            weights[:, :first].reshape(many, NEURONS, INPUTS),
            weights[:, first:-NEURONS].reshape(many, NEURONS, NEURONS),
            THRESHOLD * unit[:, -NEURONS:],
        )

    def take(self, which: np.ndarray) -> "Controllers":
        """Some of them."""
        return Controllers(self.inputs[which], self.neurons[which], self.thresholds[which])

    def commands(self, seen: np.ndarray) -> np.ndarray:
        """(B, 2) numbers 0 to 19 of what the wheels are told, for what is seen (B, 128) of zeros and ones.

        Every window begins at rest. No spike at all is the lowest command, too.
        """
        drive = (self.inputs @ seen.astype(float)[:, :, None])[:, :, 0, None]
        driven = np.moveaxis(drive * np.cumsum(HEARD), -1, 0)  # inputs spike at every tick
        spikes = np.zeros((TICKS, len(seen), NEURONS))
        slow, quick, own = np.zeros((3, len(seen), NEURONS))  # sums over spikes: the first two make HEARD
        for tick in range(TICKS):
            if tick:
                own = FADES[0] * (own - spikes[tick - 1])
            if tick >= DELAY:
                new = spikes[tick - int(DELAY)]
                slow, quick = FADES[0] * slow + new, FADES[1] * quick + new
            told = (self.neurons @ (slow - quick)[:, :, None])[:, :, 0]
            spikes[tick] = driven[tick] + told + own > self.thresholds
        return np.clip(spikes[:, :, :MOTORS].sum(axis=0).astype(int) - 1, 0, SPEEDS - 1)
