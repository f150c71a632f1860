"""Nothing that was changed from outside is answered with, and `verify` finds each change of a value."""

import hashlib
import json
import os
import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from flips import answers, flipped, flipped_objects, found, judged, wrong
from hands import bucket_of, files_of, lose_catalogue, row_number, sql, stored
from registry_contents import ROBOT, make_population, make_recording, make_robot, make_shard
from sound import Sound, sound_in

from dynreg.data.recording import Recording
from dynreg.errors import CorruptError, Damaged, DynregError, LimitError, NoPlaceError, RegistryError
from dynreg.registry import Registry, repairing, tables, verify
from dynreg.registry.files import try_lock
from dynreg.registry.sharing import shared_at


@pytest.fixture(scope="module")
def sound(tmp_path_factory, request) -> Sound:
    shared = request.config.getoption("--store") == "shared"
    return sound_in(tmp_path_factory.mktemp("sound"), request.getfixturevalue("stores") if shared else None)


@pytest.fixture(scope="module")
def right(sound, tmp_path_factory) -> dict:
    with sound.copied(tmp_path_factory.mktemp("right") / "registry") as copy:
        return answers(copy)


@pytest.fixture
def work(sound, tmp_path) -> Iterator[Path]:
    with sound.copied(tmp_path / "work") as work:
        with Registry.open(work):  # folds the log of a folder into the catalogue
            pass
        yield work


def _refused_or_right(right: dict, work: Path) -> bool:
    """Whether nothing that was changed is answered with; no look at a shared catalogue compares all its rows."""
    return shared_at(work) is not None or wrong(right, work) == []


def test_flipped_bits_are_found_or_change_nothing(sound, right, tmp_path):
    with sound.copied(tmp_path / "sound") as work:
        flips = (flipped_objects if sound.stores else flipped)(work, 40, seed=20261123)
        verdicts = {name: judged(right, path) for name, path in flips}
    assert [name for name, verdict in verdicts.items() if verdict == "wrong"] == []
    in_files = [v for name, v in verdicts.items() if not name.startswith(("catalog", "searches"))]
    assert set(in_files) == {"found"}, "every file but the catalogue's has no bytes without a meaning"


@pytest.mark.slow
def test_ten_thousand_flipped_bits(sound, right):
    wrong_ones = [n for n, path in flipped(sound.path, 10_000, seed=1) if judged(right, path) == "wrong"]
    assert wrong_ones == []


COLUMNS = [(table.name, column.name) for table in tables.SEALED + (tables.seals,) for column in table.c]


@pytest.mark.parametrize(("table", "column"), COLUMNS, ids=[f"{t}.{c}" for t, c in COLUMNS])
def test_each_column_of_the_catalogue_changed_is_found_and_not_answered_with(work, right, table, column):
    other = {"TEXT": f"'x' || {column}", "INTEGER": f"{column} + 100"}
    kind = str(next(c for c in tables.metadata.tables[table].c if c.name == column).type)
    sql(work, f"UPDATE {table} SET {column} = {other[kind]} WHERE {_one(work, table)}")
    assert found(work)
    assert _refused_or_right(right, work)
    verify(work, repair=True)
    assert not found(work) and answers(work) == right


def _one(work: Path, table: str) -> str:
    row = row_number(work)
    return f"{row} = (SELECT {row} FROM {table} ORDER BY {row} LIMIT 1)"


@pytest.mark.parametrize("table", [t.name for t in tables.SEALED])
def test_each_row_of_the_catalogue_lost_is_found_and_comes_back(work, right, table):
    sql(work, f"DELETE FROM {table} WHERE {_one(work, table)}")
    assert found(work)
    if shared_at(work) is None:
        with pytest.raises(CorruptError, match="changed from outside"):
            answers(work)
    verify(work, repair=True)
    assert not found(work) and answers(work) == right


MORE = {
    "a name more": "INSERT INTO recording_names SELECT 'more', recording_id FROM recording_names LIMIT 1",
    "a result twice": "INSERT INTO results SELECT 'ee', kind, recording_id, path, ordinal + 7 FROM results LIMIT 1",
    "an entry of nobody": "INSERT INTO entries SELECT 'ef', population_id, number + 1000 FROM entries LIMIT 1",
    "an entry of another registry": f"UPDATE entries SET id = '{'ad' * 32}' WHERE number = 3",
    "two entries with each other's number": "UPDATE entries SET number = 4 - number WHERE number IN (1, 3)",
    "a recording with another's file": "UPDATE recordings SET path = (SELECT max(path) FROM recordings)",
    "a file more": "INSERT INTO files SELECT 'shards/x', sha256, size FROM files LIMIT 1",
}


@pytest.mark.parametrize("change", MORE)
def test_rows_more_moved_and_of_elsewhere_are_found_and_taken_out(work, right, change):
    if "each other" in change:  # no number is there twice
        sql(work, "UPDATE entries SET number = -number WHERE number IN (1, 3)")
        sql(work, "UPDATE entries SET number = 4 + number WHERE number < 0")
    else:
        sql(work, MORE[change])
    assert found(work)
    assert _refused_or_right(right, work)
    verify(work, repair=True)
    assert not found(work) and answers(work) == right


def _one_of_each_kind(root: Path) -> list[str]:
    kept = [p.relative_to(root) for p in sorted(root.rglob("*")) if p.is_file() and p.stat().st_size]
    kept = [p for p in kept if "locks" not in p.parts and not p.name.endswith("-shm")]
    return [p.as_posix() for p in {(p.parts[0], p.suffix): p for p in kept}.values()]


@pytest.mark.parametrize("damage", ["half", "last byte", "empty", "gone"])
def test_files_cut_short_or_gone_are_found_and_not_answered_with(sound, right, tmp_path, damage):
    with files_of(sound.path) as root:
        kinds = _one_of_each_kind(root)
    for name in kinds:
        with sound.copied(tmp_path / "work") as work:
            with files_of(work) as root:
                place, size = root / name, (root / name).stat().st_size
                if damage == "gone":
                    place.unlink()
                else:
                    os.truncate(place, {"half": size // 2, "last byte": size - 1, "empty": 0}[damage])
            verdict, folder = judged(right, work), name.split("/")[0]
        may_be_missing = folder in ("cache", "index", "searches") or folder.startswith("catalog.sqlite-")
        may_be_missing |= (folder, damage) == ("dynreg.json", "last byte")  # the end of its line
        assert verdict == "found" or (verdict == "no value changed" and may_be_missing), (name, verdict)


def test_files_of_another_registry_and_copies_under_other_names_are_found(work, right, tmp_path):
    other = make_shard(0, 4, seed=5)
    with Registry.open(tmp_path / "other", create=True) as elsewhere:
        elsewhere.put_robot(make_robot(tmp_path / "robot"), ROBOT, "arm")
        elsewhere.put_population(make_population())
        elsewhere.put_shard("bench", 0, other)
    with files_of(work) as root:
        mine, theirs = (min((p / "shards").glob("*.safetensors")) for p in (root, tmp_path / "other"))
        shutil.copy(theirs, root / "shards" / theirs.name)  # a stray: sound, and of the same population
        shutil.copy(mine, root / "shards" / f"copy-{mine.name}")
    assert answers(work) == right, "no row tells of them"
    verify(work, repair=True)
    assert verify(work).faults == () and answers(work) == right
    with files_of(work) as root:
        shutil.copy(theirs, root / "shards" / mine.name)
    assert found(work) and wrong(right, work) == []
    verify(work, repair=True)
    assert verify(work).faults == () and answers(work) == right, "the copy has its bytes"


def test_names_and_order_outlast_the_catalogue(work, right):
    """They lie in the ledger, whichever way the catalogue is lost."""
    for damage in _LOSSES if shared_at(work) is None else (lose_catalogue, _emptied):
        damage(work)
        with pytest.raises(CorruptError, match="repair"):
            Registry.open(work)
        assert verify(work).faults[0].kind == "catalog"
        assert not verify(work, repair=True).lost, "the ledger tells all"
        assert answers(work) == right and verify(work).faults == ()


_LOSSES = (
    lambda work: (work / "catalog.sqlite").unlink(),
    lambda work: (work / "catalog.sqlite").write_bytes(b""),
    lambda work: (work / "catalog.sqlite").write_bytes(b"\x07" * 9000),
)


def _emptied(work: Path) -> None:
    sql(work, *(f"DELETE FROM {name}" for name in tables.metadata.tables if name != "migrations"))


def test_a_lost_ledger_is_begun_anew_from_the_catalogue(work, right):
    for first, stop in ((0, 1), (-1, None), (3, 5)):
        with files_of(work) as root:
            pages = sorted((root / "ledger").iterdir())
            if len(pages) < 6 and first:
                break
            for page in pages[first:stop]:
                page.write_bytes(page.read_bytes()[:-3]) if page == pages[first] else page.unlink()
        assert answers(work) == right, "the catalogue is sound"
        faults = verify(work).faults
        assert {fault.kind for fault in faults} == {"ledger"} and not any(fault.lost for fault in faults)
        verify(work, repair=True)
        assert verify(work).faults == () and answers(work) == right


def test_a_catalogue_of_yesterday_follows_the_ledger(work, right, tmp_path):
    shutil.copy(work / "catalog.sqlite", tmp_path / "yesterday")
    with Registry.open(work) as registry:
        recording = registry.resolve("first run")[1]
        registry.put_result("neighbours", recording, {"k": 9})
        newer = registry.latest().document
    shutil.copy(tmp_path / "yesterday", work / "catalog.sqlite")
    assert verify(work).faults == ()
    with Registry.open(work) as registry:
        assert registry.latest().document == newer
    assert verify(work).faults == () == verify(work).leftovers


STRANGE = {
    "a view in place of a table": (
        "ALTER TABLE results RENAME TO kept",
        "CREATE VIEW results AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i id FROM n",
    ),
    "a trigger": ("CREATE TRIGGER t AFTER INSERT ON results BEGIN DELETE FROM recordings; END",),
    "a table more": ("CREATE TABLE more (a TEXT)",),
    "a shard of 2e9 entries": ("UPDATE shards SET stop = 2000000000",),
    "a manifest that is none": ("UPDATE robots SET manifest = '[1'",),
    "bytes for a name": ("UPDATE robots SET name = x'ff00'",),
}


NOT_THERE = {
    "a trigger": "what a server does beside dynreg's tables is its owner's to judge",
    "a table more": "a database may hold other tables",
    "bytes for a name": "PostgreSQL keeps no bytes in a column of text",
}


@pytest.mark.parametrize("case", STRANGE)
def test_strange_catalogues_are_refused_found_and_rebuilt(work, right, case):
    if shared_at(work) is not None and case in NOT_THERE:
        pytest.skip(NOT_THERE[case])
    statements = STRANGE[case]
    if shared_at(work) is not None and case == "a view in place of a table":
        # PostgreSQL: a table by another name would still refer to dynreg's rows, and keep them
        statements = ("DROP TABLE results", *statements[1:])
    sql(work, *statements)
    with pytest.raises(CorruptError, match="verify --repair"):
        answers(work)
    assert found(work)
    verify(work, repair=True)
    assert verify(work).faults == () and answers(work) == right


def test_pipes_and_links_among_the_files_are_faults_and_are_not_opened(work, right):
    os.mkfifo(work / "results" / "pipe")
    robot = next((work / "robots").iterdir())
    (robot / "more").symlink_to("/etc")
    file = next((work / "simulators").iterdir())
    file.rename(work.parent / "elsewhere")
    file.symlink_to(work.parent / "elsewhere")
    with pytest.raises(CorruptError):
        answers(work)
    assert {fault.kind for fault in verify(work).faults} == {"stray", "simulator"}
    verify(work, repair=True)
    assert verify(work).faults == () and (work.parent / "elsewhere").exists()


@pytest.mark.parametrize("name", ["index", "shards", "ledger", "lost+found", "catalog.sqlite"])
def test_a_part_of_the_registry_that_is_a_link_is_refused_and_not_followed(work, name):
    outside = work.parent / "outside"
    if (work / name).exists():
        (work / name).rename(outside)
    else:
        outside.mkdir()
    kept = outside / "thesis.tex" if outside.is_dir() else outside
    if outside.is_dir():
        kept.write_text("mine")
    (work / name).symlink_to(outside)
    before = kept.read_bytes()
    for ask in (Registry.open, verify, lambda p: verify(p, repair=True)):
        with pytest.raises(RegistryError, match=f"'{name.replace('+', '.')}' .*is a link"):
            ask(work)
    assert kept.read_bytes() == before


def test_a_dry_run_says_what_a_repair_would_do_and_changes_nothing(work):
    with files_of(work) as root:
        next((root / "recordings").iterdir()).unlink()
    sql(work, "UPDATE recording_names SET name = 'x' WHERE name = 'again'")
    with pytest.raises(CorruptError):
        answers(work)
    before = stored(work)
    faults = verify(work, repair=True, dry_run=True).faults
    assert {fault.kind for fault in faults} == {"recording", "row"}
    assert all(fault.mended.startswith("would be ") for fault in faults)
    assert stored(work) == before


def test_a_repair_without_room_touches_nothing(work, monkeypatch):
    sql(work, "UPDATE results SET ordinal = ordinal + 1")
    with files_of(work) as root:
        next((root / "recordings").iterdir()).write_bytes(b"junk" * 5000)
    before = stored(work)

    def full(descriptor: int, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("dynreg.registry.disk.write", full)
    with pytest.raises(RegistryError, match="No space left") as error:
        verify(work, repair=True)
    assert not isinstance(error.value, CorruptError)
    assert stored(work) == before


CODES = {
    "SQLITE_FULL": (NoPlaceError, "room"),
    "SQLITE_IOERR_WRITE": (NoPlaceError, "room"),
    "SQLITE_IOERR_SHMSIZE": (NoPlaceError, "room"),
    "SQLITE_BUSY": (NoPlaceError, "locked"),
    "SQLITE_BUSY_SNAPSHOT": (NoPlaceError, "locked"),
    "SQLITE_READONLY_DIRECTORY": (NoPlaceError, "permissions"),
    "SQLITE_CANTOPEN": (NoPlaceError, "permissions"),
    "SQLITE_CORRUPT": (CorruptError, "repair"),
    "SQLITE_CORRUPT_INDEX": (CorruptError, "repair"),
    "SQLITE_NOTADB": (CorruptError, "repair"),
    "SQLITE_IOERR_SHORT_READ": (CorruptError, "repair"),
}


@pytest.mark.parametrize("code", CODES)
def test_codes_of_sqlite_decide_what_is_said(work, code, monkeypatch):
    """What is no damage of the catalogue is not called one, and no repair is advised for it."""
    kind, word = CODES[code]
    failing = sqlite3.OperationalError("database is in some trouble")
    failing.sqlite_errorname = code

    def fail(connection: object) -> None:
        raise failing

    with Registry.open(work) as registry, monkeypatch.context() as patched:
        patched.setattr("dynreg.registry.catalog.broken_structure", fail)
        sql(work, "UPDATE results SET ordinal = ordinal")  # another state of the file
        with pytest.raises(DynregError, match=word) as error:
            registry.recordings()
    assert type(error.value) is kind and ("--repair" in str(error.value)) == (kind is CorruptError)


def test_an_empty_registry_whose_creation_was_cut_short_is_sound(tmp_path):
    for files in ({}, {"catalog.sqlite": b""}):
        path = tmp_path / str(len(files))
        path.mkdir()
        marker = {"format": "dynreg-registry", "version": 2}
        for name, data in ({"dynreg.json": json.dumps(marker).encode()} | files).items():
            (path / name).write_bytes(data)
        assert verify(path).faults == ()
        with Registry.open(path) as registry:
            assert registry.recordings() == ()
        assert verify(path).faults == ()


@pytest.mark.parametrize("code", [5, 13, 24])  # EIO, EACCES, EMFILE
def test_a_disk_that_fails_is_no_damage_and_nothing_is_repaired_for_it(work, monkeypatch, code):
    with Registry.open(work) as registry:
        registry.recordings()
    before = stored(work)

    def fails(path: Path) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("dynreg.registry.files.open_regular", fails)
    for ask in (answers, verify, lambda path: verify(path, repair=True)):
        with pytest.raises(RegistryError, match=os.strerror(code)) as error:
            ask(work)
        assert not isinstance(error.value, CorruptError) and "--repair" not in str(error.value)
    monkeypatch.undo()
    assert stored(work) == before


def test_a_stored_file_that_asks_for_more_than_the_limit_is_refused_and_kept(work, monkeypatch):
    before = stored(work)
    monkeypatch.setenv("DYNREG_MAX_NUMBERS", "20")
    with Registry.open(work) as registry:
        asked = [lambda: registry.load("bench"), lambda: registry.recording("first run")]
        for ask in (*asked, lambda: verify(work), lambda: verify(work, repair=True)):
            with pytest.raises(LimitError, match="at most 20 .*DYNREG_MAX_NUMBERS") as error:
                ask()
            assert error.value.exit_status == 1 and "repair" not in str(error.value)
    monkeypatch.undo()
    assert stored(work) == before and verify(work).faults == ()


def test_what_the_limit_would_keep_from_being_read_is_not_stored(tmp_path, monkeypatch):
    monkeypatch.setenv("DYNREG_MAX_NUMBERS", "20")
    with Registry.open(tmp_path / "registry", create=True) as made:
        made.put_robot(make_robot(tmp_path / "robot"), ROBOT, "arm")
        made.put_population(make_population(2))
        puts = [lambda: made.put_recording(make_recording(1), ROBOT, "run")]
        puts += [lambda: made.put_shard("bench", 0, make_shard(0, 2))]
        for put in puts:
            with pytest.raises(LimitError, match="at most 20 .*DYNREG_MAX_NUMBERS"):
                put()
        assert made.recordings() == () and verify(made.path).leftovers == ()


def test_shards_of_more_entries_than_a_population_may_have_are_no_damage(work, monkeypatch):
    monkeypatch.setenv("DYNREG_MAX_ENTRIES", "1")
    assert verify(work, repair=True).faults == ()
    with Registry.open(work) as registry, pytest.raises(LimitError, match="DYNREG_MAX_ENTRIES"):
        registry.load("bench")


@pytest.mark.parametrize("error", [MemoryError, pa.ArrowMemoryError])
def test_a_memory_that_does_not_suffice_is_no_damage(work, monkeypatch, error):
    before = stored(work)

    def fails(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("pyarrow.parquet.ParquetFile", fails)
    with Registry.open(work) as registry:
        asked = [lambda: registry.load("bench"), lambda: registry.recording("first run")]
        for ask in (*asked, lambda: verify(work), lambda: verify(work, repair=True)):
            with pytest.raises(MemoryError):
                ask()
    monkeypatch.undo()
    assert stored(work) == before


@pytest.mark.parametrize(
    "damage", [Path.unlink, lambda p: p.write_text("{}"), lambda p: p.write_bytes(b"\xff")]
)
def test_a_lost_marker_is_written_anew(work, right, damage):
    damage(work / "dynreg.json")
    with pytest.raises(CorruptError, match="verify --repair"):
        Registry.open(work)
    assert [fault.kind for fault in verify(work).faults] == ["marker"]
    verify(work, repair=True)
    assert verify(work).faults == () and answers(work) == right


def test_files_under_other_names_get_their_own_again(work, right):
    with files_of(work) as root:
        first, second = sorted((root / "shards").glob("*.parquet"))[:2]
        first.rename(root / "kept")
        second.rename(first)
        (root / "kept").rename(second)
        recording = next((root / "recordings").iterdir())
        recording.rename(root / "recordings" / "run.parquet")
        next((root / "populations").iterdir()).rename(root / "populations" / "bench.safetensors")
    foreseen = verify(work, repair=True, dry_run=True)
    report = verify(work, repair=True)
    for told in (foreseen, report):
        assert [fault.kind for fault in told.faults] == ["file"] * 4 and not told.lost
    assert verify(work).faults == () and answers(work) == right


def test_without_catalogue_and_ledger_the_files_come_back_and_what_is_lost_is_said(work, right):
    with files_of(work) as root:
        shutil.rmtree(root / "ledger")
    lose_catalogue(work)
    lost = verify(work, repair=True).lost
    assert [fault.kind for fault in lost if "names" in fault.problem] == ["recording name"] * 2
    assert verify(work).faults == ()
    with Registry.open(work) as registry:
        assert registry.load("bench").ids == right["entries"][0] and len(registry.recordings()) == 2
        assert len(registry.ids("result")) == 2 and len(registry.ids("simulator")) == 1


def test_copies_that_were_put_together_keep_the_rows_of_both(work, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(work, other)
    for path, seed, name in ((work, 7, "here"), (other, 8, "there")):
        with Registry.open(path) as registry:
            registry.put_recording(make_recording(seed), ROBOT, name)
    shutil.copytree(other, work, dirs_exist_ok=True)
    faults = verify(work).faults
    assert {fault.kind for fault in faults} == {"ledger"}
    assert any("two of this number" in fault.problem for fault in faults)
    verify(work, repair=True)
    assert verify(work).faults == ()
    with Registry.open(work) as registry:
        assert {"here", "there"} <= {name for info in registry.recordings() for name in info.names}


def test_a_lost_population_hides_nothing_else_and_is_put_again(work):
    with files_of(work) as root:
        next((root / "populations").iterdir()).unlink()
    with Registry.open(work) as registry:
        with pytest.warns(Damaged, match="passed over"):
            assert registry.populations() == ()
        assert len(registry.recordings()) == 2
        registry.put_population(make_population())
        assert registry.load("bench").ids
    assert verify(work).faults == ()


def _healed_and_cut_short(work) -> None:
    recording = make_recording(1)
    next(p for p in (work / "recordings").iterdir() if p.name.startswith(recording.id[:16])).write_bytes(
        b"junk"
    )
    other = Recording(recording.channels, recording.episodes, provenance={"source": "copy.csv"})
    shutil.copy(work / "catalog.sqlite", work.parent / "yesterday")
    with Registry.open(work) as registry:
        registry.put_recording(other, ROBOT)
    shutil.copy(work.parent / "yesterday", work / "catalog.sqlite")


def test_a_page_that_removes_is_followed(work):
    """A damaged recording that is put again under another provenance gets another file; the old row goes."""
    _healed_and_cut_short(work)
    with Registry.open(work) as registry:
        assert registry.recording("first run").provenance == {"source": "copy.csv"}
    assert not verify(work).lost


def test_two_repairs_do_not_run_at_once(work):
    (work / "catalog.sqlite").write_bytes(b"junk" * 3000)
    with (
        try_lock(work / "locks" / "repair.lock"),
        pytest.raises(RegistryError, match="another process repairs"),
    ):
        verify(work, repair=True)
    verify(work, repair=True)
    assert verify(work).faults == ()


def test_a_put_during_a_repair_keeps_its_files(work, monkeypatch):
    """What a waiting writer has brought to disk is not put away by the repair that it waits for."""
    healed = make_recording(1)
    with files_of(work) as root:
        damaged = next(p for p in (root / "recordings").iterdir() if p.name.startswith(healed.id[:16]))
        whole = damaged.read_bytes()
        damaged.write_bytes(b"junk")
    bucket, name = bucket_of(work), f"recordings/{damaged.name}"
    put_away = repairing.put_away

    def slow(root, names):  # a put stages it, and waits for the lock
        (work / name).write_bytes(whole) if bucket is None else bucket.write(name, whole)
        put_away(root, names)

    monkeypatch.setattr(repairing, "put_away", slow)
    verify(work, repair=True)
    with Registry.open(work) as registry:
        registry.put_recording(healed, ROBOT)
        assert registry.recording(healed.id).id == healed.id
    assert verify(work).faults == ()


STRAYS = {
    "shards": [("states", b"PAR1"), ("rest", b"junk")],
    "populations": [("x", b"junk")],
    "results": [("kind-0123456789abcdef", b"[1]"), ("k\xff-0-0", b"{}")],
    "simulators": [("simulator", b"[]")],
    "ledger": [("999999999999", b"{}")],
    "robots": [("odd", b"x")],
}


@pytest.mark.parametrize("folder", STRAYS)
def test_after_any_stray_a_repair_leaves_a_registry_that_answers_and_a_second_one_changes_nothing(
    work, right, folder
):
    with files_of(work) as root:
        for stem, data in STRAYS[folder]:
            suffix = {"shards": "parquet", "populations": "safetensors"}.get(folder, "json")
            digest = hashlib.sha256(data).hexdigest()[:16]
            (root / folder / f"{stem}-{digest}.{suffix}").write_bytes(data)
    verify(work, repair=True)
    assert verify(work).faults == () and answers(work) == right
    before = stored(work)
    verify(work, repair=True)
    assert stored(work) == before


def test_a_dry_run_leaves_a_registry_of_format_1_as_it_is(tmp_path, registry_snapshot):
    shutil.unpack_archive(Path(__file__).with_name("format_1.zip"), tmp_path / "old")
    before = registry_snapshot(tmp_path / "old")
    assert verify(tmp_path / "old").faults == () == verify(tmp_path / "old", repair=True, dry_run=True).faults
    assert registry_snapshot(tmp_path / "old") == before


def test_numbers_and_texts_of_numpy_are_stored_as_plain_ones(work):
    with Registry.open(work) as registry:
        registry.put_recording(make_recording(5), ROBOT, np.str_("fifth"))
        registry.put_population(make_population(np.int64(12)))
    with Registry.open(work) as registry:
        assert registry.population("bench").size == 12 and registry.resolve("fifth")
    assert verify(work).faults == ()


def test_nothing_is_put_into_a_catalogue_that_was_changed(work):
    with Registry.open(work) as registry:
        sql(work, "UPDATE results SET ordinal = ordinal + 1")
        with pytest.raises(CorruptError, match="changed from outside"):
            with registry.directory.catalog.write() as writing:
                writing.remove(tables.results)


def test_a_catalogue_that_nobody_else_writes_is_compared_with_its_seals_once(registry, monkeypatch):
    """So a put costs the same however much is there."""
    registry.put_simulator({"a": 0})
    looked = []
    monkeypatch.setattr("dynreg.registry.catalog.broken_seals", lambda _: looked.append(1) or [])
    for number in range(1, 4):
        registry.put_simulator({"a": number})
        assert len(registry.ids("simulator")) == number + 2
    assert not looked
    with sqlite3.connect(registry.path / "catalog.sqlite") as connection:
        connection.execute("PRAGMA user_version = 7")
    registry.put_simulator({"a": 9})
    assert looked, "somebody else has written"
