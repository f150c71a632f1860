"""Diagnoses, trials, the library and experiments as text: the verdict first, and nothing that is not known."""

import made_up_diagnosis
import pytest
from test_tables import text_of

from dynreg.report.diagnosis.words import (
    details,
    diagnosis_steps,
    noise_words,
    size_word,
    standing,
    threshold_words,
    unsaid,
)
from dynreg.report.html import page
from dynreg.report.tables import hint
from dynreg.results import (
    Diagnosis,
    EffectEstimate,
    Gain,
    Noise,
    Threshold,
    TrialTable,
    diagnosis_sentence,
)

VERDICTS = ("named", "ambiguous", "partly_explained", "unknown", "none")


def flat(result) -> str:
    return " ".join(text_of(result).split())


@pytest.mark.parametrize("verdict", VERDICTS)
@pytest.mark.parametrize("held_out", [True, False])
def test_the_verdict_stands_first_and_every_part_is_there(verdict: str, held_out: bool) -> None:
    result = made_up_diagnosis.diagnosis(verdict, held_out=held_out)
    text = flat(result)
    assert text.startswith(" ".join(result.sentence.split()))
    for name in result.parameters:
        assert name in text
    for cause in result.causes:
        assert f"{cause.key} {cause.evidence_nats:.0f} nats" in text
    assert "18.4 nats" in text and result.finding in text and "repeatability" in text
    assert ("held-out test part" in text) == held_out
    assert max(map(len, text_of(result).splitlines())) <= 100
    assert "None" not in text and "nan" not in text


def test_long_names_and_many_channels_stay_within_the_width() -> None:
    result = made_up_diagnosis.diagnosis("partly_explained")
    long = {f"{name}_of_the_upper_left_leg_of_the_robot": e for name, e in result.parameters.items()}
    errors = tuple(
        result.error.model_copy(update={"channel": f"fl_upper_knee_{i}/velocity"}) for i in range(30)
    )
    text = text_of(result.model_copy(update={"parameters": long, "errors": errors}))
    assert max(map(len, text.splitlines())) <= 100
    assert "the first 8 of 30 channels" in text


def test_a_table_of_errors_that_is_cut_begins_with_the_base() -> None:
    result = made_up_diagnosis.diagnosis("named")
    names = [f"leg{i}/position" for i in range(12)] + ["base/x", "base/z"]
    errors = tuple(result.error.model_copy(update={"channel": name}) for name in names)
    text = flat(result.model_copy(update={"errors": errors}))
    assert text.index("base/x") < text.index("base/z") < text.index("leg0/position")
    assert "leg5/position" in text and "leg6/position" not in text


def test_each_hypothesis_is_told_what_became_of_it() -> None:
    result = made_up_diagnosis.diagnosis("ambiguous")
    told = {r.effect: standing(result, r) for r in result.ranking}
    assert told["load_friction"] == "ambiguous"
    assert told["stribeck_load_friction"] == "explains it as well"
    assert told["coulomb_friction"] == "explains less"
    assert told["inertia"] == "below the threshold"
    assert told["payload"] == "below its weak size"


@pytest.mark.parametrize(
    "value, sizes, word",
    [
        (0.01, (0.03, 0.08, 0.2), "below weak"),
        (0.03, (0.03, 0.08, 0.2), "weak"),
        (-0.1, (0.03, 0.08, 0.2), "medium"),
        (5.0, (0.03, 0.08, 0.2), "strong"),
        (30.0, (25.0, 12.5, 6.3), "below weak"),
        (20.0, (25.0, 12.5, 6.3), "weak"),
        (5.0, (25.0, 12.5, 6.3), "strong"),
        (1.0, None, "-"),
    ],
)
def test_sizes_are_those_of_the_effect_also_where_a_lower_limit_is_larger(value, sizes, word) -> None:
    assert size_word(EffectEstimate(value=value, low=0, high=1, unit="1", sizes=sizes)) == word


def test_what_the_log_cannot_tell_is_told() -> None:
    said = " ".join(unsaid(made_up_diagnosis.diagnosis("partly_explained", held_out=False)))
    for words in (
        "sensor_delay explains it as well as command_delay",
        "delay of command_delay lies on the edge",
        "viscous_friction lies on the edge",
        "No run was repeated",
        "Nothing was held out",
    ):
        assert words in said
    sure = made_up_diagnosis.diagnosis("named")
    inside = {n: e for n, e in sure.parameters.items() if not e.at_bound}
    assert unsaid(sure.model_copy(update={"parameters": inside})) == ()


@pytest.mark.parametrize("nats", [21.0, 3.0])
def test_what_explains_a_part_is_said_to_do_so_with_its_nats_and_what_explains_nothing_is_not_named(
    nats: float,
):
    result = made_up_diagnosis.diagnosis("partly_explained")
    first, delay = result.causes
    less = {
        "causes": (first, delay.model_copy(update={"equivalent": ()})),
        "ranking": tuple(
            r.model_copy(update={"score_nats": nats}) if r.effect == "sensor_delay" else r
            for r in result.ranking
        ),
    }
    told = result.model_copy(update=less)
    said = " ".join(unsaid(told))
    assert "explains it as well" not in flat(told) and "as well" not in said
    part = "sensor_delay explains a part: 21 of the 44 nats"
    assert (part in said) == (nats > told.threshold_nats) == ("sensor_delay" in said)


def test_commands_are_offered_only_for_what_commands_can_tell_apart() -> None:
    (line,) = [s for s in diagnosis_steps(made_up_diagnosis.diagnosis("ambiguous")) if "excite" in s]
    assert "--for 'load_friction[arm],stribeck_load_friction[arm]'" in line
    partly = diagnosis_steps(made_up_diagnosis.diagnosis("partly_explained"))
    assert not any("excite" in step for step in partly), "no commands tell the exact group apart"


def test_steps_follow_the_verdict() -> None:
    steps = diagnosis_steps(made_up_diagnosis.diagnosis())
    assert any("dynreg export eeee" in s and "--as robot" in s for s in steps)
    unknown = diagnosis_steps(made_up_diagnosis.diagnosis("unknown", held_out=False))
    assert "Nothing was held out. Record more episodes, or use --hold-out." in unknown
    assert any("dynreg doctor" in s for s in unknown) and any("--hold-out" in s for s in unknown)
    assert not any("export" in s for s in unknown)
    assert diagnosis_steps(made_up_diagnosis.diagnosis("none")) == ()


@pytest.mark.parametrize("verdict", ["unknown", "none"])
def test_a_calibrated_simulator_that_is_clearly_better_is_offered(verdict: str) -> None:
    found = made_up_diagnosis.diagnosis(verdict)
    better = found.model_copy(update={"over_start": Gain(value=0.4, low=0.3, high=0.5)})
    assert any("dynreg export caca" in s and "--as robot" in s for s in diagnosis_steps(better))
    for gain in (
        Gain(value=0.1, low=-0.1, high=0.3),
        Gain(value=0.4, low=None, high=None),
        Gain(value=-0.3, low=-0.4, high=-0.2),
    ):
        unsure = found.model_copy(update={"over_start": gain})
        assert not any("export" in step for step in diagnosis_steps(unsure))


def test_the_extended_simulator_is_not_advised_where_no_cause_clearly_helps() -> None:
    found = made_up_diagnosis.diagnosis("ambiguous")
    (cause,) = found.causes
    unclear = cause.model_copy(update={"gain": Gain(value=0.004, low=-0.01, high=0.01)})
    told = found.model_copy(update={"causes": (unclear,)})
    steps = diagnosis_steps(told)
    assert not any("export" in s or "excite" in s for s in steps)
    assert steps[-1].endswith("dynreg compare bench_monday --with nominal,diagnosed")
    better = told.model_copy(update={"calibration": Gain(value=0.4, low=0.3, high=0.5)})
    assert "dynreg export caca" in diagnosis_steps(better)[-1]


def channels(*calibrated: float, **told) -> Diagnosis:
    """A diagnosis whose simulators err by 1 and by these in so many joints' positions."""
    found = made_up_diagnosis.diagnosis("none")
    errors = tuple(
        found.error.model_copy(update={"channel": f"joint{i}/position", "nominal": 1.0, "calibrated": error})
        for i, error in enumerate(calibrated, start=1)
    )
    return found.model_copy(update={"errors": errors, "engine": "mujoco", **told})


@pytest.mark.parametrize("shown", [flat, lambda result: " ".join(page(result).split())])
def test_a_calibrated_simulator_that_is_worse_on_most_channels_is_told_with_the_likely_reason(shown) -> None:
    """The sum was better, by one joint of seven: nothing said that the others were worse."""
    text = shown(channels(0.2, 1.2, 1.1, 1.3, 1.01))
    assert "On 4 of 5 channels the calibrated simulator errs more than the nominal simulator" in text
    assert "Halve `timestep` in robot.toml" in text and "dynreg robots check FOLDER" in text
    assert "timestep" not in shown(channels(0.2, 1.2, 1.1, engine="kinematic"))
    extended = channels(0.2, 0.9, 0.8)
    errors = tuple(e.model_copy(update={"extended": 1.2}) for e in extended.errors)
    assert "On 3 of 3 channels the extended simulator errs more" in shown(
        extended.model_copy(update={"errors": errors})
    )
    for fewer in ((0.2, 1.2, 1.1, 0.9), (0.2, 1.01, 1.02, 1.03), (1.3,)):
        assert not any("errs more" in line for line in details(channels(*fewer)))


def test_a_simulator_that_makes_most_channels_worse_is_not_to_be_exported() -> None:
    """The parameter that helped is to be set alone."""
    helped = made_up_diagnosis.diagnosis().parameters
    name = next(iter(helped))
    parameters = helped | {name: helped[name].model_copy(update={"value": 4.5, "share": 0.9})}
    gain = {"over_start": Gain(value=0.24, low=0.2, high=0.3), "parameters": parameters}
    worse = channels(0.2, 1.2, 1.1, 1.3, **gain)
    assert any(f"Set {name} = 4.5 as `nominal` in robot.toml" in step for step in diagnosis_steps(worse))
    assert not any("Export" in step for step in diagnosis_steps(worse))
    assert not any("Set " in step for step in diagnosis_steps(channels(0.2, 0.9, 0.8, **gain)))
    assert hint(worse) == "dynreg report @last"


def test_the_threshold_says_where_it_comes_from() -> None:
    result = made_up_diagnosis.diagnosis()
    assert "by 20 simulations" in threshold_words(result) and "earlier diagnosis" in threshold_words(result)
    usual = result.model_copy(update={"threshold": Threshold(runs=0)})
    assert threshold_words(usual) == "A cause needs 18.4 nats, the usual threshold."
    assert unsaid(usual)[-1] == (
        "The threshold is the usual one. Leave out --threshold-runs 0 to let simulations of this robot set it."
    )


def test_the_residual_is_compared_with_its_floor() -> None:
    given = {"channel": "q", "unit": "rad", "left": 0.01, "floor": 0.0, "basis": "stated_noise"}
    assert "is not known" in noise_words(Noise(**given, ratio=None))
    white = noise_words(Noise(**given | {"floor": 0.005}, ratio=2.0, white=True))
    assert "2 times the error from the sensor's stated noise" in white and "looks like white noise" in white
    assert "no run was repeated" in noise_words(None)


def test_trials_show_rates_confusions_and_the_robots() -> None:
    text = flat(made_up_diagnosis.trials())
    assert text.startswith("servo_pendulum: 8 of 10 hidden effects named right, 1 of 10 named wrong")
    for words in ("8 of 10 49 to 96 %", "load_friction stribeck_friction 1", "nothing payload 1", "0.97"):
        assert words in text
    assert "one by one" not in text
    few = TrialTable.of("leg", made_up_diagnosis.trials().trials[:3])
    assert "one by one" in flat(few) and "false alarm" not in flat(few)
    assert "no trials" in flat(TrialTable.of("leg", []))


def test_a_part_of_the_cause_is_not_called_a_confusion() -> None:
    partly = made_up_diagnosis.trial().model_copy(update={"right": False, "verdict": "partly_explained"})
    assert "load_friction (explains only a part)" in flat(TrialTable.of("leg", [partly]))


def test_the_library_shows_what_fits_and_why_the_rest_does_not() -> None:
    text = flat(made_up_diagnosis.effects_list())
    assert "effects of servo_pendulum" in text and "0.01 / 0.03 / 0.08 tau" in text
    assert "command_delay, sensor_delay a hardware loop-back" in text
    assert (
        "effects that cannot act on servo_pendulum" in text
        and "nothing in the model can touch anything" in text
    )
    assert "ground_friction contact" in flat(made_up_diagnosis.effects_list(None))


def test_near_effects_are_told_when_asked() -> None:
    from dynreg.cli.output import console
    from dynreg.report.effects import tables

    out = console()
    with out.capture() as captured:
        out.print(tables(made_up_diagnosis.effects_list(), near=True))
    assert "stribeck_friction" in captured.get()
    assert "stribeck_friction" not in flat(made_up_diagnosis.effects_list())


def test_an_experiment_tells_what_it_separates_and_uses() -> None:
    text = flat(made_up_diagnosis.experiment())
    assert "separate payload from coulomb_friction by 61 nats (expected)" in text
    assert "14 nats" in text and "arm/target -3.14 3.14 -1.9 2.2 rad" in text and "ramps" in text


def test_a_protocol_tells_the_operator_and_where_least_shows() -> None:
    text = flat(made_up_diagnosis.protocol())
    assert "25 s of commands for one leg of quadruped" in text and "fl fl.csv 25 182" in text
    assert "on a stand" in text


def beside_the_start(value: float, low: float | None, high: float | None, **told) -> Diagnosis:
    """A diagnosis whose simulator was held against that at its start."""
    result = made_up_diagnosis.diagnosis().model_copy(
        update={"over_start": Gain(value=value, low=low, high=high), **told}
    )
    return result.model_copy(update={"sentence": diagnosis_sentence(result)})


@pytest.mark.parametrize("low, high", [(-0.9, -0.2), (None, None)])
def test_a_nominal_simulator_that_predicts_better_is_warned_of_everywhere(low, high) -> None:
    """The gain was told against the calibrated simulator alone, where the nominal one was better than both."""
    worse = beside_the_start(-0.56, low, high)
    assert worse.sentence.endswith(", but the nominal simulator predicts the held-out part better.")
    text, html = flat(worse), " ".join(page(worse).split())
    for shown in (text, html):
        assert "56 % higher" in shown and "do not use it" in shown
        assert "Do not use the extended simulator: the nominal simulator predicts" in shown
    assert 'role="alert"' in html and not any("dynreg export" in s for s in diagnosis_steps(worse))
    assert hint(worse).startswith(
        "dynreg compare bench_monday --with nominal,diagnosed  # do not use the extended"
    )
    assert worse.to_dict()["over_start"]["value"] == -0.56 and "nominal" in worse.to_dict()["sentence"]


def test_what_is_not_clearly_better_is_said_and_what_is_better_is_not() -> None:
    unclear = beside_the_start(0.02, -0.1, 0.12)
    assert "Against the nominal simulator, the extended simulator's error" in flat(unclear)
    assert "no clear difference" in flat(unclear) and hint(unclear) == "dynreg report @last"
    assert any("dynreg export" in s for s in diagnosis_steps(unclear))
    better = beside_the_start(0.3, 0.2, 0.4)
    assert "Against" not in flat(better) and 'role="alert"' not in page(better)
    other = beside_the_start(-0.3, -0.4, -0.2, start="34" * 32)
    assert "the simulator at the start predicts the held-out part better" in other.sentence
    assert f"--with {'34' * 6},diagnosed" in hint(other)


def test_what_was_held_out_is_said() -> None:
    text = flat(made_up_diagnosis.diagnosis())
    assert "Held out: kp400, kp400_again, of 6 episodes." in text
    assert "Held out: kp400, kp400_again" in page(made_up_diagnosis.diagnosis())
    one = {"fit": ("run[0]", "run[2]"), "select": ("run[3]",), "test": ("run[1]", "run[4]")}
    pieces = made_up_diagnosis.diagnosis().model_copy(update={"parts": one})
    assert "Held out: run[1], run[4], pieces of the one run that was fitted as well." in flat(pieces)
    assert "How it does in another run was not tested." in flat(pieces)
    assert "Held out" not in flat(made_up_diagnosis.diagnosis(held_out=False))


@pytest.mark.parametrize("shown", [flat, lambda result: " ".join(page(result).split())])
def test_a_value_that_was_not_fitted_has_no_interval(shown) -> None:
    result = made_up_diagnosis.diagnosis("named")
    stayed = result.parameters["tip_mass"].model_copy(update={"value": 0.49, "low": None, "high": None})
    moved = stayed.model_copy(update={"value": 0.7, "pulled_sigma": None})
    older = moved.model_copy(update={"low": 0.7, "high": 0.7})  # as earlier versions wrote it
    for given in (moved, older):
        text = shown(result.model_copy(update={"parameters": {"tip_mass": given, "resistance": stayed}}))
        assert "not fitted" in text and "0.7 to 0.7" not in text and "[0.7, 0.7]" not in text
    assert "Not fitted, as in robot.toml: resistance." in flat(
        result.model_copy(update={"parameters": {"tip_mass": moved, "resistance": stayed}})
    )


@pytest.mark.parametrize("verdict", VERDICTS)
def test_intervals_are_marked_where_the_model_is_not_complete(verdict: str) -> None:
    result = made_up_diagnosis.diagnosis(verdict)
    for text in (flat(result), " ".join(page(result).split()), " ".join(result._repr_html_().split())):
        assert result.reliance in text
        assert ("Do not rely on these intervals" in text) == (verdict == "unknown")
        assert ("only if the model is complete" in text) == (verdict in ("unknown", "partly_explained"))
    assert ("value [unreliable interval]" in flat(result)) == (verdict == "unknown")
