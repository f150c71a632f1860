"""Short sentences about results, for a person: the verdict of a diagnosis, its main figures, and a gain."""

from collections.abc import Sequence

from dynreg.data.units import suffix
from dynreg.results.diagnosis import (
    Cause,
    Diagnosis,
    Doubt,
    EffectEstimate,
    Inseparable,
    Looked,
    Noise,
    Pulled,
    ResidualShare,
)
from dynreg.results.helped import (
    best_channel,
    by_calibration,
    calibration_leads,
    channel_gain,
    doubtful,
    far_better,
    helping,
    main_parameters,
)
from dynreg.results.refit import Refit
from dynreg.results.result import Gain, change

TIED = 3  # equivalents of a cause that a headline names
NOISE_FLOORS = {
    "repeatability": "the difference of repeated runs",
    "stated_noise": "what the stated sensor noise leaves",
}


def diagnosis_sentence(of: Diagnosis) -> str:
    """The verdict of a diagnosis in one sentence: the causes, and whether the simulator at the start is better."""
    verdict, against = _verdict_sentence(of), [*doubt_words(of)]
    if of.worse:
        against.append(f"{of.began} predicts the held-out part better")
    if not against:
        return verdict
    return f"{verdict.removesuffix('.')}, but {_listed(against)}."


def _verdict_sentence(of: Diagnosis) -> str:
    """The larger part of what lowers the held-out error first: fitted parameters, or causes that clearly help."""
    name, shown = of.recording_name, [_effect(cause) for cause in helping(of)]
    if len(shown) == 1:
        shown = [f"{shown[0]} or {_others(cause)}" if _tied(cause) else shown[0] for cause in helping(of)]
    else:
        pairs = zip(shown, helping(of), strict=True)
        shown = [f"{told} (or {_others(cause)})" if _tied(cause) else told for told, cause in pairs]
    causes, explain = " and ".join(shown), "explain" if shown[1:] else "explains"
    if calibration_leads(of):
        rest = {
            "unknown": "but no effect of the library explains the remaining error",
            "none": "and no effect of the library shows",
            "partly_explained": f"and {causes} {explain} part of the remaining error"
            if of.leaves
            else f"and the rest points to {causes}",
        }.get(of.verdict, f"and the recording shows {causes}")
        if of.causes and not shown:
            rest = "and no effect of the library clearly adds to that"
        fitted, most = _main(of) or "fitted parameters", best_channel(of)
        predicts = f"{most.channel} of {name}" if most else name
        return f"With {fitted}, the simulator predicts {predicts} {'far ' * far_better(of)}better, {rest}."
    if of.verdict == "none":
        return f"{name} shows no effect of the library."
    if of.verdict == "unknown":
        return f"{name} shows an error that no effect of the library explains."
    if not shown:
        return f"No effect of the library clearly helps to predict {name}."
    if of.verdict == "partly_explained" and not of.leaves:
        return f"{name} points to {causes}."
    if of.verdict == "partly_explained":
        return f"{causes} {explain} part of the error of {name}."
    return f"{name} shows {causes}."


def diagnosis_details(of: Diagnosis) -> tuple[str, ...]:
    """The main figures under the verdict, one short sentence each.

    What calibration alone gains; the sizes of the causes that clearly help, and the names of the others; the held-out
    error with all causes, or with the first where that of all is not known; whether none of the known causes looks like
    the recording; the residual against its noise floor; and the interval of a cause that the recording does not
    separate from others.
    """
    error = of.error
    out = [*_calibration_sentences(of)]
    out += [f"Size of {_effect(cause)}: {_sizes(cause)}." for cause in helping(of)]
    if of.verdict == "none":
        out.append(f"No cause has more evidence than chance could give ({of.threshold_nats:.3g} nats).")
        if error.calibrated is not None:
            out.append(
                f"The calibrated model's error on {error.channel} is {error.calibrated:.3g} {error.unit}."
            )
    shown = helping(of)
    for cause in filter(_tied, shown):
        pair = "these causes" if len(shown) == 1 else f"{cause.key} from {_others(cause)}"
        out.append(f"The recording does not separate {pair}.")
    out += [*_gain_sentences(of), _doubtful_sentence(of)]
    out.append(over_start_sentence(of))
    if of.resembles is not None and of.resembles.outside and of.verdict == "unknown":
        out.append("None of the known causes looks like this recording.")
    out += [residual_sentence(of.noise), _signal(of.residual) if of.verdict == "unknown" else ""]
    out += stable_sentences(of.stable)
    out += inseparable_sentences(of.looked, of.inseparable)
    return tuple(dict.fromkeys(line for line in out if line))


def doubt_words(of: Diagnosis) -> tuple[str, ...]:
    """What speaks against the causes that are told, a few words each.

    A cause that does not help on held-out data is not told: it has a line of its own.
    """
    told = {cause.key for cause in helping(of)}
    causes = {cause.key for cause in of.causes}
    return tuple(_doubt(one) for one in of.doubts if one.of in told or one.of not in causes)


def _doubt(one: Doubt) -> str:
    match one.kind:
        case "pulled":
            return f"{one.of} would have to be {times(abs(one.value))} sigma from its value in robot.toml"
        case "parameter_at_bound":
            return f"{one.of} ends at the edge of its range"
        case "size_at_bound":
            return f"the size of {one.of} ends at the edge of its range"
        case "small":
            return f"the size of {one.of} ends at {100 * one.value:.0f} % of the weak one"
        case "no_gain":
            return f"with {one.of} the error on held-out data is {change(one.value)}"
        case "unlike":
            return (
                f"no known cause looks like the recording (the nearest shows {100 * one.value:.0f} % of it)"
            )
    than = "joints that hold still or just follow their commands"
    return f"the simulator errs {times(one.value)} times as much as {than}"


def _listed(parts: Sequence[str]) -> str:
    return " and ".join(part for part in (", ".join(parts[:-1]), parts[-1]) if part)


def _main(of: Diagnosis) -> str:
    """The parameters that moved the prediction, from where to where; "" where no few did.

    As the calibrated simulator has them: without the causes.
    """
    before = {one.name: one.before for one in of.moved}
    named = main_parameters(of).items()
    return " and ".join(f"{name} {_nominal(before.get(name, e.value), e)}" for name, e in named)


def _nominal(value: float, e: Pulled) -> str:
    return f"{value:.3g}{suffix(e.unit)} (nominal {e.nominal:.3g})"


def _calibration_sentences(of: Diagnosis) -> tuple[str, ...]:
    """The parameters that moved the prediction and what calibration gains, where that is what to tell first.

    Without intervals: where an error is unexplained, they stand in the table alone, beside the words that mark them.
    """
    gain, most = by_calibration(of), best_channel(of)
    if gain is None or not calibration_leads(of):
        return ()
    fitted = f"{_main(of)} and the other fitted parameters" if _main(of) else "the fitted parameters"
    told = f"With {fitted}, the error on held-out data is {gain_words(gain, f'that of {of.began}')}."
    return (told, f"On {most.channel} alone it is {change(channel_gain(most))}.") if most else (told,)


def _gain_sentences(of: Diagnosis) -> tuple[str, ...]:
    """What all causes gain, and how much of the gain over the simulator at the start calibration earned."""
    gain = of.gain or (of.causes[0].gain if of.causes else None)
    if gain is None:
        return ()
    causes = (
        "all causes" if of.gain and len(of.causes) > 1 else of.causes[0].key if of.causes else "the cause"
    )
    loose = of.rival == "unpenalised"
    rival = "that of the model calibrated without a prior" if loose else "the calibrated model's"
    than = rival if of.over_start else ""
    out = [f"With {causes} in the model, the error on held-out data is {gain_words(gain, than)}."]
    if of.over_start and helping(of) and not (of.worse or of.unclear):
        both = f"It is {gain_words(of.over_start, f'that of {of.began}')}."
        told = of.calibration is None or calibration_leads(of)
        out.append(both if told else f"{both} The calibrated model's is {change(of.calibration.value)}.")
    return tuple(out)


def _doubtful_sentence(of: Diagnosis) -> str:
    """The causes that were accepted and do not clearly help on held-out data; "" without one."""
    names = [cause.key for cause in doubtful(of)]
    if not names:
        return ""
    listed = _listed(names)
    do, them = ("do", "them") if names[1:] else ("does", "it")
    also = "also " if helping(of) or calibration_leads(of) else ""
    return f"The search {also}accepted {listed}, which {do} not clearly help on held-out data: do not rely on {them}."


def over_start_sentence(of: Diagnosis) -> str:
    """How the simulator that a diagnosis leaves does on held-out data beside that at its start; "" where better."""
    if not (of.worse or of.unclear):
        return ""
    better = (
        f"Against {of.began}, the {of.left} simulator's error on held-out data is {gain_words(of.over_start)}"
    )
    return f"{better}: do not use it." if of.worse else f"{better}."


def gain_words(gain: Gain, than: str = "") -> str:
    """How an error changed, with its 90 % interval and what that counts; `than` is what it is compared with.

    >>> gain_words(Gain(value=0.31, low=0.27, high=0.35, over="windows"))
    '31 % lower (90 % interval over windows: 27 to 35 % lower)'
    >>> gain_words(Gain(value=0.06, low=-0.02, high=0.13), "nominal")
    '6 % lower than nominal (90 % interval: 2 % higher to 13 % lower): no clear difference'
    """
    value = f"{change(gain.value)}{f' than {than}' if than else ''}"
    if gain.low is None or gain.high is None:
        return f"{value} (too few windows for an interval)"
    unclear = ": no clear difference" if gain.low <= 0 <= gain.high else ""
    over = f" over {gain.over}" if gain.over else ""
    return f"{value} (90 % interval{over}: {change_interval(gain.low, gain.high)}){unclear}"


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
    alone, unit = looked.alone[name], suffix(wide.unit)
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
    return cause.effect + (f" of {', '.join(cause.places)}" if cause.places else "")


def _tied(cause: Cause) -> bool:
    """Whether others explain the recording as well as the cause, whatever else is left."""
    return bool(cause.equivalent) or cause.verdict == "ambiguous"


def _others(cause: Cause) -> str:
    """Those that explain the recording as well, or how many beside the first few."""
    told, more = cause.equivalent[:TIED], len(cause.equivalent) - TIED
    return " or ".join([*told, f"{more} more"] if more > 0 else told) or "another cause"


def _sizes(cause: Cause) -> str:
    return ", ".join(_estimate(name, e) for name, e in cause.parameters.items()) or "no size"


def _estimate(name: str, e: EffectEstimate) -> str:
    return f"{name} {e.value:.3g} [{e.low:.3g}, {e.high:.3g}]{suffix(e.unit)}{' at its bound' if e.at_bound else ''}"


def _signal(residual: Sequence[ResidualShare] | None) -> str:
    """The signal that predicts most of the residual of a joint."""
    most = max(residual or (), key=lambda r: r.share, default=None)
    if most is None or most.share <= 0:
        return ""
    joint, _, signal = most.signal.rpartition("/")
    of = f"{joint} predicts {100 * most.share:.0f} % of {most.joint}'s residual"
    own = f"{most.joint} predicts {100 * most.share:.0f} % of its residual"
    return f"The {signal.replace('_', ' ')} of {of if joint else own}."


def times(ratio: float) -> str:
    """Two digits, without an exponent.

    >>> times(358.2), times(1.07)
    ('360', '1.1')
    """
    return f"{float(f'{ratio:.2g}'):g}"
