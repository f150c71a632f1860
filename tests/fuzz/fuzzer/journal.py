"""What was run, one line a span: a run that was stopped goes on from it, and the totals are read from it."""

import json
import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

GOOD = ("read", "refused", "unheard")  # unheard: read before one that took its process down


@dataclass
class Total:
    """The spans of one target, added up."""

    next: int = 0
    inputs: int = 0
    cpu: float = 0.0
    peak_mb: int = 0
    grown_kb: int = 0
    longest: tuple[float, int] = (0.0, 0)
    kinds: Counter[str] = field(default_factory=Counter)

    def add(self, report: dict[str, Any]) -> None:
        """Take one span."""
        self.next = max(self.next, report["first"] + report["count"])
        self.inputs += sum(report["kinds"].values())
        self.cpu += report["cpu"]
        self.peak_mb = max(self.peak_mb, report["peak_mb"])
        self.grown_kb += report["grown_kb"]
        self.longest = max(self.longest, tuple(report["longest"]))
        self.kinds.update(report["kinds"])


class Journal:
    """An append-only file of reports, each with the seed that it was drawn by."""

    def __init__(self, path: Path, seed: int):
        self.path, self.seed = path, seed
        path.parent.mkdir(parents=True, exist_ok=True)
        self.totals: dict[str, Total] = {}
        for report in _lines(path):
            self._count(report)
        if path.exists() and not path.read_bytes().endswith(b"\n"):
            path.open("a").write("\n")  # closes a line that a kill cut off

    def add(self, report: dict[str, Any]) -> None:
        """Write one report down."""
        whole = {"seed": self.seed, **report}
        with self.path.open("a") as file:
            file.write(json.dumps(whole) + "\n")
        self._count(whole)

    def _count(self, report: dict[str, Any]) -> None:
        total = self.totals.setdefault(report["target"], Total())
        begun = total.next
        total.add(report)
        if report["seed"] != self.seed:  # counts, but is not gone on from
            total.next = begun


def _lines(path: Path) -> Iterable[dict[str, Any]]:
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            yield json.loads(line)
        except ValueError:  # the line that a kill cut off
            continue


def table(totals: dict[str, Total]) -> str:
    """The totals for people, a target a line."""
    head = (
        "target",
        "inputs",
        "inputs/s",
        "read %",
        "peak MB",
        "longest s",
        "kB/input",
        "crash",
        "hang",
        "other",
    )
    rows = [head, *(_row(name, total) for name, total in sorted(totals.items()))]
    whole = Total()
    for total in totals.values():
        whole.inputs += total.inputs
        whole.cpu += total.cpu
        whole.grown_kb += total.grown_kb
        whole.peak_mb = max(whole.peak_mb, total.peak_mb)
        whole.longest = max(whole.longest, total.longest)
        whole.kinds.update(total.kinds)
    rows.append(_row("all", whole))
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    return os.linesep.join(
        "  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)) for row in rows
    )


def _row(name: str, total: Total) -> tuple[str, ...]:
    bad = {kind: n for kind, n in total.kinds.items() if kind not in GOOD}
    crashes = bad.pop("crash", 0) + bad.pop("died", 0)
    return (
        name,
        str(total.inputs),
        f"{total.inputs / max(total.cpu, 1e-9):.0f}",
        f"{100 * total.kinds['read'] / max(total.inputs, 1):.0f}",
        str(total.peak_mb),
        f"{total.longest[0]:.3f}",
        f"{total.grown_kb / max(total.inputs, 1):.2f}",
        str(crashes),
        str(bad.pop("hang", 0)),
        str(sum(bad.values())),
    )
