"""Draw what the benches of wheeled robots keep: paths in simulators and on the robot, and how controllers evolve.

    python benchmarks/wheeled_pictures.py --out docs

Reads benchmarks/results/wheeled_navigation.json and wheeled_static_operon.json; writes navigation.png and
displacements.png. Shown is each simulator's first evolution, not a chosen one.
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
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle

from dynreg.timed.evolve import EVERY
from dynreg.timed.goal import FIELD, REACHED, TARGET
from dynreg.timed.navigation import CORNERS

SIMULATED, REAL, QUIET = "#0b63ce", "#d9822b", "#e4e6e8"
TITLES = {
    "kinematic": "closed form",
    "dynamic": "fitted dynamic model",
    "network": "three networks",
    "extended": "extended simulator",
    "truth": "the robot itself",
}
ARMS = {"with update": "with the table's update", "without": "without"}


def draw_way(axes: Axes, simulated: np.ndarray, real: np.ndarray) -> None:
    """Two paths (n, 2) [mm], in a simulator and on the robot."""
    for way, color, width, dashes, label in (
        (real, REAL, 2.6, "-", "on the robot"),
        (simulated, SIMULATED, 1.3, (0, (4, 2)), "in the simulator"),
    ):
        x, y = np.asarray(way, float).T / 1000.0
        axes.plot(x, y, color=color, linewidth=width, linestyle=dashes, label=label)
        axes.plot(x[-1], y[-1], "o", color=color, markersize=4)


def tidy(axes: Axes, title: str) -> None:
    """Axes of a plane, in metres."""
    axes.set_title(title, fontsize=9)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("m", fontsize=8)


def navigation(found: dict) -> plt.Figure:
    """Ten commands that visit four corners: the first plan of every simulator, there and on the robot."""
    kinds = [kind for kind in TITLES if kind in found]
    figure, panels = plt.subplots(1, len(kinds), figsize=(2.5 * len(kinds), 2.3), layout="constrained")
    for axes, kind in zip(np.atleast_1d(panels), kinds, strict=True):
        side, (low, high) = CORNERS.side, CORNERS.area
        for x, y in CORNERS.centres:
            axes.add_patch(Rectangle((x - side / 2, y - side / 2), side, side, color=QUIET, linewidth=0))
        axes.add_patch(Rectangle(low, *(high - low), fill=False, color="#a4a7aa", linewidth=0.8))
        draw_way(axes, found[kind]["ways"]["simulator"], found[kind]["ways"]["robot"])
        tidy(axes, TITLES[kind])
    handles, labels = np.atleast_1d(panels)[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False, fontsize=9)
    return figure


def displacements(found: dict) -> plt.Figure:
    """The way up and the way right, in the table and on the robot, and what evolves, with and without update."""
    figure, panels = plt.subplots(1, 4, figsize=(12.0, 3.1), layout="constrained")
    for axes, (arm, title) in zip(panels, ARMS.items(), strict=False):
        axes.add_patch(Rectangle((0, 0), *FIELD, fill=False, color="#a4a7aa", linewidth=0.8))
        axes.add_patch(Circle(tuple(TARGET), REACHED, color=QUIET, linewidth=0))
        for simulated, real in zip(found[arm]["ways"]["table"], found[arm]["ways"]["robot"], strict=True):
            draw_way(axes, simulated, real)
        tidy(axes, title)
    for axes, key, title in (
        (panels[2], "fitness in the table", "best fitness in the table"),
        (panels[3], "success of the best", "share of its trials on the robot\nthat reach the target"),
    ):
        for (arm, label), dashes in zip(ARMS.items(), ("-", (0, (4, 2))), strict=True):
            values = found[arm][key]
            axes.plot(
                EVERY * np.arange(1, len(values) + 1), values, color="#333", linestyle=dashes, label=label
            )
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("generation", fontsize=8)
        axes.set_ylim(0.0, 1.04)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles[:2], labels[:2], loc="outside upper left", ncols=2, frameon=False, fontsize=9)
    panels[2].legend(frameon=False, fontsize=8, loc="lower right")
    return figure


def main(arguments: list[str] | None = None) -> None:
    """Draw both."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--out", type=Path, default=Path("docs"))
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    for name, source, draw in (
        ("navigation.png", "wheeled_navigation.json", navigation),
        ("displacements.png", "wheeled_static_operon.json", displacements),
    ):
        figure = draw(json.loads((given.results / source).read_text(encoding="utf-8")))
        figure.savefig(given.out / name, dpi=100)
        plt.close(figure)
        print(given.out / name)


if __name__ == "__main__":
    main()
