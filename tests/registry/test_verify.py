"""Each damage is found, and a repair leaves a registry that verifies clean and can be filled again."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from hands import files_of, lose_catalogue, sql, stored
from registry_contents import ROBOT, make_population, make_recording, make_shard, populate

from dynreg.data.recording import Recording
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry import Registry, collect, verify
from dynreg.registry.writing import Writing


def _one(root: Path, pattern: str) -> Path:
    return sorted(root.glob(pattern))[0]


def _flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x10
    path.write_bytes(data)


def _truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


def test_a_sound_registry_has_no_faults(registry):
    report = verify(registry.path)
    assert report.faults == () and report.leftovers == ()
    assert report.checked["entries"] == 10 and report.checked["shards"] == 3
    assert report.lost == ()
    before = stored(registry.path)
    assert verify(registry.path).faults == () and stored(registry.path) == before


# kind of file: its pattern, and what a repair makes of the damage: taken out, or left to be put again
FILES = {
    "shard states": ("shards/*.parquet", "shard"),
    "shard weights": ("shards/*.safetensors", "shard"),
    "recording": ("recordings/*.parquet", "recording"),
    "simulator": ("simulators/*.json", "simulator"),
    "result": ("results/*.json", "result"),
    "index": ("index/*.safetensors", "index"),
    "population": ("populations/*.safetensors", "population"),
    "robot": ("robots/*/robot.toml", "robot"),
}


DAMAGES = [(file, damage) for file in FILES for damage in (_flip, Path.unlink)]
DAMAGES.remove(("index", Path.unlink))  # what can be computed again may be missing
DAMAGES += [("shard states", _truncate), ("shard weights", _truncate)]


@pytest.mark.parametrize(("file", "damage"), DAMAGES, ids=[f"{f} {d.__name__}" for f, d in DAMAGES])
def test_damaged_file_is_found_and_healed(registry, robot, file, damage):
    pattern, kind = FILES[file]
    whole, content = registry.load("bench"), registry.content_hash()
    with files_of(registry.path) as root:
        damage(_one(root, pattern))

    report = verify(registry.path)
    assert [fault.kind for fault in report.faults] == [kind]
    assert report.lost == (() if kind == "index" else report.faults)

    mended = verify(registry.path, repair=True)
    assert [fault.kind for fault in mended.faults] == [kind]
    kept = kind in ("population", "robot")
    assert bool(mended.faults[0].mended) != kept
    assert len(verify(registry.path).faults) == kept

    registry.put_robot(robot, ROBOT, "arm")
    registry.put_population(make_population())
    assert populate(registry) == (1 if kind == "shard" else 0)
    registry.put_recording(make_recording(1), ROBOT, "first run")
    assert verify(registry.path).faults == ()
    assert registry.load("bench").ids == whole.ids and registry.content_hash() == content
    np.testing.assert_array_equal(registry.load("bench").states, whole.states)


def test_reading_what_is_damaged_is_an_error_that_names_the_next_step(registry):
    with files_of(registry.path) as root:
        _flip(_one(root, "recordings/*"))
        _truncate(_one(root, "shards/*.parquet"))
        _truncate(_one(root, "populations/*"))
        _one(root, "robots/*/robot.toml").unlink()
        _flip(_one(root, "index/*"))
    for read in (registry.recording, registry.load, registry.population, registry.robot_folder):
        ref = {"recording": "first run", "robot_folder": "arm"}.get(read.__name__, "bench")
        with pytest.raises(CorruptError, match="repair|with the robot's own folder again") as error:
            read(ref)
        assert error.value.exit_status == 3
    assert registry.index("bench", "landmarks") is None


ROWS = {
    "entry": ("DELETE FROM entries WHERE number = 5", "entries"),
    "entry changed": ("UPDATE entries SET id = 'ab' WHERE number = 5", "entries"),
    "entry moved": ("UPDATE entries SET number = 15 WHERE number = 5", "entries"),
    "shard": ("DELETE FROM shards WHERE start = 4", "row"),
    "shard moved": ("UPDATE shards SET stop = 7 WHERE start = 4", "row"),
    "file": ("DELETE FROM files WHERE path LIKE 'shards/%.parquet'", "row"),
    "file's hash": ("UPDATE files SET sha256 = 'x' WHERE path LIKE 'populations/%'", "row"),
    "population": ("DELETE FROM populations", "row"),
    "robot": ("DELETE FROM robots", "row"),
    "recording": ("DELETE FROM recordings", "row"),
}


@pytest.mark.parametrize("case", ROWS)
def test_damaged_row_is_found_and_written_again_from_the_files(registry, case):
    statement, kind = ROWS[case]
    content = registry.content_hash()
    sql(registry.path, statement)
    assert kind in {fault.kind for fault in verify(registry.path).faults}
    verify(registry.path, repair=True)
    assert verify(registry.path).faults == () and verify(registry.path).leftovers == ()
    assert registry.content_hash() == content and registry.missing_spans("bench") == ()
    np.testing.assert_array_equal(registry.load("bench").states, make_shard(0, 10).states)


def test_added_files_are_put_away(registry):
    strange = ["shards/notes.txt", "shards/copy.parquet", "notes.txt", f"robots/{ROBOT}/more.txt"]
    for name in strange:
        (registry.path / name).write_text("mine")
    (registry.path / "results" / f"x-{'0' * 16}-{'0' * 16}.json").write_text("{}")
    (registry.path / "shards" / "link").symlink_to("/nowhere")
    report = verify(registry.path)
    assert [fault.kind for fault in report.faults] == ["stray"] * 6 and not report.lost
    verify(registry.path, repair=True)
    assert verify(registry.path).faults == ()
    assert not any((registry.path / name).exists() for name in strange)
    kept = [p.read_text() for p in (registry.path / "lost+found").iterdir() if not p.is_symlink()]
    assert sorted(kept) == ["mine"] * 4 + ["{}"]


@pytest.mark.parametrize("name", [".DS_Store", "._notes", "Thumbs.db", "desktop.ini"])
def test_what_a_file_manager_leaves_is_no_fault_and_stays(registry, name):
    folders = [".", "shards", "recordings", "ledger", "index"] + [f"robots/{ROBOT}"] * name.startswith(".")
    for folder in folders:
        (registry.path / folder / name).write_text("theirs")
    report = verify(registry.path)
    assert report.faults == () and report.leftovers == ()
    assert verify(registry.path, repair=True).faults == ()
    assert name not in {one.path.rpartition("/")[2] for one in collect(registry, caches=True)}
    assert all((registry.path / folder / name).exists() for folder in folders)
    assert registry.load("bench").ids and registry.recordings()


@pytest.mark.parametrize("what", ["entries", "recording"])
def test_files_that_a_killed_process_left_are_no_fault_and_serve_the_next_put(registry, monkeypatch, what):
    registry.put_population(make_population(12))

    def put():
        if what == "entries":
            registry.put_shard("bench", 10, make_shard(10, 12))
        else:
            registry.put_recording(make_recording(3), ROBOT)

    content = registry.content_hash()
    with monkeypatch.context() as killed, pytest.raises(KeyboardInterrupt):
        killed.setattr(Writing, "page", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        put()  # its files are there, and nothing tells of them
    report = verify(registry.path)
    assert report.faults == () and len(report.leftovers) == (2 if what == "entries" else 1)
    assert registry.content_hash() == content
    verify(registry.path, repair=True)
    assert registry.content_hash() == content and len(verify(registry.path).leftovers) == len(
        report.leftovers
    )
    put()
    assert registry.content_hash() != content
    assert verify(registry.path).leftovers == () == verify(registry.path).faults


def test_a_robot_may_call_its_files_anything_that_is_text(registry, robot):
    (robot / "meshes" / "soft\u00adhyphen \u202e.stl").write_bytes(b"1")
    registry.put_robot(robot, "ef" * 32, "odd")
    assert verify(registry.path).faults == ()


def test_half_copied_robot_is_no_fault(registry):
    with files_of(registry.path) as root:
        half = root / "robots" / ("ef" * 32)
        half.mkdir()
        (half / "robot.toml").write_text("")
    assert verify(registry.path).faults == () and verify(registry.path).leftovers != ()
    verify(registry.path, repair=True)
    with files_of(registry.path) as root:
        assert (root / "robots" / ("ef" * 32)).exists() and list(registry.robots()) == [ROBOT]


def test_recording_put_again_heals_a_damaged_file_whatever_its_provenance(registry):
    with files_of(registry.path) as root:
        _flip(_one(root, "recordings/*"))
    whole = make_recording(1)
    registry.put_recording(
        Recording(whole.channels, whole.episodes, provenance={"source": "copy.csv"}), ROBOT
    )
    assert registry.recording("first run").id == whole.id
    assert not verify(registry.path).lost


@pytest.mark.parametrize("how", ["overwrite", "delete"])
def test_lost_catalogue_is_written_anew_from_the_files(registry, how):
    content, path = registry.content_hash(), registry.path
    registry.close()
    lose_catalogue(path, how)
    with pytest.raises(CorruptError, match="repair"):
        Registry.open(path)
    assert verify(path).faults[0].kind == "catalog"
    verify(path, repair=True)
    assert verify(path).faults == ()
    with Registry.open(path) as registry:
        assert registry.content_hash() == content
        assert registry.population("bench").size == 10 and registry.robots() == {ROBOT: "arm"}
        assert registry.latest("neighbours").document == {"k": 5}
        np.testing.assert_array_equal(registry.load("bench").states, make_shard(0, 10).states)


def test_damaged_page_of_the_catalogue_is_found(registry):
    path = registry.path
    registry.close()
    data = bytearray((path / "catalog.sqlite").read_bytes())
    data[5 * 4096 : 5 * 4096 + 64] = b"\xff" * 64
    (path / "catalog.sqlite").write_bytes(data)
    assert verify(path).faults
    verify(path, repair=True)
    assert verify(path).faults == ()


def test_path_out_of_the_registry_is_refused(registry, tmp_path):
    with files_of(registry.path) as root:
        shutil.copy(_one(root, "recordings/*"), tmp_path / "outside.parquet")
    sql(registry.path, "UPDATE recordings SET path = '../outside.parquet'")
    with pytest.raises(CorruptError, match="outside"):
        registry.recording("first run")


def test_verify_of_what_is_no_registry(tmp_path):
    with pytest.raises(RegistryError, match="registry"):
        verify(tmp_path)
