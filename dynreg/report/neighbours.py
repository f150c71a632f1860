"""The room of a query: its words, its tables and its page."""

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.errors import NoMatchError
from dynreg.report.drawing import Track, estimate_track, traces
from dynreg.report.grid import estimate_table, table
from dynreg.report.words import cost_words, count
from dynreg.results.neighbours import Neighbours
from dynreg.results.result import Gain

SHOWN_NEIGHBOURS = 5
STAGES = {
    "nominal": "nominal",
    "nearest": "nearest",
    "replayed": "replayed and re-ranked",
    "synthesised": "synthesised",
    "answer": "answer",
}


def verdict(result: Neighbours) -> str:
    """The answer in a sentence."""
    name = result.recording_name
    if not result.fits:
        return f"No simulator of this population fits {name}: do not rely on the answer below."
    if result.answer_kind == "nominal":
        return f"For {name} the nominal model stands: no simulator near it did better."
    chosen = f"the {result.answer_kind} simulator {result.answer[:12]}"
    if result.answer_kind == "neighbour":
        names = [n.name for n in result.neighbours if n.entry == result.answer]
        chosen = f"simulator {names[0] if names else result.answer[:12]}"
    gain = f" {gain_words(result.gain)}" if result.gain else ""
    return f"For {name}, use {chosen}.{gain}"


def gain_words(gain: Gain) -> str:
    """A gain against the nominal model, as a sentence; one that may be chance is not called a gain."""
    if gain.low is None or gain.high is None:
        side = "below" if gain.value >= 0 else "above"
        size = f"{100 * abs(gain.value):.0f} %"
        return f"Its replay error is {size} {side} the nominal model's (too few episodes for an interval)."
    interval = f"90 % interval of the gain: {100 * gain.low:.0f} to {100 * gain.high:.0f} %"
    if gain.low <= 0 <= gain.high:
        return f"It does not clearly differ from the nominal model ({interval})."
    side = "below" if gain.low > 0 else "above"
    return f"Its replay error is {100 * abs(gain.value):.0f} % {side} the nominal model's ({interval})."


def next_steps(result: Neighbours) -> tuple[str, ...]:
    """What to do with the result, the first thing first."""
    steps = []
    if not result.fits:
        steps.append(f"Check the log: dynreg doctor LOG --robot {result.robot}")
        steps.append(
            "Widen the parameter ranges in robot.toml, or add what the model leaves out, and populate."
        )
    if not result.parts.get("test"):
        steps.append("Nothing was held out: record more episodes, or name some with --hold-out.")
    if result.fits:
        steps.append(f"Take the simulator along: dynreg export {result.answer[:12]} --to FOLDER")
    return tuple(steps)


def refusal(result: Neighbours) -> NoMatchError | None:
    """The error of a query for which no simulator fits."""
    if result.fits:
        return None
    return NoMatchError(
        f"no simulator fits {result.recording_name!r}: {result.alarm or 'its data lie outside'}",
        expected=f"a recording that population {result.population[:12]} of {result.robot} can explain",
        do="check the log with `dynreg doctor`, or populate with wider ranges",
    )


def tables(result: Neighbours) -> Group:
    """The answer, the nearest simulators, the stages, the synthesised parameters and where it still errs."""
    parts: list[RenderableType] = [Text(verdict(result), style="bold")]
    if result.alarm:
        parts.append(Text(f"alarm: {result.alarm}", style="bold red"))
    parts += [_neighbour_table(result), _stage_table(result)]
    if result.synthesised:
        parts.append(estimate_table(result.synthesised.parameters, "synthesised parameters"))
    if result.channels:
        parts.append(_channel_table(result))
    parts += [Text(f"\n{cost_words(result.cost)}"), *(Text(f"note: {note}") for note in result.notes)]
    parts += [Text(f"- {step}") for step in next_steps(result)]
    return Group(*parts)


def _neighbour_table(result: Neighbours) -> RenderableType:
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


def _stage_table(result: Neighbours) -> RenderableType:
    rows = [
        (STAGES[s.stage], (s.simulator or "-")[:12], s.fit, s.select, s.test, s.simulations)
        for s in result.stages
    ]
    columns = ("stage", "simulator", "fit", "select", "test", "simulations")
    return table(
        columns, rows, "replay error by stage (1 = the size of the motion; test was read once, at the end)"
    )


def _channel_table(result: Neighbours) -> RenderableType:
    rows = [(c.channel, c.nominal, c.answer, c.spread, c.unit) for c in result.channels]
    part = "test part" if result.parts.get("test") else "fit and select parts"
    title = f"where it still errs: mean absolute error on the {part}"
    return table(("channel", "nominal", "answer", "motion (1 sigma)", "unit"), rows, title)


def page(result: Neighbours) -> dict[str, Any]:
    """The template's variables."""
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
        # the nominal line is dashed, so that the answer shows through where they run together
        "charts": traces(result.traces, ("measured", "answer", "nominal")),
        "stages": _stage_bars(result),
        "tracks": _neighbour_tracks(result),
        "channels": _channel_bars(result),
        "names": list(result.nominal.parameters),
        "units": {n: e.unit for n, e in result.synthesised.parameters.items()} if result.synthesised else {},
    }


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
        name: estimate_track(e, [n.parameters[name] for n in result.neighbours if name in n.parameters])
        for name, e in result.synthesised.parameters.items()
    }


def _channel_bars(result: Neighbours) -> list[dict[str, Any]]:
    rows = []
    for c in result.channels:
        largest = max(c.nominal, c.answer) or 1.0
        rows.append({"of": c, "nominal": 100 * c.nominal / largest, "answer": 100 * c.answer / largest})
    return rows
