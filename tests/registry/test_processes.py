"""Several processes at once, and processes that are killed in the middle of a write."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from registry_contents import POPULATION, ROBOT, make_population, make_shard, populate

from dynreg.registry import Registry, verify
from dynreg.registry.files import temporary_name

WORKER = """
import sys
from registry_contents import make_recording, make_shard, populate, ROBOT
from dynreg.registry import Registry
path, mode = sys.argv[1:]
print("ready", flush=True)
with Registry.open(path) as registry:
    if mode == "share":
        while registry.missing_spans("bench"):
            populate(registry)
    elif mode == "race":
        for start in range(0, 40, 4):
            registry.put_shard("bench", start, make_shard(start, start + 4))
    elif mode == "ingest":
        for seed in range(12):
            registry.put_recording(make_recording(seed), ROBOT, f"run {seed}")
    elif mode == "hold":
        with registry.claim("bench", 0) as mine:
            print(mine, flush=True)
            sys.stdin.read()
"""


def start(path: Path, mode: str) -> subprocess.Popen:
    here = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    worker = subprocess.Popen(
        [sys.executable, "-c", WORKER, path, mode],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": here},
        text=True,
    )
    assert worker.stdout.readline() == "ready\n"
    return worker


@pytest.fixture
def planned(path, robot):
    """A registry with a population of 40 entries planned and none computed."""
    with Registry.open(path, create=True) as registry:
        registry.put_robot(robot, ROBOT, "arm")
        registry.put_population(make_population(40))
        yield registry


def test_killed_writers_leave_whole_shards_and_the_rest_is_resumed(planned):
    rng = np.random.default_rng()  # another moment in every run
    for _ in range(3):
        worker = start(planned.path, "share")
        time.sleep(rng.uniform(0.0, 0.4))
        worker.send_signal(signal.SIGKILL)
        worker.communicate()
        assert verify(planned.path).faults == ()
        done = planned.count("bench")
        assert done % 4 == 0
        if done:
            np.testing.assert_array_equal(
                planned.load("bench").values, make_shard(0, 40).values[planned.load("bench").numbers]
            )
    populate(planned)
    assert planned.load("bench").ids == make_shard(0, 40).entry_ids(POPULATION)
    np.testing.assert_array_equal(planned.load("bench").states, make_shard(0, 40).states)
    verify(planned.path, repair=True)
    report = verify(planned.path)
    assert report.faults == () and report.leftovers == ()
    assert not [p for p in planned.path.rglob(".*") if ".tmp-" in p.name]


@pytest.mark.parametrize("mode", ["share", "race"])
def test_two_writers_of_one_population(planned, mode):
    workers = [start(planned.path, mode) for _ in range(2)]
    for worker in workers:
        worker.communicate(timeout=60)
        assert worker.returncode == 0
    assert planned.load("bench").ids == make_shard(0, 40).entry_ids(POPULATION)
    report = verify(planned.path)
    assert report.faults == () and report.leftovers == () and report.checked["shards"] == 10


def test_two_processes_ingesting_and_one_reading(planned):
    workers = [start(planned.path, "ingest") for _ in range(2)]
    while any(worker.poll() is None for worker in workers):
        for info in planned.recordings():
            assert planned.recording(info.id).id == info.id
        time.sleep(0.02)
    assert [worker.wait() for worker in workers] == [0, 0]
    assert len(planned.recordings()) == 12 and verify(planned.path).faults == ()


def test_a_claim_is_exclusive_and_ends_with_its_process(planned):
    worker = start(planned.path, "hold")
    assert worker.stdout.readline() == "True\n"
    with planned.claim("bench", 0) as mine:
        assert not mine
    with planned.claim("bench", 4) as mine:
        assert mine
    worker.kill()
    worker.communicate()
    with planned.claim("bench", 0) as mine:
        assert mine
        planned.put_shard("bench", 0, make_shard(0, 4))
    with planned.claim("bench", 0) as mine:
        assert not mine, "what is done cannot be claimed"
    assert list((planned.path / "locks").iterdir()) == []


def test_temporary_files_of_killed_writers_are_no_fault_and_are_swept(planned):
    left = temporary_name(planned.path / "shards" / "half.parquet")
    left.write_bytes(b"half")
    report = verify(planned.path)
    assert report.faults == () and report.leftovers == () and left.exists()
    planned.put_population(make_population(40))
    assert not left.exists()


def test_two_processes_creating_one_registry(tmp_path):
    code = "import sys; from dynreg.registry import Registry; Registry.open(sys.argv[1], create=True)"
    workers = [subprocess.Popen([sys.executable, "-c", code, tmp_path / "new"]) for _ in range(2)]
    assert [worker.wait(60) for worker in workers] == [0] * 2
    assert verify(tmp_path / "new").faults == ()
