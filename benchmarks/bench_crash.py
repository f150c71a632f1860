"""A registry that is killed while it grows, and one that several processes work on at once.

    python benchmarks/bench_crash.py [--kills 25]

1. `populate` is killed with SIGKILL at random moments. After each kill the registry must verify clean; the next
   populate goes on. In the end it must hold what an undisturbed registry holds, by content hash.
2. Two processes populate one registry while a third asks it about a recording.
"""

import argparse
import json
import multiprocessing as mp
import tempfile
import time
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from kept import RESULTS

import dynreg
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.distance.population import Training
from dynreg.errors import DynregError
from dynreg.registry import Registry, verify
from dynreg.rng import stream
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot

ROBOT, SEED = "servo_pendulum", 0
WORK = "simulate, train, store"  # what a populate does before it first tells of progress
TRAINING = Training(epochs=1, base_configurations=8, base_epochs=2)
PRELOADED = [
    "torch",
    "scipy.stats",
    "sklearn.linear_model",
    "dynreg.verbs.populations",
    "dynreg.verbs.populate",
    "dynreg.verbs.neighbours",
    "dynreg.verbs.query",
    "dynreg.sim.engines.joint_engine",
]


@dataclass(frozen=True)
class Kill:
    """One killed populate: when it died [s], what it was doing, and the registry after it.

    left : files that were stored and not yet entered; they are adopted or taken out by a repair.
    """

    after: float
    stage: str
    entries: int
    clean: bool
    left: int


@dataclass(frozen=True)
class Endured:
    """What a registry looks like after all that was done to it."""

    entries: int
    clean: bool
    same: bool
    added: tuple[int, ...] = ()
    answers: int = 0


def endure_kills(
    folder: Path, kills: int, shard_size: int = 10, entries: int = 120
) -> tuple[list[Kill], Endured]:
    """Grow a registry shard by shard under SIGKILLs, then to at least `entries`; compare with an undisturbed one."""
    processes, rng = _processes(), stream(SEED, "crash")
    path = folder / "killed"
    died: list[Kill] = []
    length = _seconds_of_a_step(processes, folder / "measure", shard_size)
    while len(died) < kills:
        held = _entries(path)
        worker, told = _start(processes, _populate, path, held + shard_size, shard_size)
        told.recv()
        moment = float(rng.uniform(0.0, length if held else 2 * length))
        worker.join(moment)
        if worker.exitcode is None:
            worker.kill()
            worker.join()
            report = verify(path) if (path / "dynreg.json").exists() else None
            clean = report is None or not report.faults
            left = len(report.leftovers) if report else 0
            died.append(Kill(moment, _last(told), _entries(path), clean, left))
    entries = max(entries, _entries(path))
    for place in (path, folder / "undisturbed"):
        worker, _ = _start(processes, _populate, place, entries, shard_size)
        worker.join()
    return died, _compared(path, folder / "undisturbed")


def endure_company(folder: Path, entries: int = 120, shard_size: int = 10) -> Endured:
    """Two processes populate, a third asks; compare with a registry that one process made alone."""
    processes = _processes()
    together, alone = folder / "together", folder / "alone"
    for place, first in ((together, 2 * shard_size), (alone, entries)):
        worker, _ = _start(processes, _populate, place, first, shard_size)
        worker.join()
        with dynreg.open(place) as reg:
            reg.ingest(_recording(), ROBOT, name="hidden")
    asker, answers = _start(processes, _ask, together)
    writers = [_start(processes, _populate, together, entries, shard_size) for _ in range(2)]
    for worker, _ in writers:
        worker.join()
    (folder / "together.done").touch()
    asker.join()
    added = tuple(int(_last(told)) for _, told in writers)
    compared = _compared(together, alone)
    sound = compared.clean and not any(w.exitcode for w in (asker, *(w for w, _ in writers)))
    return Endured(compared.entries, sound, compared.same, added, int(_last(answers)))


def _processes() -> mp.context.BaseContext:
    # forked from a server that has everything imported, so that a kill meets work and not imports
    processes = mp.get_context("forkserver")
    processes.set_forkserver_preload(PRELOADED)
    return processes


def _start(processes: mp.context.BaseContext, work, *given) -> tuple[mp.process.BaseProcess, Connection]:
    ours, theirs = processes.Pipe(duplex=False)
    worker = processes.Process(target=work, args=(theirs, *given))
    worker.start()
    theirs.close()
    return worker, ours


def _populate(tell: Connection, path: Path, entries: int, shard_size: int) -> None:
    with dynreg.open(path) as reg:
        tell.send("opened")
        report = reg.populate(
            ROBOT,
            entries,
            seed=SEED,
            training=TRAINING,
            shard_size=shard_size,
            progress=lambda stage, done, total: tell.send(stage),
        )
    assert report.entries >= entries, f"returned with {report.entries} of {entries}"
    tell.send(str(report.added))


def _ask(tell: Connection, path: Path) -> None:
    """Ask until the writers are done, and once more."""
    answers, last = 0, False
    with dynreg.open(path) as reg:
        while not last:
            last = path.with_suffix(".done").exists()
            found = reg.query("hidden", budget=12)
            entry = reg.registry.load_entry(found.neighbours[0].entry)
            assert entry.values == found.neighbours[0].parameters
            answers += 1
    tell.send(str(answers))


def _last(told: Connection) -> str:
    """The last thing that a process told."""
    last = WORK
    try:
        while told.poll():
            last = told.recv()
    except EOFError:
        pass
    return last


def _seconds_of_a_step(processes: mp.context.BaseContext, path: Path, shard_size: int) -> float:
    """How long an undisturbed populate takes for one more shard, with its links."""
    began = 0.0
    for step in (1, 2):
        worker, told = _start(processes, _populate, path, step * shard_size, shard_size)
        told.recv()
        began = time.perf_counter()
        worker.join()
    return time.perf_counter() - began


def _entries(path: Path) -> int:
    try:
        with Registry.open(path) as registry:
            return sum(registry.count(p.id) for p in registry.populations())
    except DynregError:
        return 0  # killed before it was there


def _compared(path: Path, other: Path) -> Endured:
    verify(path, repair=True)
    report = verify(path)
    clean = not report.faults and not report.leftovers
    with Registry.open(path) as one, Registry.open(other) as two:
        same = one.content_hash() == two.content_hash()
    return Endured(_entries(path), clean, same)


def _recording() -> Recording:
    """A servo that no simulator of the population is."""
    robot = load_robot(ROBOT)
    values = robot.space.from_unit(stream(SEED, "crash", "robot").uniform(0.2, 0.8, len(robot.space)))
    commands = excitation(robot, seed=SEED, name="own", episodes=6)
    states = rollout(robot, values[None], commands).states[0]
    held = lambda a: np.concatenate([a, a[:, -1:]], axis=1)  # noqa: E731
    table = np.concatenate([states, held(commands.actions), held(commands.inputs)], axis=-1)
    names = (*robot.channels, *robot.actions, *robot.inputs)
    time = np.arange(commands.steps + 1) / robot.rate
    episodes = [
        Episode(f"run{e}", time, table[e], {"kp": commands.settings[e, 0]}) for e in range(len(table))
    ]
    return Recording(tuple(Channel(name, "1") for name in names), tuple(episodes), measured=False)


def main() -> None:
    """Print the tables and write benchmarks/results/crash.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=25)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        died, after = endure_kills(Path(folder), given.kills)
        company = endure_company(Path(folder))
    print(f"{'kill':>4s} {'after [s]':>10s} {'while':22s} {'entries':>8s} {'clean':>6s} {'left':>5s}")
    for i, kill in enumerate(died, 1):
        print(
            f"{i:4d} {kill.after:10.3f} {kill.stage:22s} {kill.entries:8d} {kill.clean!s:>6s} {kill.left:5d}"
        )
    stages, counts = np.unique([kill.stage for kill in died], return_counts=True)
    told = {
        "kills": len(died),
        "clean after each": all(kill.clean for kill in died),
        "stages": dict(zip(stages.tolist(), counts.tolist(), strict=True)),
        "entries": after.entries,
        "clean at the end": after.clean,
        "same content as undisturbed": after.same,
        "company": asdict(company),
    }
    for name, value in told.items():
        print(f"{name:30s} {value}")
    RESULTS.mkdir(exist_ok=True)
    told["died"] = [asdict(kill) for kill in died]
    (RESULTS / "crash.json").write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
