"""The verdict in one sentence: it says what the numbers say, and no more."""

import made_up_diagnosis
import pytest

from dynreg.results import Cause, Gain, diagnosis_sentence

MADE = {
    v: made_up_diagnosis.diagnosis(v) for v in ("named", "ambiguous", "partly_explained", "unknown", "none")
}


def sentence_of(cause: Cause, verdict: str = "named") -> str:
    return diagnosis_sentence(MADE["named"].model_copy(update={"verdict": verdict, "causes": (cause,)}))


@pytest.mark.parametrize("verdict", MADE)
def test_it_is_one_sentence_about_the_recording(verdict: str) -> None:
    said = MADE[verdict].sentence
    assert "bench_monday" in said and said.endswith(".") and "\n" not in said
    assert "None" not in said and "nan" not in said


def test_a_named_cause_is_told_with_its_size_and_gain() -> None:
    said = MADE["named"].sentence
    for words in ("load_friction of arm", "coefficient 0.21 [0.18, 0.24]", "31 % lower", "27 to 35 %"):
        assert words in said
    assert "1.1 times what repeated runs differ by" in said


def test_an_ambiguous_one_names_the_others() -> None:
    assert "or stribeck_load_friction[arm], which it cannot tell apart" in MADE["ambiguous"].sentence


def test_a_part_is_called_a_part_and_every_cause_is_told() -> None:
    said = MADE["partly_explained"].sentence
    assert "in part by load_friction of arm" in said and "and command_delay" in said
    assert "what the sensor's stated noise makes" in said


def test_the_gain_of_all_causes_is_told_where_it_is_known() -> None:
    given = MADE["partly_explained"]
    for gain, words in (
        (Gain(value=0.44, low=0.2, high=0.6), "with them the held-out error is 44 % lower"),
        (Gain(value=0.44, low=-0.2, high=0.6), "on held-out data they do not clearly help"),
    ):
        said = diagnosis_sentence(given.model_copy(update={"gain": gain}))
        assert words in said and "delay 0.4 [0.31, 0.4] s at its bound" in said


def test_without_a_cause_none_is_told() -> None:
    for verdict in ("unknown", "none"):
        assert "load_friction" not in MADE[verdict].sentence
    assert "14 % of what is left of arm goes with its position" in MADE["unknown"].sentence
    assert "18.4 nats" in MADE["none"].sentence and "0.0612 rad" in MADE["none"].sentence


@pytest.mark.parametrize(
    "gain, words",
    [
        (Gain(value=0.2, low=None, high=None), "20 % lower"),
        (Gain(value=-0.2, low=None, high=None), "20 % higher"),
        (Gain(value=-0.2, low=-0.3, high=-0.1), "20 % higher"),
        (Gain(value=0.02, low=-0.1, high=0.1), "does not clearly help"),
    ],
)
def test_a_loss_is_not_called_a_gain(gain: Gain, words: str) -> None:
    assert words in sentence_of(MADE["named"].causes[0].model_copy(update={"gain": gain}))


def test_a_value_at_its_bound_says_so_and_a_bare_number_has_no_unit() -> None:
    (cause,) = MADE["named"].causes
    assert "0.24])" in sentence_of(cause)
    (name, estimate), *_ = cause.parameters.items()
    edge = estimate.model_copy(update={"at_bound": True, "unit": "N*m"})
    said = sentence_of(cause.model_copy(update={"parameters": {name: edge}}))
    assert "0.24] N*m at its bound)" in said
