"""What a result says, in sentences and short numbers."""

from dynreg.results import Calibration, EffectEstimate, Estimate, Gain, Neighbours

STAGES = {
    "nominal": "nominal",
    "nearest": "nearest",
    "replayed": "replayed and re-ranked",
    "synthesised": "synthesised",
    "answer": "answer",
}


def number(value: float | int | None) -> str:
    """Three digits, as people read them; `-` where there is none.

    >>> number(0.123456), number(1234.5), number(7), number(None)
    ('0.123', '1234', '7', '-')
    """
    if value is None:
        return "-"
    if isinstance(value, int):
        return str(value)
    return f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"


def count(how_many: int, what: str) -> str:
    """A number of things.

    >>> count(1, "simulation"), count(2, "simulation")
    ('1 simulation', '2 simulations')
    """
    return f"{how_many} {what}{'' if how_many == 1 else 's'}"


def interval(estimate: Estimate | EffectEstimate) -> str:
    """Value with its 90 % interval, marked where it lies on the edge of the range."""
    edge = " (at the edge)" if estimate.at_bound else ""
    return f"{number(estimate.value)} [{number(estimate.low)}, {number(estimate.high)}]{edge}"


def gain_words(gain: Gain) -> str:
    """A gain against the nominal model, as a sentence; one that may be chance is not called a gain."""
    if gain.low is None or gain.high is None:
        side = "below" if gain.value >= 0 else "above"
        size = f"{100 * abs(gain.value):.0f} %"
        return f"Its replay error is {size} {side} the nominal model's (too few episodes for an interval)."
    interval = f"90 % interval of the gain: {100 * gain.low:.0f} to {100 * gain.high:.0f} %"
    if gain.low <= 0 <= gain.high:
        return f"It does not clearly differ from the nominal model ({interval})."
    side = "below" if gain.low > 0 else "above"
    return f"Its replay error is {100 * abs(gain.value):.0f} % {side} the nominal model's ({interval})."


def verdict(result: Neighbours | Calibration) -> str:
    """The answer in a sentence."""
    if isinstance(result, Calibration):
        return _calibrated(result)
    name = result.recording_name
    if not result.fits:
        return f"No simulator of this population fits {name}: do not rely on the answer below."
    if result.answer_kind == "nominal":
        return f"For {name} the nominal model stands: no simulator near it did better."
    chosen = f"the {result.answer_kind} simulator {result.answer[:12]}"
    if result.answer_kind == "neighbour":
        names = [n.name for n in result.neighbours if n.entry == result.answer]
        chosen = f"simulator {names[0] if names else result.answer[:12]}"
    gain = f" {gain_words(result.gain)}" if result.gain else ""
    return f"For {name}, use {chosen}.{gain}"


def _calibrated(result: Calibration) -> str:
    text = (
        f"{result.method} fitted {count(len(result.parameters), 'parameter')} of {result.robot} to"
        f" {result.recording[:12]} in {count(result.cost.rollouts, 'simulation')}:"
        f" replay error {number(result.train_error)} (nominal {number(result.nominal_train_error)})"
    )
    if result.test_error is None:
        return text + "."
    return (
        text
        + f", on the test part {number(result.test_error)} (nominal {number(result.nominal_test_error)})."
    )


def next_steps(result: Neighbours | Calibration) -> tuple[str, ...]:
    """What to do with the result, the first thing first."""
    if isinstance(result, Calibration):
        return (f"Compare with what the registry gives: dynreg query {result.recording[:12]}",)
    steps = []
    if not result.fits:
        steps.append(f"Check the log: dynreg doctor LOG --robot {result.robot}")
        steps.append(
            "Widen the parameter ranges in robot.toml, or add what the model leaves out, and populate."
        )
    if not result.parts.get("test"):
        steps.append("Nothing was held out: record more episodes, or name some with --hold-out.")
    if result.fits:
        steps.append(f"Take the simulator along: dynreg export {result.answer[:12]} --to FOLDER")
    return tuple(steps)
