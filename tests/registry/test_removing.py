"""What is removed is gone, with what needs it, and with nothing else; no repair brings it back."""

import shutil
from pathlib import Path
from unittest import mock

import pytest
from hands import files_of, lose_catalogue, stored
from registry_contents import POPULATION, ROBOT, make_population, make_recording, make_robot, populate

import dynreg.registry.opening as opening
from dynreg.errors import NoMatchError, RegistryError, UsageError
from dynreg.registry import Registry, collect, removal, remove, verify

OTHER = "ef" * 32


def files(registry: Registry) -> set[str]:
    """All stored files but the ledger's and the catalogue's."""
    passing = ("ledger", "catalog", "locks", "page")
    return {name for name in stored(registry.path) if not name.startswith(passing)}


def kinds(plan) -> list[str]:
    return sorted(kind for kind, _ in plan.things)


def newer(registry: Registry, tmp_path: Path) -> None:
    folder = make_robot(tmp_path / "newer")
    (folder / "robot.toml").write_text('[robot]\nname = "arm"\n# lighter\n')
    registry.put_robot(folder, OTHER, "arm")


def test_a_dry_run_lists_and_changes_nothing(registry):
    before = stored(registry.path)
    plan = removal(registry, ["first run"])
    assert kinds(plan) == ["measured", "recording", "result"] and plan.size > 0
    assert stored(registry.path) == before


def test_a_recording_goes_with_its_results_and_names(registry):
    before = files(registry)
    plan = remove(registry, ["first run"])
    assert before - files(registry) == set(plan.files) and len(plan.files) == 3
    assert registry.recordings() == () and registry.ids("result") == () and len(registry.load("bench")) == 10
    with pytest.raises(NoMatchError):
        registry.resolve("first run")
    registry.put_recording(make_recording(2), ROBOT, "first run")
    assert not verify(registry.path).faults


def test_a_population_goes_with_entries_index_and_what_names_it(registry):
    registry.put_result("neighbours", "first run", {"population": POPULATION})
    plan = remove(registry, ["bench"])
    assert kinds(plan) == ["measured", "population", "result"]
    assert not any(name.startswith(("shards", "populations", "index")) for name in files(registry))
    assert len(registry.ids("result")) == 1 and not verify(registry.path).faults


def test_a_simulator_goes_with_the_results_that_name_it(registry):
    (simulator,) = registry.ids("simulator")
    named = registry.put_result("diagnosis", "first run", {"stages": [{"simulator": simulator}]})
    assert removal(registry, [simulator]).things[("result", named)] == f"simulator {simulator[:12]}"
    remove(registry, [simulator])
    assert named not in registry.ids("result") and len(registry.ids("result")) == 1


def test_a_recording_outlives_a_version_of_its_robot(registry, tmp_path):
    newer(registry, tmp_path)
    plan = remove(registry, [ROBOT])
    assert kinds(plan) == ["measured", "population", "robot", "simulator"]
    (info,) = registry.recordings()
    assert info.robot_hash == OTHER and plan.moved[info.id].version == 2
    assert not (registry.path / "robots" / ROBOT).exists() and not verify(registry.path).faults
    last = remove(registry, ["arm"])
    assert kinds(last) == ["recording", "result", "robot"], "no version is left"
    assert (
        files(registry) == {"dynreg.json"} & stored(registry.path).keys() and not verify(registry.path).faults
    )


def test_a_recording_moves_to_a_version_that_it_fits_and_to_no_other(registry, tmp_path):
    newer(registry, tmp_path)
    (info,) = registry.recordings()
    plan = removal(registry, [ROBOT], lambda recording, robot: robot != OTHER)
    assert ("recording", info.id) in plan.things and not plan.moved
    asked = []
    plan = remove(registry, [ROBOT], lambda *pair: asked.append(pair) or True)
    assert plan.moved[info.id].hash == OTHER and asked == [(info.id, OTHER)]


def test_an_entry_named_after_a_thing_named_twice_is_the_one_that_is_told(registry):
    entry = registry.load_entry(registry.load("bench", ()).ids[3]).id
    with pytest.raises(UsageError, match=f"{entry!r} is an entry"):
        removal(registry, ["first run", "first run", entry])


def test_what_cannot_be_removed_is_refused(registry):
    before = stored(registry.path)
    for ref, error in ((registry.load("bench", ()).ids[3], UsageError), ("nothing", NoMatchError)):
        with pytest.raises(error):
            remove(registry, ["first run", ref])
    with pytest.raises(UsageError, match="nothing to remove"):
        remove(registry, [])
    assert stored(registry.path) == before


@pytest.fixture
def cut_short(registry) -> set[str]:
    """The files of a removal whose process died before it could remove them."""
    before = files(registry)
    with (
        mock.patch.object(registry.directory, "remove", side_effect=KeyboardInterrupt),
        pytest.raises(KeyboardInterrupt),
    ):
        remove(registry, ["first run", "bench"])
    assert files(registry) == before and registry.recordings() == ()
    assert not verify(registry.path).faults
    return before


def test_a_removal_that_was_cut_short_is_finished_by_gc(registry, cut_short):
    there = collect(registry, dry_run=True)
    assert {one.path for one in there} == {
        n for n in cut_short if n.startswith(("sh", "pop", "rec", "mea", "res", "index"))
    }
    assert files(registry) == cut_short
    assert collect(registry) == there and collect(registry) == ()
    assert not verify(registry.path).faults and registry.robots() == {ROBOT: "arm"}


@pytest.mark.parametrize("lost", ["an early page", "the catalogue"])
def test_no_repair_brings_back_what_was_removed(registry, cut_short, lost):
    if lost == "an early page":
        with files_of(registry.path) as root:
            sorted((root / "ledger").iterdir())[2].unlink()
    registry.close()
    if lost == "the catalogue":
        lose_catalogue(registry.path)
    verify(registry.path, repair=True)
    assert not verify(registry.path).faults
    with Registry.open(registry.path) as again:
        assert again.recordings() == again.populations() == again.ids("result") == ()
        assert not any(name.startswith(("recordings/", "shards/")) for name in files(again))


def test_a_lost_page_of_a_removal_is_no_loss_of_data(registry):
    remove(registry, ["first run", "bench"])
    with files_of(registry.path) as root:
        sorted((root / "ledger").iterdir())[-1].unlink()
    registry.close()
    report = verify(registry.path, repair=True)
    assert not [fault for fault in report.lost if fault.kind != "ledger"]
    with Registry.open(registry.path) as again:
        assert again.recordings() == again.populations() == ()


def test_gc_keeps_an_index_of_the_first_entries_from_which_the_others_are_linked(registry):
    ids = registry.load("bench", ()).ids
    registry.put_population(make_population(12))
    populate(registry)
    assert collect(registry) == ()
    count, arrays = registry.grown_index("bench", "landmarks", registry.load("bench", ()).ids)
    assert count == len(ids) == len(arrays["losses"])


def test_gc_keeps_everything_that_something_names(registry):
    registry.cache("thresholds", {"of": "a test"}, {"value": 3.0})
    before = files(registry)
    assert collect(registry) == () and files(registry) == before
    with files_of(registry.path) as root:
        (root / "results" / "neighbours-ab-cd.json").write_text("{}")
    (unnamed,) = collect(registry)
    assert (unnamed.path, unnamed.size) == ("results/neighbours-ab-cd.json", 2)
    gone = {one.path.split("/")[0] for one in collect(registry, caches=True)}
    assert gone == {"cache", "index"} and registry.cached("thresholds", {"of": "a test"}) is None
    assert not verify(registry.path).faults


def test_gc_refuses_where_a_repair_may_need_what_nothing_names(registry):
    with files_of(registry.path) as root:
        sorted((root / "ledger").iterdir())[1].unlink()
    with pytest.raises(RegistryError, match="verify --repair"):
        collect(registry)


def test_gc_clears_copies_that_readers_left(registry, tmp_path, monkeypatch):
    import os
    import tempfile
    import time

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for name, days in (("dynreg-old", 30), ("dynreg-new", 1)):
        (tmp_path / name / "ledger").mkdir(parents=True)
        shutil.copy(registry.path / "catalog.sqlite", tmp_path / name)
        stamp = time.time() - days * 86400
        os.utime(tmp_path / name / "catalog.sqlite", (stamp, stamp))
    (left,) = collect(registry)
    assert left.path == str(tmp_path / "dynreg-old") and left.size > 0
    assert not (tmp_path / "dynreg-old").exists() and (tmp_path / "dynreg-new").exists()


def test_gc_leaves_the_copy_of_a_reader_that_still_runs(registry, tmp_path, monkeypatch):
    import os
    import tempfile
    import time

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(opening, "may_write", lambda path: False)
    with Registry.open(registry.path) as reader:
        monkeypatch.setattr(opening, "may_write", lambda path: True)
        (home,) = tmp_path.glob("dynreg-*")
        stamp = time.time() - 30 * 86400
        os.utime(home / "catalog.sqlite", (stamp, stamp))
        assert collect(registry) == () and home.exists() and len(reader.recordings()) == 1
    assert not home.exists()


def test_gc_tells_a_damaged_index_from_one_whose_entries_are_gone(registry):
    with files_of(registry.path) as root:
        (index,) = (root / "index").glob("*.safetensors")
        index.write_bytes(index.read_bytes()[:-8])
    (found,) = collect(registry, dry_run=True)
    assert found.path == f"index/{index.name}" and found.why == "it is damaged"
