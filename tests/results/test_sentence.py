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


def test_whatever_the_verdict_the_equivalents_of_each_shown_cause_are_told() -> None:
    """Beside an ambiguous first cause alone they were: one that explains a part stood there as if certain."""
    given = MADE["partly_explained"]
    first, second = given.causes
    some = first.model_copy(
        update={"equivalent": ("inertia[arm]", "backlash", "payload", "cogging", "gear_loss")}
    )
    told = given.model_copy(update={"causes": (some,)})
    assert diagnosis_sentence(told) == (
        "load_friction of arm or inertia[arm] or backlash or payload or 2 more explains part of the error of"
        " bench_monday."
    )
    assert "The recording does not separate these causes." in diagnosis_details(told)
    sure = second.model_copy(update={"gain": Gain(value=0.1, low=0.05, high=0.2)})
    both = MADE["named"].model_copy(update={"causes": (first, sure)})
    assert diagnosis_sentence(both) == (
        "bench_monday shows load_friction of arm and command_delay (or sensor_delay)."
    )
    assert "The recording does not separate command_delay from sensor_delay." in diagnosis_details(both)


def test_a_part_is_called_a_part_and_every_cause_that_helps_is_named() -> None:
    first, second = MADE["partly_explained"].causes
    sure = second.model_copy(update={"gain": Gain(value=0.1, low=0.05, high=0.2)})
    said = diagnosis_sentence(MADE["partly_explained"].model_copy(update={"causes": (first, sure)}))
    assert said.startswith("load_friction of arm") and "and command_delay" in said
    assert said.endswith("explain part of the error of bench_monday.")
    assert diagnosis_details(MADE["partly_explained"])[-1].endswith(
        "times what the stated sensor noise leaves."
    )


def test_the_gain_of_all_causes_is_given_where_it_is_known() -> None:
    given = MADE["partly_explained"]
    nothing_held_out = made_up_diagnosis.diagnosis("partly_explained", held_out=False)
    assert "delay 0.4 [0.31, 0.4] s at its bound" in "\n".join(diagnosis_details(nothing_held_out))
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
    """Of the simulator that it leaves; tip_mass alone makes nine tenths of what calibration gains."""
    given = MADE[verdict]
    heavy = given.parameters["tip_mass"].model_copy(
        update={"nominal": 1.0, "value": 1.64, "share": 0.9, "unit": "1", **parameter}
    )
    sticky = given.parameters["viscous_friction"].model_copy(update={"share": 0.5})
    moved = {"tip_mass": heavy, "viscous_friction": sticky}
    told = {"parameters": given.parameters | moved, "over_start": gain}
    return given.model_copy(update=told)


MOST = Gain(value=0.92, low=0.9, high=0.94)


def test_what_calibration_alone_explains_is_said_before_what_no_effect_does() -> None:
    told = with_over_start("unknown", MOST)
    assert diagnosis_sentence(told) == (
        "With tip_mass 1.64 (nominal 1) and viscous_friction 0.018 N*m*s/rad (nominal 0.006), the simulator predicts"
        " bench_monday far better, but no effect of the library explains the remaining error."
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


def test_the_parameter_that_is_named_moved_the_prediction_and_was_not_only_pulled() -> None:
    """Damping was pulled farther than the friction that made all of the difference, and was named."""
    told = with_over_start("unknown", MOST)
    far = told.parameters["viscous_friction"].model_copy(update={"share": 0.02, "pulled_sigma": 9.0})
    told = told.model_copy(update={"parameters": told.parameters | {"viscous_friction": far}})
    said = "\n".join((diagnosis_sentence(told), *diagnosis_details(told)))
    assert "With tip_mass 1.64 (nominal 1), the" in said and "viscous_friction" not in said
    unknown = told.parameters["tip_mass"].model_copy(update={"share": None})
    told = told.model_copy(update={"parameters": told.parameters | {"tip_mass": unknown}})
    assert diagnosis_sentence(told).startswith("With fitted parameters, the simulator predicts")


def led_by_calibration(verdict: str = "named", gain: Gain | None = None, **told) -> Diagnosis:
    """Fitted parameters take 40 % of the error, nearly all of it on one of two channels; causes what `gain` says."""
    gain = gain or Gain(value=0.004, low=0.0, high=0.008)
    given = with_over_start(verdict, Gain(value=0.41, low=0.36, high=0.46))
    causes = tuple(cause.model_copy(update={"gain": gain}) for cause in given.causes)
    position, velocity = given.errors
    told = {
        "calibration": Gain(value=0.4, low=0.35, high=0.45),
        "gain": gain,
        "causes": causes,
        "errors": (position.model_copy(update={"calibrated": 0.25 * position.nominal}), velocity),
    } | told
    return given.model_copy(update=told)


def test_calibration_leads_where_it_explains_more_and_causes_that_do_not_help_are_not_shown() -> None:
    told = led_by_calibration()
    assert diagnosis_sentence(told) == (
        "With tip_mass 1.64 (nominal 1) and viscous_friction 0.018 N*m*s/rad (nominal 0.006), the simulator predicts"
        " arm/position of bench_monday far better, and no effect of the library clearly adds to that."
    )
    details = diagnosis_details(told)
    assert details[0].endswith(
        "the error on held-out data is 40 % lower than that of the nominal simulator (90 % interval: 35 to 45 % lower)."
    )
    assert details[1] == "On arm/position alone it is 75 % lower."
    assert details[3] == (
        "The search also accepted load_friction[arm], which does not clearly help on held-out data: do not rely on it."
    )
    assert not any(line.startswith(("Size of", "It is 41 %")) for line in details)
    for value in (-0.02, 0.004):  # worse, or no more than what is printed as 0 %
        assert "load_friction" not in diagnosis_sentence(
            led_by_calibration(gain=Gain(value=value, low=value, high=0.01))
        )


def test_causes_that_help_less_than_calibration_come_second() -> None:
    helps = Gain(value=0.1, low=0.05, high=0.2)
    assert diagnosis_sentence(led_by_calibration(gain=helps)).endswith(
        "far better, and the recording shows load_friction of arm."
    )
    assert diagnosis_sentence(led_by_calibration("partly_explained", helps)).endswith(
        "far better, and load_friction of arm and command_delay (or sensor_delay) explain part of the remaining error."
    )
    weak = led_by_calibration(gain=helps, errors=MADE["named"].errors)
    assert "predicts bench_monday better, and" in diagnosis_sentence(weak)


def test_a_cause_that_explains_more_than_calibration_stays_first_and_both_earn_their_own() -> None:
    told = led_by_calibration(gain=Gain(value=0.8, low=0.7, high=0.9))
    assert diagnosis_sentence(told) == "bench_monday shows load_friction of arm."
    assert (
        "It is 41 % lower than that of the nominal simulator (90 % interval: 36 to 46 % lower)."
        " The calibrated model's is 40 % lower." in diagnosis_details(told)
    )


def test_an_unclear_cause_is_no_headline_without_calibration_either() -> None:
    (cause,) = MADE["named"].causes
    unclear = cause.model_copy(update={"gain": Gain(value=0.1, low=-0.1, high=0.3)})
    told = MADE["named"].model_copy(update={"causes": (unclear,)})
    assert diagnosis_sentence(told) == "No effect of the library clearly helps to predict bench_monday."
    assert any(
        line.startswith("The search accepted load_friction[arm], which") for line in diagnosis_details(told)
    )


def test_causes_that_help_only_together_are_shown_together() -> None:
    first, second = MADE["partly_explained"].causes
    first = first.model_copy(update={"gain": second.gain})
    given = MADE["partly_explained"].model_copy(update={"causes": (first, second)})
    assert diagnosis_sentence(given).startswith("No effect")
    both = given.model_copy(update={"gain": Gain(value=0.3, low=0.2, high=0.4)})
    assert diagnosis_sentence(both).startswith(
        "load_friction of arm and command_delay (or sensor_delay) explain part"
    )
    assert not any("do not rely" in line for line in diagnosis_details(both))


def test_the_gain_of_a_cause_says_over_which_simulator() -> None:
    details = diagnosis_details(with_over_start("named", MOST))
    assert (
        "With load_friction[arm] in the model, the error on held-out data is 31 % lower than the calibrated"
        " model's (90 % interval: 27 to 35 % lower)." in details
    )
    assert "It is 92 % lower than that of the nominal simulator (90 % interval: 90 to 94 % lower)." in details
    loose = with_over_start("named", MOST).model_copy(update={"rival": "unpenalised"})
    assert any(
        "31 % lower than that of the model calibrated without a prior (" in line
        for line in diagnosis_details(loose)
    ), "the better calibration is not always that of the table's first row"


@pytest.mark.parametrize(
    "gain, words",
    [
        (Gain(value=0.2, low=None, high=None), "20 % lower (too few windows for an interval)."),
        (Gain(value=-0.2, low=None, high=None), "20 % higher (too few windows for an interval)."),
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
