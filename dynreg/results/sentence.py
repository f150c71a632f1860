"""Short sentences about results, for a person: the verdict of a diagnosis, its main figures, and a gain."""

from collections.abc import Sequence

from dynreg.results.diagnosis import (
    Cause,
    Diagnosis,
    EffectEstimate,
    Inseparable,
    Looked,
    Noise,
    Pulled,
    ResidualShare,
)
from dynreg.results.refit import Refit
from dynreg.results.result import Gain

NOISE_FLOORS = {
    "repeatability": "the difference of repeated runs",
    "stated_noise": "the stated sensor noise",
}
MUCH = 0.5  # from this gain on, the fitted parameters remove more of the error than they leave
PULLED = 2.0  # sigma: a parameter this far from its nameplate is outside of what 95 % of such robots have
MOST_PULLED = 2  # parameters that are named: the table lists the others


def diagnosis_sentence(of: Diagnosis) -> str:
    """The verdict of a diagnosis in one sentence: the causes, and whether the simulator at the start is better."""
    verdict = _verdict_sentence(of)
    if not of.worse:
        return verdict
    return f"{verdict.removesuffix('.')}, but {of.began} predicts the held-out part better."


def _verdict_sentence(of: Diagnosis) -> str:
    name, causes = of.recording_name, of.causes
    if _calibration_helps(of) and of.verdict in ("none", "unknown"):
        remaining = (
            "but no effect of the library explains the remaining error"
            if of.verdict == "unknown"
            else "and no effect of the library shows"
        )
        pulled = _pulled(of)[:1]
        fitted = " ".join(f"{one} {_nominal(e)}" for one, e in pulled) or "fitted parameters"
        return f"With {fitted}, the simulator predicts {name} far better, {remaining}."
    if of.verdict == "none":
        return f"{name} shows no effect of the library."
    if of.verdict == "unknown":
        return f"{name} shows an error that no effect of the library explains."
    shown = [_effect(cause) for cause in causes]
    if of.verdict == "ambiguous":
        shown[0] += f" or {' or '.join(causes[0].equivalent) or 'another cause'}"
    if of.verdict == "partly_explained":
        return f"{' and '.join(shown)} {'explain' if causes[1:] else 'explains'} part of the error of {name}."
    return f"{name} shows {' and '.join(shown)}."


def diagnosis_details(of: Diagnosis) -> tuple[str, ...]:
    """The main figures under the verdict, one short sentence each.

    What calibration alone gains; the sizes of the causes; the held-out error with all causes, or with the first where
    that of all is not known; the residual against its noise floor; and the interval of a cause that the recording does
    not separate from others.
    """
    error, gain = of.error, of.gain or (of.causes[0].gain if of.causes else None)
    out = [_calibration_sentence(of)]
    out += [f"Size of {_effect(cause)}: {_sizes(cause)}." for cause in of.causes]
    if of.verdict == "none":
        out.append(f"No cause has the {of.threshold_nats:.3g} nats of evidence that chance alone could give.")
        if error.calibrated is not None:
            out.append(
                f"The calibrated model's error on {error.channel} is {error.calibrated:.3g} {error.unit}."
            )
    if of.verdict == "ambiguous":
        out.append("The recording does not separate these causes.")
    if gain is not None:
        causes = (
            "all causes" if of.gain and len(of.causes) > 1 else of.causes[0].key if of.causes else "the cause"
        )
        than = "the calibrated model's" if of.over_start else ""
        out.append(f"With {causes} in the model, the error on held-out data is {gain_words(gain, than)}.")
        if of.over_start and not (of.worse or of.unclear):
            out.append(f"It is {gain_words(of.over_start, f'that of {of.began}')}.")
    out.append(over_start_sentence(of))
    out += [residual_sentence(of.noise), _signal(of.residual) if of.verdict == "unknown" else ""]
    out += stable_sentences(of.stable)
    out += inseparable_sentences(of.looked, of.inseparable)
    return tuple(line for line in out if line)


def _calibration_helps(of: Diagnosis) -> bool:
    """Whether fitted parameters alone, without a cause, clearly remove most of the held-out error."""
    gain = of.over_start
    known = gain is not None and gain.low is not None and not of.causes
    return known and gain.low > 0 and gain.value >= MUCH


def _pulled(of: Diagnosis) -> list[tuple[str, Pulled]]:
    """The fitted parameters that lie farthest from their nameplates, the farthest first."""
    far = {n: e for n, e in of.parameters.items() if e.fitted and abs(e.pulled_sigma or 0.0) >= PULLED}
    return sorted(far.items(), key=lambda one: -abs(one[1].pulled_sigma))[:MOST_PULLED]


def _nominal(e: Pulled) -> str:
    unit = "" if e.unit == "1" else f" {e.unit}"
    return f"{e.value:.3g}{unit} (nominal {e.nominal:.3g})"


def _calibration_sentence(of: Diagnosis) -> str:
    """The parameters that moved most and what calibration gains; "" where it does not clearly gain much.

    Without intervals: where an error is unexplained, they stand in the table alone, beside the words that mark them.
    """
    if not _calibration_helps(of):
        return ""
    moved = " and ".join(f"{name} {_nominal(e)}" for name, e in _pulled(of))
    fitted = f"{moved} and the other fitted parameters" if moved else "the fitted parameters"
    gained = gain_words(of.over_start, f"that of {of.began}")
    return f"With {fitted}, the error on held-out data is {gained}."


def over_start_sentence(of: Diagnosis) -> str:
    """How the simulator that a diagnosis leaves does on held-out data beside that at its start; "" where better."""
    if not (of.worse or of.unclear):
        return ""
    better = (
        f"Against {of.began}, the {of.left} simulator's error on held-out data is {gain_words(of.over_start)}"
    )
    return f"{better}: do not use it." if of.worse else f"{better}."


def gain_words(gain: Gain, than: str = "") -> str:
    """How an error changed, with its 90 % interval; `than` is what it is compared with.

    >>> gain_words(Gain(value=0.31, low=0.27, high=0.35))
    '31 % lower (90 % interval: 27 to 35 % lower)'
    >>> gain_words(Gain(value=0.06, low=-0.02, high=0.13), "nominal")
    '6 % lower than nominal (90 % interval: 2 % higher to 13 % lower): no clear difference'
    """
    value = f"{change(gain.value)}{f' than {than}' if than else ''}"
    if gain.low is None or gain.high is None:
        return f"{value} (too few episodes for an interval)"
    unclear = ": no clear difference" if gain.low <= 0 <= gain.high else ""
    return f"{value} (90 % interval: {change_interval(gain.low, gain.high)}){unclear}"


def change(gain: float) -> str:
    """A relative gain as the change of an error.

    >>> change(0.31), change(-0.02), change(-0.001)
    ('31 % lower', '2 % higher', '0.1 % higher')
    """
    percent = round(100 * gain) or round(100 * gain, 1)  # on which side of 0 it is decides
    return f"{abs(percent):g} % {'higher' if percent < 0 else 'lower'}"


def change_interval(low: float, high: float) -> str:
    """The interval of a relative gain as the change of an error.

    >>> change_interval(-0.02, 0.13), change_interval(0.27, 0.35), change_interval(-0.3, -0.1)
    ('2 % higher to 13 % lower', '27 to 35 % lower', '10 to 30 % higher')
    """
    ends = [change(low), change(high)]
    if all(end.endswith("higher") for end in ends):
        ends.reverse()
    first, last = ends
    side = last.rpartition(" % ")[2]
    return f"{first.removesuffix(f' % {side}')} to {last}"


def residual_sentence(noise: Noise | None) -> str:
    """How large the residual is against what no simulator can explain; "" where that is not known."""
    if noise is None or noise.ratio is None:
        return ""
    return f"The residual of {noise.channel} is {times(noise.ratio)} times {NOISE_FLOORS[noise.basis]}."


def stable_sentences(stable: Sequence[Refit]) -> tuple[str, ...]:
    """What several recordings share, and what differs between them: causes, and parameters that differ; () without."""
    texts = [str(one) for one in stable if one.cause or not one.same]
    return tuple(f"{text[0].upper()}{text[1:]}." for text in texts)


def inseparable_sentences(looked: Looked | None, pairs: Sequence[Inseparable]) -> tuple[str, ...]:
    """The rivals that the recording does not separate from a cause, its interval with each of them, and the
    experiment to run; () without such pairs."""
    if looked is None or not pairs:
        return ()
    others = " or ".join(pair.between[1] for pair in pairs)
    name, wide = next(iter(looked.whatever.items()))
    alone, unit = looked.alone[name], "" if wide.unit == "1" else f" {wide.unit}"
    absent = f"{looked.key} may also be absent." if any(pair.absent for pair in pairs) else ""
    out = (
        f"The recording does not separate {looked.key} from {others}.",
        f"If one of these acts too, {name} is between {wide.low:.3g} and {wide.high:.3g}{unit}.",
        absent,
        f"If nothing else is wrong, {name} is between {alone.low:.3g} and {alone.high:.3g}{unit}.",
        f"To separate them, run `{pairs[0].experiment}`.",
    )
    return tuple(line for line in out if line)


def _effect(cause: Cause) -> str:
    return cause.effect + (f" of {', '.join(cause.joints)}" if cause.joints else "")


def _sizes(cause: Cause) -> str:
    return ", ".join(_estimate(name, e) for name, e in cause.parameters.items()) or "no size"


def _estimate(name: str, e: EffectEstimate) -> str:
    unit = "" if e.unit == "1" else f" {e.unit}"
    return f"{name} {e.value:.3g} [{e.low:.3g}, {e.high:.3g}]{unit}{' at its bound' if e.at_bound else ''}"


def _signal(residual: Sequence[ResidualShare] | None) -> str:
    """The signal that predicts most of the residual of a joint."""
    most = max(residual or (), key=lambda r: r.share, default=None)
    if most is None or most.share <= 0:
        return ""
    signal = most.signal.replace("_", " ")
    return f"The {signal} of {most.joint} predicts {100 * most.share:.0f} % of its residual."


def times(ratio: float) -> str:
    """Two digits, without an exponent.

    >>> times(358.2), times(1.07)
    ('360', '1.1')
    """
    return f"{float(f'{ratio:.2g}'):g}"
