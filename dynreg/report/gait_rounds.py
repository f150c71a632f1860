"""The room of gaits tried on a robot: a table and a page, a row for each trial."""

import shlex
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.results.gait_rounds import GaitRounds


def tables(result: GaitRounds) -> RenderableType:
    """What every gait did on the robot, beside what its simulators predicted."""
    rows = _rows(result)
    columns = tuple(rows[0]) if rows else ()
    return Group(
        Text(result.headline, style="bold"),
        table(columns, [tuple(row.values()) for row in rows], f"task {result.task} on the robot"),
        Text(f"{result.seconds:.1f} s on the robot; ended by {result.ended}"),
        *(Text(f"note: {note}") for note in _notes(result)),
    )


def page(result: GaitRounds) -> dict[str, Any]:
    """The template's variables."""
    return {
        "result": result,
        "title": f"{result.recording_name} · trials of gaits on {result.robot}",
        "verdict": result.headline,
        "tiles": [
            (str(len(result.rounds)), "trials"),
            (str(result.falls), "falls"),
            (f"{result.seconds:.1f} s", "on the robot"),
        ],
        "notes": _notes(result),
        "tables": {f"task {result.task} on the robot": _rows(result)},
    }


def hint(result: GaitRounds) -> str:
    """The best gait as commands; where none stood, what may say why."""
    if result.best is None:
        return shlex.join(["dynreg", "diagnose", result.rounds[-1].name]) if result.rounds else ""
    return f"dynreg export {result.rounds[result.best - 1].gait[:12]} --as python --to gait.py"


def _rows(result: GaitRounds) -> list[dict[str, Any]]:
    return [
        {
            "trial": i + 1,
            "gait": one.gait[:12],
            "": "fell" if one.fell else "stood",
            f"fitness [{result.unit}]": one.fitness,
            "predicted": one.median,
            "90 %": f"{one.p5:.3g} to {one.p95:.3g}",
            "again": one.again,
            "log": one.name,
        }
        for i, one in enumerate(result.rounds)
    ]


def _notes(result: GaitRounds) -> list[str]:
    """On gaits of the robot's folder, and on logs that did not tell where to seek."""
    own = [
        f"the gait of trial {i + 1} is number {one.packaged} of the gaits in the robot's folder, unchanged"
        for i, one in enumerate(result.rounds)
        if one.packaged is not None
    ]
    old = [
        f"the log before trial {i + 1} did not tell where to seek; the simulators before it served again"
        for i, one in enumerate(result.rounds)
        if not one.fits
    ]
    alone = ["of the gaits that stood, the best is the one that did most in its one trial, which may be luck"]
    return [*own, *old, *(alone if result.best and result.rounds[result.best - 1].again is None else [])]
