"""A diagnosis as text."""

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.diagnosis.words import (
    PART,
    SHOWN_RANKS,
    as_given,
    details,
    diagnosis_steps,
    errors_by_importance,
    gain_cell,
    noise_words,
    parameter_text,
    residual_words,
    size_word,
    stable_word,
    standing,
    threshold_words,
    unsaid,
)
from dynreg.report.grid import table
from dynreg.report.words import held_out_words, interval, interval_text, interval_words, number
from dynreg.results.diagnosis import Diagnosis
from dynreg.results.sentence import over_start_sentence

SHOWN_CHANNELS = 8
ERRORS = {  # columns of the table of errors, and those of them that older results lack
    "nominal": "nominal",
    "calibrated": "calibrated",
    "no prior": "unpenalised",
    "extended": "extended",
    "repeatability": "repeatability",
    "still": "held",
    "follows": "followed",
}
LATER = ("unpenalised", "held", "followed")


def tables(result: Diagnosis) -> Group:
    """Verdict, causes, ranking, parameters, error, residual, and what to do next."""
    parts: list[RenderableType] = [Text(result.sentence, style="bold")]
    alarm = over_start_sentence(result) if result.worse else ""
    parts += [Text(line, style="bold red" if line == alarm else "") for line in details(result)]
    if result.causes:
        parts.append(_causes(result))
    parts += [_ranking(result, found) for found in sorted({r.round for r in result.ranking})]
    parts.append(Text(threshold_words(result)))
    parts.append(_parameters(result))
    if result.stable:
        parts.append(_stable(result))
    if result.moved:
        rows = [(m.name, m.before, m.after, m.unit) for m in result.moved]
        parts.append(
            table(("parameter", "before", "after", "unit"), rows, "parameters that changed with the cause")
        )
    parts.append(_errors(result))
    held_out = held_out_words(result.parts)
    parts += [Text(f"\n{line}") for line in (held_out, result.finding) if line] or [Text("")]
    parts += [Text(line) for line in (noise_words(result.noise), *residual_words(result)) if line]
    said = unsaid(result)
    parts += [Text("\nlimits of this log", style="bold")] if said else []
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
    return table(columns, rows, "causes (gain: how much less the error is on the test part)")


def _stable(result: Diagnosis) -> RenderableType:
    rows = [
        (
            one.name,
            *(interval_text(one.values[name]) for name in result.recordings),
            one.unit,
            stable_word(one),
        )
        for one in result.stable
    ]
    return table(("", *result.recordings, "unit", ""), rows, "fitted to each recording")


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
            parameter_text(e),
            e.unit,
            "-" if e.pulled_sigma is None else f"{e.pulled_sigma:+.1f} sigma",
        )
        for name, e in result.parameters.items()
        if name not in as_given(result)
    ]
    columns = ("parameter", "nominal", f"value [{interval_words(not result.unexplained)}]", "unit", "pull")
    title = "parameters (pull: from the nameplate, in its standard deviations)"
    given = ", ".join(as_given(result))
    said = [result.reliance if rows else "", f"Not fitted, as in robot.toml: {given}." if given else ""]
    return Group(*([table(columns, rows, title)] if rows else []), *(Text(line) for line in said if line))


def _errors(result: Diagnosis) -> RenderableType:
    shown = errors_by_importance(result)
    known = {
        name: key
        for name, key in ERRORS.items()
        if key not in LATER or any(getattr(e, key) is not None for e in shown)
    }
    rows = [(e.channel, *(getattr(e, key) for key in known.values()), e.unit) for e in shown[:SHOWN_CHANNELS]]
    more = f", the first {SHOWN_CHANNELS} of {len(shown)} channels" if len(shown) > SHOWN_CHANNELS else ""
    title = f"mean absolute error on the {PART[result.error.part]}{more}"
    return table(("channel", *known, "unit"), rows, title)
