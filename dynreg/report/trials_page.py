"""What the page of a table of trials draws."""

from typing import Any

from dynreg.report.trial_tables import figures, rate_cells, rates, said_instead, trials_verdict
from dynreg.results import Rate, TrialTable


def trials_page(result: TrialTable) -> dict[str, Any]:
    """The template's variables."""
    return {
        "result": result,
        "title": f"{result.robot} · trials",
        "verdict": trials_verdict(result),
        "rates": [_row(name, r) for name, r in rates(result)],
        "groups": [_row(g.hidden or "nothing", g.right) for g in result.by_effect],
        "confusions": [(c.hidden or "nothing", said_instead(c), c.count) for c in result.confusions],
        "figures": figures(result),
    }


def _row(name: str, rate: Rate) -> dict[str, Any]:
    hits, interval = rate_cells(rate)
    return {
        "name": name,
        "hits": hits,
        "interval": interval,
        "value": 100 * rate.value,
        "left": 100 * rate.low,
        "width": max(100 * (rate.high - rate.low), 0.8),
    }
