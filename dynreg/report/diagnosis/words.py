"""What a diagnosis says, does not say and asks for, in sentences."""

from dynreg.report.words import count, number
from dynreg.results.diagnosis import Cause, Diagnosis, EffectEstimate, Inseparable, Noise, Ranked
from dynreg.results.result import Gain
from dynreg.results.sentence import times

FLOORS = {
    "repeatability": "what repeated runs differ by",
    "stated_noise": "what the sensor's stated noise makes",
}
PART = {"test": "held-out test part", "select": "select part", "fit": "fit part"}
SHOWN_JOINTS = 6
VERDICTS = {
    "named": "named",
    "ambiguous": "ambiguous",
    "partly_explained": "partly explained",
    "unknown": "unknown cause",
    "none": "nothing missing",
}


def standing(result: Diagnosis, ranked: Ranked) -> str:
    """What became of a ranked hypothesis: the verdict of a cause, a tie with one, or why it lost."""
    cause = result.causes[ranked.round - 1] if ranked.round <= len(result.causes) else None
    if cause is not None and cause.key == ranked.key:
        return VERDICTS[cause.verdict]
    if cause is not None and ranked.key in cause.equivalent:
        return "explains it as well"
    if ranked.note:
        return ranked.note
    return "explains less" if ranked.score_nats >= result.threshold_nats else "below the threshold"


def threshold_words(result: Diagnosis) -> str:
    """How much evidence a cause needs, and how that was found."""
    needed = f"A cause needs {number(result.threshold_nats)} nats"
    if not result.threshold.runs:
        return f"{needed}, the usual threshold."
    kept = ", kept from an earlier diagnosis" if result.threshold.cached else ""
    runs = count(result.threshold.runs, "simulation")
    note = f". {result.threshold.note}" if result.threshold.note else ""
    return f"{needed}, by {runs} of this robot without any effect{kept}{note}."


def size_word(e: EffectEstimate) -> str:
    """How large the value is among the sizes of its effect; "-" where these are not known.

    >>> size_word(EffectEstimate(value=-0.1, low=-0.2, high=0, unit="1", sizes=(0.03, 0.08, 0.2)))
    'medium'
    """
    if e.sizes is None:
        return "-"
    weak, medium, strong = (abs(s) for s in e.sizes)
    # a limit: the lower, the larger the effect
    larger = (lambda size: abs(e.value) <= size) if strong < weak else (lambda size: abs(e.value) >= size)
    names = (("strong", strong), ("medium", medium), ("weak", weak))
    return next((name for name, size in names if larger(size)), "below weak")


def gain_cell(gain: Gain | None) -> str:
    """A gain with its interval in percent."""
    if gain is None:
        return "-"
    if gain.low is None or gain.high is None:
        return f"{100 * gain.value:.0f} %"
    return f"{100 * gain.value:.0f} [{100 * gain.low:.0f}, {100 * gain.high:.0f}] %"


def noise_words(noise: Noise | None) -> str:
    """What is left, against what no simulator can explain."""
    if noise is None:
        return "There is nothing to hold what is left against: no run was repeated and no noise is stated."
    left = f"{number(noise.left)} {noise.unit} is left of {noise.channel}"
    if noise.ratio is None:
        return f"{left}; {FLOORS[noise.basis]} is not known."
    white = {True: "; it looks like white noise", False: "; it is not white noise", None: ""}[noise.white]
    return f"{left}, {times(noise.ratio)} times {FLOORS[noise.basis]} ({number(noise.floor)} {noise.unit}){white}."


def rest_words(result: Diagnosis) -> tuple[str, ...]:
    """Of each joint how much of what is left can be told, and by which signals; () where that was not asked."""
    out = []
    for rest in (result.rest or ())[:SHOWN_JOINTS]:
        of = f"{number(rest.left)} {rest.unit} (1 sigma) of {rest.joint}'s acceleration"
        told = told_by(result, rest.joint)
        if told:
            parts = ", ".join(f"{signal} {percent:.0f} %" for signal, percent in told)
            out.append(
                f"{of} is left; on unseen data its signals tell {100 * rest.told:.0f} % of that: {parts}."
            )
        else:
            out.append(f"{of} is left, none of which its signals tell.")
    return tuple(out)


def told_by(result: Diagnosis, joint: str) -> list[tuple[str, float]]:
    """(signal, share [%]) of what is left of a joint, for the signals that tell some of it, the largest first."""
    told = [r for r in result.residual or () if r.joint == joint and r.share > 0]
    return [(r.signal.replace("_", " "), 100 * r.share) for r in sorted(told, key=lambda r: -r.share)]


def unsaid(result: Diagnosis) -> tuple[str, ...]:
    """What the recording cannot tell, and where a number says less than it seems to."""
    said = [_tie(cause) for cause in result.causes if cause.equivalent]
    said += [_valley(pair) for pair in result.inseparable]
    for cause in result.causes:
        edge = [name for name, e in cause.parameters.items() if e.at_bound]
        said += [f"{name} of {cause.key} lies on the edge of what a fit may reach." for name in edge]
        if cause.gain and cause.gain.low is not None and cause.gain.low <= 0:
            alone = " by itself" if len(result.causes) > 1 else ""
            said.append(f"On held-out data {cause.key}{alone} does not clearly help.")
    for name, e in result.parameters.items():
        if e.at_bound:
            said.append(f"{name} lies on the edge of its range: its interval says little.")
    if result.noise is None or result.noise.basis == "stated_noise":
        said.append("No run was repeated, so the robot's own scatter is not known.")
    if not result.parts.get("test"):
        said.append("Nothing was held out: the errors are those of data that the choice was made by.")
    if not result.threshold.runs:
        said.append("The threshold is the usual one, not one found by simulating this robot.")
    return tuple(said)


def diagnosis_steps(result: Diagnosis) -> tuple[str, ...]:
    """What to do next, the first thing first."""
    steps = list(result.experiments)
    for cause in result.causes:
        for other in [key for key in cause.equivalent if key not in cause.inseparable][:1]:
            pair = f"'{cause.key},{other}'" if "[" in cause.key + other else f"{cause.key},{other}"
            steps.append(
                f"Commands that tell them apart: dynreg excite {result.robot} --for {pair} -o next.csv"
            )
    for pair in result.inseparable:
        step = f"Commands that tell {pair.between[0]} from {pair.between[1]}: {pair.experiment}"
        if not any(pair.experiment in other for other in steps):
            steps.append(step)
    if result.verdict == "unknown":
        steps.append(f"Check the log first: dynreg doctor LOG --robot {result.robot}")
    if not result.parts.get("test"):
        steps.append("Record more episodes, or name some with --hold-out.")
    if result.extended_simulator:
        steps.append(
            f"Take the extended simulator along: dynreg export {result.extended_simulator[:12]} --to FOLDER"
        )
    return tuple(steps)


def _valley(pair: Inseparable) -> str:
    """A pair of causes that make up for each other, and how far."""
    cause, rival = (
        ", ".join(
            f"{name} {number(e.low)} to {number(e.high)}{'' if e.unit == '1' else ' ' + e.unit}"
            for name, e in of.items()
        )
        for of in (pair.cause, pair.rival)
    )
    return f"How much is {pair.between[0]} and how much {pair.between[1]}: {cause} goes with {rival}."


def _tie(cause: Cause) -> str:
    how = "" if cause.separate_by else " What would tell them apart is not known."
    others = " and ".join(cause.equivalent)
    explain = "explains" if len(cause.equivalent) == 1 else "explain"
    return f"{others} {explain} it as well as {cause.key}.{how}"
