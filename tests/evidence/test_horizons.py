"""Fits that begin with the first moments reach the optimum, where a fit of whole windows stops at a local one."""

from dataclasses import replace

import numpy as np
import pytest
from by_hand import answered, first_channel, held_against_zero, plain

from dynreg.diagnose.calibrate import calibrate
from dynreg.evidence.accuracy import ROUGH, Accuracy
from dynreg.evidence.fit import fit
from dynreg.evidence.horizons import by_horizons
from dynreg.evidence.lockstep import Ask
from dynreg.sim.run import Run

ROWS = 40
TRUTH = 1.0


@pytest.fixture
def swinging():
    """A model whose swing is out of phase by more and more, as its only coordinate is wrong; and what it is told."""
    model, data = held_against_zero("zero_offset", rows=ROWS, tolerance=10.0)
    steps: list[int] = []

    def answer(one: Ask) -> np.ndarray:
        z = model.coordinates.from_values(one.case.values)[:, 0][:, None, None]
        steps.append(one.case.run.steps)
        time = np.arange(1, one.case.run.steps + 1) / ROWS
        return first_channel(one, np.sin((z - TRUTH) * (0.3 + 5.0 * time)) + 0.02 * np.cos(40.0 * time))

    return model, data, answer, steps


def test_first_moments_lead_past_local_optima(swinging) -> None:
    model, data, answer, steps = swinging
    (whole,), _ = answered(fit(model, [plain(-1.0)], data.sample(data.fit), iterations=40), answer)
    assert abs(whole.z[0] - TRUTH) > 0.5, "a local optimum"
    steps.clear()
    (found,) = answered(by_horizons(model, [plain(-1.0)], data, data.fit), answer)
    assert found.z[0] == pytest.approx(TRUTH, abs=0.05)
    assert steps == sorted(steps) and 0 < steps[0] < steps[-1] < ROWS


def test_a_model_with_many_parameters_on_feet_is_calibrated_by_horizons_at_a_finer_step(
    swinging, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, data, answer, steps = swinging
    monkeypatch.setattr("dynreg.evidence.model.MANY", 0)
    accuracy = Accuracy(4.0, fine=True, order=1, slopes=2.0, width=ROUGH, sides=2)
    dear, asked = replace(model, accuracy=accuracy), []

    def noted(one: Ask) -> np.ndarray:
        asked.append(one.robot)
        return answer(one)

    found = answered(calibrate(dear, data, draws=0), noted)
    assert found.model.finely == 2.0 and not found.model.corrections
    assert {robot.file.robot.timestep for robot in asked} == {0.5 * model.robot.file.robot.timestep}
    assert steps[0] < steps[-1] == ROWS
    assert answered(found.model.corrected([found.point], data), noted) is found.model


def test_the_beginning_of_a_recording_has_the_first_rows_of_all_that_is_told() -> None:
    _, data = held_against_zero("zero_offset", rows=ROWS, segments=4)
    every = np.arange(3 * ROWS).reshape(3, ROWS, 1).astype(float)
    run = Run(every, inputs=every + 0.5, noise=every[None], before=every, initial=data.windows.run.initial)
    rows = np.array([[0, ROWS + 1], [ROWS, ROWS + 6], [0, 3]])
    whole = replace(data, windows=replace(data.windows, run=run, rows=rows))
    half = whole.beginning(0.5)
    assert (half.segments, half.windows.run.steps, half.windows.measured.shape[1]) == (2, 20, 21)
    assert np.array_equal(half.windows.run.actions, every[:, :20])
    assert np.array_equal(half.windows.run.inputs, every[:, :20] + 0.5)
    assert half.windows.run.noise.shape == (1, 3, 20, 1) and half.windows.run.before.shape == (3, ROWS, 1)
    assert half.windows.rows.tolist() == [[0, 21], [ROWS, ROWS + 6], [0, 3]]
    least = whole.beginning(0.001)
    assert (least.segments, least.windows.run.steps) == (1, 1)
