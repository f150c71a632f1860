"""The room of a comparison: its words, its tables and its page."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.drawing import Chart, Tick, chart
from dynreg.report.grid import table
from dynreg.report.plan import Plan, plan
from dynreg.report.words import NOT_SCORED, channel_words, count, number
from dynreg.results.comparison import Commands, Comparison, DrivenPath, Spread
from dynreg.results.rollouts import Rollouts, Score

DIRECTIONS = {"dx": "to the side", "dy": "ahead", "dtheta": "turned"}
STYLES = 8  # of lines on the page: beyond them they begin again
SHOWN_CHANNELS = 12


def tables(result: Comparison) -> RenderableType:
    """Held-out errors by channel and horizon; of a wheeled robot errors by axis, ends of paths and times."""
    return Group(
        Text(str(result), style="bold"),
        *(_rollout_tables(result.rollouts) if result.rollouts else ()),
        *(_command_tables(result.commands) if result.commands else ()),
        *(Text(f"note: {note}") for note in result.notes),
        Text(f"\n{result.cost.seconds:.1f} s"),
    )


# ---- rollouts ----


def _rollout_tables(of: Rollouts) -> Iterator[RenderableType]:
    longest = of.horizons[-1].seconds
    rows = [(name, *(score_cell(s) for s in _scores(of, name, None))) for name in of.names]
    columns = ("simulator", *(f"{h.seconds:.3g} s" for h in of.horizons))
    less = f"% less than {of.names[0]} [90 % interval]"
    yield table(
        columns, rows, f"held-out error by length of the rollouts, scored channels, in spreads ({less})"
    )
    rows = [
        (
            channel_words(channel, channel not in of.unscored),
            of.unit(channel),
            *(_cell(of, name, channel) for name in of.names),
        )
        for channel in of.channels[:SHOWN_CHANNELS]
    ]
    columns = ("channel", "unit", *of.names)
    yield table(columns, rows, f"held-out error by channel, rollouts of {longest:.3g} s")
    more = len(of.channels) - len(rows)
    yield Text(f"{count(more, 'more channel')}" if more else "")
    yield from [Text(NOT_SCORED)] if of.unscored else []
    yield Text(tested_words(of))


def _cell(of: Rollouts, name: str, channel: str) -> str:
    return score_cell(of.score(name, channel, of.horizons[-1].seconds))


def tested_words(of: Rollouts) -> str:
    """What the errors are of, and what was left out."""
    lengths = ", ".join(f"{h.rollouts} of {h.seconds:.3g} s" for h in of.horizons)
    out = f"rollouts: {lengths}, cut from {_some(of.episodes)}"
    if of.within is not None:
        runs = (
            "that one run, and hold for it"
            if of.within == 1
            else f"those {of.within} runs, and hold for them"
        )
        out += f"; intervals are over stretches of time within {runs} alone"
    return f"{out}; left out, as a simulator was fitted to it: {_some(of.left_out)}" if of.left_out else out


def score_cell(score: Score | None) -> str:
    """An error, and how much less than the first simulator's it is."""
    return "-" if score is None else f"{number(score.error)}{less_cell(score)}"


def less_cell(score: Score) -> str:
    """How much less than the first simulator's an error is, "" of that one's own.

    >>> from dynreg.results.result import Gain
    >>> how = {"simulator": "b", "channel": None, "seconds": 1.0, "error": 1.0, "low": 0.9, "high": 1.1, "unit": "rad"}
    >>> less_cell(Score(**how, gain=Gain(value=0.3, low=0.25, high=0.35), tie=False)), less_cell(Score(**how, tie=True))
    (' (30 % [25, 35])', ' (tie)')
    >>> less_cell(Score(**how, gain=Gain(value=-0.2, low=-0.3, high=-0.1), tie=False))
    ' (20 % more [10, 30])'
    """
    if score.tie:
        return " (tie)"
    if score.gain is None:
        return ""
    sign, more = (-1, " more") if score.gain.value < 0 else (1, "")
    bounds = (score.gain.low, score.gain.high)[::sign]
    interval = "" if None in bounds else f" [{sign * 100 * bounds[0]:.0f}, {sign * 100 * bounds[1]:.0f}]"
    return f" ({sign * 100 * score.gain.value:.0f} %{more}{interval})"


def _some(names: tuple[str, ...], most: int = 6) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _scores(of: Rollouts, name: str, channel: str | None) -> list[Score | None]:
    """At every horizon; None where the channel was not measured there."""
    return [of.score(name, channel, h.seconds) for h in of.horizons]


# ---- commands of a wheeled robot ----


def _command_tables(of: Commands) -> Iterator[RenderableType]:
    yield from _error_tables(of)
    yield _pair_table(of)
    yield from _path_table(of)
    yield _pace_table(of)
    yield Text(
        f"\nmodels made from {of.parts['fit']} commands and {of.parts['validation']} to validate, judged on"
        f" {of.parts['test']}"
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


def _error_tables(of: Commands) -> Iterator[RenderableType]:
    errors = of.errors
    for whole in errors.variance:
        axis = whole.axis
        rows = [(name, *_cells(errors.models[name][axis])) for name in of.names]
        unit = errors.models[of.best][axis].unit
        title = (
            f"{DIRECTIONS[axis]} ({axis}): absolute error [{unit}], of {errors.displacements[axis]:.3g} on average;"
            f" analysis of variance: F({whole.between}, {whole.within}) = {ratio(whole.f)}, p {_p(whole.p)}"
        )
        yield table(("model", "mean", "min", "max", "SD"), rows, title)


def _p(p: float) -> str:
    return chance(p) if p < 0.001 else f"= {chance(p)}"


def _cells(spread: Spread) -> tuple[float, float, float, float]:
    return spread.mean, spread.min, spread.max, spread.sd


def _pair_table(of: Commands) -> RenderableType:
    rows = [
        (
            pair.axis,
            f"{pair.first} - {pair.second}",
            pair.difference,
            f"{pair.low:.3g} to {pair.high:.3g} {pair.unit}",
            chance(pair.tukey),
            chance(pair.paired),
        )
        for pair in of.errors.pairs
    ]
    columns = ("axis", "models", "difference", "95 % interval (Tukey)", "p Tukey", "p paired, Holm")
    return table(columns, rows, "which errors differ: unpaired as published, and paired by command")


def _path_table(of: Commands) -> Iterator[RenderableType]:
    if of.paths is None:
        return
    rows = [(name, *_cells(of.paths.models[name])) for name in of.names]
    title = (
        f"{count(of.paths.runs, 'run')} of {of.paths.commands} commands in a row: how far off the end is [cm]"
    )
    yield table(("model", "mean", "min", "max", "SD"), rows, title)


def _pace_table(of: Commands) -> RenderableType:
    rows = [(p.model, p.one_by_one, p.one_by_one_ratio, p.at_once, p.at_once_ratio, p.fit) for p in of.paces]
    columns = (
        "model",
        "one by one [us]",
        "to closed form",
        "all at once [us]",
        "to closed form",
        "made in [s]",
    )
    return table(columns, rows, "time for a command")


# ---- the page ----


def page(result: Comparison) -> dict[str, Any]:
    """The template's variables."""
    styles = {c.name: f"model-{i % STYLES}" for i, c in enumerate(result.contenders)}
    return {
        "result": result,
        "title": f"{result.recording_name} · comparison of {result.robot}",
        "verdict": str(result),
        "styles": styles,
        "tiles": [*_rollout_tiles(result.rollouts), *_command_tiles(result.commands)],
        "rollouts": _rollouts(result.rollouts, styles) if result.rollouts else None,
        "directions": DIRECTIONS,
        "bars": _bars(result.commands) if result.commands else [],
        "ends": _ends(result.commands) if result.commands else [],
        "plans": _plans(result.commands, styles) if result.commands else [],
        "chance": chance,
        "ratio": ratio,
    }


def _rollout_tiles(of: Rollouts | None) -> list[tuple[str, str]]:
    """(figure, what it is)."""
    if of is None:
        return []
    longest = of.horizons[-1].seconds
    tiles = [(str(of.horizons[-1].rollouts), f"held-out rollouts of {number(longest)} s")]
    gain = of.best_gain
    if gain is not None and not of.alike:
        tiles.append((f"{100 * gain.value:.0f} % less", f"error than {of.names[0]}: {of.best}"))
    return tiles


def _command_tiles(of: Commands | None) -> list[tuple[str, str]]:
    if of is None:
        return []
    tiles = [
        (str(of.parts["fit"] + of.parts["validation"]), "commands to make models from"),
        (str(of.parts["test"]), "commands to test"),
    ]
    if of.paths:
        end = of.paths.models[of.best].mean
        tiles.append((f"{number(end)} cm", f"off after {of.paths.commands} commands: {of.best}"))
    return tiles


def _rollouts(of: Rollouts, styles: dict[str, str]) -> dict[str, Any]:
    """What the template draws of them: error against horizon, the cells of the tables, traces."""
    shown = of.channels[:SHOWN_CHANNELS]
    curves = [_against_horizon(of, None, styles), *(_against_horizon(of, c, styles) for c in shown)]
    longest = of.horizons[-1].seconds
    rows = [
        (channel, [(name, s, less_cell(s).strip(" ()")) for name, s in scores if s is not None])
        for channel, scores in (
            (channel, [(name, of.score(name, channel, longest)) for name in of.names])
            for channel in (None, *shown)
        )
    ]
    rows = [(channel, cells) for channel, cells in rows if cells]  # else measured in shorter rollouts alone
    largest = {channel: max(s.error for _, s, _ in cells) or 1.0 for channel, cells in rows}
    return {
        "of": of,
        "curves": [c for c in curves if c is not None] if len(of.horizons) > 1 else [],
        "rows": [
            (
                channel and channel_words(channel, channel not in of.unscored),
                cells[0][1].unit,
                [(*cell, 100 * cell[1].error / largest[channel]) for cell in cells],
            )
            for channel, cells in rows
        ],
        "more": len(of.channels) - len(shown),
        "traces": [c for c in (_trace(t, styles) for t in of.traces) if c is not None],
        "tested": tested_words(of),
        "not_scored": NOT_SCORED if of.unscored else "",
        "longest": longest,
    }


def _against_horizon(of: Rollouts, channel: str | None, styles: dict[str, str]) -> Chart | None:
    """Errors against the horizons, evenly spaced."""
    curves = {
        styles[name]: [None if s is None else s.error for s in _scores(of, name, channel)]
        for name in of.names
    }
    unit = "spreads" if channel is None else of.unit(channel)
    named = "all scored channels" if channel is None else channel_words(channel, channel not in of.unscored)
    title = f"{named} [{unit}]"
    last = len(of.horizons) - 1
    found = chart(title, "length of the rollouts [s]", range(last + 1), curves)
    marks = tuple(Tick(100 * i / last, f"{h.seconds:.3g}") for i, h in enumerate(of.horizons))
    return found and replace(found, x_ticks=marks)


def _trace(t: Any, styles: dict[str, str]) -> Chart | None:
    curves = {"measured": t.measured} | {
        styles[name]: t.simulators[name] for name in styles if name in t.simulators
    }
    return chart(f"{t.channel} [{t.unit}], {t.episode}", "time [s]", t.time, curves)


def _bars(of: Commands) -> list[dict[str, Any]]:
    """For each axis the models' mean errors, in percent of the largest."""
    out = []
    for whole in of.errors.variance:
        found = {name: of.errors.models[name][whole.axis] for name in of.names}
        largest = max(s.mean for s in found.values()) or 1.0
        unit = next(iter(found.values())).unit
        rows = [(name, s, 100 * s.mean / largest) for name, s in found.items()]
        out.append({"axis": whole.axis, "unit": unit, "whole": whole, "rows": rows})
    return out


def _ends(of: Commands) -> list[tuple[str, Any, float]]:
    """(model, error at the end of paths, percent of the largest mean)."""
    if of.paths is None:
        return []
    found = {name: of.paths.models[name] for name in of.names}
    largest = max(s.mean for s in found.values()) or 1.0
    return [(name, s, 100 * s.mean / largest) for name, s in found.items()]


def _plans(of: Commands, styles: dict[str, str]) -> list[Plan]:
    return [p for p in (_plan(path, {n: styles[n] for n in of.names}) for path in of.driven) if p is not None]


def _plan(path: DrivenPath, styles: dict[str, str]) -> Plan | None:
    title = f"episode {path.episode}, from {path.begin:.1f} s, {path.seconds:.1f} s long"
    ways = [("measured", path.measured), *((style, path.models[name]) for name, style in styles.items())]
    return plan(title, [(style, (way.x, way.y)) for style, way in ways])
