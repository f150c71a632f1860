"""Whether a registered recording of a wheeled robot is still true of it: from two recordings to a result."""

import io
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import LogError, NoMatchError, RobotError, UsageError
from dynreg.lookups import name_of
from dynreg.registry import Registry
from dynreg.registry.files import write_file
from dynreg.results import Drift, DriftCell, DriftPattern, FalseAlarms, Separating, Shift, Taken
from dynreg.rng import stream
from dynreg.sim.robot import Robot
from dynreg.timed.cells import Grid, Pieces, pieces
from dynreg.timed.commands import AXES
from dynreg.timed.drift import (
    Judged,
    Shifts,
    Split,
    apart_at,
    change_by_cell,
    explained,
    rivals,
    shifts,
    split_against_itself,
)
from dynreg.timed.reference import Reference, fitted, on_the_way
from dynreg.timed.table import Rules, updated
from dynreg.wheeled import Told, told

UNITS = ("m", "m", "rad")
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class DriftSettings:
    """What is asked for. sample : seconds of a piece. cells : on each side. splits : of the earlier recording.

    level, welch, together : of the tests, see `timed.table.Rules`.
    """

    sample: float = 0.5
    cells: int = 20
    level: float = 0.05
    welch: bool = False
    together: bool = True
    splits: int = 200
    seed: int = 0

    def __post_init__(self):
        for name, value, good, expected in (
            ("sample", self.sample, 0.0 < self.sample < float("inf"), "a positive time in seconds"),
            ("cells", self.cells, 1 <= self.cells <= 200, "1 to 200 cells on each side"),
            ("level", self.level, 0.0 < self.level < 1.0, "a level between 0 and 1, such as 0.05"),
            ("splits", self.splits, self.splits >= 0, "0 or more"),
        ):
            if not good:
                raise UsageError(f"{name} {value:g}", expected=expected, do="give another number")

    @property
    def rules(self) -> Rules:
        """For the tests."""
        return Rules(level=self.level, welch=self.welch, together=self.together)


@dataclass(frozen=True)
class Held:
    """One of the two recordings, with its name."""

    recording: Recording
    name: str


@dataclass(frozen=True, eq=False)
class Compared:
    """Two recordings in cells: pieces and what is left of each over the reference, (n, 3) and (m, 3)."""

    grid: Grid
    reference: Reference
    old: Pieces
    new: Pieces
    old_off: np.ndarray
    new_off: np.ndarray


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

    earlier : None for the one of the same robot that was ingested first. out : a Parquet file for the updated table.
    Whatever was read from a log on the way is registered, too, the earlier one first; nothing is where there is an
    error. Raises UsageError for recordings of two robots, NoMatchError where there is no earlier one, and what `drift`
    does.
    """
    loaded, robot, name = recent
    chosen = earlier is None
    if earlier is None:
        identity = earliest(registry, robot, loaded.id)
        earlier = registry.recording(identity), robot, name_of(registry, identity)
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
    known = {info.id for info in registry.recordings()}
    registry.put_robot(robot.folder, robot.hash, robot.name)
    for recording in (earlier[0], loaded):
        if recording.id not in known:
            registry.put_recording(recording, robot.hash)
    if out is not None:
        write_file(Path(out), table)
    registry.put_result("drift", loaded.id, result.to_dict())
    return result


def earliest(registry: Registry, robot: Robot, but: str) -> str:
    """The id of the robot's recording that was ingested first, other than `but`; NoMatchError where there is none."""
    found = [r.id for r in registry.recordings() if r.robot_hash == robot.hash and r.id != but]
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
    both = _compared(robot, recent, earlier, settings)
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
    result = _document(robot, recent, earlier, settings, both, found, order, itself)
    result = result.model_copy(update={"chosen": chosen, "seconds": time.perf_counter() - began})
    return result, _parquet(both, after.counts)


def _compared(robot: Robot, recent: Held, earlier: Held, settings: DriftSettings) -> Compared:
    old_told, new_told = (told(robot, held.recording, longest=settings.sample) for held in (earlier, recent))
    grid = _grid(robot, old_told, settings.cells)
    nominal = _nominal(robot)
    begun = _pieces(old_told, grid, settings.sample, nominal)
    _require(begun, old_told, earlier, settings.sample)
    reference = fitted(
        nominal, begun.commands, begun.moved, stream(settings.seed, "drift", "fitted commands")
    )
    old, new = (_pieces(t, grid, settings.sample, reference) for t in (old_told, new_told))
    _require(new, new_told, recent, settings.sample)
    off = [p.moved - reference.predict(p.commands) for p in (old, new)]
    return Compared(grid, reference, old, new, *off)


def _nominal(robot: Robot) -> Reference:
    base = robot.file.base
    parameters = (
        base.speed_lag,
        base.yaw_lag,
        base.centrifugal,
        base.speed_drag,
        base.coupling,
        base.yaw_drag,
    )
    return Reference(np.array(parameters), base.track)


def _grid(robot: Robot, earlier: Told, cells: int) -> Grid:
    """Over the range of the robot's wheel commands; over that of the earlier recording where it states none."""
    base = robot.file.base
    wheels = [a for a in robot.file.actions if a.name.partition("/")[0] in (base.left, base.right)]
    if wheels and all(a.low is not None and a.high is not None for a in wheels):
        low, high = min(a.low for a in wheels), max(a.high for a in wheels)
        return Grid(base.wheel_radius * low, base.wheel_radius * high, cells)
    speeds = np.concatenate([earlier.commands.left, earlier.commands.right])
    return Grid(float(speeds.min()), float(speeds.max()), cells)


def _pieces(of: Told, grid: Grid, sample: float, reference: Reference) -> Pieces:
    begun = on_the_way(of.commands, of.episode, reference)
    return pieces(begun, of.moved, of.episode, grid, sample, of.commands)


def _require(found: Pieces, of: Told, held: Held, sample: float) -> None:
    """LogError where no piece is left, with what there is."""
    if len(found.commands):
        return
    seconds = of.commands.seconds
    raise LogError(
        f"recording {held.name!r} has no command of {sample:g} s ({found.short} shorter, {found.long} longer"
        f" pieces, {found.outside} beyond the robot's range; half of them last {np.median(seconds):.3g} s or more)",
        expected="commands held as long as a sample, or longer with poses in between",
        do=f"give --sample {np.median(seconds):.2g}, or log the pose more often",
    )


def _document(
    robot: Robot,
    recent: Held,
    earlier: Held,
    settings: DriftSettings,
    both: Compared,
    found: Shifts,
    order: tuple[Judged, ...],
    itself: Split | None,
) -> Drift:
    tests, rejected = int(np.isfinite(found.p).sum()), int(found.rejected.sum())
    clear = rivals(order)
    verdict = "too little data" if not tests else "moved" if rejected or clear else "still true"
    told_apart = verdict == "moved" and len(clear) > 1
    apart = apart_at(found, order, both.reference, both.grid, settings.sample) if told_apart else ()
    r = both.reference
    return Drift(
        robot=robot.name,
        recording=recent.recording.id,
        recording_name=recent.name,
        earlier=_taken(earlier, both.old),
        recent=_taken(recent, both.new),
        chosen=False,
        verdict=verdict,
        test="welch" if settings.welch else "student",
        together=settings.together,
        tests=tests,
        rejected=rejected,
        false_alarms=FalseAlarms(
            level=settings.level,
            expected=settings.level * tests,
            splits=itself.splits if itself else 0,
            by=itself and itself.by,
            tests=itself and itself.tests,
            one_by_one=itself and itself.one_by_one,
            alarms=itself and itself.alarms,
        ),
        pattern=clear[0] if len(clear) == 1 else None,
        rivals=clear if len(clear) > 1 else (),
        separate_by=tuple(Separating(left=a, right=b, apart=c) for a, b, c in apart),
        patterns=tuple(
            DriftPattern(
                name=j.name,
                factor=j.factor,
                low=j.low,
                high=j.high,
                share=j.share,
                evidence=j.evidence,
            )
            for j in order
        ),
        cells=_cells(both.grid, found),
        sample=settings.sample,
        grid=both.grid.each,
        low=both.grid.low,
        high=both.grid.high,
        reference={
            "left": r.left,
            "right": r.right,
            "turns": r.turns,
            "speed_lag": float(r.parameters[0]),
            "yaw_lag": float(r.parameters[1]),
        },
        seed=settings.seed,
        notes=_notes(both, found, order, clear, rejected, tests, itself),
        seconds=0.0,
    )


def _taken(held: Held, taken: Pieces) -> Taken:
    return Taken(
        recording=held.recording.id,
        name=held.name,
        samples=taken.drives,
        pieces=len(taken.commands),
        short=taken.short,
        long=taken.long,
        outside=taken.outside,
    )


def _cells(grid: Grid, found: Shifts) -> tuple[DriftCell, ...]:
    """Those that were tested, the strongest shift first."""
    sigmas = found.sigmas
    tested = np.flatnonzero(np.isfinite(found.p).any(axis=1))
    order = (
        tested[np.argsort(-np.nanmax(np.abs(sigmas[tested]), axis=1), kind="stable")] if len(tested) else []
    )
    return tuple(
        DriftCell(
            left=float(grid.middle(at)[0]),
            right=float(grid.middle(at)[1]),
            earlier=int(found.count[0, at]),
            recent=int(found.count[1, at]),
            shifts={
                axis: Shift(
                    value=float(found.value[at, i]),
                    error=float(found.error[at, i]),
                    unit=UNITS[i],
                    p=float(found.p[at, i]),
                    sigmas=float(sigmas[at, i]),
                    rejected=bool(found.rejected[at, i]),
                )
                for i, axis in enumerate(AXES)
                if np.isfinite(found.p[at, i])
            },
        )
        for at in order
    )


def _notes(
    both: Compared,
    found: Shifts,
    order: tuple[Judged, ...],
    clear: tuple[str, ...],
    rejected: int,
    tests: int,
    itself: Split | None,
) -> tuple[str, ...]:
    """What else a reader must know."""
    out = []
    if not tests:
        out.append(
            f"{both.old.drives} and {both.new.drives} samples in {both.grid.cells} cells: ask for fewer --cells,"
            " or record more commands, the same ones in both"
        )
    if clear and not rejected:
        out.append("no cell alone shows it: the pattern pools all of them")
    if clear and order[0].share < 0.5:
        out.append(
            f"{order[0].name} explains {100 * order[0].share:.0f} % of the squared shifts: not all of it"
        )
    if tests and itself is None:
        out.append("the earlier recording is too small to be split: how often the test errs was not measured")
    return tuple(out)


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
