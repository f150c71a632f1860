"""Single bits flipped in a small registry: does `verify` find them, and does anything answer wrongly without a word?

`python tests/registry/flips.py 10000` prints the counts by kind of file.
"""

import hashlib
import os
import shutil
import sqlite3
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from hands import bucket_of, forget_here
from registry_contents import ROBOT, fill, make_measured, make_recording, make_robot

from dynreg.errors import DynregError
from dynreg.registry import Registry, verify
from dynreg.rng import stream
from dynreg.search.journal import Journal

KEY = {"a": 1}
OTHER = "ef" * 32
STEP = np.array([[0.25, 0.5], [1.0, 2.0]])


def make(folder: Path) -> Path:
    """A registry with something of each kind; its last put is still in the write-ahead log, as a kill leaves it."""
    path = folder / "registry"
    with Registry.open(path, create=True) as registry:
        recording = put_all(registry, folder)
        held = sqlite3.connect(
            path / "catalog.sqlite"
        )  # an open connection keeps the log from being folded in
        held.execute("SELECT * FROM files").fetchone()
        registry.put_result("diagnosis", recording, {"verdict": "none"})
        left = folder / "left"
        shutil.copytree(path, left)
        held.close()
    return left


def make_shared(path: Path, catalog: str, blobs: str) -> Path:
    """The same on servers; its local folder."""
    with Registry.share(path, catalog, blobs) as registry:
        recording = put_all(registry, path.parent)
        registry.put_result("diagnosis", recording, {"verdict": "none"})
    return path


def put_all(registry: Registry, folder: Path) -> str:
    """Put something of each kind, with robots made in `folder`; the id of the recording that came first."""
    fill(registry, make_robot(folder / "robot"))
    recording = registry.put_recording(make_recording(1), ROBOT, "first run")
    registry.put_robot(_other_robot(folder / "other"), OTHER, "leg")
    registry.put_recording(make_recording(2), OTHER, "second run")
    registry.put_recording(make_recording(2), ROBOT)  # the name keeps the other robot
    registry.put_recording(make_recording(1), ROBOT, "again")
    registry.put_measured(make_measured(recording))
    registry.put_result("neighbours", recording, {"k": 5})
    registry.put_simulator({"robot": ROBOT, "values": {"mass": 1.5}})
    registry.put_index("bench", "landmarks", {"losses": registry.load("bench").values})
    registry.cache("kind", KEY, {"b": 2})
    journal = Journal(registry.journal_path("search"), KEY, resume=False)
    journal.add(STEP, STEP[:, :1])
    return recording


def _other_robot(folder: Path) -> Path:
    folder.mkdir()
    (folder / "robot.toml").write_text('[robot]\nname = "leg"\n')
    return folder


def answers(path: Path) -> dict[str, Any]:
    """All that can be asked of a registry, in a form that can be compared."""
    with Registry.open(path) as registry:
        held = registry.load("bench")
        record = registry.population("bench")
        index = registry.index("bench", "landmarks")
        folder = registry.robot_folder("arm")
        return {
            "robots": registry.robots(),
            "robot files": [(p.name, p.read_bytes()) for p in sorted(folder.rglob("*")) if p.is_file()],
            "population": (
                record.id,
                record.size,
                record.robot_hash,
                record.name,
                record.parameters,
                str(record.spec),
            ),
            "arrays": _digest(record.arrays),
            "entries": (
                held.ids,
                held.numbers.tolist(),
                registry.count("bench"),
                registry.missing_spans("bench"),
            ),
            "numbers": _digest(
                {"v": held.values, "s": held.states, "o": held.own_loss, "t": held.train_loss}
            ),
            "weights": _digest({**held.weights, **held.extra}),
            "one entry": _digest(registry.load_entry(held.ids[7]).weights),
            "recordings": [
                (i.id, i.robot_hash, i.names, i.robots, registry.recording(i.id).id)
                for i in registry.recordings()
            ],
            "measured": [
                (_digest(registry.measured(e).weights), registry.measured(e).own_loss, r)
                for r, e in registry.measured_in("bench").items()
            ],
            "last": (registry.resolve("@last"), registry.latest().document),
            "results": [str(registry.result(one)) for one in registry.ids("result")],
            "simulators": [registry.simulator(one) for one in registry.ids("simulator")],
            "found": [registry.resolve(identity[:12]) for identity in held.ids],
            "index": None if index is None else _digest(index),
            "cache": registry.cached("kind", KEY),
            "search": _found(Journal(registry.journal_path("search"), KEY, resume=True).next(STEP)),
        }


def wrong(right: dict[str, Any], path: Path) -> list[str]:
    """Which answers differ from the right ones; a registry that refuses gives none. What is cached may be missing."""
    try:
        given = answers(path)
    except DynregError:
        return []
    return [
        k
        for k in right
        if given[k] != right[k] and not (k in ("index", "cache", "search") and given[k] is None)
    ]


def found(path: Path) -> bool:
    """Whether `verify` finds a fault, or refuses what it is given."""
    try:
        return bool(verify(path).faults)
    except DynregError:
        return True


def flipped(sound: Path, count: int, seed: int) -> Iterator[tuple[str, Path]]:
    """Copies of a registry with one bit flipped each: of every second one in the catalogue, else in any file."""
    rng = stream(seed, "flips")
    files = sorted(p for p in sound.rglob("*") if p.is_file() and p.stat().st_size and p.suffix != "-shm")
    files = [p for p in files if not p.name.endswith("-shm")]  # no state: SQLite makes it anew
    catalogue = [p for p in files if p.name.startswith("catalog")]
    kinds = sorted({p.relative_to(sound).parts[0] for p in files})
    work = sound.parent / "work"
    for number in range(count):
        kind = kinds[int(rng.integers(len(kinds)))]
        some = catalogue if number % 2 else [p for p in files if p.relative_to(sound).parts[0] == kind]
        file = some[int(rng.integers(len(some)))]
        data = bytearray(file.read_bytes())
        bit = int(rng.integers(8 * len(data)))
        data[bit // 8] ^= 1 << bit % 8
        shutil.rmtree(work, ignore_errors=True)
        shutil.copytree(sound, work)
        (work / file.relative_to(sound)).write_bytes(data)
        yield f"{file.relative_to(sound).parts[0]} bit {bit} of {file.name}", work


def flipped_objects(work: Path, count: int, seed: int) -> Iterator[tuple[str, Path]]:
    """A shared registry with one bit of an object in its bucket flipped; the object has its bytes again afterwards."""
    rng, bucket = stream(seed, "flips"), bucket_of(work)
    names = sorted(name for name, size in bucket.names("").items() if size)
    kinds = sorted({name.split("/")[0] for name in names})
    for _ in range(count):
        kind = kinds[int(rng.integers(len(kinds)))]
        some = [name for name in names if name.split("/")[0] == kind]
        name = some[int(rng.integers(len(some)))]
        right = bucket.read(name)
        bit = int(rng.integers(8 * len(right)))
        bad = bytearray(right)
        bad[bit // 8] ^= 1 << bit % 8
        bucket.write(name, bytes(bad))
        forget_here(work)
        yield f"{kind} bit {bit} of {name}", work
        bucket.write(name, right)


def judged(right: dict[str, Any], path: Path) -> str:
    """What comes of a changed registry: "wrong" answers, a "found" fault, or "no value changed"."""
    copy = path.with_name("asked")
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(path, copy)  # asking may fold the log into the catalogue
    if wrong(right, copy):
        return "wrong"
    return "found" if found(path) else "no value changed"


def _found(grades: np.ndarray | None) -> list | None:
    return None if grades is None else grades.tolist()


def _digest(arrays: dict[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(name.encode() + np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()


def main(count: int, seed: int = 20261123) -> None:
    """Print how many flips in each kind of file were found, changed nothing, or gave wrong answers."""
    counts: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as folder:
        sound = make(Path(folder))
        shutil.copytree(sound, Path(folder) / "right")
        right = answers(Path(folder) / "right")
        for name, path in flipped(sound, count, seed):
            verdict = judged(right, path)
            counts[name.split(" ")[0], verdict] += 1
            if verdict == "wrong":
                print(f"wrong: {name}", flush=True)
    for (kind, verdict), n in sorted(counts.items()):
        print(f"{kind:24} {verdict:18} {n}")
    print(f"{count} flips, {sum(n for (_, v), n in counts.items() if v == 'wrong')} wrong answers in silence")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
