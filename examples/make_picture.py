"""Draw a stored query: what the robot did, what its simulators do, and the parameters that were found.

python examples/make_picture.py demo/registry --out docs/query.png
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

import dynreg
from dynreg.results import Estimate, Neighbours, Trace

MEASURED, ANSWER, NOMINAL, SOFT = "#a4a7aa", "#0b63ce", "#d9822b", "#5d6671"
SHOWN = 3  # traces


def draw(found: Neighbours, path: Path) -> None:
    """Traces in the upper row, parameters on their ranges below."""
    traces = found.traces[:SHOWN]
    estimates = found.synthesised.parameters if found.synthesised else {}
    figure = plt.figure(figsize=(10, 3.2 + 0.38 * len(estimates)), layout="constrained")
    upper, lower = figure.subfigures(2, 1, height_ratios=(2.8, 0.6 + 0.36 * len(estimates)))
    for axes, trace in zip(upper.subplots(1, len(traces), squeeze=False)[0], traces, strict=True):
        draw_trace(axes, trace)
    upper.supylabel(f"{traces[0].channel} [{traces[0].unit}]", fontsize=10)
    upper.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    axes = lower.subplots()
    draw_parameters(axes, estimates, found)
    lower.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_trace(axes: Axes, trace: Trace) -> None:
    """One channel in one held-out run."""
    rows = {"measured": trace.measured, "answer": trace.answer, "nominal": trace.nominal}
    looks = {
        "measured": (MEASURED, 3.5, "-"),
        "answer": (ANSWER, 1.6, "-"),
        "nominal": (NOMINAL, 1.3, (0, (4, 3))),
    }
    for name, values in rows.items():
        color, width, dashes = looks[name]
        numbers = [float("nan") if v is None else v for v in values]
        axes.plot(trace.time, numbers, color=color, linewidth=width, linestyle=dashes, label=name)
    axes.set_title(trace.episode, fontsize=10)
    axes.set_xlabel("time [s]", fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)


def draw_parameters(axes: Axes, estimates: dict[str, Estimate], found: Neighbours) -> None:
    """Values with 90 % intervals, neighbours and nominal values, each on its population's range."""
    tick = {"marker": "|", "markersize": 13, "markeredgewidth": 2.5, "linestyle": ""}
    for row, (name, e) in enumerate(estimates.items()):
        low, high = e.limits or (e.low, e.high)
        place = lambda v, low=low, high=high: (v - low) / ((high - low) or 1.0)  # noqa: E731
        once = lambda label, row=row: "" if row else label  # noqa: E731
        axes.barh(row, 1.0, 0.62, color="#eceff2", zorder=0)
        interval = place(e.high) - place(e.low)
        axes.barh(row, interval, 0.4, place(e.low), color=ANSWER, alpha=0.3, label=once("90 % interval"))
        dots = [place(n.parameters[name]) for n in found.neighbours]
        axes.plot(dots, [row] * len(dots), ".", color=SOFT, markersize=6, label=once("neighbours"))
        axes.plot(place(e.nominal), row, color=NOMINAL, label=once("nominal"), **tick)
        axes.plot(place(e.value), row, color=ANSWER, label=once("found"), **tick)
        axes.text(-0.01, row, f"{low:g}", ha="right", va="center", fontsize=8, color=SOFT)
        axes.text(1.01, row, f"{high:g}", va="center", fontsize=8, color=SOFT)
        axes.text(1.09, row, f"{e.value:.3g} {e.unit}", va="center", fontsize=9)
    axes.set_yticks(range(len(estimates)), list(estimates), fontsize=9)
    axes.set_xticks([])
    axes.set_xlim(-0.08, 1.3)
    axes.set_ylim(len(estimates) - 0.5, -0.5)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)


def main(arguments: list[str] | None = None) -> None:
    """Draw the newest query of a registry, or that about one recording."""
    parser = argparse.ArgumentParser(description="Draw a stored query.")
    parser.add_argument("registry", type=Path)
    parser.add_argument("--result", default="@last", help="result or recording, by id or name")
    parser.add_argument("--out", type=Path, default=Path("docs/query.png"))
    given = parser.parse_args(arguments)
    with dynreg.open(given.registry, create=False) as registry:
        draw(registry.result(given.result), given.out)
    print(given.out)


if __name__ == "__main__":
    main()
