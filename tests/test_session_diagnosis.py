"""Diagnoses and trials through a session: what is passed on, kept, found again and taken along."""

import shutil
from pathlib import Path

import made_up_diagnosis
import pytest

from dynreg import session
from dynreg.errors import NoMatchError, RegistryError, UsageError
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.session import Session
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot
from dynreg.verbs import trial


@pytest.fixture
def opened(registry_folder: Path, tmp_path: Path):
    with session.open(shutil.copytree(registry_folder, tmp_path / "registry")) as made:
        yield made


QUICK = {"effects": ["cogging", "payload"], "max_causes": 1, "threshold_runs": 0, "threads": 1}
TRIAL = {"hide": "chosen", "effects": ["payload"], "count": 1, "seconds": 12.5, "threshold_runs": 0}


@pytest.fixture(scope="module")
def diagnosed(registry_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry with a diagnosis of a hidden servo."""
    folder = shutil.copytree(registry_folder, tmp_path_factory.mktemp("diagnosed") / "registry")
    robot = load_robot("servo_pendulum")
    recording = log_of(robot, hide(robot, (term("cogging"),), "strong", 11), protocol(robot, seconds=25.0))
    with session.open(folder) as made:
        made.ingest(recording, robot, name="hidden")
        made.diagnose("hidden", **QUICK, seed=4, engine="joint")
    return folder


@pytest.fixture
def kept(diagnosed: Path, tmp_path: Path):
    with session.open(shutil.copytree(diagnosed, tmp_path / "registry")) as made:
        yield made


def test_a_diagnosis_is_told_its_settings_robot_and_name(kept: Session) -> None:
    found = kept.result()
    assert (found.robot, found.recording_name, found.recording) == (
        "servo_pendulum",
        "hidden",
        kept.show("hidden").id,
    )
    assert (found.start, found.seed, found.engine, found.threshold.runs) == ("nominal", 4, "joint", 0)
    assert {r.effect for r in found.ranking} <= {*QUICK["effects"]} and len(found.causes) <= 1


def test_a_diagnosis_is_kept_and_found_by_what_it_is_about(kept: Session) -> None:
    found = kept.result()
    assert kept.result("hidden") == found
    assert list(found.parameters) == list(load_robot("servo_pendulum").space.names), "in the robot's order"
    (item,) = kept.list("result").items
    assert item.name == "diagnosis" and kept.show(item.id).detail["verdict"] == found.verdict
    assert kept.verify().clean


def test_an_interrupted_diagnosis_is_no_last_result_and_keeps_its_threshold(opened: Session) -> None:
    table = made_up_diagnosis.trials()
    opened.registry.put_result("trials", None, table.to_dict())
    listed = opened.list()

    class Stop(Exception):
        """What ends a diagnosis behind its threshold."""

    stages: list[str] = []

    def stop(stage: str, done: int, total: int) -> None:
        stages.append(stage)
        if stage == "causes":
            raise Stop

    for sought in (True, False):
        stages.clear()
        with pytest.raises(Stop):
            opened.diagnose("bench", effects=["payload"], threshold_runs=2, progress=stop)
        assert ("threshold" in stages) == sought, "of the first diagnosis alone"
    assert opened.result() == table and opened.list() == listed and opened.verify().clean


def test_an_exported_diagnosis_brings_its_simulators(kept: Session, tmp_path: Path) -> None:
    found = kept.result()
    assert found.extended_simulator
    kept.export([kept.list("result").items[0].id], tmp_path / "taken")
    with session.open(tmp_path / "taken") as other:
        assert other.result() == found and other.verify().clean
        for simulator in (found.calibrated_simulator, found.extended_simulator):
            assert other.show(simulator).kind == "simulator"


def test_bad_settings_are_refused_before_the_log_is_read(opened: Session) -> None:
    with pytest.raises(UsageError, match="rust"):
        opened.diagnose("nowhere", effects=["rust"])
    with pytest.raises(NoMatchError, match="nowhere"):
        opened.diagnose("nowhere")


def test_a_trial_that_was_interrupted_diagnoses_no_robot_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried, diagnosed = trial.tried_some, []

    def watched(**told):
        diagnosed.append(told["span"])
        return tried(**told)

    def stop(stage: str, done: int, total: int) -> None:
        if stage == "trials" and done:
            raise KeyboardInterrupt

    monkeypatch.setattr("dynreg.verbs.trial.TOGETHER", 1)
    monkeypatch.setattr("dynreg.verbs.trial.tried_some", watched)
    told = TRIAL | {"count": 2, "threads": 1}
    with session.open(tmp_path / "registry") as opened:
        with pytest.raises(KeyboardInterrupt):
            opened.trial("servo_pendulum", **told, progress=stop)
        table = opened.trial("servo_pendulum", **told)
        assert diagnosed == [(0, 1), (1, 2)] and len(table.trials) == 2
        assert opened.trial("servo_pendulum", **told).trials == table.trials and len(diagnosed) == 2


def test_trials_are_kept_without_a_recording_and_survive_the_loss_of_the_catalogue(
    kept: Session, tmp_path: Path
) -> None:
    diagnosis = kept.result()
    table = kept.trial("servo_pendulum", **TRIAL, threads=1)
    assert [t.hidden for t in table.trials] == ["payload"] and table.robot == "servo_pendulum"
    assert kept.result() == table and kept.result("hidden") == diagnosis
    (item,) = [i for i in kept.list("result").items if i.name == "trials"]
    assert (item.robot, item.detail) == ("servo_pendulum", {})
    assert kept.result(item.id) == table
    kept.export([item.id], tmp_path / "taken")
    with session.open(tmp_path / "taken") as other:
        assert other.result() == table and other.verify().clean
        assert not other.list("recording").items
    path = kept.path
    kept.close()
    (path / "catalog.sqlite").write_bytes(b"junk" * 1000)
    with pytest.raises(RegistryError):
        session.open(path, create=False)
    from dynreg.registry import verify

    verify(path, repair=True)
    with session.open(path) as again:
        found = [again.result(item.id) for item in again.list("result").items]
        assert table in found and diagnosis in found


def test_an_experiment_and_the_library_need_no_registry() -> None:
    pair = ["speed_limit", "torque_limit"]
    commands, experiment = Session.excite("servo_pendulum", pair, seconds=1.0, seed=2)
    assert commands.names == ("arm/target",) and commands.provenance["seed"] == 2
    assert experiment.between == tuple(pair) and experiment.seconds == pytest.approx(1.0)
    assert experiment.separation > experiment.usual
    assert Session.effects("servo_pendulum").robot == "servo_pendulum"


@pytest.mark.parametrize(
    "between, seconds, says",
    [
        (["payload"], 5.0, "between 'payload'; expected two different effects"),
        (["payload", "payload"], 5.0, "between 'payload,payload'; expected two different effects"),
        (["a", "b", "c"], 5.0, "between 'a,b,c'; expected two different effects"),
        (["payload", "inertia"], 0.0, "seconds 0; expected a number above 0"),
    ],
)
def test_an_experiment_is_between_two_effects(between: list, seconds: float, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        Session.excite("servo_pendulum", between, seconds=seconds)
