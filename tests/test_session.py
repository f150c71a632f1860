"""What a session refuses, and what it finds again."""

import re
import shutil
from pathlib import Path

import pytest
import secret_servo
import tiny_registry

from dynreg import results, session
from dynreg.data.recording import Recording
from dynreg.errors import Assumed, MapError, NoMatchError, RegistryError, UsageError
from dynreg.session import Session

BENCH = dict(budget=7, synthesise=False)


@pytest.fixture(scope="module")
def opened(registry_folder: Path, tmp_path_factory: pytest.TempPathFactory):
    path = shutil.copytree(registry_folder, tmp_path_factory.mktemp("session") / "registry")
    with session.open(path) as made:
        yield made


@pytest.fixture(scope="module")
def recording() -> Recording:
    return secret_servo.record(secret_servo.values_of(0), 0, episodes=5, steps=40)


@pytest.fixture
def empty(tmp_path: Path):
    with session.open(tmp_path / "empty") as made:
        yield made


def test_a_recording_has_many_names(opened: Session):
    (identity,) = [item.id for item in opened.list("recording").items]
    asked = [opened.query(ref, **BENCH) for ref in ("bench", "@last", identity, identity[:8])]
    assert {(a.recording, a.recording_name, a.answer) for a in asked} == {
        (identity, "bench", asked[0].answer)
    }


def test_a_log_can_be_asked_about_without_being_ingested_first(opened: Session, tmp_path: Path):
    log = tmp_path / "bench.csv"
    log.write_text(tiny_registry.bench_csv(), encoding="utf-8")
    answer = opened.query(log, robot="servo_pendulum", **BENCH)
    assert answer.recording == opened.show("bench").id, "the same numbers are the same recording"
    with pytest.raises(UsageError, match="is a log, and no robot is named"):
        opened.query(log)


def test_a_recording_in_memory_is_registered(opened: Session, recording: Recording):
    known = opened.ingest(recording, "servo_pendulum", name="in memory")
    assert (known.recording, known.episodes, known.rows_count) == (recording.id, 5, 5 * 41)
    assert known.rate == pytest.approx(100.0) and known.settings == ("kp",)
    assert opened.ingest(recording, "servo_pendulum") == known, "ingesting again is no other recording"
    assert opened.registry.recording("in memory").id == recording.id
    assert opened.show("in memory").detail["episodes"] == 5


def test_answers_are_kept_and_found_by_what_they_are_about(opened: Session, recording: Recording):
    opened.ingest(recording, "servo_pendulum", name="kept")
    first = opened.query("kept", **BENCH)
    last = opened.query("bench", **BENCH)
    assert opened.result("kept").to_dict() == first.to_dict()
    assert opened.result().to_dict() == opened.result("bench").to_dict() == last.to_dict()
    kept = [item.id for item in opened.list("result").items]
    assert opened.result(kept[-1]).to_dict() == last.to_dict()


def test_stored_results_and_simulators_have_their_parameters_in_the_robots_order(opened: Session):
    told = opened.query("bench", budget=12)
    names = secret_servo.load_robot("servo_pendulum").space.names
    assert list(names) != sorted(names)
    stored = opened.result("bench")
    assert stored == told
    assert list(stored.synthesised.parameters) == list(stored.nominal.parameters) == list(names)
    assert list(stored.neighbours[0].parameters) == list(stored.answer_parameters) == list(names)
    assert list(opened.show(told.synthesised.simulator).detail["values"]) == list(names)
    (result,) = [i.id for i in opened.list("result").items[-1:]]
    assert list(opened.show(result).detail["nominal"]["parameters"]) == list(names)


def test_a_simulator_is_named_after_its_robot_and_how_it_came_about(opened: Session):
    made = opened.query("bench", budget=12).synthesised.simulator
    fitted = opened.calibrate("bench", method="random", budget=20).simulator
    named = {item.id: item.name for item in opened.list("simulator").items}
    assert named[made] == f"servo_pendulum synthesised {made[:8]}" == opened.show(made).name
    assert named[fitted] == f"servo_pendulum calibrated by random {fitted[:8]}"


def test_an_exported_result_brings_its_simulators(opened: Session, tmp_path: Path):
    told = opened.query("bench", budget=12)
    (result,) = [i.id for i in opened.list("result").items[-1:]]
    opened.export([result], tmp_path / "exported")
    with session.open(tmp_path / "exported") as other:
        assert other.verify().clean and other.result() == told
        named = {told.answer, told.synthesised.simulator, *(s.simulator for s in told.stages if s.simulator)}
        assert {other.show(simulator).id for simulator in named} == named
        assert other.show(told.synthesised.simulator) == opened.show(told.synthesised.simulator)


def test_last_is_a_recording_or_a_result(empty: Session, recording: Recording):
    with pytest.raises(NoMatchError, match="no last recording.*last result.*ingest"):
        empty.show("@last")
    known = empty.ingest(recording, "servo_pendulum")
    assert empty.show("@last").id == known.recording
    with pytest.raises(NoMatchError, match="no last result.*last recording.*dynreg query"):
        empty.result("@last")
    with pytest.raises(NoMatchError, match=f"no result about {known.recording[:12]}"):
        empty.result(known.recording)


def test_a_name_of_several_things_shows_them_all(opened: Session):
    robot, population = (opened.list(kind).items[0].id for kind in ("robot", "population"))
    with pytest.raises(NoMatchError) as error:
        opened.show("servo_pendulum")
    for told in (f"robot {robot[:16]}", f"population {population[:16]}", "first digits of the id"):
        assert told in str(error.value)


def test_all_that_is_listed_can_be_shown_and_read_back(opened: Session):
    opened.query("bench", budget=12)
    listed = opened.list()
    kinds = {"population", "recording", "measured", "simulator", "result", "robot"}
    assert {item.kind for item in listed.items} == kinds
    for item in listed.items:
        shown = opened.show(item.id)
        assert shown.id == item.id and shown.kind == item.kind
        assert results.EntrySummary.model_validate_json(shown.to_json()).to_dict() == shown.to_dict()
    entry = opened.show(opened.registry.load(opened.list("population").items[0].id, ()).ids[3])
    assert entry.kind == "entry" and entry.detail["number"] == 3
    assert set(entry.detail["parameters"]) == set(secret_servo.load_robot("servo_pendulum").space.names)


def test_only_known_kinds_are_listed(opened: Session):
    with pytest.raises(UsageError, match="kind 'models'"):
        opened.list("models")


def test_verify_tells_what_was_lost(opened: Session, tmp_path: Path):
    assert opened.verify().clean
    path = shutil.copytree(opened.path, tmp_path / "copy")
    next((path / "shards").glob("*.parquet")).unlink()
    with session.open(path) as damaged:
        report = damaged.verify()
        assert not report.clean and report.lost and not report.repaired
        repaired = damaged.verify(repair=True)
        assert repaired.repaired and damaged.registry.count(damaged.list("population").items[0].id) == 0
        assert damaged.populate("servo_pendulum", 8, training=tiny_registry.QUICK).added == 8
        assert damaged.verify().clean
        assert damaged.registry.content_hash() == opened.registry.content_hash()


def test_what_is_exported_can_be_asked_elsewhere(opened: Session, tmp_path: Path):
    population = opened.list("population").items[0].id
    copied = opened.export([population, "bench"], tmp_path / "exported")
    assert {item.kind for item in copied.items} >= {"population", "recording"}
    with session.open(tmp_path / "exported") as other:
        here, there = opened.query("bench", **BENCH), other.query("bench", **BENCH)
        assert (there.answer, there.neighbours) == (here.answer, here.neighbours)


def test_growing_a_population_is_seen_by_the_next_question(registry_folder: Path, tmp_path: Path):
    with session.open(shutil.copytree(registry_folder, tmp_path / "registry")) as growing:
        with pytest.raises(UsageError, match="k = 9"):
            growing.query("bench", k=9, budget=20)
        grown = growing.populate("servo_pendulum", 10, training=tiny_registry.QUICK)
        assert (grown.added, grown.entries, grown.linked) == (2, 10, 10)
        assert grown.recording == "bench"
        assert len(growing.query("bench", k=9, budget=20).neighbours) == 9


def test_without_a_population_nothing_can_be_asked(empty: Session, recording: Recording):
    known = empty.ingest(recording, "servo_pendulum")
    with pytest.raises(NoMatchError, match="no simulators of robot 'servo_pendulum'.*dynreg populate"):
        empty.query(known)
    with pytest.raises(NoMatchError):
        empty.query(known, population="servo_pendulum")
    with pytest.raises(NoMatchError):
        empty.result()
    assert empty.list().items[0].kind == "recording"


def test_a_population_that_was_planned_and_not_computed_is_no_population(opened: Session, empty: Session):
    recording, robot = opened.registry.recording("bench"), secret_servo.load_robot("servo_pendulum")
    known = empty.ingest(recording, robot)
    empty.registry.put_population(opened.registry.population(opened.list("population").items[0].id))
    with pytest.raises(NoMatchError, match="has no entries yet"):
        empty.query(known)


def test_simulators_of_another_version_answer_where_they_are_named(
    registry_folder: Path, tmp_path: Path, recording: Recording
):
    robot = secret_servo.load_robot("servo_pendulum")
    heavier = shutil.copytree(robot.folder, tmp_path / "heavier")
    table = heavier / "robot.toml"
    table.write_text(table.read_text().replace("high = 0.6\n", "high = 0.7\n", 1))
    with session.open(shutil.copytree(registry_folder, tmp_path / "registry")) as mixed:
        known = mixed.ingest(recording, heavier)
        population = mixed.list("population").items[0].id
        with pytest.raises(NoMatchError, match="no simulators of version 2 .*version 1 has") as error:
            mixed.query(known)
        words = f"dynreg populate {secret_servo.load_robot(heavier).hash[:12]} -n .*--population {population[:12]}"
        assert re.search(words, str(error.value))
        with pytest.warns(Assumed, match="is of version 1 of robot 'servo_pendulum'"):
            assert mixed.query(known, population=population).population == population


def test_two_populations_must_be_told_apart(registry_folder: Path, tmp_path: Path):
    with session.open(shutil.copytree(registry_folder, tmp_path / "registry")) as two:
        other = two.populate("servo_pendulum", 6, seed=1, training=tiny_registry.QUICK, link=False)
        with pytest.raises(UsageError, match="2 populations.*--population"):
            two.query("bench")
        answer = two.query("bench", population=other.population[:10], **BENCH)
        assert answer.population == other.population
        with pytest.raises(UsageError, match="is not linked"):
            two.query("bench", population=other.population, distance="cross_loss", **BENCH)
        two.populate("servo_pendulum", 6, seed=1, training=tiny_registry.QUICK)
        linked = two.query("bench", population=other.population, distance="cross_loss", **BENCH)
        assert linked.population == other.population


@pytest.mark.parametrize("ref", ["nothing", "@first", "ffffffffffff"])
def test_what_is_not_there_is_not_found(opened: Session, ref: str):
    for ask in (opened.query, opened.show, opened.result):
        with pytest.raises(NoMatchError):
            ask(ref)


def test_logs_that_hold_nothing_of_the_robot_are_not_registered(opened: Session, tmp_path: Path):
    log = tmp_path / "strange.csv"
    log.write_text("time,x\n0,1\n0.1,2\n")
    before = opened.list("recording")
    with pytest.raises(MapError, match="arm/position"):
        opened.ingest(log, "servo_pendulum")
    assert opened.list("recording") == before


def test_a_registry_is_made_only_where_that_was_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(RegistryError):
        session.open(tmp_path / "none", create=False)
    assert not (tmp_path / "none").exists()
    monkeypatch.setenv("DYNREG_REGISTRY", str(tmp_path / "from environment"))
    with session.open() as made:
        assert made.path == tmp_path / "from environment"
    monkeypatch.delenv("DYNREG_REGISTRY")
    monkeypatch.chdir(tmp_path)
    with session.open() as made:
        assert made.path.resolve() == (tmp_path / "dynreg-registry").resolve()


def test_information_counts_what_is_there(opened: Session):
    told = opened.info()
    assert told.entries == 8 and told.holds["population"] == 1 and told.exists
