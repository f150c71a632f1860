"""Draw what an answer costs on the robot: docs/methods_cost.png.

    python benchmarks/methods_pictures.py --journal methods_cost.jsonl --out docs

Reads the journal of `bench_methods --episodes 1 10 30` on servos, and of a quadruped on which `btr` was tried where it
holds one. Lines join medians over robots of the error on what was held out, as a share of the nominal simulator's. A
method that cannot answer so few episodes has no point there.
"""

import argparse
import json
from pathlib import Path

import matplotlib

if __name__ == "__main__":
    matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from kept import RESULTS
from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

EPISODE = 2.5  # s of a servo's
LOG = 8 * 60 / 36.0  # s of a quadruped's log
STYLES = {
    "diagnose": ("#0b63ce", "-"),
    "synthesis": ("#d9822b", "-"),
    "cma": ("#2a9d5c", "-"),
    "mujoco.sysid": ("#8e44ad", "-"),
    "nearest": ("#6b4f3a", "--"),
    "staged": ("#c0392b", "--"),
    "es": ("#a4a7aa", "--"),
    "ga": ("#a4a7aa", ":"),
    "btr": ("black", "-"),
}
SHARES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
PLACES = ("servo, in the family", "servo, outside", "quadruped")


def medians(lines: list[dict], method: str) -> tuple[np.ndarray, np.ndarray]:
    """Seconds on the robot, and the median share there, of one method."""
    mine = [x for x in lines if x["method"] == method and "share" in x]
    at: dict[float, list[float]] = {}
    for x in mine:
        at.setdefault(seconds(x), []).append(x["share"])
    return np.array(sorted(at)), np.array([np.median(at[s]) for s in sorted(at)])


def seconds(line: dict) -> float:
    """How long the robot moved for an answer [s]."""
    if "real seconds" in line:
        return line["real seconds"]
    return LOG if line["robot"] == "quadruped" else EPISODE * line["episodes"]


def draw(lines: list[dict], out: Path) -> Path:
    """The figure: a panel for each place that has lines."""
    own = {
        PLACES[0]: [x for x in lines if x.get("episodes") and x["hidden"] == "in the family"],
        PLACES[1]: [x for x in lines if x.get("episodes") and x["hidden"] == "outside"],
        PLACES[2]: [x for x in lines if x["robot"] == "quadruped"],
    }
    own = {place: found for place, found in own.items() if found}
    figure, panels = plt.subplots(
        1, len(own), figsize=(3.6 * len(own), 3.0), layout="constrained", squeeze=False
    )
    for axes, (place, found) in zip(panels[0], own.items(), strict=True):
        axes.axhline(1.0, color="#a4a7aa", lw=0.8)
        for method, (color, dashes) in STYLES.items():
            at, share = medians(found, method)
            if len(at):
                axes.plot(at, share, marker="o", ms=3.5, color=color, ls=dashes, lw=1.2, label=method)
        axes.set(title=place, xlabel="seconds on the robot", xscale="log", yscale="log")
        axes.xaxis.set_major_locator(FixedLocator(sorted({seconds(x) for x in found if "share" in x})))
        axes.yaxis.set_major_locator(FixedLocator(SHARES))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axis.set_minor_locator(NullLocator())
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
        axes.title.set_fontsize(9)
        axes.xaxis.label.set_fontsize(8)
    drawn = {line.get_label(): line for axes in panels[0] for line in axes.get_lines()}
    named = [drawn[method] for method in STYLES if method in drawn]
    figure.legend(handles=named, loc="outside lower center", frameon=False, fontsize=7, ncols=len(named))
    panels[0, 0].set_ylabel("error, of the nominal simulator's", fontsize=8)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "methods_cost.png", dpi=100)
    plt.close(figure)
    return out / "methods_cost.png"


def main(arguments: list[str] | None = None) -> None:
    """Draw all panels."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--journal", type=Path, default=RESULTS / "methods_cost.jsonl")
    parser.add_argument("--out", type=Path, default=Path("docs"))
    given = parser.parse_args(arguments)
    text = given.journal.read_text(encoding="utf-8").splitlines()
    print(draw([json.loads(line) for line in text[1:]], given.out))


if __name__ == "__main__":
    main()
