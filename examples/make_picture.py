"""Draw a stored diagnosis: what the robot did in held-out runs, what its simulators do, and how wrong each is.

python examples/make_picture.py demo/registry --out docs/story.png
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

import dynreg
from dynreg.report.words import number
from dynreg.results import Diagnosis
from dynreg.results.diagnosis import DiagnosisTrace

MEASURED, EXTENDED, NOMINAL, CALIBRATED, SOFT = "#a4a7aa", "#0b63ce", "#d9822b", "#8d6bb0", "#5d6671"
LOOKS = {
    "measured": (MEASURED, 4.0, "-"),
    "nominal": (NOMINAL, 1.4, (0, (4, 3))),
    "extended": (EXTENDED, 1.7, "-"),
}
SHOWN = 3  # traces


def draw(found: Diagnosis, path: Path) -> None:
    """Held-out traces in the upper row, the errors of the simulators below."""
    traces = [trace for trace in found.traces if trace.channel == found.error.channel][:SHOWN]
    figure = plt.figure(figsize=(10, 5.0), layout="constrained")
    upper, lower = figure.subfigures(2, 1, height_ratios=(3.0, 1.5))
    panels = upper.subplots(1, len(traces), squeeze=False, sharey=True)[0]
    for axes, trace in zip(panels, traces, strict=True):
        draw_trace(axes, trace)
    panels[0].set_ylabel(f"{found.error.channel} [{found.error.unit}]", fontsize=10)
    upper.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    draw_errors(lower.subplots(), found)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_trace(axes: Axes, trace: DiagnosisTrace) -> None:
    """One channel in one held-out run."""
    for name, (color, width, dashes) in LOOKS.items():
        values = getattr(trace, name)
        if values is not None:
            numbers = [float("nan") if v is None else v for v in values]
            axes.plot(trace.time, numbers, color=color, linewidth=width, linestyle=dashes, label=name)
    axes.set_title(trace.episode, fontsize=10)
    axes.set_xlabel("time [s]", fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)


def draw_errors(axes: Axes, found: Diagnosis) -> None:
    """The held-out error of each simulator as a bar, with the causes that the last one has."""
    error, causes = found.error, " + ".join(cause.key for cause in found.causes)
    bars = [
        ("nominal", error.nominal, NOMINAL),
        ("best parameters", error.calibrated, CALIBRATED),
        (f"with {causes}" if causes else "extended", error.extended, EXTENDED),
    ]
    bars = [bar for bar in bars if bar[1] is not None]
    for row, (_, value, color) in enumerate(bars):
        axes.barh(row, value, 0.6, color=color)
        axes.text(value, row, f"  {number(value)} {error.unit}", va="center", fontsize=10, color=SOFT)
    axes.set_yticks(range(len(bars)), [name for name, _, _ in bars], fontsize=10)
    axes.set_ylim(len(bars) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.15 * max(value for _, value, _ in bars))
    axes.set_xticks([])
    axes.set_title("mean error on held-out runs", fontsize=10, loc="left")
    axes.spines[["top", "right", "bottom"]].set_visible(False)
    axes.tick_params(length=0)


def main(arguments: list[str] | None = None) -> None:
    """Draw the newest diagnosis of a registry, or that about one recording."""
    parser = argparse.ArgumentParser(description="Draw a stored diagnosis.")
    parser.add_argument("registry", type=Path)
    parser.add_argument("--result", default="@last", help="result or recording, by id or name")
    parser.add_argument("--out", type=Path, default=Path("docs/story.png"))
    given = parser.parse_args(arguments)
    with dynreg.open(given.registry, create=False) as registry:
        draw(registry.result(given.result), given.out)
    print(given.out)


if __name__ == "__main__":
    main()
