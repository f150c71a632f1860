"""A diagnosis in sentences: what it found, what it cannot tell, and what to do next."""

import math

from dynreg.data.units import suffix
from dynreg.errors import command
from dynreg.report.words import count, interval, number, to_hold_out
from dynreg.results.diagnosis import (
    Cause,
    Diagnosis,
    EffectEstimate,
    Inseparable,
    Noise,
    Pulled,
    Ranked,
    RolloutError,
)
from dynreg.results.helped import (
    by_calibration,
    helping,
    main_parameters,
    worse_on_most,
)
from dynreg.results.refit import Refit
from dynreg.results.result import Gain
from dynreg.results.sentence import diagnosis_details, times
from dynreg.sim.engine import ENGINES
from dynreg.verbs.diagnosis_words import excite_command
from dynreg.verbs.simulator import NOMINAL, WORDS

FLOORS = {
    "repeatability": "the difference of repeated runs",
    "stated_noise": "the error from the sensor's stated noise",
}
SHOWN_RANKS = 8  # of the ranking, in tables and on a page
PART = {"test": "held-out test part", "select": "select part", "fit": "fit part"}
SHOWN_JOINTS = 6
ROUNDING = 1e-6  # a value passes through the coordinates of a fit and back
NOT_BETTER = "Do not use the {left} simulator: {began} predicts the held-out part better."
VERDICTS = {
    "named": "named",
    "ambiguous": "ambiguous",
    "partly_explained": "partly explained",
    "unknown": "unknown cause",
    "none": "nothing missing",
}


def standing(result: Diagnosis, ranked: Ranked) -> str:
    """The standing of a ranked hypothesis: the verdict of a cause, a tie with one, or why it lost."""
    cause = _cause_of(result, ranked)
    if cause is not None and cause.key == ranked.key:
        return VERDICTS[cause.verdict]
    if cause is not None and ranked.key in cause.equivalent:
        return "explains it as well"
    if ranked.note:
        return ranked.note
    return "explains less" if ranked.score_nats >= result.threshold_nats else "below the threshold"


def _cause_of(result: Diagnosis, ranked: Ranked) -> Cause | None:
    """The cause of the round in which a hypothesis was ranked; None where that found none."""
    return result.causes[ranked.round - 1] if ranked.round <= len(result.causes) else None


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


def parameter_text(e: Pulled) -> str:
    """The value of a parameter with its interval; what was not fitted has none."""
    return interval(e) if e.fitted else f"{number(e.value)}, not fitted"


def as_given(result: Diagnosis) -> tuple[str, ...]:
    """The parameters that were not fitted and are as in robot.toml."""
    return tuple(
        name
        for name, e in result.parameters.items()
        if not e.fitted and math.isclose(e.value, e.nominal, rel_tol=ROUNDING, abs_tol=ROUNDING)
    )


def errors_by_importance(result: Diagnosis) -> tuple[RolloutError, ...]:
    """The error of every channel, those of the base first: a table that is cut still says whether the robot moved as
    the simulator does, which no joint of a legged robot tells."""
    return tuple(sorted(result.errors or (result.error,), key=lambda e: not e.channel.startswith("base/")))


def stable_word(one: Refit) -> str:
    """Whether a value is the same in all recordings."""
    if one.same:
        return "same in all"
    return f"only in {' and '.join(one.there)}" if one.there and one.absent else "differs"


def gain_cell(gain: Gain | None) -> str:
    """A gain with its interval in percent."""
    if gain is None:
        return "-"
    if gain.low is None or gain.high is None:
        return f"{100 * gain.value:.0f} %"
    return f"{100 * gain.value:.0f} [{100 * gain.low:.0f}, {100 * gain.high:.0f}] %"


def noise_words(noise: Noise | None) -> str:
    """The unexplained error, beside what no simulator can explain."""
    if noise is None:
        return "The unexplained error cannot be judged: no run was repeated and no noise is stated."
    left = f"The unexplained error of {noise.channel} is {number(noise.left)} {noise.unit}"
    white = {True: " It looks like white noise.", False: " It is not white noise.", None: ""}[noise.white]
    if noise.ratio is None:
        return f"{left}. {FLOORS[noise.basis].capitalize()} is not known.{white}"
    return f"{left}: {times(noise.ratio)} times {FLOORS[noise.basis]} ({number(noise.floor)} {noise.unit}).{white}"


def residual_words(result: Diagnosis) -> tuple[str, ...]:
    """How well the signals of each joint predict its unexplained acceleration; () where that was not asked."""
    out = []
    for rest in (result.rest or ())[:SHOWN_JOINTS]:
        of = f"The unexplained acceleration of {rest.joint} is {number(rest.left)} {rest.unit} (1 sigma)."
        if told := told_by(result, rest.joint):
            parts = ", ".join(f"{signal} {percent:.0f} %" for signal, percent in told)
            out.append(f"{of} Its signals predict {100 * rest.told:.0f} % of it on unseen data: {parts}.")
        else:
            out.append(f"{of} Its signals predict none of it.")
    return tuple(out)


def told_by(result: Diagnosis, joint: str) -> list[tuple[str, float]]:
    """(signal, share [%]) of a joint's residual, for the signals that predict some of it, the largest first."""
    told = [r for r in result.residual or () if r.joint == joint and r.share > 0]
    return [(signal_words(r.signal), 100 * r.share) for r in sorted(told, key=lambda r: -r.share)]


def signal_words(signal: str) -> str:
    """A signal in words, with the joint that it belongs to where that is another.

    >>> signal_words("sign_of_velocity"), signal_words("joint_5/velocity")
    ('sign of velocity', 'velocity of joint_5')
    """
    joint, _, own = signal.rpartition("/")
    return own.replace("_", " ") + (f" of {joint}" if joint else "")


def unsaid(result: Diagnosis) -> tuple[str, ...]:
    """What the recording cannot tell, and where a number says less than it seems to."""
    said = [_tie(cause) for cause in result.causes if cause.equivalent]
    said += _parts(result)
    said += [_valley(pair) for pair in result.inseparable]
    for cause in result.causes:
        edge = [name for name, e in cause.parameters.items() if e.at_bound]
        said += [f"{name} of {cause.key} lies on the edge of what a fit may reach." for name in edge]
    for name, e in result.parameters.items():
        if e.at_bound:
            said.append(f"{name} lies on the edge of its range: its interval says little.")
    if result.noise is None or result.noise.basis == "stated_noise":
        said.append("No run was repeated, so the robot's own scatter is not known.")
    if not result.parts.get("test"):
        said.append("Nothing was held out: the errors are of the data that chose the causes.")
    if not result.threshold.runs:
        said.append(
            "The threshold is the usual one. Leave out --threshold-runs 0 to let simulations of this robot set it."
        )
    return tuple(said)


def diagnosis_steps(result: Diagnosis) -> tuple[str, ...]:
    """What to do next, the first thing first."""
    steps = [NOT_BETTER.format(left=result.left, began=result.began)] if result.worse else []
    if (
        result.causes[:1] == helping(result)[:1]
    ):  # what separates a cause that is not to be relied on is no next step
        steps += result.experiments
    for cause in helping(result):
        for other in [key for key in cause.equivalent if key not in cause.inseparable][:1]:
            steps.append(f"Commands that separate them: {excite_command(result.robot, cause.key, other)}")
    for pair in result.inseparable:
        step = f"Commands that separate {pair.between[0]} from {pair.between[1]}: {pair.experiment}"
        if not any(pair.experiment in other for other in steps):
            steps.append(step)
    if result.verdict == "unknown":
        steps.append(f"Check the log first: {command('doctor', 'LOG', '--robot', result.robot)}")
    if not result.parts.get("test"):
        steps.append(to_hold_out(result.parts, "give a shorter --horizon"))
    if result.extended_simulator and not result.worse and helping(result):
        steps.append(_export("extended", result.extended_simulator))
    elif worse_on_most(result) and main_parameters(result):
        told = ", ".join(f"{name} = {number(e.value)}" for name, e in main_parameters(result).items())
        steps.append(
            f"Set {told} as `nominal` in robot.toml, and leave the other values: they are what makes channels worse"
        )
    elif result.calibrated_simulator and _clearly_better(result):
        steps.append(_export("calibrated", result.calibrated_simulator))
    elif result.extended_simulator and not result.worse:
        steps.append(f"See whether its simulators predict better: {_compared(result)}")
    return tuple(steps)


def _export(kind: str, simulator: str) -> str:
    written = command("export", simulator[:12], "--as", "robot", "--to", "FOLDER")
    return f"Export the {kind} simulator as a robot folder: {written}"


def _compared(result: Diagnosis) -> str:
    """The command that compares the simulator that it leaves with that at the start."""
    start = result.start if result.start in (*WORDS, NOMINAL) else result.start[:12]
    return command("compare", result.recording_name, "--with", f"{start},diagnosed")


def _clearly_better(result: Diagnosis) -> bool:
    """Whether the test part shows that the calibrated simulator is better than the one at the start."""
    gain = by_calibration(result)
    return gain is not None and gain.low is not None and gain.low > 0


def details(result: Diagnosis) -> tuple[str, ...]:
    """The main figures under the verdict, and whether most of them hide that channels are predicted worse."""
    return tuple(line for line in (*diagnosis_details(result), _worse_words(result)) if line)


def _worse_words(result: Diagnosis) -> str:
    """On how many channels a fitted simulator errs more, with the likely reason; "" where not on most."""
    worse = worse_on_most(result)
    if worse is None:
        return ""
    kind, many = worse
    said = f"On {many} of {len(result.errors)} channels the {kind} simulator errs more than {result.began}"
    if result.engine not in ENGINES or ENGINES[result.engine].planar:  # few of whose errors are its step's
        return f"{said}."
    check = command("robots", "check", "FOLDER")
    return (
        f"{said}. A likely reason is the time step or the integrator: parameters are fitted as for a finer step. Halve "
        "`timestep` in robot.toml and see whether the nominal simulator errs less. "
        f"`{check}` warns only of a step that is far too long."
    )


def hint(result: Diagnosis) -> str | None:
    """The command to type next where it is another than to see the page: to compare, if the start is better."""
    return f"{_compared(result)}  # {_warning(result)}" if result.worse else None


def _warning(result: Diagnosis) -> str:
    said = NOT_BETTER.format(left=result.left, began=result.began)
    return f"{said[0].lower()}{said[1:].removesuffix('.')}"


def _valley(pair: Inseparable) -> str:
    """A pair of causes that make up for each other, and how far."""
    cause, rival = (
        ", ".join(f"{name} {number(e.low)} to {number(e.high)}{suffix(e.unit)}" for name, e in of.items())
        for of in (pair.cause, pair.rival)
    )
    return f"The shares of {pair.between[0]} and {pair.between[1]}: {cause} goes with {rival}."


def _parts(result: Diagnosis) -> list[str]:
    """What is said of those of a cause's exact group that explain less than it, and more than chance would."""
    said = []
    for ranked in result.ranking:
        cause = _cause_of(result, ranked)
        less = cause is not None and ranked.key in cause.inseparable and ranked.key not in cause.equivalent
        if less and ranked.score_nats >= result.threshold_nats:
            nats = f"{number(ranked.score_nats)} of the {number(cause.evidence_nats)} nats of {cause.key}"
            said.append(f"{ranked.key} explains a part: {nats}. Commands alone do not separate the two.")
    return said


def _tie(cause: Cause) -> str:
    how = "" if cause.separate_by else " No experiment is known that separates them."
    others = " and ".join(cause.equivalent)
    explain = "explains" if len(cause.equivalent) == 1 else "explain"
    return f"{others} {explain} it as well as {cause.key}.{how}"
