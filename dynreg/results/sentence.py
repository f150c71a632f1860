"""A diagnosis in one sentence, for a person."""

from collections.abc import Sequence

from dynreg.results.diagnosis import (
    Cause,
    Diagnosis,
    EffectEstimate,
    Inseparable,
    Looked,
    Noise,
    ResidualShare,
    RolloutError,
)
from dynreg.results.result import Gain


def diagnosis_sentence(of: Diagnosis) -> str:
    """What a diagnosis' verdict means: the cause, how large it is, what it explains, what is left, and what it cannot
    be told from.

    The gain is that of all causes together; that of the first where it is not known.
    """
    return f"{_verdict(of)} {inseparable_sentence(of.looked, of.inseparable)}".strip()


def inseparable_sentence(looked: Looked | None, pairs: Sequence[Inseparable]) -> str:
    """Which causes cannot be told apart, the interval of the first whatever acts, and the experiment to run.

    "" where there are no pairs.
    """
    if looked is None or not pairs:
        return ""
    others = " or ".join(pair.between[1] for pair in pairs)
    name, wide = next(iter(looked.whatever.items()))
    alone, unit = looked.alone[name], "" if wide.unit == "1" else f" {wide.unit}"
    absent = ", or it may not be there at all" if any(pair.absent for pair in pairs) else ""
    return (
        f"These data cannot tell {looked.key} from {others}: its {name} may be anything from {wide.low:.3g} to"
        f" {wide.high:.3g}{unit}{absent} ({alone.low:.3g} to {alone.high:.3g} only if nothing else is amiss); to"
        f" separate them, run `{pairs[0].experiment}`."
    )


def _verdict(of: Diagnosis) -> str:
    name, causes = of.recording_name, of.causes
    if of.verdict == "none":
        return (
            f"No effect of the library explains {name} better than chance could (that takes"
            f" {of.threshold_nats:.3g} nats): the calibrated model stands{_error(of.error)}{_left(of.noise, '; ')}."
        )
    if of.verdict == "unknown":
        return (
            f"Something is amiss in {name} that no effect of the library explains{_left(of.noise, ', and ')}"
            f"{_depends(of.residual)}."
        )
    first = causes[0]
    said = f"{_effect(first)} ({_sizes(first)})"
    also = f", and {' and '.join(f'{_effect(c)} ({_sizes(c)})' for c in causes[1:])}" if causes[1:] else ""
    if of.verdict == "named":
        text = f"{name} shows {said}{also}"
    elif of.verdict == "ambiguous":
        others = " or ".join(first.equivalent) or "another cause"
        text = f"{name} shows {said} or {others}, which it cannot tell apart{also}"
    else:
        text = f"{name} is explained in part by {said}{also}"
    gain = _gain(of.gain, len(causes)) if of.gain else _gain(first.gain, 1)
    return f"{text}{gain}{_left(of.noise, '; ')}."


def _effect(cause: Cause) -> str:
    return cause.effect + (f" of {', '.join(cause.joints)}" if cause.joints else "")


def _sizes(cause: Cause) -> str:
    return ", ".join(_estimate(name, e) for name, e in cause.parameters.items()) or "no size"


def _estimate(name: str, e: EffectEstimate) -> str:
    unit = "" if e.unit == "1" else f" {e.unit}"
    return f"{name} {e.value:.3g} [{e.low:.3g}, {e.high:.3g}]{unit}{' at its bound' if e.at_bound else ''}"


def _gain(gain: Gain | None, causes: int) -> str:
    it, helps = ("it", "does") if causes == 1 else ("them", "do")
    if gain is None:
        return ""
    size = f"{100 * abs(gain.value):.0f} %"
    if gain.low is None or gain.high is None:
        return f"; with {it} the held-out error is {size} {'lower' if gain.value >= 0 else 'higher'}"
    interval = f"90 % interval of the gain {100 * gain.low:.0f} to {100 * gain.high:.0f} %"
    if gain.low <= 0 <= gain.high:
        return f"; on held-out data {'it' if causes == 1 else 'they'} {helps} not clearly help ({interval})"
    return f"; with {it} the held-out error is {size} {'lower' if gain.low > 0 else 'higher'} ({interval})"


def _error(error: RolloutError) -> str:
    if error.calibrated is None:
        return ""
    return f"; it errs by {error.calibrated:.3g} {error.unit} on {error.channel}"


def _left(noise: Noise | None, joint: str) -> str:
    if noise is None or noise.ratio is None:
        return ""
    floors = {
        "repeatability": "what repeated runs differ by",
        "stated_noise": "what the sensor's stated noise makes",
    }
    floor = floors[noise.basis]
    return f"{joint}what is left is {times(noise.ratio)} times {floor}"


def _depends(residual: Sequence[ResidualShare] | None) -> str:
    most = max(residual or (), key=lambda r: r.share, default=None)
    if most is None or most.share <= 0:
        return ""
    return f"; {100 * most.share:.0f} % of what is left of {most.joint} goes with its {most.signal.replace('_', ' ')}"


def times(ratio: float) -> str:
    """Two digits, without an exponent.

    >>> times(358.2), times(1.07)
    ('360', '1.1')
    """
    return f"{float(f'{ratio:.2g}'):g}"
