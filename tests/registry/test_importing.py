"""What another registry holds comes in by content; what is here stays."""

import errno
import re
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hands import files_of
from registry_contents import (
    POPULATION,
    ROBOT,
    make_measured,
    make_population,
    make_recording,
    make_robot,
    make_shard,
)

import dynreg.registry.disk as disk
import dynreg.registry.tables as tables
from dynreg.errors import RegistryError
from dynreg.registry import Registry, export, open_source, remove, take_in, verify


@pytest.fixture
def here(tmp_path):
    with Registry.open(tmp_path / "here", create=True) as registry:
        yield registry


def everything(registry):
    return registry.content_hash(), registry.recordings(), registry.ids("result"), registry.ids("simulator")


def test_an_empty_registry_becomes_the_same(registry, here):
    brought = take_in(here, registry)
    assert everything(here) == everything(registry) and verify(here.path).faults == ()
    assert here.latest() == registry.latest() and here.measured_in("bench") == registry.measured_in("bench")
    assert brought.left_out == () and not any(brought.known.values())
    assert brought.added["entry"] == 10 and brought.added["measured"] == brought.added["result"] == 1
    np.testing.assert_array_equal(here.load("bench").states, registry.load("bench").states)


def test_a_second_import_changes_no_file(registry, here, registry_snapshot):
    take_in(here, registry)
    before = {k: v for k, v in registry_snapshot(here.path).items() if "catalog" not in k}
    brought = take_in(here, registry)
    after = {k: v for k, v in registry_snapshot(here.path).items() if "catalog" not in k}
    contents = ("shards/", "populations/", "recordings/", "results/", "simulators/", "measured/", "robots/")
    assert {k for k in after if k.startswith(contents)} == {k for k in before if k.startswith(contents)}
    assert not any(brought.added.values()) and brought.known["entry"] == 10


def test_missing_entries_are_added_to_those_that_are_here(registry, here, tmp_path):
    export(registry, [registry.load("bench").ids[i] for i in (1, 6)], tmp_path / "some")
    with Registry.open(tmp_path / "some") as some:
        take_in(here, some)
    assert here.count("bench") == 2
    assert take_in(here, registry).added["entry"] == 8
    assert here.load("bench").ids == registry.load("bench").ids


def test_what_differs_or_is_damaged_is_left_out_and_all_else_is_taken(registry, here, tmp_path):
    here.put_robot(make_robot(tmp_path / "other"), ROBOT, "arm")
    here.put_population(make_population(seed=8))
    here.put_recording(make_recording(2), ROBOT, "first run")
    with files_of(registry.path) as root:
        next((root / "simulators").glob("*.json")).write_text("{}")
    brought = take_in(here, registry)
    told = "; ".join(brought.left_out)
    assert f"population {POPULATION[:12]}" in told and "other settings" in told
    assert "the name 'first run'" in told and "simulator" in told
    assert here.count("bench") == 0 and len(here.recordings()) == 2 and len(here.ids("result")) == 1
    assert here.recording("first run").id == make_recording(2).id and verify(here.path).faults == ()


def test_entries_that_others_computed_otherwise_are_left_out(registry, here, tmp_path):
    here.put_robot(make_robot(tmp_path / "other"), ROBOT, "arm")
    here.put_population(make_population())
    here.put_shard("bench", 0, make_shard(0, 4, seed=5))
    own = here.load("bench").ids
    assert "another one than is stored" in take_in(here, registry).left_out[0]
    assert here.load("bench").ids == own


def test_itself_and_what_is_no_registry_are_refused(registry, tmp_path):
    with pytest.raises(RegistryError, match="is the registry itself"):
        take_in(registry, registry)
    with pytest.raises(RegistryError, match="there is no registry"):
        Registry.open(tmp_path / "nothing")


def test_a_measured_entry_is_one_for_a_recording_and_goes_with_it(registry):
    (recording,), entry = [r.id for r in registry.recordings()], make_measured("0" * 64)
    assert registry.put_measured(make_measured(recording)) == registry.measured_in("bench")[recording]
    other = make_measured(recording)
    object.__setattr__(other, "own_loss", 7.0)
    held = registry.measured(registry.put_measured(other))
    assert held.own_loss == 0.5 and entry.id != held.id
    gone = remove(registry, [recording])
    assert {kind for kind, _ in gone.things} == {"recording", "measured", "result"}
    assert registry.measured_in("bench") == {} and not list((registry.path / "measured").iterdir())


def test_a_measured_entry_is_exported_with_what_it_needs(registry, tmp_path):
    ((recording, entry),) = registry.measured_in("bench").items()
    export(registry, [entry], tmp_path / "out")
    with Registry.open(tmp_path / "out") as copy:
        assert copy.measured(entry).id == registry.measured(entry).id
        assert [i.id for i in copy.recordings()] == [recording] and copy.count("bench") == 0


@pytest.fixture
def richer(registry, tmp_path):
    """The small registry with a second recording, which is the last one, and results about both."""
    first = registry.recordings()[0].id
    other = "ef" * 32
    registry.put_robot(make_robot(tmp_path / "other_robot"), other, "leg")
    last = registry.put_recording(make_recording(2), ROBOT, "second run")
    registry.put_result("neighbours", last, {"k": 6})
    registry.put_result("neighbours", first, {"k": 7})
    return registry


def state(registry):
    return registry.recordings(), registry.ids("result"), registry.latest(), registry.population("bench").size


def test_an_empty_registry_gets_the_order_of_the_other_one(richer, here):
    take_in(here, richer)
    assert state(here) == state(richer)
    assert here.resolve("@last", ("recording",)) == richer.resolve("@last", ("recording",))


def test_what_is_here_stays_as_it_is_with_its_order(richer, here, tmp_path):
    take_in(here, richer)
    first, second = (info.id for info in here.recordings())
    other = "ef" * 32
    here.put_recording(make_recording(1), other, "on a leg")  # @last, with another usual robot
    here.put_result("neighbours", second, {"k": 6})  # the latest
    here.put_result("diagnosis", first, {"k": 8})
    before, pages = state(here), sorted((here.path / "ledger").iterdir())
    brought = take_in(here, richer)
    assert not any(brought.added.values()) and state(here) == before
    assert sorted((here.path / "ledger").iterdir()) == pages


def test_a_recording_that_is_here_gets_the_names_that_are_free(richer, here, tmp_path):
    take_in(here, richer)
    first = here.recordings()[0].id
    other = "ef" * 32
    richer.put_recording(make_recording(1), other, "on a leg")
    before = here.recordings()
    assert take_in(here, richer).left_out == ()
    assert [info.id for info in here.recordings()] == [info.id for info in before]
    info = here.recording_info(first)
    assert info.names == ("first run", "on a leg") and info.name == "first run"
    assert info.robot_hash == ROBOT and info.robot_as("on a leg") == other
    assert verify(here.path).faults == ()


def test_a_population_grows_by_what_there_is_and_not_by_what_is_planned(registry, here):
    take_in(here, registry)
    registry.put_population(make_population(size=1000))
    take_in(here, registry)
    assert here.population("bench").size == 10 and here.missing_spans("bench") == ()
    registry.put_shard("bench", 10, make_shard(10, 12))
    assert take_in(here, registry).added["entry"] == 2 and here.population("bench").size == 12


def odd_simulator(registry):
    registry.put_simulator({"values": {"mass": 2.0}})


def unknown_robot(registry):
    registry.put_simulator({"robot": "99" * 32})


def odd_name(registry):
    with registry.directory.catalog.write() as writing:
        row = {"name": "@odd", "recording_id": registry.recordings()[0].id}
        writing.put(tables.recording_names, row)


def lost_recording(registry):
    with files_of(registry.path) as root:
        next((root / "recordings").iterdir()).unlink()


def odd_provenance(registry, monkeypatch):
    read = Registry.recording
    monkeypatch.setattr(
        Registry, "recording", lambda *a: replace(read(*a), provenance={"files": [1, "two", {"three": b"4"}]})
    )


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (odd_simulator, "simulator .*KeyError: 'robot'"),
        (unknown_robot, "simulator .*no robot"),
        (odd_name, "recording .*'@odd' cannot be a recording's name"),
        (lost_recording, "recording .*cannot be read"),
        (odd_provenance, "recording .*(Error|cannot)"),
    ],
)
def test_one_odd_thing_is_left_out_and_all_else_is_taken(registry, here, monkeypatch, spoil, told):
    spoil(*(registry, monkeypatch) if spoil is odd_provenance else (registry,))
    brought = take_in(here, registry)
    assert re.search(told, "\n".join(brought.left_out)) and brought.damaged >= 1
    assert here.count("bench") == 10 and len(here.ids("simulator")) == 1
    assert len(here.recordings()) == (0 if "recording" in told else 1)
    assert verify(here.path).faults == ()


def test_only_a_target_that_cannot_be_written_ends_an_import(registry, here, monkeypatch):
    def full(descriptor, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(disk, "write", full)
    with pytest.raises(RegistryError, match="No space left"):
        take_in(here, registry)


def test_what_differs_or_has_a_taken_name_is_not_damaged(registry, here, tmp_path):
    here.put_robot(make_robot(tmp_path / "other"), ROBOT, "arm")
    here.put_population(make_population(seed=8))
    here.put_recording(make_recording(2), ROBOT, "first run")
    brought = take_in(here, registry)
    assert brought.damaged == 0 and len(brought.left_out) == 3
    assert "10 of its 10 entries are missing here" in "; ".join(brought.left_out)


def test_what_is_larger_than_a_limit_allows_is_left_out_and_not_damaged(registry, here, monkeypatch):
    monkeypatch.setenv("DYNREG_MAX_NUMBERS", "20")
    brought = take_in(here, registry)
    told = [line for line in brought.left_out if line.startswith(("recording", "population"))]
    assert told and all("set DYNREG_MAX_NUMBERS higher" in line for line in told) and brought.damaged == 0


def test_sound_shards_of_a_damaged_population_are_taken(registry, here):
    with files_of(registry.path) as root:
        min((root / "shards").glob("*.parquet")).unlink()
    brought = take_in(here, registry)
    (told,) = (line for line in brought.left_out if line.startswith("population"))
    assert told.endswith("No such file or directory; 4 of its 10 entries are missing here")
    assert brought.damaged == 1 and here.count("bench") == 6


@pytest.mark.parametrize("form", ["form_2.zip", "format_1.zip", None])
def test_the_other_registry_stays_byte_for_byte(here, filled, tmp_path, form):
    other = tmp_path / "other"
    if form is None:
        shutil.copytree(filled, other)
    else:
        shutil.unpack_archive(Path(__file__).with_name(form), other)
    before = {path: path.is_file() and path.read_bytes() for path in other.rglob("*")}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with open_source(other) as source:
            assert take_in(here, source).left_out == ()
    assert {path: path.is_file() and path.read_bytes() for path in other.rglob("*")} == before
    assert here.populations() and verify(here.path).faults == ()
    with Registry.open(other) as renewed:  # its files are those of the present form, so that both fit
        assert take_in(here, renewed).left_out == ()


def test_no_room_for_the_copy_of_a_catalogue_is_told(registry, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(RegistryError, match="cannot be copied to .*No space left on device.* TMPDIR"):
        open_source(registry.path)
    assert not list(tmp_path.glob("dynreg-*"))
