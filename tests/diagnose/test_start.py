"""A simulator to start from brings its effects along: they are fitted with the parameters, and not named again."""

from pathlib import Path

import numpy as np
import pytest

import dynreg
from dynreg.data.recording import Recording
from dynreg.diagnose.account import simulator, with_account
from dynreg.diagnose.diagnose import diagnose, offered, search
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import planned
from dynreg.diagnose.threshold import USUAL, Threshold, known
from dynreg.evidence.lockstep import run
from dynreg.evidence.truth import Hidden, hide, log_of, protocol
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot

OFFERED = ("cogging", "load_friction", "payload")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def begun(robot: Robot, hidden: Hidden) -> SimConfig:
    """The nominal robot with the first effect that is hidden, 20 % too large: somebody has named it before."""
    (one, *_), (values, *_) = hidden.terms, hidden.values
    sizes = {p.name: float(v) for p, v in zip(one.effect.parameters, 1.2 * values, strict=True)}
    return SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal), {one.key: sizes})


def recorded(robot: Robot, *keys: str) -> tuple[Hidden, Recording]:
    hidden = hide(robot, tuple(term(key) for key in keys), "strong", 11)
    return hidden, log_of(robot, hidden, protocol(robot, seed=1, seconds=12.5), engine="mujoco")


def test_where_the_simulator_has_the_only_cause_already_nothing_is_missing(robot: Robot, tmp_path: Path):
    hidden, recording = recorded(robot, "cogging")
    with dynreg.open(tmp_path / "registry") as registry:
        name = registry.ingest(recording, robot, name="hidden").recording
        start = registry.registry.put_simulator(begun(robot, hidden).as_dict())
        given = {"effects": OFFERED, "threshold_runs": 0, "max_causes": 1, "threads": 1}
        found = registry.diagnose(name, start=start, hold_out="test_0", **given)
        calibrated = registry.registry.simulator(found.calibrated_simulator)["effects"]
    assert found.verdict == "none" and not found.causes and found.extended_simulator is None
    assert found.simulator == start, "it was null for every start"
    assert not {"cogging"} & {r.effect for r in found.ranking}
    (size, *_), (true, *_) = calibrated["cogging"].values(), hidden.values[0]
    assert size == pytest.approx(true, rel=0.1), "fitted anew: it began 20 % too large"
    assert any("already has cogging." in note for note in found.notes)


def test_what_else_is_missing_is_named_and_the_extended_simulator_has_both(robot: Robot):
    hidden, recording = recorded(robot, "cogging", "load_friction")
    asked = DiagnosisOptions(hold_out="test_0", effects=OFFERED, max_causes=1, threads=1)
    model, data = pose(robot, recording, asked, begun(robot, hidden))
    problem = run(planned(model, data, offered(model, data, asked)))
    found = run(search(problem, recording, known(Threshold(USUAL, ())), asked)).found
    assert found.accepted == 1 and found.rounds[0].chosen.point.hypothesis.terms[-1].key == "load_friction"
    points = {"start": model.start, "calibrated": found.base, "extended": found.current}
    kinds = {kind: [t.key for t in simulator(model, data, p, asked)[1].terms] for kind, p in points.items()}
    assert kinds == {
        "start": ["cogging"],
        "calibrated": ["cogging"],
        "extended": ["cogging", "load_friction"],
    }
    left = run(model.residuals(list(points.values()), data.sample(np.flatnonzero(data.parts.test))))
    start, calibrated, extended = np.nanmean(left**2, axis=(1, 2, 3))
    assert extended < calibrated < start


def test_of_two_effects_the_one_that_is_missing_is_told_and_the_known_one_keeps_its_size(robot: Robot):
    hidden, recording = recorded(robot, "cogging", "load_friction")
    cogging, friction = (values[0] for values in hidden.values)
    asked = DiagnosisOptions(hold_out="test_0", effects=OFFERED, max_causes=2, threshold_runs=2, threads=1)
    made, seen = run(with_account(diagnose(robot, recording, asked, begun(robot, hidden)), asked))
    (cause,) = seen.causes
    assert made.verdict == "named" and list(cause) == [p.name for p in hidden.terms[1].effect.parameters]
    assert next(iter(cause.values())).value == pytest.approx(friction, rel=0.15)
    _, effects = seen.simulators["extended"]
    assert [t.key for t in effects.terms] == ["cogging", "load_friction"]
    assert effects.values[0][0][0] == pytest.approx(cogging, rel=0.1)
    assert max(made.threshold.scores) < USUAL, "robots that the start has all of lack nothing"


def test_the_simulator_that_a_search_begins_with_is_the_one_that_was_named(robot: Robot):
    hidden, recording = recorded(robot, "cogging")
    start = begun(robot, hidden)
    asked = DiagnosisOptions(threads=1)
    model, data = pose(robot, recording, asked, start)
    values, effects = simulator(model, data, model.start, asked)
    assert robot.space.as_dict(values) == pytest.approx(dict(start.values))
    assert [t.key for t in effects.terms] == ["cogging"]
    assert effects.values[0][0] == pytest.approx(np.array([*start.effects["cogging"].values()]))
