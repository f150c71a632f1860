"""What lowers the held-out error that a diagnosis tells: fitted parameters or causes, which of them, and where."""

from dynreg.results.diagnosis import Cause, Diagnosis, Pulled, RolloutError, Simulator
from dynreg.results.result import Gain

CLEAR = 0.005  # of the error: a gain that is less is printed as 0 %
MUCH = 0.5  # from this gain on, the fitted parameters remove more of the error than they leave
MAIN = 1 / 3  # of what calibration gains: a parameter that alone makes less is not what moved the prediction
BESIDE = 0.5  # of what the first of them makes, that another one must make to be named beside it
MOST_MAIN = 2  # parameters that are named: the table lists the others
WORSE = 0.05  # of an error: by less the errors of two simulators on few windows differ by chance


def clearly_helps(gain: Gain | None) -> bool:
    """Whether a gain is clearly above 0: by its interval, and by its value where there is none."""
    return gain is not None and (gain.value if gain.low is None else gain.low) >= CLEAR


def helping(of: Diagnosis) -> tuple[Cause, ...]:
    """The causes on which held-out data can be relied: each that clearly helps, or all where only all together do.

    All of them where nothing was held out. A cause for which parameters stood in (`Cause.replaced`) cannot help over
    these: it must not clearly do worse.
    """
    alone = tuple(cause for cause in of.causes if _relied_on(cause))
    return of.causes if not alone and clearly_helps(of.gain) else alone


def _relied_on(cause: Cause) -> bool:
    return cause.gain is None or clearly_helps(cause.gain) or (cause.replaced and not cause.gain.worse)


def doubtful(of: Diagnosis) -> tuple[Cause, ...]:
    """The causes that were accepted and do not clearly help on held-out data."""
    return tuple(cause for cause in of.causes if cause not in helping(of))


def by_calibration(of: Diagnosis) -> Gain | None:
    """The gain of the fitted parameters alone; None where it is not known."""
    return of.calibration or (None if of.causes else of.over_start)


def calibration_leads(of: Diagnosis) -> bool:
    """Whether the fitted parameters clearly remove more of the held-out error than the causes do.

    Without causes they must remove most of it, over all channels or on one.
    """
    gain = by_calibration(of)
    if of.worse or gain is None or gain.low is None or not clearly_helps(gain):
        return False
    if not of.causes:
        return far_better(of)
    return gain.value > (1.0 - gain.value) * (of.gain.value if of.gain else 0.0)


def far_better(of: Diagnosis) -> bool:
    """Whether the fitted parameters remove most of the held-out error, over all channels or on one."""
    gain = by_calibration(of)
    return gain is not None and (gain.value >= MUCH or best_channel(of) is not None)


def best_channel(of: Diagnosis) -> RolloutError | None:
    """The channel on which calibration removes most of the held-out error, where it does not over all channels."""
    gain = by_calibration(of)
    tested = [e for e in of.errors if e.part == "test" and channel_gain(e) >= MUCH]
    if not tested or gain is None or gain.value >= MUCH:
        return None
    return max(tested, key=channel_gain)


def channel_gain(e: RolloutError) -> float:
    """By how much calibration lowers the error of a channel."""
    return 0.0 if e.calibrated is None or not e.nominal > 0 else 1.0 - e.calibrated / e.nominal


def main_parameters(of: Diagnosis) -> dict[str, Pulled]:
    """The parameters that moved the prediction: those that alone make a large share of what calibration gains."""
    large = {name: e for name, e in of.parameters.items() if e.share is not None and e.share >= MAIN}
    most = max((e.share for e in large.values()), default=0.0)
    named = [(name, e) for name, e in large.items() if e.share >= BESIDE * most]
    return dict(sorted(named, key=lambda one: -one[1].share)[:MOST_MAIN])


def worse_on_most(of: Diagnosis) -> tuple[Simulator, int] | None:
    """The simulator that errs more than that at the start on most of several channels, and on how many."""
    for kind in ("calibrated", "extended"):
        than = [(getattr(e, kind), e.nominal) for e in of.errors if getattr(e, kind) is not None]
        clearly = sum(one > (1.0 + WORSE) * nominal for one, nominal in than)
        if len(than) > 1 and clearly > len(than) / 2:
            return kind, sum(one > nominal for one, nominal in than)
    return None
