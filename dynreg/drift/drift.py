"""A recording held against an earlier one: tests, patterns, rates of error, and the updated table."""

import io
import itertools
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from dynreg.data.recording import Recording
from dynreg.drift.compared import Compared, DriftSettings, Held, compared
from dynreg.drift.document import document
from dynreg.errors import NoMatchError, RobotError, UsageError
from dynreg.registry import RecordingInfo, Registry, write_file
from dynreg.results import Drift
from dynreg.rng import stream
from dynreg.sim.robot import Robot
from dynreg.timed.commands import AXES
from dynreg.timed.drift import change_by_cell, explained, shifts, split_against_itself
from dynreg.timed.table import updated

Progress = Callable[[str, int, int], None]


def stored_drift(
    registry: Registry,
    recent: tuple[Recording, Robot, str],
    earlier: tuple[Recording, Robot, str] | None,
    settings: DriftSettings,
    *,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> Drift:
    """A recording (itself, its robot, its name) held against an earlier one, and the result stored.

    earlier : None for the one of the same robot that was ingested first, before this one. out : a Parquet file for the
    updated table.
    Whatever was read from a log on the way is registered, too, the earlier one first; nothing is where there is an
    error. Raises UsageError for recordings of two robots, NoMatchError where there is no earlier one, and what `drift`
    does.
    """
    loaded, robot, name = recent
    chosen = earlier is None
    if earlier is None:
        first = earliest(registry, robot, loaded.id)
        earlier = registry.recording(first.id), robot, first.name
    if earlier[1].hash != robot.hash:
        raise UsageError(
            f"{name!r} is of robot {robot.name!r} ({robot.hash[:12]}), {earlier[2]!r} of {earlier[1].name!r}"
            f" ({earlier[1].hash[:12]})",
            expected="two recordings of the same robot folder",
            do="name another recording with --against",
        )
    result, table = drift(
        robot, Held(loaded, name), Held(earlier[0], earlier[2]), settings, chosen=chosen, progress=progress
    )
    if out is not None:
        write_file(Path(out), table)
        result = result.model_copy(update={"kept": True})
    registry.put_robot(robot.folder, robot.hash, robot.name)
    for recording in (earlier[0], loaded):
        if not registry.holds(recording.id):
            registry.put_recording(recording, robot.hash)
    registry.put_result("drift", loaded.id, result.to_dict())
    return result


def earliest(registry: Registry, robot: Robot, but: str) -> RecordingInfo:
    """The robot's recording that was ingested first; NoMatchError where none was before `but`.

    Where `but` is not registered, all of them were.
    """
    before = itertools.takewhile(lambda r: r.id != but, registry.recordings())
    found = [r for r in before if r.robot_hash == robot.hash]
    if not found:
        raise NoMatchError(
            f"no earlier recording of {robot.name!r} in {str(registry.path)!r}",
            expected="one to hold this one against",
            do=f"ingest it with `dynreg ingest LOG --robot {robot.name}`, or name it with --against",
        )
    return found[0]


def drift(
    robot: Robot,
    recent: Held,
    earlier: Held,
    settings: DriftSettings,
    *,
    chosen: bool = False,
    progress: Progress | None = None,
) -> tuple[Drift, bytes]:
    """A recording held against an earlier one of the same robot, and the updated table as a Parquet file's bytes.

    chosen : the earlier one was not named. Raises RobotError for a robot without wheels, LogError for recordings
    without a pose or without pieces of `settings.sample` seconds, UsageError for one recording twice.
    """
    began = time.perf_counter()
    report = progress or (lambda *_: None)
    if robot.file.base is None:
        raise RobotError(
            f"robot {robot.name!r} has no wheels of which one could have changed",
            expected="[base] in robot.toml",
            do="name a recording of a robot on two wheels, such as 'diffdrive'",
        )
    if recent.recording.id == earlier.recording.id:
        raise UsageError(
            f"{recent.name!r} against itself",
            expected="another recording, made before",
            do="name the earlier one with --against",
        )
    report("displacements", 0, 3)
    both = compared(robot, recent, earlier, settings)
    old_table, new_table = both.old.table(both.grid, both.old_off), both.new.table(both.grid, both.new_off)
    found = shifts(old_table, new_table, settings.rules)
    report("displacements", 1, 3)
    order = explained(found, change_by_cell(both.reference, both.new, both.grid))
    report("displacements", 2, 3)
    itself = split_against_itself(
        both.old,
        both.old_off,
        both.grid,
        both.reference,
        settings.rules,
        settings.splits,
        stream(settings.seed, "drift", "splits"),
    )
    report("displacements", 3, 3)
    after, _ = updated(old_table, new_table.cell, new_table.values, 1, settings.rules)
    result = document(robot, recent, earlier, settings, both, found, order, itself)
    result = result.model_copy(update={"chosen": chosen, "seconds": time.perf_counter() - began})
    return result, _parquet(both, after.counts)


def _parquet(both: Compared, counts: np.ndarray) -> bytes:
    """The updated table, a row for each sample, the earlier ones first; counts (n + m, 3)."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns: dict[str, np.ndarray] = {
        "born": np.repeat([0, 1], [both.old.drives, both.new.drives]),
        "cell": np.concatenate([both.old.cell_of_drive, both.new.cell_of_drive]),
    }
    parts = ((both.old, both.old_off), (both.new, both.new_off))
    asked = [np.stack(p.commands.columns[:3], axis=1) for p, _ in parts]
    told_columns = np.concatenate([p.by_drive(a) for (p, _), a in zip(parts, asked, strict=True)])
    moved = np.concatenate([p.by_drive(p.moved) for p, _ in parts])
    off = np.concatenate([p.by_drive(o) for p, o in parts])
    columns |= dict(zip(("left", "right", "seconds"), told_columns.T, strict=True))
    for name, values in (("", moved), ("off_", off), ("kept_", counts)):
        columns |= {f"{name}{axis}": values[:, i] for i, axis in enumerate(AXES)}
    out = io.BytesIO()
    pq.write_table(pa.table(columns), out)
    return out.getvalue()
