"""The room of one trial."""

from rich.console import RenderableType

from dynreg.report.trials import listed
from dynreg.results.trials import TrialResult


def tables(result: TrialResult) -> RenderableType:
    """What was hidden and what was said of it."""
    return listed((result,), f"one trial on {result.robot}")
