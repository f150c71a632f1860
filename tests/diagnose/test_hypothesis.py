"""Which sizes of effects are worth a name."""

import numpy as np
import pytest

from dynreg.diagnose.hypothesis import Hypothesis, worth_naming
from dynreg.sim.effects import term


@pytest.mark.parametrize(
    ("key", "own", "shared"),
    [
        ("asymmetric_friction", [1.0, 0.0], [0.05, 2.0]),
        ("stribeck_friction", [1.0, 0.0, 0.0], [0.05, 2.0, 0.0]),
        ("stribeck_load_friction", [0.0, 0.0, 1.0, 0.0], [0.05, 2.0, 0.05, 0.0]),
    ],
)
def test_what_a_simpler_effect_has_too_is_not_worth_the_name_of_the_larger_one(key, own, shared):
    hypothesis = Hypothesis((term(key),))
    assert worth_naming(hypothesis, np.array(own))
    assert not worth_naming(hypothesis, np.array(shared))
