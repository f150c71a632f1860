"""An exported simulator that was fitted joint by joint: what its folder says of MuJoCo."""

import re
from pathlib import Path

import pytest

import dynreg
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.session import Session
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot
from dynreg.verbs.in_mujoco import in_mujoco
from dynreg.verbs.simulators import named

QUICK = {"effects": ["coulomb_friction"], "max_causes": 1, "threshold_runs": 0, "threads": 1, "ranker": "off"}


@pytest.fixture(scope="module")
def registry(tmp_path_factory: pytest.TempPathFactory) -> Session:
    robot = load_robot("servo_pendulum")
    hidden = hide(robot, (term("coulomb_friction"),), "strong", 5)
    with dynreg.open(tmp_path_factory.mktemp("alone") / "registry") as session:
        log = log_of(robot, hidden, protocol(robot, seed=5, seconds=12.5), engine="mujoco")
        session.ingest(log, robot, name="bench")
        yield session


def test_a_folder_says_where_it_was_fitted_and_how_mujoco_differs_on_the_held_out_part(
    registry: Session, tmp_path: Path
) -> None:
    found = registry.diagnose("bench", engine="joint", **QUICK)
    warning = registry.export_robot(found.extended_simulator, tmp_path / "servo").warning
    said = re.search(
        r"fitted in the joint engine.* arm/position is ([\d.e-]+) rad.* ([\d.e-]+) rad in MuJoCo", warning
    )
    assert said, warning
    alone, together = map(float, said.groups())
    error = next(e for e in found.errors if e.channel == "arm/position")
    assert alone == pytest.approx(error.extended, rel=0.02), (
        "the error that the diagnosis tells of the same windows"
    )
    assert alone < together < error.calibrated, "MuJoCo's time step and softer friction cost some of the gain"


def test_a_simulator_that_was_never_fitted_has_nothing_to_say(registry: Session) -> None:
    robot = load_robot("servo_pendulum")
    config = SimConfig.of(robot, robot.space.nominal)
    stored = registry.registry.put_simulator(config.as_dict() | {"lineage": {"kind": "by hand"}})
    assert in_mujoco(registry.registry, named(registry.registry, stored)) == ""
