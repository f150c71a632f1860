"""The result of a drift, from what the tests found."""

from dataclasses import asdict

import numpy as np

from dynreg.drift.compared import Held, Plan
from dynreg.drift.drift import Drifted
from dynreg.results.drift import Drift, DriftCell, FalseAlarms, Separating, Shift, Taken
from dynreg.sim.robot import Robot
from dynreg.timed.cells import Grid, Pieces
from dynreg.timed.commands import AXES
from dynreg.timed.drift import Shifts
from dynreg.timed.patterns import HIGHEST, LOWEST

UNITS = ("m", "m", "rad")
ALIKE = 0.5  # of the driving: less is told
MUCH = 0.1  # of the pieces: so many that are left out are told
NOT_SPLIT = {"splits": 0, "by": None, "tests": None, "one_by_one": None, "alarms": None}


def document(robot: Robot, recent: Held, earlier: Held, plan: Plan, found: Drifted) -> Drift:
    """The verdict with all its numbers."""
    both, clear, r = found.both, found.clear, found.both.reference
    return Drift(
        robot=robot.name,
        recording=recent.recording.id,
        recording_name=recent.name,
        earlier=_taken(earlier, both.old),
        recent=_taken(recent, both.new),
        chosen=False,
        verdict=found.verdict,
        test="welch" if plan.rules.welch else "student",
        together=plan.rules.together,
        tests=found.tests,
        rejected=found.rejected,
        false_alarms=FalseAlarms(
            level=plan.rules.level,
            expected=plan.rules.level * found.tests,
            **(asdict(found.itself) if found.itself else NOT_SPLIT),
        ),
        pattern=clear[0] if len(clear) == 1 else None,
        rivals=clear if len(clear) > 1 else (),
        separate_by=tuple(Separating(left=a, right=b, apart=c, known=d) for a, b, c, d in found.apart),
        patterns=found.order,
        cells=_cells(both.grid, found.shifts),
        sample=plan.sample,
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
        seed=plan.seed,
        notes=_notes(found, plan.splits),
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
    return tuple(_cell(grid, found, at, sigmas[at]) for at in order)


def _cell(grid: Grid, found: Shifts, at: int, sigmas: np.ndarray) -> DriftCell:
    """One by its number, with the normal deviates (3,) of its tests."""
    left, right = map(float, grid.middle(at))
    return DriftCell(
        left=left,
        right=right,
        earlier=int(found.count[0, at]),
        recent=int(found.count[1, at]),
        shifts={
            axis: Shift(
                value=float(found.value[at, i]),
                error=float(found.error[at, i]),
                unit=UNITS[i],
                p=float(found.p[at, i]),
                sigmas=float(sigmas[i]),
                rejected=bool(found.rejected[at, i]),
            )
            for i, axis in enumerate(AXES)
            if np.isfinite(found.p[at, i])
        },
    )


def _notes(found: Drifted, splits: int) -> tuple[str, ...]:
    """What else a reader must know. splits : that were asked for."""
    both, out = found.both, []
    if not found.tests:
        out.append(
            f"{both.old.drives} and {both.new.drives} samples in {both.grid.cells} cells: ask for fewer --cells,"
            " or record more commands, the same ones in both"
        )
    if both.new.outside > MUCH * (len(both.new.commands) + both.new.outside):
        out.append(
            f"{both.new.outside} pieces of the recent recording are left out because their speeds are outside the"
            " compared range. Where robot.toml limits no wheel, that range is the earlier recording's"
        )
    if found.verdict == "moved" and both.alike < ALIKE:
        out.append(
            f"{100 * both.alike:.0f} % of the driving is alike in both (each wheel ahead, back or still, now and just"
            " before): what the reference does not know, such as slip, then looks like a change. To be sure, drive as"
            " in the earlier recording"
        )
    if found.clear and not found.rejected:
        out.append("no single cell shows the change: the pattern pools all of them")
    if found.clear and found.order[0].share < 0.5:
        best = found.order[0]
        out.append(f"{best.name} explains {100 * best.share:.0f} % of the squared shifts: not all of it")
    out += [
        f"the factor of {j.name} is at a bound of the search, {LOWEST:g} to {HIGHEST:g}: the change may be larger, or"
        " another one"
        for j in found.order
        if j.at_bound and j.name in found.clear
    ]
    if found.tests and splits > 0 and found.itself is None:
        out.append("the earlier recording is too small to be split: how often the test errs was not measured")
    return tuple(out)
