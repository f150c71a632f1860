"""The room of a comparison of models: its words, its tables and its page."""

from collections.abc import Iterator
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.report.plan import Plan, plan
from dynreg.report.words import count
from dynreg.results.comparison import Comparison, DrivenPath, Spread

DIRECTIONS = {"dx": "to the side", "dy": "ahead", "dtheta": "turned"}
STYLES = 8  # of models' lines on the page: beyond them they begin again


def tables(result: Comparison) -> RenderableType:
    """Errors by axis, which of them differ, ends of paths and times."""
    parts = result.parts
    return Group(
        Text(str(result), style="bold"),
        *_error_tables(result),
        _pair_table(result),
        *_path_table(result),
        _pace_table(result),
        Text(
            f"\nmodels made from {parts['fit']} commands and {parts['validation']} to validate, judged on"
            f" {parts['test']}; {result.cost.seconds:.1f} s"
        ),
        *(Text(f"note: {note}") for note in result.notes),
    )


def chance(p: float) -> str:
    """A p-value.

    >>> chance(0.0421), chance(1e-9)
    ('0.042', '< 0.001')
    """
    return "< 0.001" if p < 0.001 else f"{p:.2g}"


def ratio(f: float | None) -> str:
    """A ratio of variances.

    >>> ratio(4.2613), ratio(None)
    ('4.26', 'infinite')
    """
    return "infinite" if f is None else f"{f:.3g}"


def _error_tables(result: Comparison) -> Iterator[RenderableType]:
    errors = result.errors
    for whole in errors.variance:
        axis = whole.axis
        rows = [(name, *_cells(errors.models[name][axis])) for name in result.names]
        unit = errors.models[result.best][axis].unit
        title = (
            f"{DIRECTIONS[axis]} ({axis}): absolute error [{unit}], of {errors.displacements[axis]:.3g} on average;"
            f" analysis of variance: F({whole.between}, {whole.within}) = {ratio(whole.f)}, p {_p(whole.p)}"
        )
        yield table(("model", "mean", "min", "max", "SD"), rows, title)


def _p(p: float) -> str:
    return chance(p) if p < 0.001 else f"= {chance(p)}"


def _cells(spread: Spread) -> tuple[float, float, float, float]:
    return spread.mean, spread.min, spread.max, spread.sd


def _pair_table(result: Comparison) -> RenderableType:
    rows = [
        (
            pair.axis,
            f"{pair.first} - {pair.second}",
            pair.difference,
            f"{pair.low:.3g} to {pair.high:.3g} {pair.unit}",
            chance(pair.tukey),
            chance(pair.paired),
        )
        for pair in result.errors.pairs
    ]
    columns = ("axis", "models", "difference", "95 % interval (Tukey)", "p Tukey", "p Wilcoxon, Holm")
    return table(columns, rows, "which errors differ: unpaired as published, and paired by command")


def _path_table(result: Comparison) -> Iterator[RenderableType]:
    if result.paths is None:
        return
    rows = [(name, *_cells(result.paths.models[name])) for name in result.names]
    title = (
        f"{count(result.paths.runs, 'run')} of {result.paths.commands} commands in a row:"
        f" how far off the end is [cm]"
    )
    yield table(("model", "mean", "min", "max", "SD"), rows, title)


def _pace_table(result: Comparison) -> RenderableType:
    rows = [
        (p.model, p.one_by_one, p.one_by_one_ratio, p.at_once, p.at_once_ratio, p.fit) for p in result.paces
    ]
    columns = (
        "model",
        "one by one [us]",
        "to closed form",
        "all at once [us]",
        "to closed form",
        "made in [s]",
    )
    return table(columns, rows, "time for a command")


def page(result: Comparison) -> dict[str, Any]:
    """The template's variables."""
    styles = {name: f"model-{i % STYLES}" for i, name in enumerate(result.names)}
    return {
        "result": result,
        "title": f"{result.recording_name} · models of {result.robot}",
        "verdict": str(result),
        "directions": DIRECTIONS,
        "styles": styles,
        "bars": _bars(result),
        "ends": _ends(result),
        "plans": [p for p in (_plan(path, styles) for path in result.driven) if p is not None],
        "chance": chance,
        "ratio": ratio,
    }


def _bars(result: Comparison) -> list[dict[str, Any]]:
    """For each axis the models' mean errors, in percent of the largest."""
    errors = result.errors
    out = []
    for whole in errors.variance:
        found = {name: errors.models[name][whole.axis] for name in result.names}
        largest = max(s.mean for s in found.values()) or 1.0
        unit = next(iter(found.values())).unit
        rows = [(name, s, 100 * s.mean / largest) for name, s in found.items()]
        out.append({"axis": whole.axis, "unit": unit, "whole": whole, "rows": rows})
    return out


def _ends(result: Comparison) -> list[tuple[str, Any, float]]:
    """(model, error at the end of paths, percent of the largest mean)."""
    if result.paths is None:
        return []
    found = {name: result.paths.models[name] for name in result.names}
    largest = max(s.mean for s in found.values()) or 1.0
    return [(name, s, 100 * s.mean / largest) for name, s in found.items()]


def _plan(path: DrivenPath, styles: dict[str, str]) -> Plan | None:
    title = f"episode {path.episode}, from {path.begin:.1f} s, {path.seconds:.1f} s long"
    ways = [("measured", path.measured), *((style, path.models[name]) for name, style in styles.items())]
    return plan(title, [(style, (way.x, way.y)) for style, way in ways])
