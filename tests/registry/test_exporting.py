"""An exported part is a registry of its own that verifies clean and keeps every id."""

import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
from hands import files_of
from registry_contents import POPULATION, ROBOT, make_shard, populate

from dynreg.errors import CorruptError, NoMatchError, UsageError
from dynreg.registry import Registry, export, verify
from dynreg.registry.files import try_lock


@pytest.fixture
def out(tmp_path):
    return tmp_path / "exported"


def test_population(registry, out, registry_snapshot):
    assert export(registry, ["bench"], out) == (POPULATION,)
    assert verify(out).faults == ()
    with Registry.open(out) as copy:
        assert copy.load("bench").ids == registry.load("bench").ids and copy.recordings() == ()
        np.testing.assert_array_equal(copy.load("bench").states, registry.load("bench").states)
        np.testing.assert_array_equal(
            copy.population("bench").arrays["base"], registry.population("bench").arrays["base"]
        )
        assert registry_snapshot(copy.robot_folder(ROBOT)) == registry_snapshot(registry.robot_folder(ROBOT))


def test_subset_can_be_filled_up_to_the_whole(registry, out):
    ids = registry.load("bench").ids
    wanted = (ids[6], ids[1], ids[2])
    assert export(registry, [entry[:16] for entry in wanted], out) == wanted
    assert verify(out).faults == ()
    with Registry.open(out) as copy:
        part = copy.load("bench")
        np.testing.assert_array_equal(part.numbers, [1, 2, 6])
        np.testing.assert_array_equal(part.states, make_shard(0, 10).states[[1, 2, 6]])
        populate(copy)
        assert copy.load("bench").ids == ids


def test_recording_result_and_simulator(registry, out):
    simulator = registry.put_simulator({"robot": ROBOT})
    export(registry, ["first run", registry.latest().id, simulator], out)
    assert verify(out).faults == ()
    with Registry.open(out) as copy:
        assert copy.recordings() == registry.recordings()
        assert copy.latest() == registry.latest() and copy.simulator(simulator) == {"robot": ROBOT}


def test_a_result_brings_the_simulators_that_it_names(registry, out):
    made = [registry.put_simulator({"robot": ROBOT, "values": {"mass": mass}}) for mass in (1.0, 2.0, 3.0)]
    entries = registry.load("bench", ()).ids
    document = {
        "answer": made[0],
        "synthesised": {"simulator": made[0], "replay_error": 0.1},
        "neighbours": [{"entry": entries[4]}],
        "stages": [
            {"simulator": made[1]},
            {"simulator": None},
            {"simulator": entries[7]},
            {"simulator": "f" * 64},
        ],
    }
    result = registry.put_result("neighbours", "first run", document)
    export(registry, [result], out)
    assert verify(out).faults == ()
    with Registry.open(out) as copy:
        assert copy.result(result).document == document
        assert copy.ids("simulator") == tuple(sorted(made[:2])), "those that it names, and no others"
        assert copy.simulator(made[1]) == registry.simulator(made[1])
        assert copy.load("bench", ()).ids == (entries[7],)


def test_refusals_leave_nothing_behind(registry, out, tmp_path):
    before = sorted(p.name for p in tmp_path.iterdir())
    with pytest.raises(NoMatchError):
        export(registry, ["bench", "nothing like it"], out)
    with pytest.raises(UsageError, match="at least one"):
        export(registry, [], out)
    with pytest.raises(UsageError, match="exists already; expected a name that is not taken; name another"):
        export(registry, ["bench"], tmp_path)
    with files_of(registry.path) as root:
        next((root / "shards").glob("*.parquet")).unlink()
    with pytest.raises(CorruptError):
        export(registry, ["bench"], out)
    assert sorted(p.name for p in tmp_path.iterdir()) == before


KILLED = """
import os, sys
import dynreg.registry.exporting as exporting
from dynreg.registry import Registry, export
exporting._COPY["population"] = lambda *_: os.kill(os.getpid(), 9)
with Registry.open(sys.argv[1]) as registry:
    export(registry, ["first run", "bench"], sys.argv[2])
"""


def test_what_a_killed_export_left_is_swept_by_the_next(registry, out):
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", KILLED, registry.path, out], timeout=60)
        assert done.returncode == -signal.SIGKILL and not out.exists()
        (left,) = out.parent.glob(".exported.tmp-*")
    with try_lock(left):  # as a living export holds it
        export(registry, ["first run"], out)
        assert left.exists()
    shutil.rmtree(out)
    export(registry, ["first run"], out)
    assert not left.exists() and verify(out).faults == ()


def test_a_registry_goes_into_a_folder_that_is_there(registry, tmp_path):
    with pytest.raises(
        UsageError, match="cannot write .*sub': No such file or directory; .* in an existing folder"
    ):
        export(registry, ["bench"], tmp_path / "nowhere" / "sub")
    assert not (tmp_path / "nowhere").exists()
