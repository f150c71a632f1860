"""The room of one trial."""

from rich.console import RenderableType

from dynreg.report.trials import listed
from dynreg.results.trials import TrialResult


def tables(result: TrialResult) -> RenderableType:
    """The hidden effect and the diagnosis."""
    return listed((result,), f"one trial on {result.robot}")
