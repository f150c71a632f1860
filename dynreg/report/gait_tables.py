"""A gait as rich tables."""

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.results import Gait


def gait_tables(result: Gait) -> RenderableType:
    """Its genes, how it walks in every simulator, and what the search cost."""
    genes = [(name, g.value, g.low, g.high, g.unit) for name, g in result.genes.items()]
    trials = [
        (t.simulator[:12], t.kind, "fell" if t.fell else "stood", t.fitness, t.x[-1], t.y[-1])
        for t in result.trials
    ]
    columns = ("simulator", "kind", "", f"fitness [{result.unit}]", "ahead [m]", "left [m]")
    fitness = result.fitness
    return Group(
        Text(str(result), style="bold"),
        table(("gene", "value", "low", "high", "unit"), genes, "sinusoidal joint commands"),
        table(columns, trials, f"{result.seconds:g} s of task {result.task} in each"),
        Text(
            f"\nfitness: min {fitness.min:.3g}, lower quartile {fitness.quantile:.3g}, mean {fitness.mean:.3g}"
            f" {result.unit}; success from {result.success:g}"
        ),
        Text(
            f"search: {result.method}, {result.evaluations} gaits ({result.resumed} from before), ended by"
            f" {result.ended}; {result.cost.rollouts} simulations, {result.cost.seconds:.1f} s"
        ),
        *(Text(f"note: {note}") for note in result.notes),
    )
