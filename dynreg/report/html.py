"""One self-contained HTML page of a result: no script, no font, no file besides it."""

from collections.abc import Callable
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from dynreg.errors import UsageError
from dynreg.report.comparison_page import comparison_page
from dynreg.report.diagnosis_page import diagnosis_page
from dynreg.report.drawing import Chart, Track, chart, track
from dynreg.report.drift_page import drift_page
from dynreg.report.gait_page import gait_page
from dynreg.report.trials_page import trials_page
from dynreg.report.words import STAGES, count, next_steps, number, verdict
from dynreg.results import (
    Calibration,
    Comparison,
    Diagnosis,
    Drift,
    Estimate,
    Gait,
    Neighbours,
    Result,
    TrialTable,
)


def write_report(result: Result, path: str | Path) -> Path:
    """Write the page of `result` to `path`; the same result gives the same bytes.

    Raises UsageError where the result has no page or the file cannot be written.
    """
    path = Path(path)
    text = page(result)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(
            f"cannot write {str(path)!r}: {error.strerror}",
            expected="a file name in an existing folder that may be written",
            do="name another file",
        ) from error
    return path


def page(result: Result) -> str:
    """The page's HTML."""
    if type(result) not in _PAGES:
        raise UsageError(
            f"a {type(result).__name__} has no report",
            expected="a stored query or calibration, a diagnosis, trials, a gait, a comparison or a drift",
            do="see `dynreg list --kind result`",
        )
    template, variables = _PAGES[type(result)]
    return _environment().get_template(template).render(**variables(result))


@cache
def _environment():
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    folder = Path(str(resources.files("dynreg.report") / "templates"))
    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "count": count}
    return environment


def _neighbours(result: Neighbours) -> dict[str, Any]:
    by_name = {s.stage: s for s in result.stages}
    answer = by_name.get("answer")
    known = [name for name in ("test", "select", "fit") if getattr(answer, name, None) is not None]
    shown = known[0] if known else "test"
    part = "test part" if shown == "test" else "fit and select parts"
    return {
        "result": result,
        "title": f"{result.recording_name} · {result.robot}",
        "verdict": verdict(result),
        "steps": next_steps(result),
        "part": part,
        "shown": shown,
        "error_before": getattr(by_name.get("nominal"), shown, None),
        "error_after": getattr(answer, shown, None),
        "charts": _trace_charts(result),
        "stages": _stage_bars(result),
        "tracks": _neighbour_tracks(result),
        "channels": _channel_bars(result),
        "names": list(result.nominal.parameters),
        "units": {n: e.unit for n, e in result.synthesised.parameters.items()} if result.synthesised else {},
    }


def _calibration(result: Calibration) -> dict[str, Any]:
    steps = [step.simulations for step in result.history]
    errors = {"answer": [step.error for step in result.history]}
    return {
        "result": result,
        "title": f"{result.recording[:12]} · {result.robot}",
        "verdict": verdict(result),
        "steps": next_steps(result),
        "chart": chart("best replay error so far", "simulations", steps, errors),
        "tracks": {name: _track(e, ()) for name, e in result.parameters.items()},
    }


def _trace_charts(result: Neighbours) -> list[Chart]:
    drawn = (
        chart(
            f"{t.channel} [{t.unit}], episode {t.episode}",
            "time [s]",
            t.time,
            # the last one on top: dashed, so that the answer shows through where they run together
            {"measured": t.measured, "answer": t.answer, "nominal": t.nominal},
        )
        for t in result.traces
    )
    return [c for c in drawn if c is not None]


def _stage_bars(result: Neighbours) -> list[dict[str, Any]]:
    """Stages with (part, error, percent of the largest error)."""
    largest = max((e for s in result.stages for e in (s.fit, s.select, s.test) if e is not None), default=1.0)
    return [
        {
            "name": STAGES[s.stage],
            "simulator": s.simulator,
            "simulations": s.simulations,
            "bars": [
                (part, error, 100 * error / (largest or 1.0))
                for part, error in (("fit", s.fit), ("select", s.select), ("test", s.test))
                if error is not None
            ],
        }
        for s in result.stages
    ]


def _neighbour_tracks(result: Neighbours) -> dict[str, Track]:
    if result.synthesised is None:
        return {}
    return {
        name: _track(e, [n.parameters[name] for n in result.neighbours if name in n.parameters])
        for name, e in result.synthesised.parameters.items()
    }


def _channel_bars(result: Neighbours) -> list[dict[str, Any]]:
    rows = []
    for c in result.channels:
        largest = max(c.nominal, c.answer) or 1.0
        rows.append({"of": c, "nominal": 100 * c.nominal / largest, "answer": 100 * c.answer / largest})
    return rows


def _track(e: Estimate, others: list[float] | tuple[float, ...]) -> Track:
    return track(e.value, e.low, e.high, e.nominal, others, e.limits)


_PAGES: dict[type[Result], tuple[str, Callable[[Any], dict[str, Any]]]] = {
    Neighbours: ("neighbours.html", _neighbours),
    Calibration: ("calibration.html", _calibration),
    Diagnosis: ("diagnosis.html", diagnosis_page),
    TrialTable: ("trials.html", trials_page),
    Gait: ("gait.html", gait_page),
    Drift: ("drift.html", drift_page),
    Comparison: ("comparison.html", comparison_page),
}
