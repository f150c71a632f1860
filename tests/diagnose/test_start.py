"""A simulator to start from brings its effects along: they are fitted with the parameters, and not named again."""

import numpy as np
import pytest

import dynreg
from dynreg.diagnose.asked import Asked
from dynreg.diagnose.pose import pose
from dynreg.diagnose.truth import Hidden, hide, log_of, protocol
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot

HELD = "test_0,test_1"
OFFERED = ("cogging", "load_friction", "payload", "command_delay")
KEYS = ("cogging", "load_friction")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def known(robot: Robot, hidden: Hidden) -> SimConfig:
    """The nominal robot with the first effect that is hidden, 20 % too large: somebody has named it before."""
    (one, *_), (values, *_) = hidden.terms, hidden.values
    sizes = {p.name: float(v) for p, v in zip(one.effect.parameters, 1.2 * values, strict=True)}
    return SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal), {one.key: sizes})


@pytest.fixture(scope="module")
def found(robot: Robot, tmp_path_factory):
    """Diagnoses that start from a simulator with the first effect, of robots that hide so many effects."""
    out = {}
    with dynreg.open(tmp_path_factory.mktemp("registry")) as registry:
        for many in (1, 2):
            hidden = hide(robot, tuple(term(key) for key in KEYS[:many]), "strong", 11)
            recording = log_of(robot, hidden, protocol(robot, seed=1, seconds=25.0), engine="mujoco")
            name = registry.ingest(recording, robot, name=f"hidden {many}").recording
            registry.registry.put_robot(robot.folder, robot.hash, robot.name)
            start = registry.registry.put_simulator(known(robot, hidden).as_dict())
            told = registry.diagnose(
                name, start=start, hold_out=HELD, effects=OFFERED, threshold_runs=0, max_causes=1, threads=1
            )
            made = [told.calibrated_simulator, told.extended_simulator]
            out[many] = hidden, told, [registry.registry.simulator(s)["effects"] if s else None for s in made]
    return out


def test_where_the_simulator_has_the_only_cause_already_nothing_is_missing(found):
    hidden, told, (calibrated, extended) = found[1]
    assert told.verdict == "none" and not told.causes
    assert set(calibrated) == {"cogging"} and extended is None
    assert not {"cogging"} & {r.effect for r in told.ranking}
    (size, *_), (true, *_) = calibrated["cogging"].values(), hidden.values[0]
    assert size == pytest.approx(true, rel=0.1), "fitted anew: it began 20 % too large"
    assert any("cogging came with the simulator" in note for note in told.notes)


def test_what_else_is_missing_is_named_and_the_extended_simulator_has_both(found):
    _, told, (calibrated, extended) = found[2]
    assert [c.effect for c in told.causes] == ["load_friction"] and told.verdict == "named"
    assert set(calibrated) == {"cogging"} and set(extended) == {"cogging", "load_friction"}
    assert told.error.extended < told.error.calibrated < told.error.nominal


def test_the_simulator_that_a_search_begins_with_is_the_one_that_was_named(robot: Robot):
    hidden = hide(robot, (term("cogging"),), "strong", 11)
    recording = log_of(robot, hidden, protocol(robot, seed=1, seconds=12.5))
    start = known(robot, hidden)
    problem, split = pose(robot, recording, Asked(threads=1), start)
    values, effects = problem.simulator(problem.start, split.chosen)
    assert robot.space.as_dict(values) == pytest.approx(dict(start.values))
    assert [t.key for t in effects.terms] == ["cogging"]
    assert effects.values[0][0] == pytest.approx(np.array([*start.effects["cogging"].values()]))
