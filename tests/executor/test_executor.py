"""Every executor: results in order, our own errors as they are, a lost worker loses nothing, the same bytes."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import jobs
import numpy as np
import pytest
from lossy import Lossy

from dynreg.cli.main import main
from dynreg.errors import UsageError
from dynreg.executor import Executor, Local, opened
from dynreg.registry import verify

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
    assert status == 2 and "--address '127.0.0.1:6379' without" in said and "--executor ray" in said


def test_an_unknown_executor_is_refused(line) -> None:
    status, said = line("--executor", "slurm")
    assert status == 2 and "local, ray" in said


def test_local_is_the_usual_one() -> None:
    with opened("local", None, 3) as executor:
        assert executor == Local(3) and executor.workers == 1
