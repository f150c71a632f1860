"""Draw what Back to Reality came to: gaits in the simulator and on the robot, learning on the robot, and the kicks.

    python benchmarks/reality_pictures.py --gaits btr.jsonl --kicks kick.jsonl --out docs

Reads the journals that bench_back_to_reality and bench_kick leave, and draws their first robot into reality.png: the
scores of the gaits that were tried, with a break where the simulator was adapted (as paper B's figure 2); the best
score so far of every method on the robot; and how much of a kick's simulated score was left on the robot, over the
kicks simulated until then.
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

SIMULATED, REAL, OTHER = "#d9822b", "#0b63ce", "#a4a7aa"
NAMES = {
    "btr_cma": "Back to Reality, by CMA-ES",
    "btr": "Back to Reality",
    "roulette": "GA of paper B",
    "ga": "GA of paper A",
    "hill": "hill climber",
    "policy": "policy gradient",
    "cma": "CMA-ES",
}


def lines(path: Path) -> list[dict]:
    """Those of the first robot in a journal."""
    found = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()[1:]]
    return [line for line in found if line["robot"] == found[0]["robot"]]


def score(tried: dict) -> float:
    """Of a gait on the robot: the mean over its trials, 0 after a fall."""
    return 0.0 if None in tried["scores"] else float(np.mean(tried["scores"]))


def compared(axes: plt.Axes, tried: list[dict], unit: float) -> None:
    """Simulated and real scores of the gaits that came from the simulator; unit : cm/s of one score."""
    own = [one for one in tried if one["step"] == "transfer" and one["simulated"] is not None]
    number = np.arange(1, len(own) + 1)
    iteration = np.array([one["iteration"] for one in own])
    for one in np.unique(iteration):
        rows = iteration == one
        simulated = np.array([own[i]["simulated"] for i in np.flatnonzero(rows)])
        real = np.array([score(own[i]) for i in np.flatnonzero(rows)])
        first = int(one == iteration[0])  # one label will do
        axes.plot(number[rows], unit * simulated, "o-", ms=3, color=SIMULATED, label="simulator" * first)
        axes.plot(number[rows], unit * real, "o-", ms=3, color=REAL, label="robot" * first)
    for at in np.flatnonzero(np.diff(iteration)):
        axes.axvline(number[at] + 0.5, color="black", lw=0.8, ls=(0, (4, 3)))
    axes.set(title="gaits from the simulator", xlabel="gait on the robot", ylabel="speed [cm/s]")


def rising(axes: plt.Axes, cells: dict[str, dict], unit: float) -> None:
    """The best score of a single trial so far, of every method."""
    curves = {}
    for name in NAMES:
        cell = cells.get(name, {})
        if "history" in cell:
            curves[name] = tuple(np.array(cell["history"]).T)
        elif "tried" in cell:
            scores = [s or 0.0 for one in cell["tried"] for s in one["scores"]]
            curves[name] = (np.arange(1, len(scores) + 1), np.maximum.accumulate(scores))
    for (name, (trials, best)), dashes in zip(
        curves.items(), ("-", "--", "-", "--", ":", "-.", (0, (1, 3))), strict=False
    ):
        color = REAL if name.startswith("btr") else OTHER
        axes.step(trials, unit * best, where="post", color=color, ls=dashes, label=NAMES[name])
    axes.set(title="best trial so far on the robot", xlabel="trials", ylabel="speed [cm/s]")


def kept(axes: plt.Axes, points: list[dict]) -> None:
    """The share of the simulated score that was left on the robot, of every kick that was tried."""
    simulated = np.cumsum([line["rollouts"] for line in points])
    shares = [
        (at, 0.0 if None in scores else float(np.mean(scores)) / told)
        for at, line in zip(simulated, points, strict=True)
        for _, told, scores in line["tried"]
        if told
    ]
    axes.axhline(1.0, color=OTHER, lw=0.8)
    axes.plot(*zip(*shares, strict=True), "o", ms=3.5, color=REAL)
    for at, line in zip(simulated, points, strict=True):
        if any(made == "adapted" for made, *_ in line["versions"]):
            axes.axvline(at, color=OTHER, lw=0.6, ls=(0, (4, 3)), zorder=0)
    axes.set(
        title="kicks: score on the robot / simulated", xlabel="simulated kicks so far", ylim=(-0.05, 2.05)
    )


def main(arguments: list[str] | None = None) -> None:
    """Draw all three."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--gaits", type=Path, default=RESULTS / "back_to_reality.jsonl")
    parser.add_argument("--kicks", type=Path, default=RESULTS / "kick.jsonl")
    parser.add_argument("--seconds", type=float, default=20.0, help="of a trial of the gaits")
    parser.add_argument("--out", type=Path, default=Path("docs"))
    given = parser.parse_args(arguments)
    cells = {line["step"]: line for line in lines(given.gaits)}
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(11.0, 3.0), layout="constrained")
    compared(left, cells["btr"]["tried"], 100.0 / given.seconds)
    rising(middle, cells, 100.0 / given.seconds)
    kept(right, [line for line in lines(given.kicks) if line["step"] == "point"])
    for axes in (left, middle, right):
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
        axes.title.set_fontsize(9)
        axes.xaxis.label.set_fontsize(8)
        axes.yaxis.label.set_fontsize(8)
    left.legend(frameon=False, fontsize=7)
    middle.legend(frameon=False, fontsize=6, loc="upper right", bbox_to_anchor=(1.0, 0.93))
    given.out.mkdir(parents=True, exist_ok=True)
    figure.savefig(given.out / "reality.png", dpi=100)
    plt.close(figure)
    print(given.out / "reality.png")


if __name__ == "__main__":
    main()
