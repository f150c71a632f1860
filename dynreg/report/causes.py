"""The room of a query on a population of effects: its words and its table."""

from rich.console import Group
from rich.text import Text

from dynreg.errors import command
from dynreg.report.grid import table
from dynreg.report.words import number
from dynreg.results.causes import Causes

SHOWN = 8  # causes of the table


def tables(result: Causes) -> Group:
    """The likeliest causes with their shares and cosines."""
    rows = [
        (
            one.effect or "none",
            ", ".join(one.places) or "-",
            f"{100 * one.belief:.0f} %",
            f"{100 * one.near:.0f} %",
            f"{one.cosine:.3f}",
        )
        for one in result.causes[:SHOWN]
    ]
    columns = ("effect", "place", "belief", f"share of the {result.k} nearest", "cosine")
    beyond = (
        f"What calibration leaves is {number(result.size / max(result.noise, 1e-12))} times what noise leaves. "
        f"The nearest of {result.entries} entries resembles it by {result.resemblance:.3f}."
    )
    return Group(
        Text(str(result)), table(columns, rows, "causes that the recording looks like"), Text(beyond)
    )


def hint(result: Causes) -> str:
    """What to type next: a ranking is no verdict."""
    return command("diagnose", result.recording_name)
