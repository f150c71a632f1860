"""The room of a query: its words, its tables and its page."""

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.errors import NoMatchError, command
from dynreg.replay.parts import CUT
from dynreg.report.drawing import Track, estimate_track, traces
from dynreg.report.grid import estimate_table, table
from dynreg.report.words import (
    NOT_SCORED,
    channel_words,
    cost_words,
    count,
    held_out_words,
    interval_words,
    number,
    to_hold_out,
)
from dynreg.results.neighbours import Neighbours
from dynreg.results.result import change
from dynreg.results.sentence import change_interval, gain_words

SHOWN_NEIGHBOURS = 5
STAGES = {
    "nominal": "nominal",
    "nearest": "nearest",
    "replayed": "replayed and re-ranked",
    "synthesised": "synthesised",
    "answer": "answer",
}


def verdict(result: Neighbours) -> str:
    """The answer in one short sentence."""
    name = result.recording_name
    if result.untested:
        return f"For {name}, {_answer(result)} is the nearest: not known whether it is close."
    if result.far:
        return f"No simulator that was replayed is close to {name}: do not rely on the best one."
    if result.fits is False:
        return f"No simulator of this population fits {name}: do not rely on the best one."
    if result.unended:
        return f"For {name}, the search had not ended: do not rely on the best simulator yet."
    if result.answer_kind == "nominal":
        return f"For {name}, use the nominal model: no simulator near it did better."
    if result.unclear:
        return f"For {name}, no simulator here is clearly better than nominal."
    if result.unknown:
        better = f"not known whether it is better than nominal: {result.unknown}"
        return f"For {name}, {_answer(result)} is the best, {better}."
    return f"For {name}, use {_answer(result)}."


def _answer(result: Neighbours) -> str:
    """The simulator that the query found, in words."""
    if result.answer_kind == "neighbour":
        names = [n.name for n in result.neighbours if n.entry == result.answer]
        return f"simulator {names[0] if names else result.answer[:12]}"
    return f"the {result.answer_kind} simulator {result.answer[:12]}"


def comparison(result: Neighbours) -> str:
    """The answer's error on held-out data against the nominal model's; "" where there is nothing to compare."""
    if result.gain is None or result.answer_kind == "nominal":
        return ""
    error = f"error on held-out data is {gain_words(result.gain, 'nominal')}"
    if result.fits is False:
        return f"The best is {_answer(result)}: its {error}. It is still too large for a fit."
    said = result.unclear or result.unended
    return f"The best is {_answer(result)}: its {error}." if said else f"Its {error}."


def next_steps(result: Neighbours) -> tuple[str, ...]:
    """What to do next, the most important step first."""
    steps = []
    diagnose = command("diagnose", result.recording_name)
    if result.far:
        steps.append(f"Search for a simulator that fits: {command('query', result.recording_name)}")
    if result.fits is False:
        steps.append(f"Ask what the model lacks: {diagnose}")
        steps.append(f"Check the log: dynreg doctor LOG --robot {result.robot}")
        steps.append(
            "Where a parameter is at the edge of its range, widen the range in robot.toml and populate again."
        )
    if result.unended:
        steps.append("Search on: ask again with twice the --budget.")
    if not result.parts.get("test"):
        steps.append(to_hold_out(result.parts, CUT))
    if result.fits is not False and (result.unclear or result.unended):
        steps.append(f"Ask what all of them lack: {diagnose}")
    elif result.untested:
        steps.append(f"See whether it is close: {command('query', result.recording_name)}")
    elif result.fits is not False:
        export = command("export", result.answer[:12], "--as", "robot", "--to", "FOLDER")
        steps.append(f"Export the simulator as a robot folder: {export}")
        steps.append(f"Ask what it lacks: {diagnose}")
    return tuple(steps)


def refusal(result: Neighbours) -> NoMatchError | None:
    """The error of a query that no simulator fits; None otherwise."""
    if result.fits is not False:
        return None
    diagnose = command("diagnose", result.recording_name)
    if result.far:
        return NoMatchError(
            f"no simulator that was replayed is close to {result.recording_name!r}{_misfit(result)}",
            expected="one that errs as a right one would",
            do=f"search for it with `{command('query', result.recording_name)}`, or populate more simulators",
        )
    return NoMatchError(
        f"no simulator fits {result.recording_name!r}{_misfit(result)}",
        expected=f"a recording that population {result.population[:12]} of {result.robot} can explain",
        do=f"ask what the model lacks (`{diagnose}`), or check the log (`dynreg doctor LOG --robot {result.robot}`)",
    )


def _misfit(result: Neighbours) -> str:
    """How much the answer errs, in a few words: the table tells the alarm."""
    if result.misfit is None:
        return ""
    return f": the answer errs {number(result.misfit)} times as much as a right one would"


def tables(result: Neighbours) -> Group:
    """The answer, the nearest simulators, the error by stage, the synthesised parameters, the error by channel."""
    parts: list[RenderableType] = [Text(verdict(result), style="bold")]
    if comparison(result):
        parts.append(Text(comparison(result)))
    if result.alarm:
        parts.append(Text(f"alarm: {result.alarm}", style="bold red"))
    parts += [_neighbour_table(result), _stage_table(result)]
    if result.synthesised:
        title = "parameters of the synthesised simulator"
        parts.append(estimate_table(result.synthesised.parameters, title, reliable=result.reliable))
        parts += [] if result.reliable else [Text(result.reliance)]
    if result.channels:
        parts.append(_channel_table(result))
    held_out = held_out_words(result.parts)
    parts += [Text(f"\n{held_out}")] if held_out else []
    parts += [
        Text(f"\n{cost_words(result.cost, result.simulators)}"),
        *(Text(f"note: {note}") for note in result.notes),
    ]
    parts += [Text(f"- {step}") for step in next_steps(result)]
    return Group(*parts)


def neighbour_words(result: Neighbours) -> str:
    """What the simulators of the table are: the nearest ones, or those of the nearest that replay best."""
    k, by = len(result.neighbours), f"by the distance {result.distance}"
    if any(s.stage == "replayed" for s in result.stages):
        return f"best {k} by replay error, of the nearest {by}"
    return f"{count(k, 'nearest neighbour')} {by}"


def _neighbour_table(result: Neighbours) -> RenderableType:
    """One column for each neighbour, so that any number of parameters fits the width."""
    shown = result.neighbours[:SHOWN_NEIGHBOURS]
    more = len(result.neighbours) - len(shown)
    units = {n: e.unit for n, e in result.synthesised.parameters.items()} if result.synthesised else {}
    nominal = result.nominal.parameters
    rows = [
        ("distance", "", None, *(n.distance for n in shown)),
        ("replay error", "", result.nominal.replay_error, *(n.replay_error for n in shown)),
        *((p, units.get(p, ""), nominal[p], *(n.parameters.get(p) for n in shown)) for p in nominal),
    ]
    title = neighbour_words(result) + (f" (the first {len(shown)} shown)" if more else "")
    return table(("", "unit", "nominal", *(f"#{n.index}" for n in shown)), rows, title)


def _stage_table(result: Neighbours) -> RenderableType:
    rows = [
        (STAGES[s.stage], (s.simulator or "-")[:12], s.fit, s.select, s.test, s.simulations)
        for s in result.stages
    ]
    columns = ("stage", "simulator", "fit", "select", "test", "simulations")
    return table(
        columns, rows, "replay error by stage (1: as large as the motion; test: read once, at the end)"
    )


def _channel_table(result: Neighbours) -> RenderableType:
    rows = [
        (channel_words(c.channel, c.scored), c.nominal, c.answer, c.spread, c.unit) for c in result.channels
    ]
    part = "test part" if result.parts.get("test") else "fit and select parts"
    title = f"mean absolute error by channel on the {part}"
    found = table(("channel", "nominal", "answer", "motion (1 sigma)", "unit"), rows, title)
    return found if all(c.scored for c in result.channels) else Group(found, Text(NOT_SCORED))


def page(result: Neighbours) -> dict[str, Any]:
    """The template's variables."""
    by_name, gain = {s.stage: s for s in result.stages}, result.gain
    answer = by_name.get("answer")
    known = [name for name in ("test", "select", "fit") if getattr(answer, name, None) is not None]
    shown = known[0] if known else "test"
    part = "test part" if shown == "test" else "fit and select parts"
    return {
        "result": result,
        "near": neighbour_words(result),
        "title": f"{result.recording_name} · {result.robot}",
        "verdict": verdict(result),
        "comparison": comparison(result),
        "change": change(gain.value) if gain else "",
        "change_interval": change_interval(gain.low, gain.high) if gain and gain.low is not None else "",
        "steps": next_steps(result),
        "part": part,
        "shown": shown,
        "error_before": getattr(by_name.get("nominal"), shown, None),
        "error_after": getattr(answer, shown, None),
        # the nominal line is dashed, so that the answer's line shows where the two coincide
        "charts": traces(result.traces, ("measured", "answer", "nominal")),
        "stages": _stage_bars(result),
        "tracks": _neighbour_tracks(result),
        "channels": _channel_bars(result),
        "not_scored": "" if all(c.scored for c in result.channels) else NOT_SCORED,
        "interval_name": interval_words(result.reliable),
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
        name = channel_words(c.channel, c.scored)
        rows.append(
            {"of": c, "name": name, "nominal": 100 * c.nominal / largest, "answer": 100 * c.answer / largest}
        )
    return rows
