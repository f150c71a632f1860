"""The room of many trials: their words, their tables and their page."""

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.report.words import count, number
from dynreg.results.trials import Confusion, Rate, TrialResult, TrialTable
from dynreg.sim.sizes import SIZES

LISTED = 12  # up to this many trials are listed one by one


def tables(result: TrialTable) -> RenderableType:
    """The rates, also by effect; the confusions; and a few trials one by one."""
    parts: list[RenderableType] = [Text(verdict(result), style="bold")]
    parts.append(table(("", "", "90 % interval"), [(n, *rate_cells(r)) for n, r in rates(result)], "rates"))
    rows = [
        (g.hidden or "nothing", g.trials, *rate_cells(g.right), g.in_set.hits if g.in_set else None)
        for g in result.by_effect
    ]
    columns = ("hidden effect", "robots", "right", "90 % interval", "in the set of equivalents")
    parts.append(table(columns, rows, "rates by hidden effect"))
    if result.confusions:
        rows = [(c.hidden or "nothing", diagnosed(c), c.count) for c in result.confusions]
        parts.append(table(("hidden effect", "diagnosis", "count"), rows, "not right"))
    if len(result.trials) <= LISTED:
        parts.append(listed(result.trials, "one by one"))
    parts += [Text(f"\n{figures(result)}"), *(Text(f"note: {note}") for note in result.notes)]
    return Group(*parts)


def verdict(result: TrialTable) -> str:
    """The rates in a sentence."""
    parts = []
    if result.right:
        parts.append(f"{result.right.hits} of {count(result.right.of, 'hidden effect')} named right")
    if result.in_part and result.in_part.hits:
        parts.append(f"{result.in_part.hits} right in part")
    if result.wrong:
        parts.append(f"{result.wrong.hits} of {result.wrong.of} named wrong")
    if result.outside:
        names = f"{result.outside.hits} of {count(result.outside.of, 'cause')} outside the library"
        parts.append(f"{names} named with confidence")
    if result.false_alarm:
        alarms = count(result.false_alarm.hits, "false alarm")
        parts.append(f"{alarms} in {count(result.false_alarm.of, 'robot')} without an effect")
    return f"{result.robot}: {', '.join(parts) or 'no trials'}."


def rates(result: TrialTable) -> list[tuple[str, Rate]]:
    """(name, rate) of the rates that are known."""
    named = [
        ("right", result.right),
        *((f"right, {size}", result.by_size.get(size)) for size in SIZES),
        ("true effect among the equivalents", result.in_set),
        ("right in part", result.in_part),
        ("wrong name", result.wrong),
        ("false alarm (no hidden effect)", result.false_alarm),
        ("other verdict than none (no hidden effect)", result.not_none),
        ("confident name for a cause outside the library", result.outside),
    ]
    return [(name, rate) for name, rate in named if rate is not None]


def rate_cells(rate: Rate) -> tuple[str, str]:
    """The count, and the interval in percent."""
    return f"{rate.hits} of {rate.of}", f"{100 * rate.low:.0f} to {100 * rate.high:.0f} %"


def diagnosed(confusion: Confusion) -> str:
    """The diagnosis of a hidden effect that is not right."""
    if confusion.named is None:
        return "nothing"
    part = confusion.in_part or confusion.named == confusion.hidden
    return f"{confusion.named} (explains only a part)" if part else confusion.named


def figures(result: TrialTable) -> str:
    """Medians of the values that are not rates."""
    known = [
        ("size of the set of equivalents: median {}", result.set_median),
        ("its 95th percentile {}", result.set_p95),
        ("median share of the attainable gain {}", result.gain_share_median),
        ("median relative error of the effect's size if right {}", result.parameter_error_median),
        ("median time of a diagnosis {} s", result.seconds_median),
    ]
    return "; ".join(text.format(number(value)) for text, value in known if value is not None)


def page(result: TrialTable) -> dict[str, Any]:
    """The template's variables."""
    return {
        "result": result,
        "title": f"{result.robot} · trials",
        "verdict": verdict(result),
        "rates": [_bar(name, r) for name, r in rates(result)],
        "groups": [_bar(g.hidden or "nothing", g.right) for g in result.by_effect],
        "confusions": [(c.hidden or "nothing", diagnosed(c), c.count) for c in result.confusions],
        "figures": figures(result),
    }


def _bar(name: str, rate: Rate) -> dict[str, Any]:
    hits, interval = rate_cells(rate)
    return {
        "name": name,
        "hits": hits,
        "interval": interval,
        "value": 100 * rate.value,
        "left": 100 * rate.low,
        "width": max(100 * (rate.high - rate.low), 0.8),
    }


def listed(trials: tuple[TrialResult, ...], title: str) -> RenderableType:
    """A table with one row for each trial."""
    rows = [
        (
            str(t.seed),
            (t.hidden or "nothing") + (f"[{','.join(at)}]" if (at := t.joints or t.bodies) else ""),
            t.size or "-",
            t.named or "nothing",
            t.verdict,
            t.judged,
            t.seconds,
        )
        for t in trials
    ]
    return table(("seed", "hidden effect", "size", "diagnosis", "verdict", "", "time [s]"), rows, title)
