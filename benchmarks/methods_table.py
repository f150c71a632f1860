"""The table of every method: errors as a share of the nominal simulator's, and of walkers what a gait is worth."""

from collections.abc import Iterable

import numpy as np
from bootstrap import median_interval
from scipy.stats import wilcoxon

from dynreg.timed.compare import holm

TRUE = "the robot itself"
SURE = 0.05


def show(lines: list[dict]) -> None:
    """Print the tables."""
    for key in dict.fromkeys(map(_table, lines)):
        own = [x for x in lines if _table(x) == key and "share" in x]
        cannot = {x["method"] for x in lines if _table(x) == key and "problem" in x}
        shares = {m: {x["number"]: x["share"] for x in own if x["method"] == m} for m in _methods(own)}
        rivals = {m: float(np.median([*s.values()])) for m, s in shares.items() if m != TRUE}
        best = min(rivals, key=rivals.__getitem__)
        behind = _behind(shares, best)
        episodes = "" if key[3] is None else f", {key[3]} episodes"
        print(f"{key[0]}, {key[1]}, {key[2]:g} s{episodes}: {len(shares[best])} robots; best is {best}")
        for m in sorted(shares, key=lambda m: rivals.get(m, -1.0)):
            _row(m, [x for x in own if x["method"] == m], behind.get(m))
        if cannot:
            print(f"  cannot: {', '.join(sorted(cannot))}")
        _walks([x for x in own if "walk" in x])


def _table(line: dict) -> tuple:
    return (*(line.get(k) for k in ("robot", "hidden", "seconds", "episodes")),)


def _methods(lines: Iterable[dict]) -> list[str]:
    return list(dict.fromkeys(x["method"] for x in lines))


def _behind(shares: dict[str, dict[int, float]], best: str) -> dict[str, float]:
    """{method: p} of Wilcoxon's test on pairs of robots against the best, with Holm's correction."""
    p = {}
    for m in shares:
        both = sorted(shares[m].keys() & shares[best].keys())
        apart = np.log([shares[m][n] / shares[best][n] for n in both])
        if m not in (best, TRUE):
            p[m] = float(wilcoxon(apart).pvalue) if apart.any() else 1.0
    return dict(zip(p, holm([*p.values()]), strict=True))


def _row(method: str, mine: list[dict], p: float | None) -> None:
    found = np.array([x["share"] for x in mine])
    low, high = median_interval(found)
    runs, spent = (float(np.median([x[k] for x in mine])) for k in ("rollouts", "core seconds"))
    told = {t: sum(x["told"] == t for x in mine) for t in ("right", "wrong", "none")}
    words = ", ".join(f"{n} {t}" for t, n in told.items() if n)
    behind = "" if p is None else f"p {p:.3f}{'' if p < SURE else ' (not sure)'}"
    print(
        f"  {method:16} {np.median(found):6.3f} [{low:.3f}, {high:.3f}] {runs:8.0f} simulators {spent:7.1f} core s  "
        f"{behind}  {words}"
    )


def _walks(lines: list[dict]) -> None:
    """What gaits are worth that were sought in the answers, beside those sought in the robot's own simulator."""
    speed = lambda m: float(np.mean([x["walk"]["speed"] for x in lines if x["method"] == m]))  # noqa: E731
    for m in sorted(_methods(lines), key=speed, reverse=True):
        mine = [x["walk"] for x in lines if x["method"] == m]
        share = f"{speed(m) / speed(TRUE):5.2f} of the oracle's" if TRUE in _methods(lines) else ""
        falls, trials = (sum(w[k] for w in mine) for k in ("falls", "trials"))
        rank = float(np.mean([w["rank"] for w in mine]))
        print(
            f"    {m:16} walks {100 * speed(m):6.1f} cm/s {share}, {falls} of {trials} trials fell, "
            f"rank correlation {rank:+.2f}"
        )
