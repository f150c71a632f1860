"""Every executor: results in order, our own errors as they are, a lost worker loses nothing, the same bytes."""

import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import jobs
import numpy as np
import pytest
from lossy import Lossy

from dynreg import session
from dynreg.cli.main import main
from dynreg.diagnose.diagnose import posed
from dynreg.diagnose.options import DiagnosisOptions, Ranker
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.threshold import Threshold, threshold
from dynreg.diagnose.trial import trial_threshold
from dynreg.errors import UsageError
from dynreg.evidence.lockstep import Search, run
from dynreg.executor import Executor, Local, opened
from dynreg.registry import Registry, verify
from dynreg.results.trials import TrialResult
from dynreg.sim.robot import load_robot
from dynreg.verbs.nulls import HandedOut, null_of_diagnosis
from dynreg.verbs.plain import plain_recording, plain_robot, recording_from, robot_from
from dynreg.verbs.subjects import Recorded, recorded
from dynreg.verbs.trial import TrialSettings, null_of_trials, trials_of, tried_some

PUT, MADE = "dynreg.registry.registry:Registry.put_shard", "dynreg.verbs.populations:make_entries"
STAGED = "dynreg.registry.directory:Directory.stage"


@pytest.fixture(params=[Local, Lossy], ids=["local", "lossy"])
def executor(request: pytest.FixtureRequest) -> Executor:
    return request.param()


def test_results_come_in_the_order_of_the_jobs(executor: Executor) -> None:
    every = [{"values": np.full(3, i), "name": str(i)} for i in range(8)]
    found = list(executor.map(jobs.doubled, every))
    assert [name for name, _ in found] == [one["name"] for one in every]
    assert all((values == 2 * one["values"]).all() for (_, values), one in zip(found, every, strict=True))
    assert list(executor.map(jobs.doubled, [])) == []


def test_an_error_of_ours_is_tried_once_and_stays_what_it_is(executor: Executor, tmp_path: Path) -> None:
    with pytest.raises(UsageError) as raised:
        list(executor.map(jobs.refused, [{"kind": "usage", "counter": str(tmp_path / "tries")}]))
    assert str(raised.value) == "k = 0; expected 1 or more; ask for one" and raised.value.exit_status == 2
    assert (tmp_path / "tries").read_text() == "."


@pytest.mark.parametrize("executor", [Local(1), Lossy()], ids=["local", "lossy"])
def test_shards_made_elsewhere_are_the_same_bytes(executor: Executor, filled, usual) -> None:
    assert filled(executor) == usual


def test_workers_that_are_killed_lose_nothing(filled, usual, tmp_path: Path) -> None:
    """Before a shard is stored, with a file of it on disk, and when it is there and only the answer is missing."""
    executor = Lossy({0: MADE, 1: STAGED, 2: PUT})
    assert filled(executor)[0] == usual[0]
    assert sorted(executor.done) == [0, 0, 1, 1, 2, 2, 3], "they were done again"
    report = verify(tmp_path / "registry")
    assert report.faults == () and report.leftovers == ()


@pytest.fixture
def line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[..., tuple[int, str]]]:
    """Runs a populate: its exit status, and what it says on stderr."""

    def ran(*options: str) -> tuple[int, str]:
        told = ("populate", "servo_pendulum", "-n", "2", "--registry", str(tmp_path / "registry"), *options)
        return main(told), capsys.readouterr().err

    return ran


def test_without_ray_a_command_says_what_to_install(line, monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    status, said = line("--executor", "ray")
    assert status == 2 and "pip install 'dynreg[ray]'" in said and said.count("\n") == 1
    assert not (tmp_path / "registry").exists()


def test_an_address_belongs_to_ray(line) -> None:
    status, said = line("--address", "127.0.0.1:6379")
    assert status == 2 and "'127.0.0.1:6379' without executor 'ray'" in said and "--executor ray" in said


def test_an_address_is_not_passed_over_where_ray_is_connected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", SimpleNamespace(is_initialized=lambda: True))
    with pytest.raises(UsageError, match="'127.0.0.1:6379' in a process that is connected to Ray"):
        with opened("ray", "127.0.0.1:6379"):
            pass


def test_an_unknown_executor_is_refused(line) -> None:
    status, said = line("--executor", "slurm")
    assert status == 2 and "local, ray" in said


def test_local_is_the_usual_one() -> None:
    with opened("local", None, 3) as executor:
        assert executor == Local(3) and executor.workers == 1


def test_the_robots_of_a_trial_are_diagnosed_elsewhere_with_the_same_numbers(tmp_path: Path) -> None:
    """Those without an effect, which set the threshold, and those with one, each in a process of its own."""
    settings = TrialSettings(hide="nothing", count=2, seconds=12.5, threshold_runs=2, threads=1)
    with session.open(tmp_path / "registry") as opened_here:
        robot = load_robot("servo_pendulum")
        usual = opened_here.trial(robot, **vars(settings))
    executor, told = Lossy(), {"robot": plain_robot(robot), "settings": vars(settings), "threads": 1}
    nulls = HandedOut(executor, null_of_trials, told)
    needed = trial_threshold(trials_of(robot, settings, 1), None, None, nulls)
    assert f"{needed.nats:.3g} nats" in usual.notes[0] and nulls.rollouts > 0
    spans = [{"span": (number, number + 1), "needed": vars(needed)} for number in range(2)]
    found = [one for (one,) in executor.map(tried_some, [told | span for span in spans])]
    for one, other in zip(found, usual.trials, strict=True):
        assert TrialResult(**one) == other.model_copy(
            update={name: one[name] for name in ("seconds", "core_seconds")}
        )


@pytest.mark.parametrize("ranker", ["auto", "make"])
def test_the_threshold_of_a_diagnosis_is_found_elsewhere_with_the_same_numbers(
    ranker: Ranker, tmp_path: Path, registry_folder: Path
) -> None:
    """No worker has the registry, nor the simulators with one effect each that this process made."""
    options = DiagnosisOptions(
        effects=("coulomb_friction",), windows=2, threshold_runs=2, threads=1, ranker=ranker
    )
    with Registry.open(shutil.copytree(registry_folder, tmp_path / "copy")) as registry:
        asked = recorded(registry, "bench", None, None, ingest=False)
        job = {
            "robot": plain_robot(asked.robot),
            "recording": plain_recording(asked.recording),
            "start": None,
            "options": vars(options),
            "threads": 1,
        }
        nulls = HandedOut(Lossy({1: "dynreg.diagnose.diagnose:pose"}), null_of_diagnosis, job)
        (problem, here) = run(_threshold(asked, options, None))
        (_, there) = run(_threshold(asked, options, nulls))
    assert there == here and nulls.rollouts > 0 and problem.terms
    assert (problem.guide is not None) == (ranker == "make")


def test_a_single_worker_has_its_work_too(
    tmp_path: Path, registry_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who asks for workers does not get the answer of this process, however few they are."""
    executor = Lossy(workers=1)
    monkeypatch.setattr("dynreg.executor.opened", lambda *_: nullcontext(executor))
    with session.open(shutil.copytree(registry_folder, tmp_path / "copy")) as opened_here:
        how = {"effects": ("coulomb_friction",), "windows": 2, "threshold_runs": 2, "threads": 1}
        opened_here.diagnose("bench", **how)
    assert sorted(executor.done) == [0, 1]


def _threshold(
    asked: Recorded, options: DiagnosisOptions, nulls: HandedOut | None
) -> Search[tuple[Problem, Threshold]]:
    problem = yield from posed(asked.robot, asked.recording, options)
    found = yield from threshold(problem, asked.recording, options, nulls=nulls)
    return problem, found


@pytest.mark.parametrize("narrow", [False, True])
def test_robots_and_recordings_come_back_from_plain_data(narrow: bool, registry_folder: Path) -> None:
    robot = load_robot("quadruped")
    robot = replace(robot, space=robot.space.with_ranges({"friction": (0.4, 0.5)})) if narrow else robot
    again = robot_from(plain_robot(robot))
    assert again.hash == robot.hash and again.space == robot.space and again.file == robot.file
    with Registry.open(registry_folder) as registry:
        recording = registry.recording("bench")
    other = recording_from(plain_recording(recording))
    assert other.id == recording.id and other.provenance == recording.provenance
    assert other.measured == recording.measured
