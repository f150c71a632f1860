"""Settings refuse what cannot be, in one line, before anything is simulated."""

import dataclasses

import pytest

from dynreg.errors import UsageError
from dynreg.verbs.diagnose import DiagnoseSettings
from dynreg.verbs.trial import SIZES, TrialSettings

BAD_DIAGNOSES = [
    ({"effects": ("rust",)}, "rust"),
    ({"without": ("rust",)}, "rust"),
    ({"effects": ()}, "no effects"),
    ({"effects": ("payload", "inertia"), "without": ("payload",)}, "payload"),
    ({"max_causes": 0}, "max_causes 0"),
    ({"max_causes": 11}, "max_causes 11"),
    ({"threshold_runs": -1}, "threshold_runs -1"),
    ({"seed": -1}, "seed -1"),
    ({"threads": -1}, "threads -1"),
    ({"start": ""}, "start"),
    ({"joints": ()}, "no joints"),
    ({"windows": 0}, "windows 0"),
]
BAD_TRIALS = [
    ({"hide": "all"}, "hide 'all'"),
    ({"hide": "chosen"}, "chosen"),
    ({"effects": ("payload",)}, "payload"),
    ({"hide": "chosen", "effects": ("backlash[arm",)}, "backlash"),
    ({"hide": "chosen", "effects": ("rust",)}, "rust"),
    ({"size": "huge"}, "huge"),
    ({"hide": "nothing", "size": "strong"}, "nothing is hidden"),
    ({"count": 0}, "count 0"),
    ({"seconds": 0.0}, "seconds 0"),
    ({"seconds": float("nan")}, "seconds nan"),
    ({"seconds": float("inf")}, "seconds inf"),
    ({"seed": -2}, "seed -2"),
]


@pytest.mark.parametrize("given, says", BAD_DIAGNOSES)
def test_bad_settings_of_a_diagnosis_are_refused(given: dict, says: str) -> None:
    with pytest.raises(UsageError, match="expected") as error:
        DiagnoseSettings(**given)
    assert says in error.value.problem and error.value.exit_status == 2


@pytest.mark.parametrize("given, says", BAD_TRIALS)
def test_bad_settings_of_a_trial_are_refused(given: dict, says: str) -> None:
    with pytest.raises(UsageError, match="expected") as error:
        TrialSettings(**given)
    assert says in error.value.problem


def test_a_trial_hides_effects_of_the_sizes_that_effects_have() -> None:
    from dynreg.sim import effects
    from dynreg.truths import causes  # which shares no code with the model

    assert effects.SIZES == SIZES == causes.SIZES


def test_settings_are_frozen_and_can_be_compared() -> None:
    chosen = TrialSettings(hide="chosen", effects=("backlash[arm]", "payload"))
    assert chosen == TrialSettings(hide="chosen", effects=("backlash[arm]", "payload"))
    for settings in (DiagnoseSettings(), chosen):
        with pytest.raises(dataclasses.FrozenInstanceError):
            settings.seed = 1
