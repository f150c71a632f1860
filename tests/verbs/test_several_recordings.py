"""Three recordings in one question: a friction that all have, and a tilt that one has alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynreg
from dynreg.errors import UsageError
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.report.html import page
from dynreg.results import Diagnosis, diagnosis_details
from dynreg.session import Session
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

QUICK = {"effects": ["load_friction", "cogging"], "threshold_runs": 0, "max_causes": 2, "threads": 1}


TOLD: list[tuple[str, int, int]] = []  # of the progress


@pytest.fixture(scope="module")
def registry(tmp_path_factory: pytest.TempPathFactory) -> Session:
    robot = load_robot("servo_pendulum")
    plain = hide(robot, (term("load_friction"),), "strong", 11)
    both = hide(robot, (term("load_friction"), term("cogging")), "strong", 11)
    both = replace(both, values=(plain.values[0], both.values[1]), parameters=plain.parameters)
    with dynreg.open(tmp_path_factory.mktemp("several") / "registry") as session:
        for name, hidden, seed in (("a", plain, 1), ("b", both, 2), ("c", plain, 3)):
            log = log_of(robot, hidden, protocol(robot, seed=seed, seconds=12.5), engine="mujoco")
            session.ingest(log, robot, name=name)
        yield session


@pytest.fixture(scope="module")
def found(registry: Session) -> Diagnosis:
    return registry.diagnose(["a", "b", "c"], **QUICK, progress=lambda *told: TOLD.append(told))


def test_a_friction_is_the_same_in_all_and_cogging_is_only_in_one(found: Diagnosis) -> None:
    assert found.recordings == ("a", "b", "c") and found.recording_name == "a+b+c"
    assert found.causes[0].effect == "load_friction"
    friction = next(one for one in found.stable if one.cause == "load_friction")
    assert friction.same and friction.together.value == pytest.approx(0.2, rel=0.1)
    assert {*friction.there} == {"a", "b", "c"}
    cogging = [one for one in found.stable if one.cause == "cogging" and one.there == ("b",)]
    assert cogging and all(not one.same and set(one.absent) == {"a", "c"} for one in cogging)
    details = " ".join(diagnosis_details(found))
    assert "same in all" in details and "only in b" in details
    html = page(found)
    assert "Fitted to each recording" in html and "only in b" in html


def test_the_cost_and_the_progress_have_the_fits_to_each_recording(found: Diagnosis) -> None:
    """They are most of the simulations here, and were not counted."""
    done = [many for stage, many, _ in TOLD if stage == "simulations"]
    assert done == sorted(done) and done[0] < 200, "the first after the first replays"
    assert all(many <= total for stage, many, total in TOLD if stage == "simulations")
    assert found.cost.rollouts > 1.5 * done[-1]
    assert [one for one in TOLD if one[0] == "each recording"] == [
        ("each recording", number, 2) for number in range(3)
    ]


def test_what_was_joined_is_kept_with_its_episodes_and_where_they_come_from(
    registry: Session, found: Diagnosis
) -> None:
    joined = registry.recording("a+b+c")
    assert joined.id == found.recording and len(joined.episodes) == 15
    assert joined.episodes[5].name == "b/fit_0" and joined.episodes[5].settings["recording"] == 1.0
    assert joined.provenance["joined"] == [registry.recording(name).id for name in "abc"]
    assert registry.result("a+b+c") == found
    assert np.array_equal(joined.episodes[5].values, registry.recording("b").episodes[0].values)


def test_the_rests_within_a_recording_stay_where_several_are_joined(tmp_path: Path) -> None:
    """Two runs of 1 s, 30 s apart, in each of two recordings. Where one began anew, all rests were dropped."""
    from dynreg.data.recording import Channel, Episode, Recording
    from dynreg.replay.rows import rows_of
    from dynreg.verbs.several import joined
    from dynreg.verbs.subjects import Recorded

    robot = load_robot("servo_pendulum")
    channels = tuple(Channel(c.name, c.unit) for c in robot.recording_spec.channels if not c.optional)
    time, values = np.arange(101) / 100, np.zeros((101, len(channels)))
    each = [
        Recording(channels, tuple(Episode(f"run{k}", late + 30.0 * k + time, values) for k in range(2)))
        for late in (0.0, 100.0)
    ]
    with dynreg.open(tmp_path / "registry") as session:
        asked = [Recorded(session.registry, robot, one, name) for one, name in zip(each, "ab", strict=True)]
    whole = joined(asked).recording
    wanted = [0.0, 30.0, 31.0, 61.0]
    assert whole.begins() == pytest.approx(wanted)
    assert rows_of(robot, whole).begin == pytest.approx(wanted)


def test_a_simulator_of_all_is_fitted_to_each(registry: Session, found: Diagnosis) -> None:
    from dynreg.verbs.simulators import simulator

    robot = load_robot("servo_pendulum")
    made = simulator(registry.registry, found.extended_simulator, robot, registry.recording("b").id)
    told = (name.partition("[")[0] for part in ("fit", "select") for name in found.parts[part])
    assert made.fitted_to == {name.removeprefix("b/") for name in told if name.startswith("b/")}
    held_out = {name.partition("[")[0] for name in found.parts["test"]}
    assert {f"b/{name}" for name in made.fitted_to}.isdisjoint(held_out)


def test_recordings_that_are_too_short_alone_keep_the_joint_answer_and_get_a_note(
    registry: Session, tmp_path: Path
) -> None:
    """One episode of 2 s makes one rollout of 10 s: the whole search ran, and then its answer was lost."""
    whole = registry.recording("a")
    with dynreg.open(tmp_path / "registry") as session:
        for name, source in (("long", "a"), ("longer", "c")):
            session.ingest(registry.recording(source), "servo_pendulum", name=name)
        for name, episode in zip("wxyz", whole.episodes, strict=False):
            cut = replace(episode, time=episode.time[:201], values=episode.values[:201])
            session.ingest(replace(whole, episodes=(cut,)), "servo_pendulum", name=name)
        short = session.diagnose(["w", "x", "y", "z"], **QUICK, horizon=10.0)
        mixed = session.diagnose(["long", "w", "longer"], **QUICK, horizon=2.5)
    assert short.recordings == ("w", "x", "y", "z") and short.stable == ()
    assert "w was not fitted alone: the recording makes 1 rollout of 10 s" in short.notes
    assert short.notes[-1].startswith("Too few recordings were fitted alone")
    assert {*mixed.stable[0].values} == {"long", "longer"}
    assert mixed.notes[-1].startswith("w was not fitted alone")


def test_one_recording_twice_and_other_verbs_are_refused(registry: Session) -> None:
    with pytest.raises(UsageError, match="recording 'a' is named twice"):
        registry.diagnose(["b", "a", "a"], **QUICK)


def written(path: Path, scale: float) -> Path:
    """A log of a servo that stands."""
    rows = "".join(f"{k / 100:.2f},{scale * (k % 7):.3f},0,0,7.4,400\n" for k in range(120))
    path.write_text("time,arm/position,arm/velocity,arm/target,supply,kp\n" + rows)
    return path


def test_the_name_of_what_is_joined_moves_as_that_of_a_log_does(tmp_path: Path) -> None:
    """B's log read again with another map: the whole diagnosis ran, and then its name was in use."""
    from dynreg.errors import Assumed
    from dynreg.verbs.several import joined
    from dynreg.verbs.subjects import recorded

    robot, log_map = load_robot("servo_pendulum"), tmp_path / "turned.toml"
    one, two = written(tmp_path / "one.csv", 0.1), written(tmp_path / "two.csv", 0.2)
    units = {"arm/position": "rad", "arm/velocity": "rad/s", "arm/target": "rad", "supply": "V"}
    log_map.write_text(
        '[map]\nrobot = "servo_pendulum"\n[settings.kp]\nvalue = 400\n'
        + "".join(f'[channels."{n}"]\nsource = "{n}"\nunit = "{u}"\nscale = 0.9\n' for n, u in units.items())
    )
    with dynreg.open(tmp_path / "registry") as session:
        registry = session.registry
        ask = lambda names: joined([recorded(registry, n, ingest=False) for n in names])  # noqa: E731
        session.ingest(one, robot, name="a")
        session.ingest(two, robot, name="b")
        first = ask("ab")
        first.register()
        session.ingest(two, robot, log_map=log_map, name="b")
        again = ask("ab")
        assert again.recording.id != first.recording.id
        again.register()
        assert registry.name_holder("a+b") == again.recording.id
        session.ingest(written(tmp_path / "three.csv", 0.3), robot, name="a+c")
        session.ingest(written(tmp_path / "four.csv", 0.4), robot, name="c")
        other = ask("ac")
        with pytest.warns(Assumed, match="of other log files is called 'a\\+c'"):
            other.register()
        assert registry.holds(other.recording.id) and registry.name_holder("a+c") != other.recording.id
