"""Results whose effects an earlier version named otherwise: their simulators open, their ranges say what to do."""

from types import SimpleNamespace

import made_up_diagnosis
import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.results.diagnosis import EffectEstimate
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.robot import load_robot
from dynreg.verbs.ranges_document import opened


def test_a_payload_told_as_a_share_of_a_body_is_not_drawn_as_kilograms() -> None:
    robot = load_robot("servo_pendulum")
    config = SimConfig(
        robot.hash, robot.name, robot.space.as_dict(robot.space.nominal), {"payload": {"share": 0.2}}
    )
    np.testing.assert_allclose(terms_of(config, robot).values[0], [[0.2 * 0.49]])
    answer = made_up_diagnosis.diagnosis()
    share = {"share": EffectEstimate(value=0.2, low=0.18, high=0.22, unit="1")}
    cause = answer.causes[0].model_copy(update={"effect": "payload", "joints": (), "parameters": share})
    old = answer.model_copy(update={"causes": (cause,), "posterior": None})
    with pytest.raises(
        UsageError, match=r"payload with \['share'\].*expected its mass; diagnose the recording again"
    ):
        opened("old", old, SimpleNamespace(robot=robot, config=config))
