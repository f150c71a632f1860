"""What is said of a calibration by trials: the difference that was made small, with its unit where it has one."""

import pytest

from dynreg.report.html import page
from dynreg.report.on_robot import rows, verdict
from dynreg.results import Calibration


def made(difference: str, before: float, after: float) -> Calibration:
    """Two gaits on a robot and one adaptation."""
    version = {"simulator": "a" * 64, "parent": None, "recordings": (), "episodes": ()}
    gait = {"iteration": 1, "step": "transfer", "simulated": 0.3}
    nothing = ("train_error", "test_error", "nominal_train_error", "nominal_test_error")
    return Calibration(
        robot="dog",
        recording=None,
        method="btr",
        simulator="a" * 64,
        versions=(
            {**version, "stage": "start"},
            {**version, "stage": "iteration 1", "parent": "a" * 64, "before": before, "after": after},
        ),
        parameters={},
        **dict.fromkeys(nothing),
        history=(),
        ended="iterations",
        on_robot={
            "task": "forward",
            "unit": "m/s",
            "seconds": 1.0,
            "tried": (
                {**gait, "trials": (1,), "scores": (0.1,)},
                {**gait, "trials": (2,), "scores": (0.2,)},
                {**gait, "trials": (3,), "scores": (0.15,), "step": "refine"},
            ),
            "best": 2,
            "gait": {},
            "difference": difference,
        },
        cost={"evaluations": 0, "rollouts": 3, "seconds": 1.0, "trials": 3},
    )


@pytest.mark.parametrize(
    ("difference", "said", "titled"),
    [
        (
            "absolute",
            "The difference of simulated and real scores went from 0.2 to 0.1 m/s.",
            "difference of simulated and real scores [m/s]",
        ),
        (
            "signed",
            "The mean signed difference of simulated and real scores went from 0.2 to 0.1 m/s.",
            "mean signed difference of simulated and real scores [m/s]",
        ),
        (
            "rank",
            "1 - the rank correlation of simulated and real scores went from 0.2 to 0.1.",
            "1 - the rank correlation of simulated and real scores",
        ),
    ],
)
def test_each_kind_of_difference_is_named_with_its_unit(difference: str, said: str, titled: str) -> None:
    found = made(difference, 0.2, 0.1)
    assert verdict(found).endswith(said)
    text = page(found)
    assert titled in text and (titled.endswith("]") or f"{titled} [" not in text)


def test_nothing_is_said_to_fall_that_stayed() -> None:
    text = verdict(made("absolute", 0.2, 0.2))
    assert "went from 0.2 to 0.2" in text and "fell" not in text


def test_small_steps_that_are_not_the_best_have_no_row() -> None:
    assert [row[0] for row in rows(made("absolute", 0.2, 0.1).on_robot)] == ["1", "2"]
