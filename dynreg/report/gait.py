"""The room of a gait: its tables and its page."""

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.data.units import suffix
from dynreg.gait.play import commands
from dynreg.report.drawing import Chart, chart
from dynreg.report.grid import table
from dynreg.results.gait import Gait

SHOWN = 3.0  # s of the feet on the ground
PERIODS = 2  # of the joints' traces, after the ramp


def tables(result: Gait) -> RenderableType:
    """The genes, the run in every simulator, and the cost of the search."""
    genes = [(name, g.value, g.low, g.high, g.unit) for name, g in result.genes.items()]
    trials = [
        (t.simulator[:12], t.kind, "fell" if t.fell else "stood", t.fitness, t.x[-1], t.y[-1])
        for t in result.trials
    ]
    columns = ("simulator", "kind", "", f"fitness [{result.unit}]", "ahead [m]", "left [m]")
    fitness = result.fitness
    return Group(
        Text(result.headline, style="bold"),
        *([Text(result.prediction)] if result.prediction else []),
        table(("gene", "value", "low", "high", "unit"), genes, f"joint commands of kind {result.kind}"),
        table(columns, trials, f"task {result.task}, {result.seconds:g} s in each simulator"),
        Text(
            f"\nfitness: min {fitness.min:.3g}, lower quartile {fitness.quantile:.3g}, mean {fitness.mean:.3g}"
            f"{suffix(result.unit)} (goal: {result.success:g} in every simulator)"
        ),
        Text(
            f"search: {result.method}, {result.evaluations} gaits ({result.resumed} of them resumed), ended by"
            f" {result.ended}; {result.cost.rollouts} simulations, {result.cost.seconds:.1f} s"
        ),
        *(Text(f"note: {note}") for note in result.notes),
    )


def page(result: Gait) -> dict[str, Any]:
    """The template's variables."""
    tried, best = best_so_far(result)
    rising = chart(f"best value so far [{result.unit}]", "gaits tried", tried, {"answer": best})
    return {
        "result": result,
        "title": f"{result.recording_name or result.method} · gait of {result.robot}",
        "verdict": result.headline,
        "search": rising,
        "ways": [c for c in map(_way, result.trials) if c is not None],
        "joints": _traces(result),
        "steps": _steps(result),
        "shown": SHOWN,
    }


def best_so_far(result: Gait) -> tuple[list[int], list[float]]:
    """The number of gaits tried and the best value so far, as a step function from the first gait on."""
    tried, best = [], []
    for step in result.history:
        tried += [step.evaluations] * (2 if best else 1)
        best += [*best[-1:], step.value]
    return [*tried, result.evaluations], [*best, *best[-1:]]


def _way(trial: Any) -> Chart | None:
    end = ", fell" if trial.fell else ""
    title = f"{trial.kind} {trial.simulator[:12]}: {trial.fitness:.3g}{end}; metres to the left"
    if len({*trial.x}) < 2:
        return None
    return chart(title, "metres ahead", trial.x, {"answer": trial.y})


def _traces(result: Gait) -> list[Chart]:
    """The commands of every joint over two periods, after the ramp; all of a motion that is made once."""
    times, angles = commands(result)
    shown = PERIODS * result.table.period if result.table.period else result.table.times[-1]
    at = (times >= result.ramp) & (times <= result.ramp + shown)
    drawn = (
        chart(f"{joint.action} [rad]", "time [s]", times[at].tolist(), {"answer": angles[at, i].tolist()})
        for i, joint in enumerate(result.joints)
    )
    return [c for c in drawn if c is not None]


def _steps(result: Gait) -> list[tuple[str, list[tuple[float, float]]]]:
    """(foot, [(begin, length) of contacts in percent of the time shown]) in the first simulator without a fall."""
    stood = [t for t in result.trials if not t.fell]
    if not stood:
        return []
    begin = max(0.0, min(result.ramp, result.seconds - SHOWN))
    out = []
    for foot, spans in stood[0].contacts.items():
        cut = [(max(a, begin), min(b, begin + SHOWN)) for a, b in spans]
        out.append((foot, [(100 * (a - begin) / SHOWN, 100 * (b - a) / SHOWN) for a, b in cut if b > a]))
    return out
