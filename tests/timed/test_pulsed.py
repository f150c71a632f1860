"""Pulsed neurons: against the sums as they are printed, spike by spike."""

import numpy as np
import pytest

from dynreg.rng import stream
from dynreg.timed.pulsed import GENES, INPUTS, NEURONS, TICKS, Controllers


def one_by_one(controllers: Controllers, at: int, seen: np.ndarray) -> list[int]:
    """Spikes of each neuron of one controller, by the sums over all spikes before."""

    def heard(s: float) -> float:
        return np.exp(-(s - 2.0) / 4.0) * (1.0 - np.exp(-(s - 2.0) / 10.0)) if s >= 2.0 else 0.0

    fired: list[list[int]] = [[] for _ in range(NEURONS)]
    for t in range(TICKS):
        now = []
        for i in range(NEURONS):
            u = sum(
                w * sum(heard(t - f) for f in range(t + 1))
                for w, on in zip(controllers.inputs[at, i], seen, strict=True)
                if on
            )
            u += sum(controllers.neurons[at, i, j] * heard(t - f) for j in range(NEURONS) for f in fired[j])
            u += sum(-np.exp(-(t - f) / 4.0) for f in fired[i])
            now.append(u > controllers.thresholds[at, i])
        for i in np.flatnonzero(now):
            fired[i].append(t)
    return [len(f) for f in fired]


def test_there_are_as_many_numbers_as_the_paper_says() -> None:
    assert GENES == 396
    made = Controllers.of(np.linspace(0, 1, 2 * GENES).reshape(2, GENES))
    assert made.inputs.shape == (2, 3, 128) and made.neurons.shape == (2, 3, 3)
    assert (
        made.inputs.min() == -1.0
        and 0.0 <= made.thresholds.min() <= made.thresholds.max() == pytest.approx(3.9)
    )


def test_spikes_are_those_of_the_printed_sums() -> None:
    rng = stream(1, "pulsed")
    made = Controllers.of(rng.uniform(size=(12, GENES)))
    seen = rng.uniform(size=(12, INPUTS)) < 0.15
    told = made.commands(seen)
    counts = np.array([one_by_one(made, b, seen[b]) for b in range(12)])
    assert np.array_equal(told, np.clip(counts[:, :2] - 1, 0, 19))
    assert len({*told.ravel()}) > 3  # not all or nothing
    assert np.array_equal(made.take(np.array([3, 4])).commands(seen[3:5]), told[3:5])


def test_who_sees_nothing_and_starts_at_rest_tells_the_lowest_command() -> None:
    made = Controllers.of(np.full((1, GENES), 0.5))
    assert made.commands(np.zeros((1, INPUTS), dtype=bool)).tolist() == [[0, 0]]
