"""Proposals walk to planted parameters."""

import numpy as np
import pytest
from planted_map import TRUTH, Plant, started
from planted_map import space as planted_space

from dynreg.neighbours.synthesise import linearise, propose, refine
from dynreg.sim.space import ParameterSpace


@pytest.fixture(scope="module")
def space() -> ParameterSpace:
    return planted_space()


@pytest.mark.parametrize("curvature", [0.0, 0.5])
def test_it_finds_the_planted_parameters(space, curvature):
    plant = Plant(curvature)
    begun = started(space, plant)
    replays = refine(begun, plant.residuals, 15, seed=0)
    best = replays.unit[replays.score.argmin()]
    np.testing.assert_allclose(best, TRUTH, atol=0.02)
    assert replays.score.min() < 0.1 * begun.score.min() and len(replays.unit) == 18 + 15


@pytest.mark.parametrize("budget", [0, 1, 2, 4, 7])
def test_it_spends_the_budget_and_no_more(space, budget):
    replays = refine(started(space, Plant()), Plant().residuals, budget, seed=0)
    assert len(replays.unit) == 18 + budget


def test_proposals_stay_inside_the_ranges_and_leave_what_is_known(space):
    replays = started(space, Plant(2.0), free=(True, False, True, True))
    made = refine(replays, Plant(2.0).residuals, 12, seed=0).unit[18:]
    assert made.min() >= 0 and made.max() <= 1
    assert (made[:, 1] == TRUTH[1]).all()
    assert len(np.unique(made, axis=0)) == 12, "none is simulated twice"


def test_the_same_evidence_gives_the_same_proposals(space):
    replays = started(space, Plant())
    np.testing.assert_array_equal(propose(replays, 0.1, 3), propose(replays, 0.1, 3))
    assert not np.array_equal(propose(replays, 0.1, 3), propose(replays, 0.1, 4))


def test_the_score_weighs_fit_and_select_by_their_windows(space):
    replays = started(space, Plant())
    whole = np.abs(Plant().residuals(replays.unit)).mean(axis=(1, 2, 3))
    np.testing.assert_allclose(replays.score, whole, rtol=1e-6)


def test_a_linear_map_is_recovered_without_doubt(space):
    plant = Plant(noise=0.0)
    replays = started(space, plant, count=200)
    local = linearise(replays)
    slopes = plant.slopes[:, :3].reshape(4, -1).T
    np.testing.assert_allclose(local.jacobian, slopes, atol=0.1 * np.abs(slopes).max())
    assert np.trace(local.doubt) < 0.01 * np.trace(
        local.jacobian.T @ (local.jacobian * local.weight[:, None])
    )


@pytest.mark.filterwarnings("error")
def test_where_the_recording_tells_all_parameters_nothing_is_free(space):
    replays = started(space, Plant(), free=(False, False, False, False))
    assert linearise(replays).jacobian.shape[1] == 0
