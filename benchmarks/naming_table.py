"""The naming benchmarks' figures as Markdown: `python benchmarks/naming_table.py` brings docs/naming.md up to date.

A table stands between `<!-- naming: ROBOT -->` and `<!-- /naming -->`.
"""

import json
import re
from pathlib import Path

from kept import RESULTS
from naming import NOTHING

from dynreg.errors import UsageError
from dynreg.sim.effects import SIZES

PAGE = Path(__file__).parents[1] / "docs" / "naming.md"
BLOCK = re.compile(r"(<!-- naming: (.+?) -->\n).*?(<!-- /naming -->)", re.DOTALL)
HEAD = ("hidden", *SIZES, "error of the size", "90 % interval holds it", "most often instead")


def documents(folder: Path = RESULTS) -> dict[str, dict]:
    """{robot: tables} of all naming benchmarks that have run."""
    files = [json.loads(path.read_text()) for path in sorted(folder.glob("naming*.json"))]
    return {d["robot"]: d for file in files for d in ([file] if "robot" in file else file.values())}


def markdown(out: dict) -> str:
    """One row for each hidden effect, and one for all; blank where nothing is known."""
    sizes = {s: f"{r['hits']}/{r['of']}" for s, r in out["by_size"].items()}
    whole = ["**all**", *(sizes.get(s, "") for s in SIZES), _percent(out["parameter_error_median"])]
    rows = [HEAD, ["---"] * len(HEAD), *(_row(out, e) for e in out["effects"])]
    rows.append([*whole, _of(out["covered"]), ""])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"


def filled(page: str, found: dict[str, dict]) -> str:
    """The page with every marked block made anew; UsageError for a robot without figures."""

    def block(match: re.Match) -> str:
        begin, robot, end = match.groups()
        if robot not in found:
            raise UsageError(
                f"no naming figures of {robot!r}",
                expected=f"one of {sorted(found)}",
                do="run its naming benchmark, or mend the mark",
            )
        return f"{begin}\n{markdown(found[robot])}\n{end}"

    return BLOCK.sub(block, page)


def _row(out: dict, effect: str) -> list[str]:
    mine = out["effects"][effect]
    sizes = ["/".join(map(str, mine["sizes"][s])) if s in mine["sizes"] else "" for s in SIZES]
    return [effect, *sizes, _percent(mine["error"]), _of(mine["covered"]), _instead(out, effect)]


def _instead(out: dict, effect: str) -> str:
    """What was said most often where the answer was not right; of as many, a name that is another."""
    wrong = [c for c in out["confusions"] if c["hidden"] == effect]
    if not wrong:
        return ""
    most = max(wrong, key=lambda c: (c["count"], c["named"] not in (None, effect)))
    named = most["named"] or NOTHING
    return f"{'itself, in part' if named == effect else named} ({most['count']})"


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.2g} %"


def _of(share: dict | None) -> str:
    return "" if share is None else f"{share['hits']}/{share['of']}"


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(), documents()))
