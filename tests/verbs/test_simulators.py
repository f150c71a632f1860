"""Which simulator: every word, what old words say, and that effects come along."""

import shutil
import warnings

import pytest

from dynreg import session
from dynreg.errors import NoMatchError, OldWord, UsageError
from dynreg.session import Session
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot
from dynreg.verbs.simulator import NAMES, OLD
from dynreg.verbs.simulators import named, own, simulator, told_last

EFFECT = {"coulomb_friction[arm]": {"torque": 0.02}}


@pytest.fixture(scope="module")
def diagnosed(registry_folder, tmp_path_factory):
    """A registry with a recording "bench", a simulator with an effect, and results about the recording that tell it."""
    folder = tmp_path_factory.mktemp("diagnosed") / "registry"
    shutil.copytree(registry_folder, folder)
    robot = load_robot("servo_pendulum")
    with session.open(folder) as opened:
        registry, recording = opened.registry, opened.show("bench").id
        values = robot.space.as_dict(robot.space.nominal)
        plain = registry.put_simulator(SimConfig(robot.hash, robot.name, values).as_dict())
        full = registry.put_simulator(SimConfig(robot.hash, robot.name, values, EFFECT).as_dict())
        parts = {"fit": ["e0", "e1[3]"], "select": ["e2"], "test": ["e3"]}
        found = {"calibrated_simulator": plain, "extended_simulator": full, "parts": parts}
        registry.put_result("diagnosis", recording, found)
        yield registry, robot, recording, plain, full


@pytest.fixture(scope="module")
def asked(registry_folder, tmp_path_factory):
    """A session in which the recording "bench" was queried and calibrated to; its robot and the recording's id."""
    folder = tmp_path_factory.mktemp("simulators") / "registry"
    shutil.copytree(registry_folder, folder)
    with session.open(folder) as opened:
        found = opened.query("bench", k=3)
        fitted = opened.calibrate("bench", budget=10)
        yield opened.registry, load_robot("servo_pendulum"), found, fitted


def test_words_say_what_results_told(asked):
    registry, robot, found, fitted = asked
    by_word = {
        word: simulator(registry, word, robot, found.recording) for word in NAMES if word != "diagnosed"
    }
    assert by_word["nominal"].config.values == robot.space.as_dict(robot.space.nominal)
    assert by_word["nearest"].id == found.neighbours[0].entry
    assert by_word["synthesised"].id == found.synthesised.simulator
    assert by_word["@answer"].id == found.answer
    assert by_word["calibrated"].id == fitted.simulator
    assert all(one.robot is robot for one in by_word.values())


def test_a_result_that_is_named_tells_the_simulator_that_it_recommends(asked):
    registry, robot, found, _ = asked
    source = registry.latest("neighbours", found.recording).id
    named = simulator(registry, source, robot, found.recording)
    assert (named.id, named.source) == (found.answer, source)
    assert named.fitted_to == {name.partition("[")[0] for p in ("fit", "select") for name in found.parts[p]}


def test_a_simulator_that_is_named_brings_its_effects(asked):
    registry, robot, found, _ = asked
    config = SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal), EFFECT)
    identity = registry.put_simulator(config.as_dict() | {"lineage": {"made_by": "by hand"}})
    assert simulator(registry, identity[:12], robot, found.recording).config.effects == EFFECT


@pytest.mark.parametrize("old", OLD)
def test_old_words_still_work_and_say_what_they_are_called_now(asked, old):
    registry, robot, found, _ = asked
    with pytest.warns(OldWord, match=f"{old!r} is called {OLD[old]!r} now"):
        if OLD[old] == "diagnosed":
            with pytest.raises(NoMatchError, match="no 'diagnosed' simulator"):
                simulator(registry, old, robot, found.recording)
        else:
            expected = simulator(registry, OLD[old], robot, found.recording)
            assert simulator(registry, old, robot, found.recording) == expected


def test_a_word_of_which_nothing_is_stored_says_what_to_run(asked):
    registry, robot, found, _ = asked
    with pytest.raises(NoMatchError, match="run `dynreg diagnose` on it first"):
        simulator(registry, "diagnosed", robot, found.recording)
    with pytest.raises(NoMatchError, match="no query about this recording is stored"):
        simulator(registry, "nearest", robot, None)


def test_a_simulator_of_another_robot_is_refused_where_it_must_be_ones_own(asked):
    registry, robot, found, _ = asked
    other = load_robot("leg")
    named = simulator(registry, "nearest", robot, found.recording)
    assert own(named, robot) is named
    with pytest.raises(UsageError, match="is of robot 'servo_pendulum'"):
        own(named, other)


def test_words_of_today_warn_of_nothing(asked):
    registry, robot, found, _ = asked
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulator(registry, "nearest", robot, found.recording)


def test_what_names_no_simulator_is_told_the_words(asked):
    registry, robot, found, _ = asked
    with pytest.raises(NoMatchError, match="no simulator is called 'best'; expected one of nominal, nearest"):
        simulator(registry, "best", robot, found.recording)


def test_calibrated_means_what_a_diagnosis_calibrated_where_nothing_else_did(diagnosed):
    registry, robot, recording, plain, full = diagnosed
    assert named(registry, "calibrated").id == told_last(registry, "calibrated") == plain
    found = simulator(registry, "calibrated", robot, recording)
    assert (found.id, found.fitted_to) == (plain, SEEN)
    assert named(registry, "diagnosed").id == full
    assert found.source == registry.latest("diagnosis", recording).id


def test_a_simulator_of_an_earlier_diagnosis_is_known_for_what_that_one_says(diagnosed):
    """After another diagnosis of the recording, too: its simulators counted as having seen all of it."""
    registry, robot, recording, _, full = diagnosed
    values = robot.space.as_dict(robot.space.nominal) | {"tip_mass": 0.51}
    lineage = {"lineage": {"made_by": "diagnose", "recording": recording}}
    first = registry.put_simulator(SimConfig(robot.hash, robot.name, values).as_dict() | lineage)
    told = {"calibrated_simulator": first, "parts": {"fit": ["e0"], "select": ["e4"], "test": ["e2"]}}
    again = registry.latest("diagnosis", recording).document
    registry.put_result("diagnosis", recording, told)
    registry.put_result("diagnosis", recording, {**again, "seed": 1})
    assert simulator(registry, first, robot, recording).fitted_to == {"e0", "e4"}
    assert simulator(registry, full, robot, recording).fitted_to == SEEN


def test_by_whatever_name_a_simulator_is_found_without_a_robot(diagnosed):
    registry, robot, recording, plain, full = diagnosed
    source = registry.latest("diagnosis", recording).id
    assert [named(registry, ref).id for ref in ("diagnosed", source, full)] == [full] * 3
    assert named(registry, plain).config.effects == {} and named(registry, plain).robot.hash == robot.hash
    with pytest.raises(NoMatchError, match="bench"):
        named(registry, "bench")


SEEN = {"e0", "e1", "e2"}


def test_a_diagnosis_tells_its_extended_simulator_with_its_effects_and_what_it_saw(diagnosed):
    registry, robot, recording, plain, full = diagnosed
    source = registry.latest("diagnosis", recording).id
    for ref in ("diagnosed", source):
        named = simulator(registry, ref, robot, recording)
        assert (named.id, named.source, named.config.effects) == (full, source, EFFECT)
        assert named.fitted_to == SEEN


def test_by_its_id_a_simulator_is_known_for_what_a_result_says_of_it(diagnosed):
    registry, robot, recording, plain, full = diagnosed
    for identity in (plain, full):
        named = simulator(registry, identity, robot, recording)
        assert (named.id, named.source, named.fitted_to) == (identity, None, SEEN)


def test_a_result_about_another_recording_says_nothing_of_this_one(diagnosed):
    registry, robot, recording, plain, full = diagnosed
    other = simulator(registry, registry.latest("diagnosis", recording).id, robot, "f" * 64)
    assert (other.id, other.fitted_to) == (full, frozenset())


def test_a_simulator_told_about_another_recording_is_still_known_for_what_this_one_says(diagnosed):
    registry, robot, recording, plain, full = diagnosed
    registry.put_result("calibration", None, {"simulator": full})
    told = registry.latest("calibration").id
    assert simulator(registry, told, robot, recording).fitted_to == SEEN


def test_a_simulator_made_from_the_recording_without_saying_from_what_is_not_innocent(diagnosed):
    registry, robot, recording, *_ = diagnosed
    values = robot.space.as_dict(robot.space.nominal) | {"tip_mass": 0.5}
    document = SimConfig(robot.hash, robot.name, values).as_dict()
    identity = registry.put_simulator(
        document | {"lineage": {"made_by": "calibrate cma", "recording": recording}}
    )
    assert simulator(registry, identity, robot, recording).fitted_to is None
    assert simulator(registry, identity, robot, None).fitted_to == frozenset()


def test_a_word_without_a_recording_stands_for_what_the_newest_result_tells(asked):
    registry, _, found, _ = asked
    assert told_last(registry, "@answer") == found.answer
    assert told_last(registry, "@last") == "@last"
    with pytest.raises(NoMatchError, match="no 'diagnosed' simulator: no diagnosis is stored"):
        told_last(registry, "diagnosed")
    assert Session(registry).show("@answer").id == found.answer
