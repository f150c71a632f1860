"""Diagnoses and trials through a session: what is passed on, kept, found again and taken along."""

import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import made_up_diagnosis
import pytest

from dynreg import session
from dynreg.errors import NoMatchError, RegistryError, UsageError
from dynreg.session import Session


@pytest.fixture
def opened(registry_folder: Path, tmp_path: Path):
    with session.open(shutil.copytree(registry_folder, tmp_path / "registry")) as made:
        yield made


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list:
    """Stands where the diagnosis, the trial and the experiment would; keeps what they were asked."""
    kept: list = []

    def stand_in(answer):
        def called(*given, **named):
            kept.append((given, named))
            return answer(*given)

        return called

    made = {
        "diagnose": stand_in(_diagnosis),
        "trial": stand_in(lambda *_: made_up_diagnosis.trials()),
    }
    for name, function in made.items():
        module = SimpleNamespace(**{name: function})
        monkeypatch.setitem(sys.modules, f"dynreg.diagnose.{name}", module)
    return kept


def _diagnosis(registry, robot, recording, settings):
    """A diagnosis that registered its simulators."""
    config = {"robot": robot.hash, "robot_name": robot.name, "values": {}}
    simulators = {
        f"{kind}_simulator": registry.put_simulator(
            config | {"lineage": {"made_by": "diagnose", "kind": kind}}
        )
        for kind in ("calibrated", "extended")
    }
    return made_up_diagnosis.diagnosis().model_copy(
        update={"recording": recording.id, "robot": robot.name, "simulator": None, **simulators}
    )


def test_a_diagnosis_is_told_its_settings_robot_and_name(opened: Session, asked: list) -> None:
    opened.diagnose("bench", start="nearest", without=["payload"], max_causes=1, seed=4, engine="joint")
    (((registry, robot, recording, settings), named),) = asked
    assert registry is opened.registry and robot.name == "servo_pendulum"
    assert recording.id == opened.show("bench").id and named == {"name": "bench", "progress": None}
    told = (settings.start, settings.without, settings.max_causes, settings.seed, settings.engine)
    assert told == ("nearest", ("payload",), 1, 4, "joint") and settings.effects is None


def test_a_diagnosis_is_kept_and_found_by_what_it_is_about(opened: Session, asked: list) -> None:
    told = opened.diagnose("bench")
    assert opened.result() == opened.result("bench") == told
    assert list(opened.result().parameters) == list(told.parameters), "in the robot's order"
    (item,) = opened.list("result").items
    assert item.name == "diagnosis" and opened.show(item.id).detail["verdict"] == "named"
    assert opened.verify().clean


def test_an_interrupted_diagnosis_is_no_last_result_and_keeps_its_threshold(opened: Session) -> None:
    table = made_up_diagnosis.trials()
    opened.registry.put_result("trials", None, table.to_dict())
    listed = opened.list()

    class Stop(Exception):
        """What ends a diagnosis behind its threshold."""

    stages = []

    def stop(stage: str, done: int, total: int) -> None:
        stages.append(stage)
        if stage == "causes":
            raise Stop

    for _ in range(2):
        with pytest.raises(Stop):
            opened.diagnose("bench", effects=["payload"], threshold_runs=2, progress=stop)
    assert stages.count("threshold") == 2, "of the first diagnosis alone"
    assert opened.result() == table and opened.list() == listed and opened.verify().clean


def test_an_exported_diagnosis_brings_its_simulators(opened: Session, asked: list, tmp_path: Path) -> None:
    told = opened.diagnose("bench")
    opened.export([opened.list("result").items[0].id], tmp_path / "taken")
    with session.open(tmp_path / "taken") as other:
        assert other.result() == told and other.verify().clean
        for simulator in (told.calibrated_simulator, told.extended_simulator):
            assert other.show(simulator).kind == "simulator"


def test_bad_settings_are_refused_before_the_log_is_read(opened: Session, asked: list) -> None:
    with pytest.raises(UsageError, match="rust"):
        opened.diagnose("nowhere", effects=["rust"])
    with pytest.raises(NoMatchError, match="nowhere"):
        opened.diagnose("nowhere")
    assert asked == []


def test_trials_are_kept_without_a_recording(opened: Session, asked: list, tmp_path: Path) -> None:
    table = opened.trial("servo_pendulum", hide="chosen", effects=["payload"], count=3)
    (((registry, robot, settings), named),) = asked
    assert registry is opened.registry and robot.name == "servo_pendulum" and named == {"progress": None}
    assert (settings.hide, settings.effects, settings.count) == ("chosen", ("payload",), 3)
    assert opened.result() == table
    (item,) = opened.list("result").items
    assert (item.name, item.robot, item.detail) == ("trials", "servo_pendulum", {})
    assert opened.result(item.id) == table
    with pytest.raises(NoMatchError):
        opened.result("bench")  # it is about no recording
    opened.export([item.id], tmp_path / "taken")
    with session.open(tmp_path / "taken") as other:
        assert other.result() == table and other.verify().clean
        assert not other.list("recording").items


def test_trials_survive_the_loss_of_the_catalogue(opened: Session, asked: list) -> None:
    table = opened.trial("servo_pendulum")
    diagnosis = opened.diagnose("bench")
    path = opened.path
    opened.close()
    (path / "catalog.sqlite").write_bytes(b"junk" * 1000)
    with pytest.raises(RegistryError):
        session.open(path, create=False)
    from dynreg.registry import verify

    verify(path, repair=True)
    with session.open(path) as again:
        kept = [again.result(item.id) for item in again.list("result").items]
        assert table in kept and diagnosis in kept


def test_an_experiment_and_the_library_need_no_registry() -> None:
    pair = ["speed_limit", "torque_limit"]
    commands, experiment = Session.excite("servo_pendulum", pair, seconds=1.0, seed=2)
    assert commands.names == ("arm/target",) and commands.provenance["seed"] == 2
    assert experiment.between == tuple(pair) and experiment.seconds == pytest.approx(1.0)
    assert experiment.separation > experiment.usual
    assert Session.effects("servo_pendulum").robot == "servo_pendulum"


@pytest.mark.parametrize(
    "between, seconds",
    [
        (["payload"], 5.0),
        (["payload", "payload"], 5.0),
        (["a", "b", "c"], 5.0),
        (["payload", "inertia"], 0.0),
    ],
)
def test_an_experiment_is_between_two_effects(between: list, seconds: float) -> None:
    with pytest.raises(UsageError, match="two different effects"):
        Session.excite("servo_pendulum", between, seconds=seconds)
