"""A diagnosis as text."""

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.diagnosis.words import (
    PART,
    diagnosis_steps,
    gain_cell,
    noise_words,
    rest_words,
    size_word,
    standing,
    threshold_words,
    unsaid,
)
from dynreg.report.grid import table
from dynreg.report.words import interval, number
from dynreg.results.diagnosis import Diagnosis

SHOWN_RANKS = 8
SHOWN_CHANNELS = 8


def tables(result: Diagnosis) -> Group:
    """Verdict, causes, ranking, parameters, error, what is left, and what to do next."""
    parts: list[RenderableType] = [Text(result.sentence, style="bold")]
    if result.causes:
        parts.append(_causes(result))
    parts += [_ranking(result, found) for found in sorted({r.round for r in result.ranking})]
    parts.append(Text(threshold_words(result)))
    parts.append(_parameters(result))
    if result.moved:
        rows = [(m.name, m.before, m.after, m.unit) for m in result.moved]
        parts.append(table(("parameter", "before", "after", "unit"), rows, "what moved with the cause"))
    parts += [_errors(result), Text(f"\n{result.finding}") if result.finding else Text("")]
    parts += [Text(line) for line in (noise_words(result.noise), *rest_words(result)) if line]
    said = unsaid(result)
    parts += [Text("\nwhat the log cannot tell", style="bold")] if said else []
    parts += [Text(f"- {line}") for line in said]
    parts += [Text(f"input: {line}") for line in result.inputs] + [Text(f"note: {n}") for n in result.notes]
    cost = result.cost
    parts.append(Text(f"cost: {cost.rollouts} simulations, {cost.seconds:.1f} s"))
    parts += [Text(f"- {step}") for step in diagnosis_steps(result)]
    return Group(*parts)


def _causes(result: Diagnosis) -> RenderableType:
    rows = []
    for cause in result.causes:
        about = (cause.key, f"{number(cause.evidence_nats)} nats", gain_cell(cause.gain))
        for i, (name, e) in enumerate(cause.parameters.items()):
            rows.append((*(about if i == 0 else ("", "", "")), name, interval(e), e.unit, size_word(e)))
    columns = (
        "cause",
        "evidence",
        "gain",
        "parameter",
        "value [90 % interval]",
        "unit",
        "size",
    )
    return table(columns, rows, "causes (gain: of the error on the test part)")


def _ranking(result: Diagnosis, number_of_round: int) -> RenderableType:
    ranked = [r for r in result.ranking if r.round == number_of_round]
    rows = [(r.key, f"{r.score_nats:.1f}", standing(result, r)) for r in ranked[:SHOWN_RANKS]]
    more = f", the first {SHOWN_RANKS} of {len(ranked)}" if len(ranked) > SHOWN_RANKS else ""
    after = (
        ""
        if number_of_round == 1
        else f" after {', '.join(c.key for c in result.causes[: number_of_round - 1])}"
    )
    return table(("hypothesis", "nats", ""), rows, f"ranking{after}{more}")


def _parameters(result: Diagnosis) -> RenderableType:
    rows = [
        (
            name,
            e.nominal,
            interval(e),
            e.unit,
            "-" if e.pulled_sigma is None else f"{e.pulled_sigma:+.1f} sigma",
        )
        for name, e in result.parameters.items()
        if e.pulled_sigma is not None or not e.low == e.high == e.nominal  # others stayed where they were put
    ]
    columns = ("parameter", "nominal", "value [90 % interval]", "unit", "pull")
    return table(columns, rows, "parameters (pull: from the nameplate, in its standard deviations)")


def _errors(result: Diagnosis) -> RenderableType:
    shown = result.errors or (result.error,)
    rows = [
        (e.channel, e.nominal, e.calibrated, e.extended, e.repeatability, e.unit)
        for e in shown[:SHOWN_CHANNELS]
    ]
    more = f", the first {SHOWN_CHANNELS} of {len(shown)} channels" if len(shown) > SHOWN_CHANNELS else ""
    title = f"mean absolute error on the {PART[result.error.part]}{more}"
    return table(("channel", "nominal", "calibrated", "extended", "repeatability", "unit"), rows, title)
