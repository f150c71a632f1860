"""What goes in comes out, under its id, whenever and however often it was put."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from hands import files_of, stored
from registry_contents import (
    CHANNELS,
    COLUMNS,
    POPULATION,
    ROBOT,
    fill,
    make_population,
    make_recording,
    make_robot,
    make_shard,
    populate,
)

import dynreg.registry.mapped as mapped
from dynreg.errors import NoMatchError, RegistryError, UsageError
from dynreg.registry import Registry, ShardData, verify


def test_population_comes_back(registry):
    record, expected = registry.population("bench"), make_population()
    assert (record.id, record.robot_hash, record.size, record.seed) == (POPULATION, ROBOT, 10, 7)
    assert record.channels == CHANNELS and record.parameters == ("mass", "friction")
    assert record.spec == expected.spec
    for name, array in expected.arrays.items():
        assert record.arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(record.arrays[name], array)
    assert [p.id for p in registry.populations()] == [POPULATION]


def test_entries_come_back_stacked_in_order(registry):
    arrays, expected = registry.load("bench"), make_shard(0, 10)
    np.testing.assert_array_equal(arrays.numbers, np.arange(10))
    np.testing.assert_array_equal(arrays.values, expected.values)
    np.testing.assert_array_equal(arrays.states, expected.states)
    assert arrays.states.dtype == np.float32
    assert arrays.weights.keys() == {"w0", "b0"} and arrays.weights["w0"].dtype == np.float16
    np.testing.assert_array_equal(arrays.weights["w0"], expected.weights["w0"])
    np.testing.assert_array_equal(arrays.own_loss, expected.own_loss)
    np.testing.assert_array_equal(arrays.train_loss, expected.train_loss)
    np.testing.assert_array_equal(arrays.extra["falls"], expected.extra["falls"])
    assert arrays.ids == expected.entry_ids(POPULATION) and len(set(arrays.ids)) == 10


def test_large_arrays_are_read_only_when_asked_for(registry):
    assert registry.load("bench", ()).states is None and registry.load("bench", ()).weights is None
    assert registry.load("bench", ("weights",)).states is None
    with pytest.raises(RegistryError, match="states"):
        registry.load("bench", ("state",))


@pytest.mark.parametrize("number", [0, 3, 4, 9])
def test_one_entry_is_a_row_of_the_stack(registry, number):
    arrays = registry.load("bench")
    entry = registry.load_entry(arrays.ids[number])
    assert (entry.number, entry.population_id) == (number, POPULATION)
    np.testing.assert_array_equal(entry.states, arrays.states[number])
    np.testing.assert_array_equal(entry.weights["b0"], arrays.weights["b0"][number])
    assert entry.values == dict(zip(("mass", "friction"), arrays.values[number], strict=True))
    assert entry.own_loss == arrays.own_loss[number] and entry.extra["falls"] == arrays.extra["falls"][number]


def test_parquet_shard_explains_itself(registry):
    registry.load("bench")  # which brings what lies elsewhere
    (path, *_) = sorted((registry.path / "shards").glob("*.parquet"))
    table, ids = pq.read_table(path), registry.load("bench", ()).ids
    assert table.schema.names == ["entry", "number", "episode", "step", "time", *(c.name for c in COLUMNS)]
    told = {field.name: {k.decode(): v.decode() for k, v in field.metadata.items()} for field in table.schema}
    assert told["arm/velocity"] == {"role": "state", "unit": "rad/s"}
    assert told["arm/target"] == {"role": "action", "unit": "rad"}
    assert told["load"] == {"role": "setting", "unit": "kg"} and told["time"] == {"role": "key", "unit": "s"}
    about, made = json.loads(table.schema.metadata[b"dynreg"]), make_shard(0, 4)
    assert about["entries"] == list(ids[:4]) and about["robot"] == {"name": "bench", "hash": ROBOT}
    assert about["parameters"]["mass"] == {"unit": "kg", "values": made.values[:, 0].tolist()}
    rows = table.filter(pc.equal(table["entry"], ids[2])).to_pydict()
    assert rows["number"] == [2] * 10 and rows["episode"] == [0] * 5 + [1] * 5
    assert rows["step"] == [*range(5)] * 2
    np.testing.assert_allclose(rows["time"], [0.02 * i for i in range(5)] + [0.04 * i for i in range(5)])
    np.testing.assert_array_equal(rows["supply"], made.states[2, :, :, 2].ravel())
    bank = make_population().arrays
    for e in range(2):
        one = slice(5 * e, 5 * e + 5)
        assert rows["arm/target"][one] == [*bank["bank.actions"][e, :, 0].astype(np.float32), None]
        assert rows["load"][one] == [np.float32(bank["bank.settings"][e, 0])] * 5


NUMBERED = ("catalog", "page")  # an ingestion changes which recording is the last


def test_putting_again_changes_no_file(registry, robot):
    before = {
        name: data for name, data in stored(registry.path).items() if name.split(".")[0] not in NUMBERED
    }
    fill(registry, robot)
    ids = registry.put_shard("bench", 4, make_shard(4, 8))
    registry.put_recording(make_recording(1), ROBOT, "first run")
    after = {name: data for name, data in stored(registry.path).items() if name.split(".")[0] not in NUMBERED}
    assert after == before and ids == registry.load("bench").ids[4:8]


def test_two_registries_of_the_same_content_have_the_same_files(registry, tmp_path, robot):
    with Registry.open(tmp_path / "other", create=True) as other:
        fill(other, robot)
        assert other.content_hash() != registry.content_hash()
        other.put_recording(make_recording(1), ROBOT)
        assert other.content_hash() == registry.content_hash()
        names = other.directory.names("shards")
    assert sorted(names) == sorted(registry.directory.names("shards"))


def test_growing_keeps_entries_and_goes_on_behind_a_partial_shard(registry):
    before = registry.load("bench")
    registry.put_population(make_population(14))
    assert registry.missing_spans("bench") == ((10, 12), (12, 14))
    assert populate(registry) == 2
    after = registry.load("bench")
    assert after.ids[:10] == before.ids
    np.testing.assert_array_equal(after.states, make_shard(0, 14).states)
    registry.put_population(make_population(5))
    assert registry.population("bench").size == 14 and registry.missing_spans("bench") == ()


def test_overlapping_shards_add_only_what_is_new(path, robot):
    with Registry.open(path, create=True) as registry:
        registry.put_robot(robot, ROBOT, "arm")
        registry.put_population(make_population(12))
        registry.put_shard("bench", 2, make_shard(2, 5))
        ids = registry.put_shard("bench", 0, make_shard(0, 8))
        assert registry.missing_spans("bench") == ((8, 12),)
        assert registry.load("bench").ids == ids == make_shard(0, 8).entry_ids(POPULATION)
        np.testing.assert_array_equal(registry.load("bench").states, make_shard(0, 8).states)


def test_losses_that_are_no_number_come_back(registry):
    registry.put_population(make_population(11))
    shard = make_shard(10, 11)
    registry.put_shard(
        "bench", 10, ShardData(shard.values, shard.states, shard.weights, [np.nan], [np.inf], shard.extra)
    )
    arrays = registry.load("bench")
    assert np.isnan(arrays.own_loss[10]) and np.isinf(arrays.train_loss[10])


def test_robot_copy_is_complete_and_outlives_its_source(registry, robot, registry_snapshot):
    expected = registry_snapshot(robot)
    shutil.rmtree(robot)
    assert registry_snapshot(registry.robot_folder("arm")) == expected


def test_a_robots_newest_maps_are_kept(registry, robot, registry_snapshot):
    """The hash leaves `maps/` out, so another map is no other robot."""
    for maps in ({"log.toml": "a = 1"}, {"log.toml": "a = 2", "old.toml": "b = 1"}, {"new.toml": "c = 1"}):
        shutil.rmtree(robot / "maps", ignore_errors=True)
        (robot / "maps").mkdir()
        for name, text in maps.items():
            (robot / "maps" / name).write_text(text)
        registry.put_robot(robot, ROBOT, "arm")
        assert registry_snapshot(registry.robot_folder("arm")) == registry_snapshot(robot)
        assert verify(registry.path).faults == ()
    with files_of(registry.path) as root:
        (root / "robots" / ROBOT / "maps" / "new.toml").write_text("damaged")
    (fault,) = verify(registry.path).faults
    assert fault.kind == "robot" and "new.toml" in fault.what
    registry.put_robot(robot, ROBOT, "arm")
    assert verify(registry.path).faults == ()


def test_recording_comes_back_with_all_its_names(registry):
    recording = make_recording(1)
    recording_id = registry.put_recording(recording, ROBOT, "the same")
    assert recording_id == recording.id
    back = registry.recording("the same")
    assert back.id == recording.id and back.provenance["source"] == "log1.csv" and back.measured
    (info,) = registry.recordings()
    assert info.names == ("the same", "first run") and info.robot_hash == ROBOT


def test_documents_come_back(registry):
    assert registry.simulator(registry.put_simulator({"b": 1.5, "a": [1, None]})) == {
        "a": [1, None],
        "b": 1.5,
    }
    first = registry.put_result("diagnosis", "first run", {"verdict": "named"})
    second = registry.put_result("diagnosis", "first run", {"verdict": "none"})
    assert registry.result(first).document == {"verdict": "named"}
    assert registry.latest("diagnosis").id == second
    assert registry.latest("neighbours", "first run").document == {"k": 5}
    registry.put_result("diagnosis", "first run", {"verdict": "named"})
    assert registry.latest("diagnosis", "first run").id == first
    with pytest.raises(NoMatchError, match="gait"):
        registry.latest("gait")
    with pytest.raises(RegistryError, match="null"):
        registry.put_result("diagnosis", "first run", {"error": float("nan")})


def test_index_is_given_only_for_the_entries_it_was_computed_for(registry):
    np.testing.assert_array_equal(registry.index("bench", "landmarks")["losses"], make_shard(0, 10).values)
    assert registry.index("bench", "graph") is None
    registry.put_population(make_population(12))
    assert registry.index("bench", "landmarks") is not None
    populate(registry)
    assert registry.index("bench", "landmarks") is None
    registry.put_index("bench", "landmarks", {"losses": np.zeros(12)})
    assert registry.index("bench", "landmarks")["losses"].shape == (12,)
    assert len(list((registry.path / "index").iterdir())) == 1


def test_an_index_never_passes_for_one_of_other_entries(registry):
    """One process computes while another grows the population and puts an index of its own."""
    before = registry.load("bench", ()).ids
    registry.put_population(make_population(12))
    populate(registry)
    now = registry.load("bench", ()).ids
    assert registry.put_index("bench", "graph", {"links": np.zeros(12)}, now)
    assert not registry.put_index("bench", "graph", {"links": np.zeros(10)}, before)
    assert not registry.put_index("bench", "embedding", {"vectors": np.zeros(10)}, before)
    assert registry.index("bench", "graph")["links"].shape == (12,)
    assert registry.index("bench", "embedding") is None
    assert registry.index("bench", "graph", before) is None, "read by one who has loaded fewer entries"
    assert registry.index("bench", "graph", now)["links"].shape == (12,)


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="this system does not list open files")
def test_models_of_many_shards_hold_few_files_open(registry, monkeypatch):
    monkeypatch.setattr(mapped, "OPEN", 3)
    registry.put_population(make_population(40))
    populate(registry)
    models, opened = registry.models("bench", range(40)), []
    for _ in range(2):
        for row in range(40):
            np.testing.assert_array_equal(models.take([row])["w0"], make_shard(row, row + 1).weights["w0"])
            opened.append(len(os.listdir("/proc/self/fd")))
    assert len(models) == 40 and max(opened) <= min(opened) + 3


def test_no_entries_are_none(registry):
    assert list(registry.parts("bench", [])) == [] == list(registry.weights("bench", []))
    assert sum(len(part.entries) for part in registry.parts("bench")) == 10


def test_entries_that_come_while_an_index_is_written_make_it_stale(registry):
    ids, names = registry.load("bench", ()).ids, sorted((registry.path / "index").iterdir())

    class Links:
        """An array that is made when it is encoded, while the population grows."""

        def __array__(self, dtype=None, copy=None):
            registry.put_population(make_population(12))
            populate(registry)
            return np.zeros(10)

    assert not registry.put_index("bench", "graph", {"links": Links()}, ids)
    assert registry.count("bench") == 12
    assert registry.index("bench", "graph") is None
    assert sorted((registry.path / "index").iterdir()) == names, "nothing is left behind"


def test_registry_can_be_moved(registry, tmp_path):
    content, moved = registry.content_hash(), tmp_path / "elsewhere" / "registry"
    registry.close()
    moved.parent.mkdir()
    shutil.move(registry.path, moved)
    with Registry.open(moved) as registry:
        assert registry.content_hash() == content
        np.testing.assert_array_equal(registry.load("bench").states, make_shard(0, 10).states)
        assert registry.robot_folder("arm").is_relative_to(moved)
        assert registry.recording("first run").id == make_recording(1).id


def _changed_robot(registry, tmp_path):
    folder = make_robot(tmp_path / "changed")
    (folder / "robot.toml").write_text("other")
    registry.put_robot(folder, ROBOT, "arm")


REFUSED = {
    "other content under a number": (
        lambda r, p: r.put_shard("bench", 4, make_shard(4, 8, seed=1)),
        "entry 4",
    ),
    "past the size": (lambda r, p: r.put_shard("bench", 8, make_shard(8, 12)), "0 to 10"),
    "other settings under an id": (lambda r, p: r.put_population(make_population(seed=8)), "other settings"),
    "other files under a robot's hash": (_changed_robot, "other files"),
    "name in use": (
        lambda r, p: r.put_recording(make_recording(2), ROBOT, "first run"),
        "'first run' is in use",
    ),
    "name that reads as a reference": (
        lambda r, p: r.put_recording(make_recording(2), ROBOT, "@last"),
        "@last",
    ),
    "no such robot": (lambda r, p: r.put_recording(make_recording(2), "ef" * 32), "no robot"),
    "no such folder": (lambda r, p: r.put_robot(p / "none", "ef" * 32, "none"), "none"),
    "kind that is a path": (lambda r, p: r.put_result("../x", "first run", {}), "kind"),
    "key that is a path": (lambda r, p: r.put_index("bench", "../x", {}), "letters"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_puts_leave_every_byte_as_it_was(registry, tmp_path, case):
    call, message = REFUSED[case]
    before = stored(registry.path)
    with pytest.raises((RegistryError, NoMatchError, UsageError), match=message):
        call(registry, tmp_path)
    assert stored(registry.path) == before


def test_shapes_must_be_those_of_the_other_entries(registry):
    registry.put_population(make_population(12))
    before = stored(registry.path)
    with pytest.raises(RegistryError, match="shapes"):
        registry.put_shard("bench", 10, make_shard(10, 12, steps=6))
    with pytest.raises(RegistryError, match="number 10 is the same entry as number 0"):
        registry.put_shard("bench", 10, make_shard(0, 1))
    assert stored(registry.path) == before
    with pytest.raises(RegistryError, match="own_loss"):
        ShardData(np.zeros((2, 2)), np.zeros((2, 1, 3, 3)), {}, np.zeros(3), np.zeros(2))
