"""A table of corrections that t-tests keep true: hidden gains are found, a robot that changes is followed."""

from dataclasses import dataclass

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.errors import LogError, SimulationError
from dynreg.methods import displaced as by_displaced
from dynreg.methods.answer import Answer
from dynreg.methods.by_ttest import followed
from dynreg.methods.calibrator import Evidence, Limits, Question
from dynreg.methods.displaced import Samples, Simulators, displaced, off
from dynreg.methods.judged import replay_errors
from dynreg.methods.table import METHODS
from dynreg.replay.data import Data, data
from dynreg.rng import stream
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.real import SimulatedRobot, sensed
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

ROBOT = load_robot("diffdrive")
NOMINAL = ROBOT.space.nominal


@dataclass(frozen=True)
class Hidden:
    """What is not as robot.toml says: a factor on both wheels' radius and one on the track, and the difference."""

    radius: float = 1.0
    track: float = 1.0
    difference: float = 0.0


def held(*hidden: Hidden, seed: int, episodes: int) -> Data:
    """So many episodes of each, of 40 random speeds held for half a second; the last 2 are held out.

    The robot moves by another engine than the one that replays it, and has sensor noise.
    """
    rng, nominal = stream(seed, "held"), ROBOT.space.as_dict(NOMINAL)
    every = []
    for one in hidden:
        told = rng.uniform(-10.0, 10.0, (episodes, 40, 2)).repeat(25, axis=1)
        own = {"wheel_radius": one.radius * 0.021, "track": one.track * 0.0884}
        values = ROBOT.space.from_dict(nominal | own)[None]
        terms = Terms((term("wheel_gain"),), (np.array([[one.difference]]),))
        run = Run(told, initial=np.zeros((episodes, len(ROBOT.channels))), period=1.0 / ROBOT.rate)
        states = rollout(ROBOT, values, run, engine="unicycle", terms=terms, threads=1).states[0]
        rows = np.concatenate([told, told[:, -1:]], axis=1)
        every += [*np.concatenate([sensed(ROBOT, states, rng), rows], axis=2)]
    channels = tuple(Channel(c.name, c.unit) for c in (*ROBOT.file.channels, *ROBOT.file.actions))
    time = np.arange(len(every[0])) / ROBOT.rate
    named = tuple(Episode(f"e{i}", time, values) for i, values in enumerate(every))
    recording = Recording(channels, named, measured=False)
    return data(ROBOT, recording, ",".join(e.name for e in named[-2:]))


def fitted(cut: Data, budget: int | None = None) -> Answer:
    return METHODS["ttest"].made().fit(Question(cut), Evidence(), Limits(budget, threads=1))


def errors(cut: Data, found: Answer) -> np.ndarray:
    """(2, 2) of the nominal simulator and the answer, on the train and the test part."""
    answer = SimConfig.of(ROBOT, found.final.values, found.final.effects)
    return replay_errors(cut, [SimConfig.of(ROBOT, cut.start), answer], threads=1)


@pytest.fixture(scope="module")
def uneven() -> Data:
    """Whose right wheel is faster, under the usual commands, which hardly ever hold still."""
    actions = excitation(ROBOT, seed=1, episodes=8, steps=150).actions
    real = SimulatedRobot(ROBOT, NOMINAL, (term("wheel_gain"),), (np.array([0.15]),), seed=1, threads=1)
    told = [real.run(commands, ROBOT.rate, f"e{i}").recording for i, commands in enumerate(actions)]
    return data(ROBOT, Recording(told[0].channels, tuple(one.episodes[0] for one in told), measured=False))


def test_a_hidden_gain_of_a_wheel_is_found_and_predicts_what_is_held_out(uneven: Data) -> None:
    found = fitted(uneven)
    nominal, answer = errors(uneven, found)
    assert (answer < 0.3 * nominal).all() and found.causes == ("wheel_gain",)
    assert found.final.effects["wheel_gain"]["difference"] == pytest.approx(0.15, abs=0.01)
    assert found.final.figures["explained"] > 0.95


def test_each_episode_is_a_version_that_came_from_the_one_before(uneven: Data) -> None:
    found = fitted(uneven)
    held_out = {*uneven.named["test"]}
    kept = tuple(e.name for e in uneven.recording.episodes if e.name not in held_out)
    assert tuple(v.stage for v in found.versions) == kept == found.final.episodes
    assert [v.parent for v in found.versions] == [None, *range(len(kept) - 1)]
    assert found.versions[0].after < found.versions[0].before and found.ended == "episodes"
    assert found.versions[0].figures["tests"] == 0, "the first samples are held against nothing"


def test_gains_of_both_wheels_and_of_turns_are_the_radius_and_the_track() -> None:
    cut = held(Hidden(radius=0.96, track=1.05), seed=2, episodes=6)
    found = fitted(cut)
    values = ROBOT.space.as_dict(found.final.values)
    assert values["wheel_radius"] == pytest.approx(0.96 * 0.021, rel=0.01)
    assert values["track"] == pytest.approx(1.05 * 0.0884, rel=0.01)
    assert errors(cut, found)[1, 1] < 0.3 * errors(cut, found)[0, 1]


def test_a_parameter_that_begins_at_its_upper_bound_moves_from_there() -> None:
    cut = held(Hidden(), seed=2, episodes=6)
    high = dict(zip(ROBOT.space.names, ROBOT.space.bounds[:, 1], strict=True))
    start = ROBOT.space.from_dict(ROBOT.space.as_dict(NOMINAL) | {"wheel_radius": high["wheel_radius"]})
    question = Question(cut, start)
    found = METHODS["ttest"].made().fit(question, Evidence(), Limits(None, threads=1))
    values = ROBOT.space.as_dict(found.final.values)
    assert values["wheel_radius"] == pytest.approx(0.021, rel=0.01)
    assert values["track"] == pytest.approx(0.0884, rel=0.01)


def test_where_nothing_is_hidden_tests_keep_their_level_and_nothing_is_found() -> None:
    """Of some 1000 tests at 5 %."""
    tests = rejected = 0
    for seed in range(5):
        cut = held(Hidden(), seed=seed, episodes=12)
        pieces = displaced(cut)
        begun = Simulators(cut, 1).moved(pieces, NOMINAL[None], {})[0]
        for turn in followed(pieces, Samples.cut(pieces, 3), off(pieces.moved, begun)):
            tests += turn.tested.tests
            rejected += int(turn.tested.rejected.sum())
    assert tests > 800 and 0.02 < rejected / tests < 0.08
    found = fitted(cut)
    np.testing.assert_allclose(found.final.values, NOMINAL, rtol=0.005)
    assert abs(found.final.figures["difference"]) < 0.005 and found.final.figures["explained"] < 0.5


def test_a_robot_that_changes_while_it_is_recorded_is_followed() -> None:
    cut = held(Hidden(difference=0.1), Hidden(difference=-0.1), seed=5, episodes=8)
    found = fitted(cut)
    figures = {v.stage: v.figures for v in found.versions}
    assert figures["e7"]["difference"] == pytest.approx(0.1, abs=0.01)
    assert figures["e8"]["rejected"] > 0.4 * figures["e8"]["tests"] and figures["e8"]["removed"] > 20
    # of the episodes that it has seen, 8 are of before and 6 of after: their mean is 0.014
    assert found.final.figures["difference"] < -0.04
    nominal, answer = errors(cut, found)[:, 1]
    assert answer < 0.7 * nominal


def test_the_budget_of_simulations_is_kept_and_versions_then_stay(uneven: Data) -> None:
    found = fitted(uneven, budget=12)
    assert found.rollouts <= 12 and found.ended == "budget"
    before, last = found.versions[-2:]
    assert np.array_equal(before.values, last.values) and before.effects == last.effects
    assert "explained" in found.versions[0].figures and "explained" not in last.figures, "it was not tried"


def test_a_recording_without_poses_half_a_second_apart_is_refused(uneven: Data) -> None:
    log = uneven.recording
    short = Recording(log.channels, tuple(Episode(e.name, e.time[:20], e.values[:20]) for e in log.episodes))
    with pytest.raises(LogError, match="about 0.5 s apart"):
        fitted(data(ROBOT, short))


def test_a_simulator_that_diverges_is_told(uneven: Data, monkeypatch: pytest.MonkeyPatch) -> None:
    """NaN corrections came to scipy, and means of cells hid them."""
    pieces, real = displaced(uneven), by_displaced.rollouts

    def diverging(*given, **told):
        (found,) = real(*given, **told)
        found.states[0, 0, 5:] = np.nan
        return [found]

    monkeypatch.setattr(by_displaced, "rollouts", diverging)
    with pytest.raises(
        SimulationError, match="a simulator of 'diffdrive' diverges under the recording's commands"
    ):
        Simulators(uneven).moved(pieces, NOMINAL[None], {})
