"""Results as rich tables, at most 100 columns wide."""

from collections.abc import Callable
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg import results
from dynreg.report.comparison_tables import comparison_tables
from dynreg.report.diagnosis_tables import diagnosis_tables
from dynreg.report.drift_tables import drift_tables
from dynreg.report.gait_tables import gait_tables
from dynreg.report.grid import KEPT_WHOLE, table
from dynreg.report.library_tables import effects_table, experiment_table
from dynreg.report.trial_tables import trial_table, trials_table
from dynreg.report.words import STAGES, count, interval, next_steps, number, verdict
from dynreg.results import Result

SHOWN_NEIGHBOURS = 5


def render(result: Result) -> RenderableType:
    """The tables of a result."""
    return _RENDERERS.get(type(result), _plain)(result)


def _neighbours(result: results.Neighbours) -> Group:
    parts: list[RenderableType] = [Text(verdict(result), style="bold")]
    if result.alarm:
        parts.append(Text(f"alarm: {result.alarm}", style="bold red"))
    parts += [_neighbour_table(result), _stage_table(result)]
    if result.synthesised:
        parts.append(_estimate_table(result.synthesised.parameters, "synthesised parameters"))
    if result.channels:
        parts.append(_channel_table(result))
    parts += [Text(f"\n{_cost(result.cost)}"), *(Text(f"note: {note}") for note in result.notes)]
    parts += [Text(f"- {step}") for step in next_steps(result)]
    return Group(*parts)


def _neighbour_table(result: results.Neighbours) -> RenderableType:
    """Neighbours stand side by side, so that any number of parameters stays within the width."""
    shown = result.neighbours[:SHOWN_NEIGHBOURS]
    more = len(result.neighbours) - len(shown)
    units = {n: e.unit for n, e in result.synthesised.parameters.items()} if result.synthesised else {}
    nominal = result.nominal.parameters
    rows = [
        ("distance", "", None, *(n.distance for n in shown)),
        ("replay error", "", result.nominal.replay_error, *(n.replay_error for n in shown)),
        *((p, units.get(p, ""), nominal[p], *(n.parameters.get(p) for n in shown)) for p in nominal),
    ]
    title = f"{count(len(result.neighbours), 'neighbour')} in {result.robot} by {result.distance}"
    title += f", the first {len(shown)}" if more else ""
    return table(("", "unit", "nominal", *(f"#{n.index}" for n in shown)), rows, title)


def _stage_table(result: results.Neighbours) -> RenderableType:
    rows = [
        (STAGES[s.stage], (s.simulator or "-")[:12], s.fit, s.select, s.test, s.simulations)
        for s in result.stages
    ]
    columns = ("stage", "simulator", "fit", "select", "test", "simulations")
    return table(
        columns, rows, "replay error by stage (1 = the size of the motion; test was read once, at the end)"
    )


def _estimate_table(parameters: dict[str, results.Estimate], title: str) -> RenderableType:
    rows = [(name, e.nominal, interval(e), e.unit) for name, e in parameters.items()]
    return table(("parameter", "nominal", "value [90 % interval]", "unit"), rows, title)


def _channel_table(result: results.Neighbours) -> RenderableType:
    rows = [(c.channel, c.nominal, c.answer, c.spread, c.unit) for c in result.channels]
    part = "test part" if result.parts.get("test") else "fit and select parts"
    title = f"where it still errs: mean absolute error on the {part}"
    return table(("channel", "nominal", "answer", "motion (1 sigma)", "unit"), rows, title)


def _calibration(result: results.Calibration) -> Group:
    errors = [
        ("nominal", result.nominal_train_error, result.nominal_test_error),
        (result.method, result.train_error, result.test_error),
    ]
    return Group(
        Text(verdict(result), style="bold"),
        _estimate_table(result.parameters, "parameters"),
        table(("", "train", "test"), errors, "replay error (1 = the size of the motion)"),
        Text(f"\n{_cost(result.cost)}"),
        *(Text(f"- {step}") for step in next_steps(result)),
    )


def _population(result: results.PopulationSummary) -> Group:
    text = (
        f"population {result.population[:12]} of {result.robot}: {result.entries} of {result.planned}"
        f" simulators, {result.added} added in {result.seconds:.1f} s"
    )
    spent = [
        ("simulate", result.simulate_seconds),
        ("train", result.train_seconds),
        ("link", result.link_seconds),
    ]
    return Group(Text(text, style="bold"), table(("step", "time [s]"), spent))


def _recording(result: results.RecordingSummary) -> Group:
    kind = "measured" if result.measured else "simulated"
    rate = "uneven times" if result.rate is None else f"{number(result.rate)} Hz"
    text = (
        f"{result.name} ({result.recording[:12]}): {kind} recording of {result.robot},"
        f" {count(result.episodes, 'episode')}, {result.rows_count} rows, {result.duration:.1f} s, {rate}"
    )
    lines = [f"channels: {', '.join(result.channels)}"]
    lines += [f"settings: {', '.join(result.settings)}"] if result.settings else []
    return Group(Text(text, style="bold"), *map(Text, lines), *(Text(f"- {f}") for f in result.findings))


def _listing(result: results.Listing) -> RenderableType:
    if not result.items:
        return Text(f"{result.registry}: nothing yet")
    rows = [(i.id[:12], i.kind, i.name or "-", i.robot, _short(i.detail)) for i in result.items]
    return table(("id", "kind", "name", "robot", "detail"), rows, result.registry)


def _entry(result: results.EntrySummary) -> RenderableType:
    head = {"id": result.id, "kind": result.kind, "name": result.name, "robot": result.robot}
    told = {"schema", "robot_name", result.kind, *head}  # a detail may say again what the head says
    rows = [(key, value) for key, value in head.items() if value]
    for key, value in result.detail.items():
        if key in told or value in (None, "", [], {}):
            continue
        if isinstance(value, dict):
            rows.append((key, ""))
            rows += [(f"  {name}", _value(part)) for name, part in value.items()]
        else:
            rows.append((key, _value(value)))
    return table(("", ""), rows)


def _verification(result: results.Verification) -> Group:
    counts = ", ".join(f"{what} {how_many}" for what, how_many in result.checked.items())
    state = "sound" if result.clean else count(len(result.faults), "fault")
    lines = [f"- {fault}" for fault in result.faults] + [f"mended: {done}" for done in result.repaired]
    lines += [f"lost: {what}" for what in result.lost]
    return Group(Text(f"{result.registry}: {state} ({counts})", style="bold"), *map(Text, lines))


def _plain(result: Result) -> RenderableType:
    return table(("", ""), [(key, _value(value)) for key, value in result.to_dict().items()])


def _cost(cost: results.Cost) -> str:
    return f"cost: {cost.evaluations} distance evaluations, {cost.rollouts} simulations, {cost.seconds:.1f} s"


def _short(detail: dict[str, Any]) -> str:
    return ", ".join(f"{k} {_value(v)}" for k, v in detail.items() if not isinstance(v, dict | list | tuple))


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{k} {_value(v)}" for k, v in value.items())
    if isinstance(value, list | tuple):
        texts = [_value(v) for v in value]
        return ("\n" if any(len(text) > KEPT_WHOLE for text in texts) else ", ").join(texts)
    return number(value) if isinstance(value, float) else str(value)


_RENDERERS: dict[type[Result], Callable[[Any], RenderableType]] = {
    results.Neighbours: _neighbours,
    results.Calibration: _calibration,
    results.PopulationSummary: _population,
    results.RecordingSummary: _recording,
    results.Listing: _listing,
    results.EntrySummary: _entry,
    results.Verification: _verification,
    results.Diagnosis: diagnosis_tables,
    results.EffectsList: effects_table,
    results.Experiment: experiment_table,
    results.TrialResult: trial_table,
    results.TrialTable: trials_table,
    results.Gait: gait_tables,
    results.Drift: drift_tables,
    results.Comparison: comparison_tables,
}
