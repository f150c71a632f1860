"""A shared registry is the same registry: whoever opens it, wherever, with others at the same time."""

import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hands import files_of
from registry_contents import (
    POPULATION,
    ROBOT,
    fill,
    make_population,
    make_recording,
    make_shard,
    populate,
)
from sqlalchemy import Engine
from sqlalchemy.exc import OperationalError

import dynreg.registry.references as references
import dynreg.registry.server as server
from dynreg.errors import Assumed, CorruptError, Interrupted, NoPlaceError, RegistryError, UsageError
from dynreg.registry import Registry, rebuild, verify
from dynreg.registry.bucket import Bucket
from dynreg.registry.collecting import collect
from dynreg.registry.reaching import explained
from dynreg.registry.served import ServedCatalog
from dynreg.registry.writing import Writing


@pytest.fixture
def place(stores):
    """The name of an empty database and bucket."""
    name = stores.new()
    yield name
    stores.drop(name)


@pytest.fixture
def faces(stores, place, tmp_path):
    """Open the registry there by a new folder, as on another machine."""
    opened: list[Registry] = []

    def face() -> Registry:
        path = tmp_path / f"face{len(opened)}"
        opened.append(Registry.share(path, stores.catalog(place), stores.blobs(place)))
        return opened[-1]

    yield face
    for registry in opened:
        registry.close()


def test_it_holds_what_a_folder_holds_byte_by_byte(faces, robot, tmp_path):
    with Registry.open(tmp_path / "folder", create=True) as folder:
        for registry in (folder, shared := faces()):
            fill(registry, robot)
            registry.put_recording(make_recording(1), ROBOT, "first run")
            registry.put_result("neighbours", "first run", {"k": 5})
        assert shared.content_hash() == folder.content_hash()
        for kind in ("shards", "populations", "recordings", "results", "robots", "ledger"):
            assert shared.directory.names(kind) == folder.directory.names(kind)


def test_another_machine_finds_all_of_it(faces, robot, registry_snapshot):
    one, other = faces(), faces()
    fill(one, robot)
    one.put_recording(make_recording(1), ROBOT, "first run")
    one.put_index("bench", "landmarks", {"losses": one.load("bench").values})
    assert other.load("bench").ids == make_shard(0, 10).entry_ids(POPULATION)
    np.testing.assert_array_equal(other.load("bench").states, make_shard(0, 10).states)
    assert other.recording("first run").id == make_recording(1).id
    assert registry_snapshot(other.robot_folder("arm")) == registry_snapshot(robot)
    np.testing.assert_array_equal(other.index("bench", "landmarks")["losses"], make_shard(0, 10).values)
    fetched = other.directory.bucket.fetched
    other.load("bench"), other.recording("first run"), other.robot_folder("arm")
    assert other.directory.bucket.fetched == fetched, "what lies here is not fetched again"


def test_a_copy_here_that_was_damaged_is_fetched_again(faces, robot):
    one = faces()
    fill(one, robot)
    for path in (one.path / "shards").iterdir():
        path.write_bytes(b"damaged")
    np.testing.assert_array_equal(one.load("bench").states, make_shard(0, 10).states)


def test_one_entry_is_fetched_without_its_shard_and_known_by_its_id(faces, robot, tmp_path):
    one, other = faces(), faces()
    one.put_robot(robot, ROBOT, "arm")
    one.put_population(make_population(400, shard_size=200))
    populate(one)
    whole = make_shard(0, 200)
    bucket, ids = other.directory.bucket, whole.entry_ids(POPULATION)
    size = sum(bucket.names("shards").values())
    entry = other.load_entry(ids[150])
    np.testing.assert_array_equal(entry.states, whole.states[150])
    np.testing.assert_array_equal(entry.weights["w0"], whole.weights["w0"][150])
    (models,) = other.weights("bench", [ids[7], ids[150]])
    np.testing.assert_array_equal(models["w0"], whole.weights["w0"][[7, 150]])
    assert other.load("bench", ()).ids[:200] == ids
    assert 0 < bucket.fetched < 0.6 * size, "headers are the most of so small entries"
    fetched = bucket.fetched
    other.load_entry(ids[150])
    assert bucket.fetched == fetched, "parts are kept"
    with files_of(one.path) as root:
        path = min((root / "shards").glob("*.safetensors"))
        data = bytearray(path.read_bytes())
        data[data.index(whole.weights["w0"][160].tobytes())] ^= 1
        path.write_bytes(data)
    with pytest.raises(CorruptError, match="not the one that was registered"):
        faces().load_entry(ids[160])


@pytest.mark.parametrize(
    "bad", [lambda d: d[:-1] + bytes([d[-1] ^ 1]), lambda d: bytes(len(d)), lambda d: d[:100]]
)
def test_what_was_damaged_in_the_bucket_is_read_again_once_it_is_mended(faces, robot, bad):
    one, other = faces(), faces()
    fill(one, robot)
    ids, bucket = one.load("bench").ids, other.directory.bucket
    name = min(name for name in bucket.names("shards") if name.endswith(".safetensors"))
    data = bucket.read(name)
    bucket.write(name, bad(data))
    with pytest.raises(CorruptError, match="cannot be read"):
        for identity in ids:
            other.load_entry(identity)
    bucket.write(name, data)
    assert [other.load_entry(identity).id for identity in ids] == list(ids)


def test_models_of_whole_shards_are_compared_with_their_hash(faces, robot):
    one, other = faces(), faces()
    fill(one, robot)
    ids, bucket = one.load("bench").ids, other.directory.bucket
    name = max(name for name in bucket.names("shards") if name.endswith(".safetensors"))
    data = bucket.read(name)
    bucket.write(name, data[:-1] + bytes([data[-1] ^ 1]))
    with pytest.raises(CorruptError, match="not those that were registered"):
        list(other.weights("bench", ids))


def test_a_verification_leaves_damaged_journals_where_they_are(faces, robot):
    one = faces()
    fill(one, robot)
    journal = one.path / "searches" / "gait.jsonl"
    journal.parent.mkdir(exist_ok=True)
    journal.write_bytes(b"no journal")
    assert [fault.what for fault in verify(one.path).faults] == ["searches/gait.jsonl"] and journal.exists()


def test_a_repair_may_take_longer_than_a_silent_writer(faces, robot, monkeypatch):
    one = faces()
    fill(one, robot)
    short = {name: text.replace(f"{server.IDLE_SECONDS}s", "50ms") for name, text in server._BEGINS.items()}
    monkeypatch.setattr(server, "_BEGINS", short)
    names = Bucket.names

    def slowly(self: Bucket, folder: str):
        time.sleep(0.1)
        return names(self, folder)

    monkeypatch.setattr(Bucket, "names", slowly)
    assert verify(one.path, repair=True).faults == ()
    assert collect(one) == ()


def test_a_catalogue_is_not_joined_with_another_bucket(faces, robot, stores, place, tmp_path):
    fill(faces(), robot)
    with pytest.raises(RegistryError, match="does not hold the files"):
        Registry.share(tmp_path / "new", stores.catalog(place), stores.blobs(place, "robot"))
    assert not (tmp_path / "new").exists()


def test_writers_at_once_lose_nothing_and_keep_one_order(faces, robot):
    writers = [faces() for _ in range(4)]
    writers[0].put_robot(robot, ROBOT, "arm")
    writers[0].put_population(make_population(40))
    told, errors = set(), []

    def write(number: int, registry: Registry) -> None:
        try:
            for step in range(4):
                start = 4 * ((3 * number + step) % 10)  # some are put by several
                told.update(registry.put_shard("bench", start, make_shard(start, start + 4)))
                told.add(registry.put_result("diagnosis", None, {"step": step, "writer": number % 2}))
                told.add(registry.put_recording(make_recording(step), ROBOT, f"run {step}"))
        except Exception as error:
            errors.append(error)

    threads = [threading.Thread(target=write, args=one) for one in enumerate(writers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors
    reader = faces()
    held = {*reader.load("bench", ()).ids, *reader.ids("result"), *(i.id for i in reader.recordings())}
    assert told == held and len(reader.recordings()) == 4 and len(reader.ids("result")) == 8
    report = verify(reader.path)
    assert report.faults == () and report.leftovers == ()


def test_a_claim_holds_against_every_machine_until_its_session_ends(faces, robot, stores, place):
    one, other = faces(), faces()
    one.put_robot(robot, ROBOT, "arm")
    one.put_population(make_population(40))
    with (
        one.claim("bench", 0) as mine,
        other.claim("bench", 0) as theirs,
        other.claim("bench", 4) as next_one,
    ):
        assert (mine, theirs, next_one) == (True, False, True)
    with other.claim("bench", 0) as mine:
        assert mine
    with one.claim("bench", 0) as mine:  # that it is lost is no error: two writers do no harm
        assert mine
        stores.sql("postgres", _END_ALL.format(place))  # as when its machine is gone
        with other.claim("bench", 0) as theirs:
            assert theirs


_END_ALL = (
    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{}' AND pid <> pg_backend_pid()"
)


def test_a_put_that_the_server_broke_off_is_made_again(faces, robot, stores, place, monkeypatch):
    registry, page, broken = faces(), Writing.page, []
    registry.put_robot(robot, ROBOT, "arm")

    def breaking(self: Writing):
        if len(broken) < 2:
            broken.append(self)
            stores.sql("postgres", _END_ALL.format(place))
        return page(self)

    monkeypatch.setattr(Writing, "page", breaking)
    monkeypatch.setattr(server, "PAUSES", (0.01,) * 3)
    recording = registry.put_recording(make_recording(1), ROBOT, "first run")
    assert len(broken) == 2 and registry.resolve("first run") == ("recording", recording)
    assert verify(registry.path).faults == ()


LOOKS = {
    "robots": lambda registry: registry.robots(),
    "population": lambda registry: registry.population("bench").id,
    "load": lambda registry: registry.load("bench").ids,
    "recordings": lambda registry: registry.recordings(),
    "recording": lambda registry: registry.recording("first run").id,
    "simulator": lambda registry: registry.simulator(registry.ids("simulator")[0]),
    "latest": lambda registry: registry.latest().id,
    "holds": lambda registry: registry.holds(make_recording(1).id),
    "content": lambda registry: registry.content_hash(),
    "models": lambda registry: registry.models("bench", range(3)).take(np.arange(3))["b0"].tolist(),
    "verify": lambda registry: verify(registry.path),
}


@pytest.mark.parametrize("name", LOOKS)
def test_a_look_that_the_server_broke_off_is_made_again(shared, stores, monkeypatch, name):
    registry, look, read, broken = shared, LOOKS[name], ServedCatalog.transaction, []
    expected = look(registry)
    place = registry.directory.catalog.url.database

    @contextmanager
    def breaking(self: ServedCatalog, begin: str):
        with read(self, begin) as connection:
            broken.append(begin)
            if len(broken) in (2, 3):  # of a verification the first look is whether its server is there
                stores.sql("postgres", _END_ALL.format(place))
            yield connection

    monkeypatch.setattr(ServedCatalog, "transaction", breaking)
    monkeypatch.setattr(server, "PAUSES", (0.01,) * 3)
    for _ in range(2):  # some make a single transaction
        assert look(registry) == expected
    assert len(broken) > 3


def test_a_wait_within_a_wait_is_no_longer_than_one(shared, monkeypatch):
    registry, connects, paused = shared, iter(range(1000)), []
    connect = Engine.connect

    def flapping(self: Engine):
        if next(connects) % 2:
            return connect(self)
        raise OperationalError("", {}, Exception("server closed the connection unexpectedly"))

    def broken(*_: object):
        raise Interrupted("it broke off", expected="x", do="y")

    registry.robots()  # the server was there before
    monkeypatch.setattr(Engine, "connect", flapping)
    monkeypatch.setattr(references, "resolve", broken)
    monkeypatch.setattr(server.time, "sleep", paused.append)
    with pytest.raises(NoPlaceError, match=f"tried again for {sum(server.PAUSES):.0f} s"):
        registry.count("bench")
    assert paused == list(server.PAUSES)


def test_a_writer_that_hangs_is_told_of(faces, monkeypatch):
    one, other = faces(), faces()
    short = {name: text.replace(f"{server.LOCK_SECONDS}s", "100ms") for name, text in server._BEGINS.items()}
    monkeypatch.setattr(server, "_BEGINS", short)
    with (
        one.directory.catalog.write(),
        pytest.raises(NoPlaceError, match="stayed locked .* wait for the other"),
    ):
        other.put_simulator({"a": 1})
    assert other.put_simulator({"a": 1})


def test_a_catalogue_that_is_lost_is_not_taken_for_an_empty_one(faces, robot, stores, place, tmp_path):
    registry = faces()
    fill(registry, robot)
    content = registry.content_hash()
    registry.close()
    stores.sql("postgres", f"DROP DATABASE {place} WITH (FORCE)", f"CREATE DATABASE {place}")
    with pytest.raises(CorruptError, match="verify --repair"):
        Registry.open(registry.path)
    with pytest.raises(RegistryError, match="whose catalogue is another one.* add --rebuild"):
        Registry.share(tmp_path / "new", stores.catalog(place), stores.blobs(place))
    verify(registry.path, repair=True)
    with Registry.open(registry.path) as again:
        assert again.content_hash() == content


def test_a_registry_of_which_the_bucket_alone_is_left_is_joined_again(faces, robot, stores, place, tmp_path):
    registry = faces()
    fill(registry, robot)
    registry.put_recording(make_recording(1), ROBOT, "first run")
    registry.put_result("neighbours", "first run", {"k": 5})
    content, last = registry.content_hash(), registry.latest()
    with pytest.raises(RegistryError, match="holds the catalogue of a.*an empty database"):
        rebuild(tmp_path / "new", stores.catalog(place), stores.blobs(place))
    registry.close()
    shutil.rmtree(registry.path)
    stores.sql("postgres", f"DROP DATABASE {place} WITH (FORCE)", f"CREATE DATABASE {place}")
    with pytest.raises(RegistryError, match="nothing from which"):
        rebuild(tmp_path / "new", stores.catalog(place), stores.blobs(place, "elsewhere"))
    assert not (tmp_path / "new").exists()
    assert not rebuild(tmp_path / "new", stores.catalog(place), stores.blobs(place)).lost
    with Registry.open(tmp_path / "new") as again:
        assert again.content_hash() == content and again.latest() == last
        assert again.resolve("first run")[1] == make_recording(1).id
    assert verify(tmp_path / "new").faults == ()


def test_a_bucket_without_its_ledger_gives_back_all_but_names(faces, robot, stores, place, tmp_path):
    registry = faces()
    fill(registry, robot)
    registry.put_recording(make_recording(1), ROBOT, "first run")
    content = registry.content_hash()
    registry.close()
    with files_of(registry.path) as root:
        shutil.rmtree(root / "ledger")
    stores.sql("postgres", f"DROP DATABASE {place} WITH (FORCE)", f"CREATE DATABASE {place}")
    with pytest.raises(CorruptError, match="its bucket is not"):
        Registry.open(registry.path)
    lost = rebuild(tmp_path / "new", stores.catalog(place), stores.blobs(place)).lost
    assert "recording name" in {fault.kind for fault in lost}
    with Registry.open(tmp_path / "new") as again:
        assert again.content_hash() == content
    assert verify(tmp_path / "new").faults == ()


@contextmanager
def put_back(stores, place: str) -> Iterator[None]:
    """A database that is put back from a backup: it forgets what is done within, and the bucket keeps it."""
    backup = f"{place}y"
    stores.sql("postgres", f"CREATE DATABASE {backup} TEMPLATE {place}")
    yield
    again = f"CREATE DATABASE {place} TEMPLATE {backup}"
    stores.sql("postgres", f"DROP DATABASE {place} WITH (FORCE)", again, f"DROP DATABASE {backup}")


def test_a_database_of_yesterday_is_found_and_gets_what_came_since(faces, robot, stores, place):
    registry = faces()
    fill(registry, robot)
    registry.close()
    with put_back(stores, place), Registry.open(registry.path) as again:
        for seed in (1, 2):
            again.put_recording(make_recording(seed), ROBOT, f"run {seed}")
        content = again.content_hash()
    with Registry.open(registry.path) as again, pytest.raises(RegistryError, match="older than the ledger"):
        collect(again)
    (fault,) = verify(registry.path).faults
    assert fault.kind == "catalog" and "last 2 pages" in fault.problem and not fault.lost
    assert not verify(registry.path, repair=True).lost
    with Registry.open(registry.path) as again:
        assert again.content_hash() == content
        assert [info.names for info in again.recordings()] == [("run 1",), ("run 2",)]
    assert verify(registry.path).faults == ()


def test_gc_keeps_the_last_put_that_a_database_from_a_backup_does_not_name(faces, robot, stores, place):
    registry = faces()
    fill(registry, robot)
    registry.close()
    with put_back(stores, place), Registry.open(registry.path) as again:
        again.put_robot(robot, "ef" * 32, "leg")
        content = again.content_hash()
    with Registry.open(registry.path) as again:
        with pytest.warns(Assumed, match=r"ledger/.* are kept: .*`dynreg verify --repair` takes it"):
            assert collect(again) == ()
    assert not verify(registry.path, repair=True).lost
    with Registry.open(registry.path) as again:
        assert again.content_hash() == content
    assert verify(registry.path).faults == ()


def test_gc_removes_the_page_of_a_put_that_was_cut_short_once_another_has_its_number(
    faces, robot, monkeypatch
):
    registry = faces()
    fill(registry, robot)
    with monkeypatch.context() as short, pytest.raises(OSError, match="killed"):
        short.setattr(Writing, "enter", killed)
        registry.put_recording(make_recording(1), ROBOT, "run 1")
    with pytest.warns(Assumed, match="are kept"):
        assert collect(registry) == ()
    registry.put_recording(make_recording(2), ROBOT, "run 2")
    content = registry.content_hash()
    assert {one.path.split("/")[0] for one in collect(registry)} == {"ledger", "recordings"}
    assert collect(registry) == () and registry.content_hash() == content
    assert verify(registry.path).faults == ()


def killed(*_: object) -> None:
    raise OSError("killed")


def test_gc_refuses_a_database_from_a_backup_that_went_on_before_it_was_repaired(faces, robot, stores, place):
    registry = faces()
    fill(registry, robot)
    registry.close()
    with put_back(stores, place), Registry.open(registry.path) as again:
        for seed in (1, 2):
            again.put_recording(make_recording(seed), ROBOT, f"run {seed}")
    with Registry.open(registry.path) as again:
        again.put_recording(make_recording(3), ROBOT, "run 3")
        with pytest.raises(RegistryError, match="older than the ledger"):
            collect(again)
    verify(registry.path, repair=True)
    with Registry.open(registry.path) as again:
        assert {info.id for info in again.recordings()} == {make_recording(seed).id for seed in (1, 2, 3)}


SECRET = "open-sesame"
REFUSED = {
    "server away": ("postgresql://lab@127.0.0.1:1/lab", None, NoPlaceError, "cannot be reached"),
    "no such database": ("{lab}/nothing", None, NoPlaceError, "createdb nothing"),
    "no such user": ("postgresql://nobody@{at}/{place}", None, NoPlaceError, "refuses this user"),
    "wrong password": ("postgresql://locked@{at}/{place}", None, NoPlaceError, "PGPASSWORD"),
    "password in the address": ("postgresql://lab:open-sesame@h/lab", None, UsageError, "PGPASSWORD"),
    "another database": ("sqlite:///lab.db", None, UsageError, "none of PostgreSQL"),
    "no such bucket": (
        None,
        "s3://nothing-there/x?{how}",
        NoPlaceError,
        "no bucket at 's3://nothing-there/x'",
    ),
    "key in the address": (None, "s3://key:open-sesame@b/x", UsageError, "AWS_SECRET_ACCESS_KEY"),
    "key of another store": (None, "abfs://b@lab/x?client_secret=open-sesame", UsageError, "holds a key"),
    "password of a key": ("postgresql://h/lab?sslpassword=open-sesame", None, UsageError, "PGPASSWORD"),
    "no bucket": (None, "registry", UsageError, "s3://BUCKET/PREFIX"),
    "odd option": (None, "s3://b/x?secret=open-sesame", UsageError, "'secret'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_reached_is_told_in_one_line_without_a_secret(
    case, stores, place, tmp_path, monkeypatch
):
    catalog, blobs, kind, says = REFUSED[case]
    stores.sql("postgres", "DROP ROLE IF EXISTS locked", "CREATE ROLE locked LOGIN PASSWORD 'another'")
    monkeypatch.setenv("PGPASSWORD", SECRET)
    good_catalog, good_blobs = stores.catalog(place), stores.blobs(place)
    at, how = f"127.0.0.1:{stores.port}", good_blobs.partition("?")[2]
    told = (catalog or good_catalog).format(lab=good_catalog.rpartition("/")[0], at=at, place=place)
    with pytest.raises(kind, match=says) as error:
        Registry.share(tmp_path / "new", told, (blobs or good_blobs).format(how=how))
    assert SECRET not in str(error.value) and "\n" not in str(error.value)
    assert not (tmp_path / "new").exists()


def test_a_bucket_that_refuses_says_which_rights_are_wanted():
    said = "When reading 'x' in bucket 'b': AWS Error ACCESS_DENIED during GetObject operation: Access Denied"
    error = explained("s3://b/p?endpoint_override=h", "x", OSError(said))
    assert isinstance(error, NoPlaceError) and "ACCESS_DENIED" in str(error) and "AWS_PROFILE" in str(error)


def test_a_folder_that_is_something_else_is_refused(stores, place, tmp_path, robot):
    good = stores.catalog(place), stores.blobs(place)
    with pytest.raises(RegistryError, match="something else already"):
        Registry.share(robot, *good)
    Registry.share(tmp_path / "face", *good).close()
    Registry.share(tmp_path / "face", *good).close()
    with pytest.raises(RegistryError, match="a face of another registry"):
        Registry.share(tmp_path / "face", good[0], good[1].replace("/robots", "/others"))
    assert Path(tmp_path / "face" / "dynreg.json").read_text().count("postgresql://") == 1
