"""What the page of a comparison of models draws."""

from typing import Any

from dynreg.report.comparison_tables import DIRECTIONS, chance, ratio
from dynreg.report.plan import Plan, plan
from dynreg.results import Comparison, DrivenPath

STYLES = 8  # of models' lines: beyond them they begin again


def comparison_page(result: Comparison) -> dict[str, Any]:
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
