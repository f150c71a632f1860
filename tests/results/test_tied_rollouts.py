"""What a comparison says of simulators that tie over all channels, and differ on some."""

import pytest

from dynreg.results import Gain, Horizon, Rollouts, Score

OTHERS = {"joint1/position": (-0.16, True), "joint2/position": (-0.03, True)}


def rollouts(**of: dict[str | None, tuple[float, bool | None]]) -> Rollouts:
    """Simulators against the nominal one: {name: {channel: (gain, tie)}}; joint9/velocity is not scored."""
    how = {"seconds": 2.0, "error": 1.0, "low": 0.9, "high": 1.1, "unit": "rad"}
    scores = [
        Score(
            simulator=name, channel=channel, gain=Gain(value=g, low=g - 0.02, high=g + 0.03), tie=tie, **how
        )
        for name, channels in of.items()
        for channel, (g, tie) in channels.items()
    ]
    return Rollouts(
        episodes=("bag",),
        left_out=(),
        names=("nominal", *of),
        horizons=(Horizon(seconds=2.0, rollouts=6, whole=True),),
        best=next(iter(of)),
        alike=("nominal", *tuple(of)[1:]),
        unscored=("joint9/velocity",),
        scores=tuple(scores),
    )


@pytest.mark.parametrize(
    "others, said",
    [
        (OTHERS, "On the other scored channels they tie, with errors up to 16 % higher. "),
        ({"joint1/position": (0.02, True)}, "On the other scored channels they tie. "),
        ({"joint1/position": (-0.5, False)}, "They differ on 1 more of the scored channels. "),
        ({}, ""),
    ],
)
def test_a_tie_over_all_channels_does_not_hide_the_one_that_differs(others: dict, said: str) -> None:
    """A friction took 76 % off the error of one joint of seven, and the headline said that nothing differs."""
    found = rollouts(calibrated={None: (0.25, True), "joint4/position": (0.76, False)} | others)
    assert str(found) == (
        "In rollouts of 2 s of held-out bag, calibrated errs 76 [74, 79] % less than nominal on joint4/position. "
        f"{said}Over all scored channels together they tie"
    )


def test_each_simulator_that_differs_on_a_channel_is_told_and_losses_are_called_so() -> None:
    found = rollouts(
        extended={None: (0.2, True), "joint4/position": (0.6, False)},
        calibrated={None: (0.1, True), "joint2/position": (-0.3, False)},
    )
    assert (
        "calibrated errs 30 [27, 32] % more than nominal on joint2/position and extended errs 60 [58, 63] % less"
        in str(found)
    )


def test_channels_that_tie_or_that_no_score_counts_are_no_difference() -> None:
    for channels in (OTHERS, {"joint9/velocity": (0.5, False)}, {"joint1/position": (0.5, None)}):
        assert str(rollouts(calibrated={None: (0.0, True)} | channels)).endswith("calibrated and nominal tie")
