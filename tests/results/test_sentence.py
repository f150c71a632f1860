"""The verdict in one sentence: it says what the numbers say, and no more."""

import made_up_diagnosis
import pytest

from dynreg.results import Cause, Diagnosis, Gain, diagnosis_details, diagnosis_sentence

MADE = {
    v: made_up_diagnosis.diagnosis(v) for v in ("named", "ambiguous", "partly_explained", "unknown", "none")
}


def details_of(cause: Cause) -> str:
    return "\n".join(diagnosis_details(MADE["named"].model_copy(update={"causes": (cause,)})))


@pytest.mark.parametrize("verdict", MADE)
def test_it_is_one_sentence_about_the_recording(verdict: str) -> None:
    said = MADE[verdict].sentence
    assert "bench_monday" in said and said.endswith(".") and "\n" not in said and ";" not in said
    assert len(said) < 100 and "[" not in said.replace("[arm]", "")  # the numbers stand below it
    assert "None" not in said and "nan" not in said


def test_a_named_cause_is_the_verdict_and_its_numbers_are_details() -> None:
    assert MADE["named"].sentence == "bench_monday shows load_friction of arm."
    assert diagnosis_details(MADE["named"]) == (
        "Size of load_friction of arm: coefficient 0.21 [0.18, 0.24].",
        "With load_friction[arm] in the model, the error on held-out data is 31 % lower"
        " (90 % interval: 27 to 35 % lower).",
        "The residual of arm/position is 1.1 times the difference of repeated runs.",
    )


def test_an_ambiguous_one_names_the_others() -> None:
    assert "or stribeck_load_friction[arm]." in MADE["ambiguous"].sentence
    assert "The recording does not separate these causes." in diagnosis_details(MADE["ambiguous"])


def test_a_part_is_called_a_part_and_every_cause_is_named() -> None:
    said = MADE["partly_explained"].sentence
    assert said.startswith("load_friction of arm") and "and command_delay" in said
    assert said.endswith("explain part of the error of bench_monday.")
    assert diagnosis_details(MADE["partly_explained"])[-1].endswith("times the stated sensor noise.")


def test_the_gain_of_all_causes_is_given_where_it_is_known() -> None:
    given = MADE["partly_explained"]
    assert "delay 0.4 [0.31, 0.4] s at its bound" in "\n".join(diagnosis_details(given))
    for gain, words in (
        (Gain(value=0.44, low=0.2, high=0.6), "44 % lower (90 % interval: 20 to 60 % lower)."),
        (
            Gain(value=0.44, low=-0.2, high=0.6),
            "44 % lower (90 % interval: 20 % higher to 60 % lower): no clear difference.",
        ),
    ):
        details = diagnosis_details(given.model_copy(update={"gain": gain}))
        assert f"With all causes in the model, the error on held-out data is {words}" in details


def test_without_a_cause_none_is_named() -> None:
    for verdict in ("unknown", "none"):
        assert "load_friction" not in "\n".join((MADE[verdict].sentence, *diagnosis_details(MADE[verdict])))
    assert "The position of arm predicts 14 % of its residual." in diagnosis_details(MADE["unknown"])
    details = "\n".join(diagnosis_details(MADE["none"]))
    assert "18.4 nats" in details and "0.0612 rad" in details


def with_over_start(verdict: str, gain: Gain, **parameter) -> Diagnosis:
    given = MADE[verdict]
    heavy = given.parameters["tip_mass"].model_copy(
        update={"nominal": 1.0, "value": 1.64, "pulled_sigma": 6.4, "unit": "1", **parameter}
    )
    told = {"parameters": given.parameters | {"tip_mass": heavy}, "over_start": gain}
    return given.model_copy(update=told)


MOST = Gain(value=0.92, low=0.9, high=0.94)


def test_what_calibration_alone_explains_is_said_before_what_no_effect_does() -> None:
    told = with_over_start("unknown", MOST)
    assert diagnosis_sentence(told) == (
        "With tip_mass 1.64 (nominal 1), the simulator predicts bench_monday far better,"
        " but no effect of the library explains the remaining error."
    )
    assert diagnosis_details(told)[0] == (
        "With tip_mass 1.64 (nominal 1) and viscous_friction 0.018 N*m*s/rad (nominal 0.006) and the other fitted"
        " parameters, the error on held-out data is 92 % lower than that of the nominal simulator"
        " (90 % interval: 90 to 94 % lower)."
    )
    assert diagnosis_sentence(with_over_start("none", MOST)).endswith(
        "far better, and no effect of the library shows."
    )


@pytest.mark.parametrize(
    "gain",
    [
        Gain(value=0.92, low=None, high=None),
        Gain(value=0.6, low=-0.1, high=0.9),
        Gain(value=0.4, low=0.3, high=0.5),
    ],
)
def test_a_small_or_unsure_gain_of_calibration_is_no_headline(gain: Gain) -> None:
    for verdict in ("unknown", "none"):
        told = with_over_start(verdict, gain)
        assert diagnosis_sentence(told) == MADE[verdict].sentence
        assert "fitted parameters" not in "\n".join(diagnosis_details(told))


def test_a_parameter_that_was_not_fitted_is_not_called_moved() -> None:
    told = with_over_start("unknown", MOST, low=None, high=None)
    assert "viscous_friction 0.018" in diagnosis_sentence(told) and "tip_mass" not in diagnosis_sentence(told)


def test_the_gain_of_a_cause_says_over_which_simulator() -> None:
    details = diagnosis_details(with_over_start("named", MOST))
    assert (
        "With load_friction[arm] in the model, the error on held-out data is 31 % lower than the calibrated"
        " model's (90 % interval: 27 to 35 % lower)." in details
    )
    assert "It is 92 % lower than that of the nominal simulator (90 % interval: 90 to 94 % lower)." in details


@pytest.mark.parametrize(
    "gain, words",
    [
        (Gain(value=0.2, low=None, high=None), "20 % lower (too few episodes for an interval)."),
        (Gain(value=-0.2, low=None, high=None), "20 % higher (too few episodes for an interval)."),
        (Gain(value=-0.2, low=-0.3, high=-0.1), "20 % higher (90 % interval: 10 to 30 % higher)."),
        (
            Gain(value=0.02, low=-0.1, high=0.1),
            "2 % lower (90 % interval: 10 % higher to 10 % lower): no clear difference.",
        ),
        (
            Gain(value=-0.001, low=-0.2, high=0.001),
            "0.1 % higher (90 % interval: 20 % higher to 0.1 % lower)",
        ),
    ],
)
def test_a_loss_is_not_called_a_gain(gain: Gain, words: str) -> None:
    assert f"is {words}" in details_of(MADE["named"].causes[0].model_copy(update={"gain": gain}))


def test_a_value_at_its_bound_says_so_and_a_bare_number_has_no_unit() -> None:
    (cause,) = MADE["named"].causes
    assert "0.24]." in details_of(cause)
    (name, estimate), *_ = cause.parameters.items()
    edge = estimate.model_copy(update={"at_bound": True, "unit": "N*m"})
    said = details_of(cause.model_copy(update={"parameters": {name: edge}}))
    assert "0.24] N*m at its bound." in said
