"""The room of many trials: their words, their tables and their page."""

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.report.words import count, number
from dynreg.results.trials import Confusion, Rate, TrialResult, TrialTable

LISTED = 12  # as many trials are listed one by one
SIZES = ("weak", "medium", "strong")


def tables(result: TrialTable) -> RenderableType:
    """The rates, by effect, what was taken for what, and a few trials one by one."""
    parts: list[RenderableType] = [Text(verdict(result), style="bold")]
    parts.append(table(("", "", "90 % interval"), [(n, *rate_cells(r)) for n, r in rates(result)], "rates"))
    rows = [
        (g.hidden or "nothing", g.trials, *rate_cells(g.right), g.in_set.hits if g.in_set else None)
        for g in result.by_effect
    ]
    parts.append(
        table(("hidden", "robots", "right", "90 % interval", "in the set"), rows, "by what was hidden")
    )
    if result.confusions:
        rows = [(c.hidden or "nothing", said_instead(c), c.count) for c in result.confusions]
        parts.append(table(("hidden", "said", "times"), rows, "not right"))
    if len(result.trials) <= LISTED:
        parts.append(listed(result.trials, "one by one"))
    parts += [Text(f"\n{figures(result)}"), *(Text(f"note: {note}") for note in result.notes)]
    return Group(*parts)


def verdict(result: TrialTable) -> str:
    """The rates in a sentence."""
    said = []
    if result.right:
        said.append(f"{result.right.hits} of {count(result.right.of, 'hidden effect')} named right")
    if result.wrong:
        said.append(f"{result.wrong.hits} of {result.wrong.of} given a wrong name")
    if result.false_alarm:
        alarms = count(result.false_alarm.hits, "false alarm")
        said.append(f"{alarms} in {count(result.false_alarm.of, 'robot')} without an effect")
    return f"{result.robot}: {', '.join(said) or 'no trials'}."


def rates(result: TrialTable) -> list[tuple[str, Rate]]:
    """(what, rate) of those that there are."""
    named = [
        ("right", result.right),
        *((f"right, {size}", result.by_size.get(size)) for size in SIZES),
        ("truth among the equivalents", result.in_set),
        ("wrong name", result.wrong),
        ("false alarm, nothing hidden", result.false_alarm),
    ]
    return [(name, rate) for name, rate in named if rate is not None]


def rate_cells(rate: Rate) -> tuple[str, str]:
    """Hits of all, and the interval in percent."""
    return f"{rate.hits} of {rate.of}", f"{100 * rate.low:.0f} to {100 * rate.high:.0f} %"


def said_instead(confusion: Confusion) -> str:
    """What was said of a hidden effect that was not right."""
    if confusion.named is None:
        return "nothing"
    same = confusion.named == confusion.hidden
    return f"{confusion.named}, but as a part of the cause" if same else confusion.named


def figures(result: TrialTable) -> str:
    """Medians of what is no rate."""
    known = [
        ("set of equivalents: median {}", result.set_median),
        ("95th percentile {}", result.set_p95),
        ("share of the attainable gain {}", result.gain_share_median),
        ("error of the effect's size, where right {}", result.parameter_error_median),
        ("{} s a diagnosis", result.seconds_median),
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
        "confusions": [(c.hidden or "nothing", said_instead(c), c.count) for c in result.confusions],
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
    """Trials one by one."""
    rows = [
        (
            str(t.seed),
            (t.hidden or "nothing") + (f"[{','.join(t.joints)}]" if t.joints else ""),
            t.size or "-",
            t.named or "nothing",
            t.verdict,
            "right" if t.right else "not right",
            t.seconds,
        )
        for t in trials
    ]
    return table(("seed", "hidden", "size", "said", "verdict", "", "time [s]"), rows, title)
