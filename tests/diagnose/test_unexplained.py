"""What no effect of the library explains is told by the signals that it depends on, on the whole way."""

from dataclasses import replace

import numpy as np
import pytest

import dynreg
from dynreg.data.recording import Recording
from dynreg.diagnose.one_step import beside_each
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.unexplained import unexplained
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.lockstep import counted, run
from dynreg.evidence.point import Point
from dynreg.evidence.truth import Hidden, hide, log_of, protocol
from dynreg.report.diagnosis.words import residual_words
from dynreg.results import diagnosis_details
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot

HELD = "test_0,test_1,test_2,test_3"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def recorded(robot: Robot, key: str, value: float | None = None) -> tuple[Hidden, Recording]:
    """The log of a nominal robot with one effect at a strong size, or of the given value."""
    hidden = hide(robot, (term(key),), "strong", 11)
    hidden = replace(hidden, parameters=robot.space.nominal)
    if value is not None:
        hidden = replace(hidden, values=(np.array([value]),))
    return hidden, log_of(robot, hidden, protocol(robot, seed=1, reach=0.45), engine="joint")


def posed(robot: Robot, recording: Recording, hold_out: str | None = HELD) -> State:
    """A search that has found nothing yet and stands at the nominal simulator."""
    model, data = pose(robot, recording, DiagnosisOptions(hold_out=hold_out, threads=1))
    return State(model, data.sample(data.fit), model.start, model.start)


def test_a_cause_that_the_library_lacks_is_told_by_its_signal(robot, tmp_path):
    """Cogging depends on the position; here it is left out of the library."""
    _, recording = recorded(robot, "cogging")
    with dynreg.open(tmp_path / "registry") as registry:
        name = registry.ingest(recording, robot, name="hidden").recording
        found = registry.diagnose(name, hold_out=HELD, effects=["payload"], threshold_runs=0, threads=1)
    assert found.verdict == "unknown" and not found.causes
    (left,) = found.rest
    assert left.joint == "arm" and left.unit == "rad/s^2" and left.trajectories == 16
    assert left.told > 0.3 > left.chance
    assert found.residual[0].signal == "position" and found.residual[0].share > 0.5 * left.told
    assert any(line.startswith("The position of arm predicts") for line in diagnosis_details(found))
    (words,) = residual_words(found)
    assert f"predict {100 * left.told:.0f} % of it on unseen data: position" in words


@pytest.mark.parametrize("verdict", ["named", "ambiguous", "none"])
def test_where_nothing_is_left_nothing_is_asked(robot, verdict):
    assert run(counted(unexplained(posed(robot, recorded(robot, "cogging")[1]), verdict))) == (None, 0)


def test_it_is_told_of_the_simulator_as_it_is_stored_however_finely_the_search_ran(robot):
    found = posed(robot, recorded(robot, "cogging")[1])
    (asked,) = next(unexplained(replace(found, model=replace(found.model, finely=2.0)), "unknown"))
    assert asked.robot.file.robot.timestep == robot.file.robot.timestep


def test_what_a_delay_remembers_is_no_dependence(robot):
    """A simulator with the right delay leaves next to nothing to tell, though each row is a start of its own."""
    hidden, recording = recorded(robot, "command_delay", 0.025)
    found = posed(robot, recording)
    c = found.model.coordinates
    size = c.effect_coordinates(hidden.terms[0], hidden.values[0])
    right = Point(Hypothesis(hidden.terms), np.zeros(len(c)), size)
    without = run(unexplained(found, "unknown"))[0]
    with_delay = run(unexplained(replace(found, current=right), "partly_explained"))[0]
    assert with_delay.explained < 0.05 and with_delay.size < 0.7 * without.size and without.explained > 0.2


def test_a_state_that_was_never_measured_is_no_start():
    robot = load_robot("quadruped")
    hidden = hide(robot, (term("payload"),), "weak", 1)
    recording = log_of(robot, hidden, protocol(robot, seed=1, seconds=12.5), engine=None)
    base = [i for i, c in enumerate(recording.channels) if c.name.startswith("base")]
    blank = lambda e: np.where(np.isin(np.arange(e.values.shape[1]), base), np.nan, e.values)  # noqa: E731
    episodes = tuple(replace(e, values=blank(e)) for e in recording.episodes)
    recording = Recording(recording.channels, episodes, measured=False)
    assert run(unexplained(posed(robot, recording, None), "unknown")) is None


def test_what_two_neighbours_share_is_pointed_at_by_the_other_ones_signal():
    """A motor that turns with two joints brakes one by the speed of the other, which no signal of its own tells."""
    arm = load_robot("two_joint_arm")
    first, second = arm.driven
    assert beside_each(arm) == {first: (second,), second: (first,)}
    coupled = term(f"cable_coupling[{first},{second}]")
    hidden = replace(hide(arm, (coupled,), "strong", 4), parameters=arm.space.nominal)
    log = log_of(arm, hidden, protocol(arm, seed=1, seconds=25.0))
    model, data = pose(arm, log, DiagnosisOptions(hold_out="test_0,test_1", threads=1))
    state = State(model, data.sample(data.fit), model.start, model.start)
    left = {one.joint: one for one in run(unexplained(state, "unknown"))}
    rows = {row.signal: row.share for row in left[first].rows}
    assert sum(share for name, share in rows.items() if name.startswith(f"{second}/")) > 0.1
