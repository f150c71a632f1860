"""Diagnoses as documents: what they refuse, and what a notebook shows of them."""

import html

import made_up_diagnosis
import pytest
from pydantic import ValidationError

from dynreg.results import Diagnosis, EffectsList, Gain, cause_key

VERDICTS = ("named", "ambiguous", "partly_explained", "unknown", "none")


@pytest.mark.parametrize("verdict", VERDICTS)
@pytest.mark.parametrize("held_out", [True, False])
def test_every_verdict_comes_back_from_its_json(verdict: str, held_out: bool) -> None:
    told = made_up_diagnosis.diagnosis(verdict, held_out=held_out)
    assert Diagnosis.model_validate_json(told.to_json()) == told


@pytest.mark.parametrize(
    "verdict, causes",
    [("named", ()), ("unknown", None), ("none", made_up_diagnosis.diagnosis().causes)],
)
def test_a_verdict_that_its_causes_do_not_bear_is_refused(verdict: str, causes: tuple | None) -> None:
    if causes is None:  # a first cause of another verdict
        verdict, causes = "ambiguous", made_up_diagnosis.diagnosis().causes
    document = made_up_diagnosis.diagnosis().to_dict()
    document |= {"verdict": verdict, "causes": [c.to_dict() for c in causes]}
    with pytest.raises(ValidationError, match="verdict"):
        Diagnosis.model_validate(document)


def test_the_document_has_the_keys_that_were_promised() -> None:
    document = made_up_diagnosis.diagnosis("ambiguous").to_dict()
    assert document["schema"] == "dynreg/diagnosis/1"
    promised = "robot recording simulator verdict causes ranking parameters error where experiments"
    assert set(document) >= {*promised.split(), "extended_simulator"}
    (cause,) = document["causes"]
    promised = "effect joints verdict parameters evidence_nats equivalent separate_by gain"
    assert set(cause) >= set(promised.split())
    assert set(cause["parameters"]["coefficient"]) >= {"value", "low", "high", "unit"}
    assert set(document["ranking"][0]) >= {"effect", "joints", "score_nats"}
    promised = "nominal value low high unit pulled_sigma"
    assert set(document["parameters"]["tip_mass"]) >= set(promised.split())
    promised = "channel unit metric nominal calibrated extended repeatability part unpenalised held followed"
    assert set(document["error"]) == set(promised.split())
    assert set(document["where"][0]) >= {"channel", "regime", "share"}


def test_intervals_that_are_wider_for_what_is_left_say_so() -> None:
    told = made_up_diagnosis.diagnosis("named")
    for white in (True, None, False):
        result = told.model_copy(update={"noise": told.noise.model_copy(update={"white": white})})
        assert result.reliance.startswith("These intervals hold if the model is complete.")
        assert ("no white noise" in result.reliance) == (white is False)
    assert "no white noise" not in told.model_copy(update={"noise": None}).reliance


def test_keys_of_causes_are_those_of_the_library() -> None:
    from dynreg.sim.effects import term

    for effect, joints in (("load_friction", ()), ("backlash", ("arm",)), ("backlash", ("hip", "knee"))):
        assert term(cause_key(effect, joints)).key == cause_key(effect, joints)


def test_a_notebook_shows_sentence_causes_ranking_parameters_and_errors() -> None:
    result = made_up_diagnosis.diagnosis("partly_explained")
    shown = html.unescape(result._repr_html_())
    assert result.sentence in shown
    for words in (
        "load_friction[arm]",
        "command_delay",
        "18.4 nats",
        "torque_constant",
        "arm/velocity",
        "2.6",
    ):
        assert words in shown
    assert shown.count("<table") == 4
    assert len(result.to_frame()) == len(result.ranking)


def test_a_notebook_escapes_what_a_log_was_named() -> None:
    result = made_up_diagnosis.diagnosis().model_copy(update={"sentence": "<script>x</script>"})
    assert "<script" not in result._repr_html_()


def test_a_diagnosis_without_causes_shows_no_empty_table_of_them() -> None:
    shown = made_up_diagnosis.diagnosis("none")._repr_html_()
    assert shown.count("<table") == 3 and "causes" not in shown


def test_the_library_says_whether_a_robot_can_have_an_effect_only_where_one_is_named() -> None:
    for robot in ("servo_pendulum", None):
        listed: EffectsList = made_up_diagnosis.effects_list(robot)
        assert all((e.applies is None) == (robot is None) for e in listed.effects)


def test_a_gain_below_nothing_is_a_higher_error_in_the_line_of_a_list() -> None:
    found = made_up_diagnosis.diagnosis("named")
    worse = found.model_copy(update={"gain": Gain(value=-0.05, low=-0.08, high=-0.01)})
    assert worse.brief().endswith("named load_friction[arm], held-out error 5 % higher")
