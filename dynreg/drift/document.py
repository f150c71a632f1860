"""The result of a drift, from what the tests found."""

import numpy as np

from dynreg.drift.compared import Compared, DriftSettings, Held
from dynreg.results import Drift, DriftCell, DriftPattern, FalseAlarms, Separating, Shift, Taken
from dynreg.sim.robot import Robot
from dynreg.timed.cells import Grid, Pieces
from dynreg.timed.commands import AXES
from dynreg.timed.drift import Judged, Shifts, Split, apart_at, rivals
from dynreg.timed.patterns import HIGHEST, LOWEST

UNITS = ("m", "m", "rad")


def document(
    robot: Robot,
    recent: Held,
    earlier: Held,
    settings: DriftSettings,
    both: Compared,
    found: Shifts,
    order: tuple[Judged, ...],
    itself: Split | None,
) -> Drift:
    """The verdict with all that it stands on. itself : None where the earlier recording was not split."""
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
        separate_by=tuple(Separating(left=a, right=b, apart=c, known=d) for a, b, c, d in apart),
        patterns=tuple(
            DriftPattern(
                name=j.name,
                factor=j.factor,
                low=j.low,
                high=j.high,
                share=j.share,
                evidence=j.evidence,
                at_bound=j.at_bound,
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
        notes=_notes(both, order, clear, rejected, tests, settings.splits > 0 and itself is None),
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
    order: tuple[Judged, ...],
    clear: tuple[str, ...],
    rejected: int,
    tests: int,
    whole: bool,
) -> tuple[str, ...]:
    """What else a reader must know. whole : splits were asked for, and the earlier recording could not be split."""
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
    out += [
        f"the factor of {j.name} stands at a bound of the search, {LOWEST:g} to {HIGHEST:g}: what moved may be more, or"
        " something else"
        for j in order
        if j.at_bound and j.name in clear
    ]
    if tests and whole:
        out.append("the earlier recording is too small to be split: how often the test errs was not measured")
    return tuple(out)
