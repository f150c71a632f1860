"""The bench of Back to Reality recomputes the table of the paper, whose column IF is printed as a fraction."""

from types import SimpleNamespace

import numpy as np
import pytest
from bench_back_to_reality import REAL_ONLY, TABLE, TRIALS, Bench, improvement, learning
from reality_runs import scaled


@pytest.mark.parametrize("name", TABLE)
def test_learning_performance_comes_out_to_the_third_digit(name: str) -> None:
    genes, trials, first, last, fraction, printed, recomputed = TABLE[name]
    assert improvement(first, last) / 100.0 == pytest.approx(fraction, abs=1e-3), "a fraction is printed"
    assert round(learning(genes, trials, first, last), 3) == recomputed
    assert recomputed == pytest.approx(printed, abs=0.006)
    as_printed = genes * fraction / trials
    assert as_printed == pytest.approx(printed / 100.0, rel=0.01), "with the fraction LP would be a hundredth"


def test_a_share_of_the_generations_leaves_trials_as_published() -> None:
    part, usual = scaled(0.1, 2), scaled(1.0, 2)
    assert (part.first, part.later, part.turns) == (60, 10, 4)
    assert (part.stand, part.repeats, part.variations * part.steps) == (10, 3, 130)
    assert (usual.first, usual.later, usual.turns) == (600, 100, 45)


class Lucky(Bench):
    """Trials that score how near a gait is to the middle; one in ten is lucky by 5."""

    def score(self, unit: np.ndarray, name: str) -> float:
        self.tape.asked.append(name)
        self.tape.units[name] = unit.tolist()
        lucky = 5.0 if len(self.tape.asked) % 10 == 0 and "again" not in name else 0.0
        return 2.0 - float(np.abs(unit - 0.5).mean()) + lucky


@pytest.mark.parametrize("method", REAL_ONLY)
def test_searches_on_the_robot_alone_have_as_many_trials_and_try_their_best_again(method: str) -> None:
    class Space(SimpleNamespace):
        def __len__(self) -> int:
            return 4

    tape = SimpleNamespace(hidden=SimpleNamespace(seed=5), asked=[], units={})
    bench = Lucky(tape, SimpleNamespace(space=Space(periodic=np.zeros(4, dtype=bool))))
    found = bench.real_only(np.full(4, 0.3), method, scaled(0.1, 2))
    on_the_way = [name for name in tape.asked if "again" not in name]
    assert found["trials"] == len(on_the_way) == len(set(on_the_way)) == TRIALS
    assert [len(some) for some in found["confirmed"]] == [3, 3]
    better = int(np.argmax([np.mean(some) for some in found["confirmed"]]))
    assert found["unit"] == tape.units[f"{method} confirmed {better} 0"] and len(found["speeds"]) == 10
