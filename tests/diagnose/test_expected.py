"""How many simulations a diagnosis will ask for: near enough to say how long it takes."""

import pytest

from dynreg.cli.output import PlainProgress
from dynreg.diagnose.diagnose import simulated
from dynreg.diagnose.plans import Long, Many, Short


@pytest.mark.parametrize(
    ("plan", "parameters", "terms", "runs", "asked"),
    [
        (Short(), 7, 31, 2, 7345),  # servo_pendulum, one cause; counted
        (Long(), 6, 111, 1, 1489),  # leg in the air, one cause; counted
        (Many(), 38, 8, 0, 2067),  # aibo, one cause; counted
    ],
)
def test_the_number_is_good_to_a_factor_of_two(plan, parameters, terms, runs, asked) -> None:
    assert asked / 2 < plan.expected(parameters, terms, runs) < 2 * asked
    assert plan.expected(parameters, terms, 20) > 5 * plan.expected(parameters, terms, 0)


def test_the_first_replays_that_were_timed_tell_how_long_the_rest_will_take(
    capsys: pytest.CaptureFixture[str],
) -> None:
    now = [0.0]
    lines = PlainProgress(clock=lambda: now[0])
    told = simulated(lines, 1000)
    for many, second in ((0, 0.0), (10, 5.0), (20, 16.0), (1200, 600.0)):
        now[0] = second
        told(many)
    assert capsys.readouterr().err.splitlines() == [
        "simulations: 1.0 %, about 8 min left",
        "simulations: 2.0 %, about 13 min left",
        "still searching ...",
    ]


def test_past_the_number_that_was_expected_no_share_and_no_time_left_are_told(
    capsys: pytest.CaptureFixture[str],
) -> None:
    now = [0.0]
    lines = PlainProgress(clock=lambda: now[0])
    told = simulated(lines, 1000)
    for second in range(0, 260, 10):
        now[0] = float(second)
        told(10 * second)
    after = capsys.readouterr().err.splitlines()[10:]
    assert after[0] == "still searching: 10 s so far" and after[-1] == "still searching: 2 min so far"
    assert not any("%" in line or "left" in line for line in after)
