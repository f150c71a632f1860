"""The room of gaits tried on a robot: a table, a row for each trial."""

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.results.gait_rounds import GaitRounds


def tables(result: GaitRounds) -> RenderableType:
    """What every gait did on the robot, beside what its simulators predicted."""
    rows = [
        (
            i + 1,
            one.gait[:12],
            "fell" if one.fell else "stood",
            one.fitness,
            one.median,
            f"{one.p5:.3g} to {one.p95:.3g}",
            one.name,
        )
        for i, one in enumerate(result.rounds)
    ]
    columns = ("trial", "gait", "", f"fitness [{result.unit}]", "predicted", "90 %", "log")
    old = [i + 1 for i, one in enumerate(result.rounds) if not one.fits]
    return Group(
        Text(result.headline, style="bold"),
        table(columns, rows, f"task {result.task} on the robot"),
        Text(f"{result.seconds:.1f} s on the robot; ended by {result.ended}"),
        *(
            Text(
                f"note: the log before trial {n} did not tell where to seek; the simulators before it served again"
            )
            for n in old
        ),
    )
