"""What the page of a diagnosis draws."""

from collections.abc import Sequence
from typing import Any

from dynreg.report.diagnosis.words import (
    PART,
    SHOWN_RANKS,
    VERDICTS,
    details,
    diagnosis_steps,
    errors_by_importance,
    gain_cell,
    noise_words,
    residual_words,
    size_word,
    stable_word,
    standing,
    threshold_words,
    told_by,
    unsaid,
)
from dynreg.report.drawing import estimate_track, ruler, traces
from dynreg.report.words import held_out_words, interval_text, interval_words, number
from dynreg.results.diagnosis import Cause, Diagnosis, Ranked, RolloutError, Where
from dynreg.results.sentence import over_start_sentence, times
from dynreg.sim.sizes import SIZES

SHOWN_CHANNELS = 10
FEW_CHANNELS = 3  # as many stand side by side on a phone
SIMULATORS = ("nominal", "calibrated", "extended")


def page(result: Diagnosis) -> dict[str, Any]:
    """The template's variables."""
    return {
        "result": result,
        "title": f"{result.recording_name or result.recording[:12]} · {result.robot} · diagnosis",
        "verdict": VERDICTS[result.verdict],
        "details": details(result),
        "tiles": _tiles(result),
        "steps": diagnosis_steps(result),
        "causes": [_cause(cause) for cause in result.causes],
        "part": PART[result.error.part],
        "alarm": over_start_sentence(result) if result.worse else "",
        "held_out": held_out_words(result.parts),
        # the dotted and the dashed line on top, so that lines which run together still show
        "charts": traces(result.traces, ("measured", "extended", "calibrated", "nominal")),
        "drawn": [s for s in SIMULATORS if any(getattr(t, s) is not None for t in result.traces)],
        "rankings": _rankings(result),
        "threshold": threshold_words(result),
        "maps": _maps(result.where),
        "errors": [_error_bars(e) for e in errors_by_importance(result)[:SHOWN_CHANNELS]],
        "more_errors": max(0, len(result.errors) - SHOWN_CHANNELS),
        "compared": [s for s in SIMULATORS if getattr(result.error, s) is not None],
        "tracks": {name: estimate_track(e) for name, e in result.parameters.items()},
        "interval_name": interval_words(not result.unexplained),
        "noise": noise_words(result.noise),
        "rests": _rests(result),
        "unsaid": unsaid(result),
        "stable": [(one, stable_word(one)) for one in result.stable],
        "interval_text": interval_text,
    }


def _tiles(result: Diagnosis) -> list[tuple[str, str]]:
    """(figure, what it is)."""
    error = result.error
    best = next(s for s in reversed(SIMULATORS) if getattr(error, s) is not None)
    tiles = [
        (f"{number(error.nominal)} {error.unit}", f"nominal error of {error.channel}, {PART[error.part]}"),
        (
            f"{number(getattr(error, best))} {error.unit}",
            f"{best} model's error{_beside(error) if best == 'extended' else ''}, {PART[error.part]}",
        ),
    ]
    if result.causes:
        first = result.causes[0]
        tiles.append(
            (
                f"{number(first.evidence_nats)} nats",
                f"for {first.key}; needed {number(result.threshold_nats)}",
            )
        )
    elif result.ranking:
        first = max(result.ranking, key=lambda r: r.score_nats)
        tiles.append(
            (
                f"{number(first.score_nats)} nats",
                f"for {first.key}, the best; needed {number(result.threshold_nats)}",
            )
        )
    if result.noise is not None and result.noise.ratio is not None:
        floor = {
            "repeatability": "repeated runs' difference",
            "stated_noise": "error that stated sensor noise leaves",
        }
        tiles.append(
            (f"{times(result.noise.ratio)} x", f"unexplained error, over the {floor[result.noise.basis]}")
        )
    return tiles


def _beside(error: RolloutError) -> str:
    return "" if error.calibrated is None else f" (calibrated {number(error.calibrated)})"


def _rests(result: Diagnosis) -> list[dict[str, Any]]:
    """Of each joint the sentence and the shares [%] of its residual that its signals predict."""
    pairs = zip(result.rest or (), residual_words(result), strict=False)  # not every joint is told of
    return [{"said": said, "bars": told_by(result, rest.joint)} for rest, said in pairs]


def _cause(cause: Cause) -> dict[str, Any]:
    rulers = {}
    for name, e in cause.parameters.items():
        if e.sizes is not None:
            marks = dict(zip(SIZES, e.sizes, strict=True))
            rulers[name] = ruler(e.value, e.low, e.high, marks) if len(set(e.sizes)) == 3 else None
    return {
        "of": cause,
        "verdict": VERDICTS[cause.verdict],
        "gain": gain_cell(cause.gain) if cause.gain else "",
        "rulers": rulers,
        "sizes": {name: size_word(e) for name, e in cause.parameters.items()},
    }


def _rankings(result: Diagnosis) -> list[dict[str, Any]]:
    """Of each round the bars in percent and where the threshold stands."""
    out = []
    for number_of_round in sorted({r.round for r in result.ranking}):
        ranked = [r for r in result.ranking if r.round == number_of_round]
        most = max(result.threshold_nats, *(r.score_nats for r in ranked), 1e-9) * 1.04
        before = [c.key for c in result.causes[: number_of_round - 1]]
        out.append(
            {
                "title": f"After {' and '.join(before)}" if before else "",
                "threshold": 100 * max(result.threshold_nats, 0.0) / most,
                "bars": [_rank(result, r, most) for r in ranked[:SHOWN_RANKS]],
                "more": max(0, len(ranked) - SHOWN_RANKS),
            }
        )
    return out


def _rank(result: Diagnosis, ranked: Ranked, most: float) -> dict[str, Any]:
    said = standing(result, ranked)
    kind = "chosen" if said in VERDICTS.values() else "tied" if said == "explains it as well" else ""
    width = 100 * max(ranked.score_nats, 0.0) / most
    return {"key": ranked.key, "nats": f"{ranked.score_nats:.1f}", "said": said, "kind": kind, "width": width}


def _maps(where: Sequence[Where]) -> list[dict[str, Any]]:
    """Of each simulator a table of shares [%], channels by regimes; few channels stand side by side."""
    out = []
    for simulator in SIMULATORS:
        mine = {(w.channel, w.regime): w for w in where if w.simulator == simulator and w.share > 0}
        if not mine:
            continue
        regimes = list(dict.fromkeys(regime for _, regime in mine))
        channels = _by_share(mine)
        shown = channels[:SHOWN_CHANNELS]
        upright = len(shown) <= FEW_CHANNELS
        rows, columns = (regimes, shown) if upright else (shown, regimes)
        cells = [[_cell(mine.get((c, r) if upright else (r, c))) for c in columns] for r in rows]
        out.append(
            {
                "simulator": simulator,
                "columns": [c if upright else _regime(c) for c in columns],
                "rows": list(zip([_regime(r) if upright else r for r in rows], cells, strict=True)),
                "most": 100 * max(*(w.share for w in mine.values()), 1e-9),
                "more": len(channels) - len(shown),
            }
        )
    return out


def _by_share(mine: dict[tuple[str, str], Where]) -> list[str]:
    """Channels, those with the largest share first."""
    share: dict[str, float] = {}
    for (channel, regime), w in mine.items():
        share[channel] = max(share.get(channel, 0.0), 2.0 + w.share if regime == "overall" else w.share)
    return sorted(share, key=lambda channel: -share[channel])


REGIMES = {
    "early": "first third of rollouts",
    "late": "last third of rollouts",
    "log_begin": "first third of the log",
    "log_end": "last third of the log",
    "saturation": "drive at its limit",
}


def _regime(name: str) -> str:
    return REGIMES.get(name, name.replace("_", " "))


def _cell(w: Where | None) -> dict[str, Any] | None:
    return (
        None if w is None else {"percent": 100 * w.share, "ratio": w.ratio, "error": w.error, "unit": w.unit}
    )


def _error_bars(e: RolloutError) -> dict[str, Any]:
    sizes = {s: getattr(e, s) for s in SIMULATORS if getattr(e, s) is not None}
    largest = max(*sizes.values(), e.repeatability or 0.0) or 1.0
    return {
        "of": e,
        "bars": [(name, size, 100 * size / largest) for name, size in sizes.items()],
        "floor": None if e.repeatability is None else 100 * e.repeatability / largest,
    }
