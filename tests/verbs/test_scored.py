"""A trial's answer is held against what was hidden: the cause, and the joint that it sits in."""

import numpy as np
import pytest

from dynreg.diagnose.trial import joint_right, same_cause
from dynreg.evidence.truth import Hidden
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot


@pytest.mark.parametrize(
    ("hides", "named", "right"),
    [
        ("backlash[knee]", "backlash[knee]", True),
        ("backlash[knee]", "joint_elasticity[knee]", True),  # the joint alone is asked for
        ("backlash[knee]", "backlash[hip_roll]", False),
        ("backlash[knee]", None, False),
        ("encoder_offset[hip_roll]", "gravity_tilt", True),
        ("encoder_offset[knee]", "gravity_tilt", False),
        ("gravity_tilt", "encoder_offset[hip_roll]", None),
    ],
)
def test_the_joint_is_right_where_the_cause_sits_or_no_commands_tell(hides, named, right):
    leg, hidden = load_robot("leg"), Hidden((term(hides),), (np.ones(1),), np.zeros(0), seed=1)
    assert joint_right(leg, hidden, named and term(named)) is right


def test_the_same_cause_is_the_term_and_its_exact_group_at_its_joint():
    leg = load_robot("leg")
    assert same_cause(leg, term("gravity_tilt")) == {"gravity_tilt", "encoder_offset[hip_roll]"}
    assert same_cause(leg, term("encoder_offset[knee]")) == {"encoder_offset[knee]"}
    assert same_cause(leg, term("force_offset[knee]")) == {"force_offset[knee]", "asymmetric_friction[knee]"}
