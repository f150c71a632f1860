"""The text of a diagnosis beside its numbers: where the error lies, inputs, notes, and what to record next."""

from collections.abc import Iterator, Mapping, Sequence

from dynreg.data.names import joint_of
from dynreg.data.recording import Recording
from dynreg.data.units import suffix
from dynreg.diagnose.account import Account
from dynreg.diagnose.diagnose import Diagnosed, no_candidates
from dynreg.diagnose.doubts import at_bounds
from dynreg.diagnose.identifiability import Unidentified
from dynreg.diagnose.joints import damping_of, passive_joints
from dynreg.diagnose.measured import measured_effects
from dynreg.diagnose.noise import own_noise
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.threshold import ALARMS, CONFIDENCE, FEW, USUAL
from dynreg.diagnose.verdict import rivals
from dynreg.diagnose.where import ErrorRow
from dynreg.errors import command
from dynreg.evidence.interval import NORMAL_90
from dynreg.replay.holes import holes, sentence, without_start
from dynreg.results.diagnosis import Pulled
from dynreg.results.sentence import times
from dynreg.sim.robot import Robot
from dynreg.sim.sets import FRICTION_FIELDS
from dynreg.verbs.held_out import held_out_notes
from dynreg.verbs.unscored import unscored_notes

WORDS = {
    "reversals": "where the motion reverses",
    "low_speed": "at low speed",
    "high_speed": "at high speed",
    "high_load": "under high load",
    "saturation": "where the drive is at its limit",
    "drive_off": "while the drive is off",
    "early": "in the first third of the rollouts",
    "late": "in the last third of the rollouts",
    "log_begin": "in the first third of the log",
    "log_end": "in the last third of the log",
}
MOVED = 1.0  # sigma: from here on a value is not robot.toml's, however wide its interval is
MUCH = 0.2  # of the error, which is told of a joint that nothing drives
OWN = tuple(FRICTION_FIELDS.values())  # what such a joint has in MuJoCo's model
DRIFT = ("overall", "early", "late")  # the error of every rollout grows with time: these regimes say nothing


def finding(rows: tuple[ErrorRow, ...]) -> str:
    """One sentence: the regime with the largest excess error, over the mean error outside the regime."""
    overall = {r.channel: r for r in rows if r.regime == "overall"}
    excess: dict[str, float] = {}
    candidates = [r for r in rows if r.regime not in DRIFT and r.ratio and r.ratio > 1.2 and r.samples >= 10]
    for r in candidates:
        excess[r.regime] = excess.get(r.regime, 0.0) + _excess(r)
    regime = max(excess, key=lambda k: excess[k], default=None)
    if regime is None or excess[regime] < 0.05:
        worst = max(overall.values(), key=lambda r: r.share, default=None)
        if worst is None or not worst.share > 0:
            return "No error was measured."
        return f"{100 * worst.share:.0f} % of the error is on {worst.channel}; no regime of its motion stands out."
    inside = [r for r in rows if r.regime == regime]
    top = max((r for r in candidates if r.regime == regime), key=_excess)
    among = "" if len(inside) == 1 else f", most of it on {top.channel}"
    return (
        f"{100 * sum(r.share for r in inside):.0f} % of the error lies {WORDS[regime]}{among}. The error of "
        f"{top.channel} is {top.error:.3g} {top.unit} there ({times(top.ratio)} times the error elsewhere), in "
        f"{100 * top.samples / overall[top.channel].samples:.0f} % of the samples."
    )


def inputs(problem: Problem, recording: Recording) -> tuple[str, ...]:
    """Which inputs were measured, and which were assumed."""
    out = []
    for table in problem.model.robot.file.inputs:
        if table.name in recording.names:
            out.append(
                f"{table.name} was measured and drives the simulators. Where the motion changes it, it is partly a "
                "result of the motion"
            )
        elif table.optional:
            out.append(f"{table.name} was not measured: {table.nominal:g}{suffix(table.unit)} is assumed")
    for name, by in measured_effects(problem.model.robot, problem.data.train).items():
        out.append(f"{name} is not a candidate: the measured input {by} already contains it")
    return tuple(out)


def notes(
    made: Diagnosed,
    seen: Account,
    recording: Recording,
    parameters: dict[str, Pulled],
    options: DiagnosisOptions,
) -> tuple[str, ...]:
    """Limits of the diagnosis: data left out, an unknown noise floor, parameters at a bound or not identifiable."""
    out = []
    lost = holes(made.problem.model.robot, recording)
    if lost:
        out.append(f"{sentence(recording, lost)}. Rollouts over such rows are left out")
    if some := without_start(made.problem.model.robot, recording):
        out.append(f"{some}. Log the same channels in all of them")
    given = made.found.base.hypothesis.terms
    if given:
        out.append(
            f"the simulator at the start of the search already has {', '.join(t.key for t in given)}. The search fits "
            "its size again, and does not name it as a cause"
        )
    if options.joints:
        out.append(
            f"only {', '.join(options.joints)} was diagnosed: parameters that do not act there keep their initial value"
        )
    out += not_looked_for(made.problem, options)
    if made.verdict != "none":
        out += not_driven(made.problem.model.robot, seen.where)
    out += not_ranked(made, options)
    noise = made.evidence.noise
    if noise.ratio is None:
        out.append(
            f"no run was repeated and robot.toml states no noise of {noise.channel}: what no simulator can explain is "
            "not known. State the noise, or repeat a run"
        )
    elif noise.basis == "stated_noise":
        out.append(
            "no run was repeated: the residual is compared with the stated sensor noise, the least that any simulator "
            "leaves"
        )
    robot = made.problem.model.robot
    stated = dict(zip(robot.channels, robot.sensor_noise, strict=True))
    for name, sigma in own_noise(robot, made.problem.train_part(recording)).items():
        out.append(
            f"the noise of {name} is about {sigma / stated[name]:.0f} times the value in robot.toml: correct it there"
        )
    out += zeros_moved(robot, made.evidence.zeros)
    out += at_the_edge([name for name, _ in at_bounds(made.problem.model.coordinates, made.found.current)])
    out += held_out_notes(robot, made.problem.data.windows, made.problem.data.parts)
    out += unscored_notes(robot, made.problem.data.windows, made.problem.data.parts)
    out += same_words(seen.same)
    return (*out, *identifiability_words(made.problem.model.robot, seen.unidentified, parameters))


def zeros_moved(robot: Robot, zeros: Mapping[str, float]) -> Iterator[str]:
    """A line on the zeros that explain an error without a cause, by channel; see `verdict.Evidence`."""
    if zeros:
        units = {c.name: suffix(c.unit) for c in robot.file.channels}
        by = ", ".join(f"{name} by up to {most:.2g}{units[name]}" for name, most in zeros.items())
        yield f"robot.toml states that episodes have zeros of their own: those explain the error, if moved ({by})"


def at_the_edge(names: Sequence[str]) -> Iterator[str]:
    """A line on the parameters that a wider range would let go further; see `doubts.at_bounds`."""
    if names:
        yield (
            f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} at the edge of the allowed range: widen the "
            "range in robot.toml, or look for another cause"
        )


def not_driven(robot: Robot, rows: Sequence[ErrorRow]) -> Iterator[str]:
    """A line on each joint without a drive that holds much of the error: no effect has a place there."""
    for joint in passive_joints(robot):
        share = sum(r.share for r in rows if r.regime == "overall" and joint_of(r.channel) == joint)
        if share < MUCH:
            continue
        pairs = zip(robot.space.names, robot.setters, strict=True)
        own = [name for name, several in pairs if any(a.path in OWN and joint in a.elements for a in several)]
        do = f"{', '.join(own)} {'is' if len(own) == 1 else 'are'} fitted there"
        if not own:
            do = f"let [[parameters]] in robot.toml set its damping, as {damping_of(joint)!r}"
        yield (
            f"{joint} is not driven: {100 * share:.0f} % of the calibrated simulator's error is on it, and effects act "
            f"at driven joints alone; {do}"
        )


def not_fitted_alone(why: Mapping[str, str], others: int) -> Iterator[str]:
    """A line on each of several recordings that could not be fitted alone, by name; others : how many could."""
    for name, problem in why.items():
        yield f"{name} was not fitted alone: {problem}"
    if why and others < 2:
        yield (
            "Too few recordings were fitted alone to tell what is the same in all: cut shorter rollouts with "
            "--horizon, or record longer"
        )


def same_words(pairs: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """The parameters that no recording like this tells from an effect, and what to do about it."""
    return tuple(
        f"the effect {effect} and the parameter {parameter} do the same here: only what both do together is known, and "
        "neither value alone. Give the parameter a fixed value in robot.toml, or ask again with --without "
        f"{effect.partition('[')[0]}"
        for effect, parameter in pairs
    )


def not_looked_for(problem: Problem, options: DiagnosisOptions) -> Iterator[str]:
    """A line for each reason for which effects have no place among the candidates."""
    left = no_candidates(problem.model.robot, problem.data, options, problem.terms)
    for why in dict.fromkeys(left.values()):
        names = [name for name, reason in left.items() if reason == why]
        yield f"{', '.join(names)} {'was' if len(names) == 1 else 'were'} not looked for: {why}"


def not_ranked(made: Diagnosed, options: DiagnosisOptions) -> Iterator[str]:
    """A line on the candidates that were asked for and have no place in the ranking, with the reason of each."""
    rounds = made.found.rounds
    scored = (one.point for naming in rounds for one in naming.ranking)
    held = {t.effect.id for point in (*scored, made.found.base) for t in point.hypothesis.terms}
    offered = {term.effect.id for term in made.problem.terms}
    small = {name for naming in rounds for name in naming.small}
    reasons = {
        True: "its fitted size is below half the weak one",
        False: "others promised more in a first look",
    }
    left = [name for name in options.effects or () if name in offered - held]
    if left:
        yield f"not ranked: {', '.join(f'{name} ({reasons[name in small]})' for name in left)}"


def identifiability_words(
    robot: Robot, found: Unidentified, parameters: Mapping[str, Pulled]
) -> tuple[str, ...]:
    """The parameters that the recording does not identify, alone or together, and what to do about it.

    parameters : as they were fitted, by name.
    """
    out, more = [], "" if robot.planar else ", or add a known mass in some runs"
    held = [name for name, _ in found.held]
    moved = [name for name in (*found.alone, *held) if _pull(parameters[name]) >= MOVED]
    kept = [name for name in found.alone if name not in moved]
    if kept:
        own = (
            "its value stays within 1 sigma of that"
            if len(kept) == 1
            else "their values stay within 1 sigma of those"
        )
        out.append(f"the recording does not identify {', '.join(kept)}: {own} of robot.toml")
    if moved:
        values = ", ".join(_shift(name, parameters[name]) for name in moved)
        them = "it" if len(moved) == 1 else "them"
        out.append(
            f"the recording moves {values}, but does not determine {them} better than robot.toml does: a missing "
            f"effect may cause the shift. Measure {them}"
        )
    exact = [f"{name} {times(ratio)} times" for name, ratio in found.held if name not in moved]
    if exact:
        out.append(
            f"robot.toml states {', '.join(exact)} more exactly than the recording tells: the interval is robot.toml's"
        )
    unknown = f"the recording does not tell their scale. Measure one of them{more}"
    out += [f"{_scaled(*one)}: {unknown}" for one in found.together]
    return tuple(out)


def _scaled(up: Sequence[str], down: Sequence[str]) -> str:
    """That parameters which rise and others which fall with them leave the motion as it is."""
    grow = f"{', '.join(up)} {'grow' if up[1:] else 'grows'}"
    shrink = f" and {', '.join(down)} {'shrink' if down[1:] else 'shrinks'}" if down else " together"
    return f"the motion hardly changes when {grow}{shrink}"


def _pull(p: Pulled) -> float:
    """How far a fitted value is from robot.toml's [sigma]: of its own interval where that states no tolerance."""
    if p.pulled_sigma is not None:
        return abs(p.pulled_sigma)
    width = 0.0 if p.low is None or p.high is None else p.high - p.low
    return abs(p.value - p.nominal) * 2.0 * NORMAL_90 / width if width > 0 else 0.0


def _shift(name: str, p: Pulled) -> str:
    """From where to where a parameter was moved: "tip_mass from 0.189 to 0.235 kg"."""
    return f"{name} from {p.nominal:.3g} to {p.value:.3g}{suffix(p.unit)}"


def experiments(made: Diagnosed) -> tuple[str, ...]:
    """Recordings to make next: data that separate the first cause from its rivals, or repeated runs."""
    if made.verdict in ("ambiguous", "partly_explained") and made.found.accepted:
        first = made.found.rounds[0]
        term = first.chosen.point.hypothesis.terms[-1]
        apart = rivals(made.problem.model.robot, first)
        how = term.effect.separate_by_at(term.at)
        return (f"To separate {term.key} from {', '.join(apart)}: {how}",) if apart else ()
    if made.verdict == "unknown":
        return ("Repeat the same commands: no simulator can explain the difference of repeated runs",)
    return ()


def excite_command(robot: str, first: str, second: str) -> str:
    """The command that writes an experiment which separates two causes."""
    return command("excite", robot, "--for", f"{first},{second}", "-o", "next.csv")


def threshold_note(scores: Sequence[float]) -> str:
    """How the threshold was found, from the best scores [nats] of simulated robots without an effect."""
    if not scores:
        return "a default: this robot was not simulated without effects"
    many = f"{len(scores)} simulated robot{'s' * (len(scores) > 1)} without an effect"
    reached = f"{many} reached at most {max(scores):.3g} nats under these commands"
    if len(scores) < FEW:
        return f"{reached}: too few to set one below the usual {USUAL:.3g} nats, which takes {FEW} of them"
    return (
        f"{reached}. With {100 * CONFIDENCE:g} % confidence at most {100 * ALARMS:g} in 100 of them would exceed the "
        "threshold, by their largest scores. More runs make it more certain"
    )


def _excess(row: ErrorRow) -> float:
    """Share of the error that vanishes if the error in the regime falls to the mean error elsewhere."""
    return row.share * (1.0 - 1.0 / row.ratio) if row.ratio else 0.0
