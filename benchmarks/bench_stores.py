"""A shared registry under writers at once, and what a query fetches of a population that lies in a bucket.

    python benchmarks/bench_stores.py [--minutes 5] [--writers 4] [--simulators 400]

1. Writers on PostgreSQL and a stand-in for S3 put shards of one population, simulators and results for so many minutes,
   some of the same content at the same time. Each notes what it was told is stored. In the end all of it must be there,
   and every hash must be right.
2. A population is made there; from a new folder it is asked about a recording, and parts of it are read. The bytes that
   were fetched are given as a share of the population's.

Both servers run on this machine, so times tell of the code and not of a network.
"""

import argparse
import json
import multiprocessing as mp
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from kept import RESULTS

import dynreg
from dynreg.data.recording import Channel
from dynreg.registry import PopulationRecord, Registry, ShardData, verify
from dynreg.rng import stream

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

import stores  # noqa: E402
import tiny_registry  # noqa: E402

ROBOT, POPULATION, SIZE, SHARD = "ab" * 32, "cd" * 32, 500_000, 20
JUDGED = 200  # entries that a search among so many judges; see bench_scale.py


@dataclass(frozen=True)
class Written:
    """What the writers did. lost : of what they were told is stored, how much is not. faults : that `verify` found.

    slowest_put : seconds of the slowest round of up to three puts.
    """

    writers: int
    seconds: float
    puts: int
    entries: int
    lost: int
    faults: int
    slowest_put: float


@dataclass(frozen=True)
class Fetched:
    """Bytes that a new folder fetched, and in how many requests; share of the population's bytes in the bucket."""

    what: str
    bytes: int
    requests: int
    share: float
    seconds: float


def shard(start: int) -> ShardData:
    """Entries that depend on their numbers alone."""
    rng = stream(start, "bench", "stores")
    values = np.arange(start, start + SHARD, dtype=float)[:, None] / SIZE
    states = rng.normal(size=(SHARD, 4, 51, 3)).astype(np.float32)
    weights = {"w0": rng.normal(size=(SHARD, 64, 64)).astype(np.float16)}
    return ShardData(values, states, weights, values[:, 0], values[:, 0])


def population() -> PopulationRecord:
    """The population that all writers fill."""
    channels = tuple(Channel(name, "rad") for name in ("a", "b", "c"))
    return PopulationRecord(
        POPULATION,
        ROBOT,
        "bench",
        channels,
        ("mass",),
        SIZE,
        0,
        {},
        {"base.w0": np.zeros(3)},
        shard_size=SHARD,
    )


def write(path: Path, number: int, until: float, told: Path) -> None:
    """One writer: shards that nobody else has claimed, and documents, every second of them also another writer's."""
    rng, slowest, puts = stream(number, "bench", "writer"), 0.0, 0
    with Registry.open(path) as registry, told.open("w") as acknowledged:

        def note(kind: str, identity: str) -> None:
            acknowledged.write(f"{kind} {identity}\n")
            acknowledged.flush()

        step = 0
        while time.time() < until:
            began = time.perf_counter()
            start = SHARD * int(rng.integers(SIZE // SHARD))
            if step % 2:  # two writers meet here: the lowest that is missing
                start = registry.missing_spans(POPULATION)[0][0]
            with registry.claim(POPULATION, start) as mine:
                if mine or step % 5 == 0:  # now and then without a claim: two put the same
                    puts += 1
                    for identity in registry.put_shard(POPULATION, start, shard(start)):
                        note("entry", identity)
            note("simulator", registry.put_simulator({"robot": ROBOT, "step": step}))
            note("result", registry.put_result("bench", None, {"writer": number % 2, "step": step}))
            slowest = max(slowest, time.perf_counter() - began)
            puts, step = puts + 2, step + 1
    told.with_suffix(".json").write_text(json.dumps({"slowest": slowest, "puts": puts}))


def writers_at_once(place: Path, servers: stores.Stores, writers: int, minutes: float) -> Written:
    """Let writers put for so many minutes; then look for everything that they were told is stored."""
    name = servers.new()
    robot = place / "robot"
    robot.mkdir()
    (robot / "robot.toml").write_text('[robot]\nname = "bench"\n')
    with Registry.share(place / "faces0", servers.catalog(name), servers.blobs(name)) as registry:
        registry.put_robot(robot, ROBOT, "bench")
        registry.put_population(population())
    began = time.time()
    until, processes, running = began + 60 * minutes, mp.get_context("spawn"), []
    for number in range(writers):
        face = place / f"faces{number}"
        Registry.share(
            face, servers.catalog(name), servers.blobs(name)
        ).close()  # each as on a machine of its own
        told = place / f"told{number}"
        running.append(processes.Process(target=write, args=(face, number, until, told)))
        running[-1].start()
    for process in running:
        process.join()
    seconds = time.time() - began
    if any(process.exitcode for process in running):
        raise SystemExit(f"writers ended with {[process.exitcode for process in running]}")
    told = {line for n in range(writers) for line in (place / f"told{n}").read_text().splitlines()}
    with Registry.share(place / "reader", servers.catalog(name), servers.blobs(name)) as registry:
        held = {f"entry {one}" for one in registry.load(POPULATION, ()).ids}
        held |= {f"{kind} {one}" for kind in ("simulator", "result") for one in registry.ids(kind)}
        entries = registry.count(POPULATION)
    said = [json.loads((place / f"told{n}.json").read_text()) for n in range(writers)]
    faults = verify(place / "reader").faults
    slowest = max(one["slowest"] for one in said)
    puts = sum(one["puts"] for one in said)
    return Written(writers, seconds, puts, entries, len(told - held), len(faults), slowest)


def fetched_by_a_query(place: Path, servers: stores.Stores, simulators: int) -> list[Fetched]:
    """What new folders fetch of a population: for a query, for the index and a walk over it, for one entry."""
    name = servers.new()
    log = place / "run.csv"
    log.write_text(tiny_registry.bench_csv(lambda i, row: row), encoding="utf-8")
    with dynreg.share(place / "made", catalog=servers.catalog(name), blobs=servers.blobs(name)) as session:
        made = session.populate("servo_pendulum", simulators).population
        recording = session.ingest(log, "servo_pendulum", name="monday").recording
        size = sum(session.registry.directory.bucket.names("shards").values())
    asked = {
        "query": lambda session: session.query(recording),
        "values and losses of all": lambda session: session.registry.load(made, ()),
        "index": lambda session: [session.registry.index(made, key) for key in ("graph", "embedding")],
        f"models of {JUDGED} that a search judges": lambda session: _judged(session.registry, made),
        "one entry": lambda session: session.registry.load_entry(
            session.registry.load(made, ()).ids[simulators // 2]
        ),
    }
    found = []
    for number, (what, ask) in enumerate(asked.items()):
        face = place / f"asks{number}"
        with dynreg.share(face, catalog=servers.catalog(name), blobs=servers.blobs(name)) as session:
            bucket, began = session.registry.directory.bucket, time.perf_counter()
            ask(session)
            seconds = time.perf_counter() - began
        found.append(Fetched(what, bucket.fetched, bucket.requests, bucket.fetched / size, seconds))
    return [*found, Fetched("(the population's shards)", size, 0, 1.0, 0.0)]


def _judged(registry: Registry, population: str) -> None:
    with registry.directory.catalog.read() as connection:
        ids = _ids(connection, population)
    some = stream(0, "bench", "judged").choice(len(ids), min(JUDGED, len(ids)), replace=False)
    list(registry.weights(population, [ids[i] for i in some]))


def _ids(connection, population: str) -> list[str]:
    from sqlalchemy import select

    from dynreg.registry.tables import entries

    query = select(entries.c.id).where(entries.c.population_id == population)
    return list(connection.execute(query.order_by(entries.c.number)).scalars())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--writers", type=int, default=4)
    parser.add_argument("--simulators", type=int, default=400)
    told = parser.parse_args()
    if why := stores.why_none():
        raise SystemExit(why)
    with stores.running() as servers, tempfile.TemporaryDirectory() as folder:
        written = writers_at_once(Path(folder), servers, told.writers, told.minutes)
        print(
            f"{written.writers} writers, {written.seconds:.0f} s: {written.puts} puts, {written.entries} entries, "
            f"slowest round {written.slowest_put:.2f} s; lost {written.lost}, faults {written.faults}"
        )
        fetched = fetched_by_a_query(Path(folder), servers, told.simulators)
    for one in fetched:
        print(
            f"{one.what:32} {one.bytes / 1e6:9.3f} MB {one.requests:5d} requests {one.share:8.2%} {one.seconds:7.2f} s"
        )
    RESULTS.mkdir(exist_ok=True)
    document = {"written": asdict(written), "fetched": [asdict(one) for one in fetched]}
    (RESULTS / "stores.json").write_text(json.dumps(document, indent=1) + "\n")
    if written.lost or written.faults:
        raise SystemExit("something was lost")


if __name__ == "__main__":
    main()
