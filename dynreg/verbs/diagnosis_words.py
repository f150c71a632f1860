"""What a diagnosis says in words beside its numbers: where the error is, inputs, notes, and what to record next."""

from dynreg.data.recording import Recording
from dynreg.diagnose.account import Account
from dynreg.diagnose.diagnose import Diagnosed
from dynreg.diagnose.loose import Loose
from dynreg.diagnose.noise import own_noise
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.shown import shown
from dynreg.diagnose.verdict import rivals
from dynreg.diagnose.where import ErrorRow
from dynreg.replay.holes import holes, sentence
from dynreg.results.diagnosis import Pulled
from dynreg.results.sentence import times
from dynreg.sim.robot import Robot

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
DRIFT = ("overall", "early", "late")  # a rollout's error grows anyway: that names no place


def finding(rows: tuple[ErrorRow, ...]) -> str:
    """One sentence: where most of a simulator's error is that would not be there at the mean error elsewhere."""
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
    said = f"{100 * sum(r.share for r in inside):.0f} % of the error lies {WORDS[regime]}"
    among = "" if len(inside) == 1 else f", most of it on {top.channel}"
    return (
        f"{said}{among}: {top.error:.3g} {top.unit} there in {100 * top.samples / overall[top.channel].samples:.0f} % "
        f"of the samples of {top.channel}, {times(top.ratio)} times the error elsewhere."
    )


def inputs(problem: Problem, recording: Recording) -> tuple[str, ...]:
    """What of the inputs was measured, and what was assumed."""
    out = []
    for table in problem.model.robot.file.inputs:
        if table.name in recording.names:
            out.append(
                f"{table.name} was measured and drives the simulators; where the motion itself changes it, "
                "it is partly a consequence"
            )
        elif table.optional:
            out.append(f"{table.name} was not measured: {table.nominal:g} {table.unit} is assumed")
    for name, by in shown(problem.model.robot, problem.data.windows).items():
        out.append(f"{name} is no candidate: what was measured as {by} already holds it")
    return tuple(out)


def notes(
    made: Diagnosed,
    seen: Account,
    recording: Recording,
    parameters: dict[str, Pulled],
    options: DiagnosisOptions,
) -> tuple[str, ...]:
    """What was left out, what the verdict could not be held against, and which parameters stand at a bound or open."""
    out = []
    lost = holes(made.problem.model.robot, recording)
    if lost:
        out.append(f"{sentence(recording, lost)}: rollouts with such rows are left out")
    given = made.found.base.hypothesis.terms
    if given:
        out.append(
            f"{', '.join(t.key for t in given)} came with the simulator that the search began with: fitted anew, and "
            "not named again"
        )
    if options.joints:
        out.append(
            f"{', '.join(options.joints)} alone: parameters that cannot be seen there stay where the search began"
        )
    if made.evidence.noise.basis == "stated_noise":
        out.append(
            "no run was repeated: what is left is held against the stated sensor noise, which is less than it can be"
        )
    robot = made.problem.model.robot
    stated = dict(zip(robot.channels, robot.sensor_noise, strict=True))
    for name, sigma in own_noise(robot, recording).items():
        out.append(
            f"{name} is about {sigma / stated[name]:.0f} times as noisy as robot.toml states: correct its noise there"
        )
    at_bound = [name for name, p in parameters.items() if p.at_bound]
    if at_bound:
        out.append(
            f"{', '.join(at_bound)} at the edge of the allowed range: widen it in robot.toml, or look on"
        )
    return (*out, *loose_words(made.problem.model.robot, seen.loose))


def loose_words(robot: Robot, loose: Loose) -> tuple[str, ...]:
    """The parameters that the recording does not tell, alone or together, and what to do about it."""
    out, more = [], "" if robot.planar else ", or add a known mass in some runs"
    if loose.alone:
        out.append(f"the recording does not tell {', '.join(loose.alone)}: what robot.toml states stands")
    for up, down in loose.together:
        against = f" against {', '.join(down)}" if down else ""
        out.append(
            f"the recording hardly tells the scale of {', '.join(up)}{against}: they can change "
            f"together with the motion nearly the same; measure one of them{more}"
        )
    return tuple(out)


def experiments(made: Diagnosed) -> tuple[str, ...]:
    """What to record next: what separates the first cause from its rivals, or repeats and more excitation."""
    if made.verdict in ("ambiguous", "partly_explained") and made.found.accepted:
        first = made.found.rounds[0]
        term = first.chosen.point.hypothesis.terms[-1]
        apart = rivals(made.problem.model.robot, first)
        return (f"To tell {term.key} from {', '.join(apart)}: {term.effect.separate_by}",) if apart else ()
    if made.verdict == "unknown":
        return (
            "Repeat the same commands: what differs from run to run cannot be explained by any simulator",
        )
    return ()


def excite_command(robot: str, first: str, second: str) -> str:
    """The command that writes an experiment between two causes."""
    pair = f"'{first},{second}'" if "[" in first + second else f"{first},{second}"
    return f"dynreg excite {robot} --for {pair} -o next.csv"


def threshold_note(made: Diagnosed) -> str:
    """Where the threshold comes from."""
    scores = made.threshold.scores
    if not scores:
        return "a default: this robot was not simulated without effects"
    return (
        f"{len(scores)} simulated robots without an effect reached at most {max(scores):.3g} nats under these "
        "commands; by their largest scores one in 100 would exceed the threshold, which more runs make surer"
    )


def _excess(row: ErrorRow) -> float:
    """Share of the error that would go if the regime were as good as elsewhere."""
    return row.share * (1.0 - 1.0 / row.ratio) if row.ratio else 0.0
