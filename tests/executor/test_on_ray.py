"""Ray: as every executor; workers that are killed or have another version; commands that answer as locally."""

import json
import os
import socket
from collections.abc import Callable, Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import jobs
import numpy as np
import pytest
import tiny_registry

import dynreg
from dynreg.cli.main import main
from dynreg.errors import BudgetError, ExecutorError, UsageError
from dynreg.executor import Executor, opened
from dynreg.registry import verify
from dynreg.verbs.populations import fill_span

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("ray") is None, reason="no ray: run `make test-ray`"),
]
HERE = Path(__file__).parent
TIMES = {"seconds", "core_seconds", "seconds_median", "cost"}


@pytest.fixture(scope="module")
def on_ray() -> Iterator[Executor]:
    """Two workers on this machine, which find the functions of these tests."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE), str(HERE.parent), *filter(None, [before])])
    try:
        import ray

        ray.init("local", num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
        with opened("ray") as executor:
            yield executor
    finally:
        ray.shutdown()
        os.environ.update({"PYTHONPATH": before or ""})


def timeless(document: Any) -> Any:
    """A document without the time that it took."""
    if isinstance(document, dict):
        return {key: timeless(value) for key, value in document.items() if key not in TIMES}
    return [timeless(one) for one in document] if isinstance(document, list) else document


def test_results_come_in_the_order_of_the_jobs(on_ray: Executor) -> None:
    assert on_ray.workers == 2 and on_ray.threads == 1
    every = [{"values": np.full(3, i), "name": str(i)} for i in range(8)]
    found = list(on_ray.map(jobs.doubled, every))
    assert [name for name, _ in found] == [one["name"] for one in every]
    assert all((values == 2 * one["values"]).all() for (_, values), one in zip(found, every, strict=True))


@pytest.mark.parametrize("kind", ["usage", "budget"])
def test_an_error_of_ours_is_tried_once_and_stays_what_it_is(kind: str, on_ray, tmp_path: Path) -> None:
    with pytest.raises((UsageError, BudgetError)) as raised:
        list(on_ray.map(jobs.refused, [{"kind": kind, "counter": str(tmp_path / "tries")}]))
    with pytest.raises(type(raised.value)) as local:
        jobs.refused(kind, str(tmp_path / "others"))
    assert vars(raised.value) == vars(local.value) and str(raised.value) == str(local.value)
    assert (tmp_path / "tries").read_text() == "."


def test_a_bug_is_what_it_was(on_ray: Executor) -> None:
    with pytest.raises(ZeroDivisionError, match="here"):
        list(on_ray.map(jobs.broken, [{"counter": "here"}]))


def test_a_job_whose_worker_is_lost_is_done_again_and_not_for_ever(on_ray: Executor, tmp_path: Path) -> None:
    every = [{"number": number, "folder": str(tmp_path)} for number in range(4)]
    assert list(on_ray.map(jobs.once_lost, every)) == [0, 1, 2, 3]
    with pytest.raises(ExecutorError, match="lost the worker of a job each time"):
        list(on_ray.map(jobs.lost, [{"number": 0}]))


@pytest.mark.parametrize(
    "dies",
    [
        "dynreg.verbs.populations:make_entries",
        "dynreg.registry.directory:Directory.stage",
        "dynreg.registry.registry:Registry.put_shard",
    ],
)
def test_a_populate_whose_worker_is_killed_leaves_the_same_bytes(
    dies, on_ray, filled, usual, tmp_path
) -> None:
    class Killing:
        """Each worker's first shard kills it, until one has."""

        threads, workers = on_ray.threads, on_ray.workers

        def map(self, function: Callable[..., Any], every: Iterable[dict[str, Any]]) -> Iterator[Any]:
            assert function is fill_span
            extra = {"mark": str(tmp_path / "killed"), "dies": dies}
            return on_ray.map(jobs.span_killed_once, [{**job, **extra} for job in every])

    assert filled(Killing())[0] == usual[0]
    assert (tmp_path / "killed").exists()
    report = verify(tmp_path / "registry")
    assert report.faults == () and report.leftovers == ()


def test_shards_made_by_workers_are_the_same_bytes(on_ray, filled, usual) -> None:
    assert filled(on_ray) == usual


def test_a_worker_with_another_version_is_refused(on_ray, monkeypatch: pytest.MonkeyPatch) -> None:
    here = dynreg.__version__
    monkeypatch.setattr(dynreg, "__version__", "99.0", raising=False)
    with pytest.raises(ExecutorError, match=rf"has dynreg {here}.*pip install dynreg==99.0"):
        list(on_ray.map(jobs.doubled, [{"values": np.zeros(1), "name": "a"}]))


def test_more_threads_than_a_machine_has_cores_are_refused(on_ray) -> None:
    with pytest.raises(ExecutorError, match="of 3 threads .* have 2 cores"), opened("ray", None, 3):
        pass


def test_a_trial_and_a_diagnosis_say_the_same(on_ray, tmp_path: Path, registry_folder: Path) -> None:
    def asked(executor: str) -> list[Any]:
        with dynreg.open(tmp_path / executor) as session:
            table = session.trial(
                "servo_pendulum", count=3, seconds=15.0, threshold_runs=2, executor=executor
            )
            log = registry_folder.parent / "bench.csv"
            how = {"threshold_runs": 3, "windows": 4, "effects": ("coulomb_friction", "command_delay")}
            found = session.diagnose(log, robot="servo_pendulum", **how, executor=executor)
        return [timeless(table.to_dict()), timeless(found.to_dict()), found.cost.rollouts]

    assert asked("ray") == asked("local")


def test_a_cluster_that_does_not_answer_is_told_at_once(tmp_path: Path, capsys) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    import ray

    ray.shutdown()
    line = ("populate", "servo_pendulum", "-n", "2", "--registry", str(tmp_path / "r"))
    status = main((*line, "--executor", "ray", "--address", address))
    said = capsys.readouterr().err
    assert status == 1 and said.startswith(f"error: no Ray cluster at '{address}'") and said.count("\n") == 1
    assert not (tmp_path / "r").exists()


def test_a_command_prints_one_document_and_nothing_else(tmp_path: Path, capfd) -> None:
    """With workers that it starts itself; the population is that of `tiny_registry`, which trains quickly."""
    with dynreg.open(tmp_path / "registry") as session:
        session.populate("servo_pendulum", 1, training=tiny_registry.QUICK, link=False)
    line = ("populate", "servo_pendulum", "-n", "3", "--registry", str(tmp_path / "registry"), "--json")
    assert main((*line, "--executor", "ray")) == 0
    assert json.loads(capfd.readouterr().out)["entries"] == 3
