"""The table of `bench_gait_hidden`: what gaits of all sources do on hidden quadrupeds."""

from collections.abc import Callable, Iterable, Sequence
from functools import cache

import numpy as np
from walkers import FAMILY

from dynreg.results.trials import rate
from dynreg.rng import stream

SOURCES = (
    "packaged",
    "nearest",
    "hill",
    "synthesised",
    "pulled",
    "diagnosed",
    "calibrated",
    "nominal",
    "random",
    "population",
    "rounds",
    "true",
)
DRAWS = 4000  # of the bootstrap
UNTOLD = {"spent": None, "core": None}  # of the first of several searches: only the sum of all is measured


def table(steps: dict[tuple[str, str], dict], robots: Iterable[str], seconds: float) -> dict[str, dict]:
    """{half: {source: figures}} of the robots that have all of their sources; `seconds` of a trial."""
    out = {}
    for half, inside in (("in the family", True), ("outside", False)):
        mine = [name for name in robots if name.startswith(FAMILY) == inside]
        sources = [s for s in SOURCES if any((name, s) in steps for name in mine)]
        whole = [name for name in mine if all((name, s) in steps for s in sources)]
        if not (sources and whole):
            continue
        cells = {s: [steps[name, s] for name in whole] for s in sources}
        if "rounds" in cells:
            rounds = cells["rounds"]
            cells = {"first": [c | UNTOLD | c.get("first", {}) for c in rounds], **cells}
            if all("tried" in one for c in rounds for one in c.get("rounds", ())):
                cells["luckiest"] = [c | _luckiest(c.get("rounds", ())) for c in rounds]
        speed = {s: np.array([100 * c["real"] / seconds for c in found]) for s, found in cells.items()}
        rows = {s: _row(found, speed[s], speed.get("true")) for s, found in cells.items()}
        gains = {
            f"diagnosed - {other}": _boot(lambda d, o: d - o, speed["diagnosed"], speed[other])
            for other in ("nearest", "synthesised", "calibrated", "nominal")
            if {"diagnosed", other} <= {*speed}
        }
        for source in ("rounds", "luckiest"):
            if source in speed:
                gain = _boot(lambda d, o: d - o, speed[source], speed["first"])
                gain["better"] = int((speed[source] > speed["first"]).sum())
                gain["the same gait"] = sum(c.get("best") == 1 for c in cells[source])
                gains[f"{source} - their first gait"] = gain
        told = {
            name: steps[name, "naming"].get("causes", steps[name, "naming"].get("problem"))
            for name in whole
            if (name, "naming") in steps
        }
        out[half] = {"robots": len(whole), "sources": rows, "gains": gains, "named": told}
    return out


def _luckiest(rounds: Sequence[dict]) -> dict:
    """What the gait does that reached most in its one trial without a fall (the last where all fell), and its number.

    Nothing where none was tried.
    """
    stood = [i for i, one in enumerate(rounds) if not one["fell"]]
    at = max(stood, key=lambda i: rounds[i]["real"], default=len(rounds) - 1)
    return {**rounds[at]["tried"], "best": at + 1} if rounds else {}


def _row(cells: list[dict], speed: np.ndarray, oracle: np.ndarray | None) -> dict:
    mean = lambda of: None if None in of else float(np.mean(of))  # noqa: E731
    spent = [c["spent"] or {"trials": None, "seconds": None} for c in cells]
    return {
        "success": rate(c["success"] for c in cells).to_dict(),
        "falls": sum(c["fell"] for c in cells),
        "speed": _boot(lambda v: v, speed),
        "share": None if oracle is None else _boot(lambda v, o: v / o, speed, oracle),
        "trials": mean([s["trials"] for s in spent]),
        "seconds": mean([s["seconds"] for s in spent]),
        "core": mean([c["core"] for c in cells]),
    }


@cache
def _picks(count: int) -> np.ndarray:
    return stream(0, "gait table").integers(0, count, (DRAWS, count))


def _boot(of: Callable[..., np.ndarray], *columns: np.ndarray) -> dict[str, float | None]:
    """`of` the means of columns (n,) over robots, and its 90 % bootstrap interval; None where it is no number."""
    with np.errstate(divide="ignore", invalid="ignore"):
        value = of(*(c.mean() for c in columns))
        drawn = of(*(c[_picks(len(c))].mean(axis=1) for c in columns))
        low, high = np.quantile(drawn, [0.05, 0.95])
    known = lambda x: float(x) if np.isfinite(x) else None  # noqa: E731
    return {"value": known(value), "low": known(low), "high": known(high)}


def show(out: dict[str, dict]) -> None:
    """Print the tables."""
    for half, found in out.items():
        print(f"\n{half}, {found['robots']} robots")
        print(
            f"  {'':12s} success  falls  speed [cm/s]           share of the oracle    trials  real s  core s"
        )
        for source, row in found["sources"].items():
            won = row["success"]
            print(
                f"  {source:12s} {won['hits']:3d}/{won['of']:<3d}  {row['falls']:3d}   {_told(row['speed'])}"
                f"  {_told(row['share']):21s} {_cost(row['trials'])}  {_cost(row['seconds'])}  {_cost(row['core'])}"
            )
        for name, gain in found["gains"].items():
            more = ", ".join(f"{k} on {v}" for k, v in gain.items() if k not in ("value", "low", "high"))
            print(f"  {name}: {_told(gain)} cm/s {more}".rstrip())
        for name, causes in found["named"].items():
            print(f"    {name}: {causes if isinstance(causes, str) else ', '.join(causes) or 'nothing'}")


def _cost(x: float | None) -> str:
    return f"{'-':>6s}" if x is None else f"{x:6.1f}"


def _told(x: dict | None) -> str:
    if x is None or None in (x["value"], x["low"], x["high"]):
        return "-"
    return f"{x['value']:5.2f} [{x['low']:5.2f}, {x['high']:5.2f}]"
