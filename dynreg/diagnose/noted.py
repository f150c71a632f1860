"""What a reader of a diagnosis must know beside its numbers: inputs, notes, and what to record next."""

from typing import TYPE_CHECKING

from dynreg.data.recording import Recording
from dynreg.diagnose.evidence import Evidence, rivals
from dynreg.diagnose.name import Naming
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.shown import shown
from dynreg.replay.holes import holes, sentence
from dynreg.results.diagnosis import Pulled, Verdict

if TYPE_CHECKING:
    from dynreg.diagnose.diagnose import Found
    from dynreg.diagnose.settings import Settings


def inputs(problem: Problem, recording: Recording) -> tuple[str, ...]:
    """What of the inputs was measured, and what was assumed."""
    out = []
    for table in problem.robot.file.inputs:
        if table.name in recording.names:
            out.append(
                f"{table.name} was measured and drives the simulators; where the motion itself changes it, "
                "it is partly a consequence"
            )
        elif table.optional:
            out.append(f"{table.name} was not measured: {table.nominal:g} {table.unit} is assumed")
    for name, by in shown(problem.robot, problem.windows).items():
        out.append(f"{name} is no candidate: what was measured as {by} already holds it")
    return tuple(out)


def notes(
    problem: Problem,
    recording: Recording,
    parameters: dict[str, Pulled],
    evidence: Evidence,
    settings: "Settings",
) -> tuple[str, ...]:
    """What was left out, what the verdict could not be held against, and which parameters stand at a bound."""
    out = []
    lost = holes(problem.robot, recording)
    if lost:
        out.append(f"{sentence(recording, lost)}: rollouts with such rows are left out")
    if settings.joints:
        out.append(
            f"{', '.join(settings.joints)} alone: parameters that cannot be seen there stay where the search began"
        )
    if evidence.noise.basis == "stated_noise":
        out.append(
            "no run was repeated: what is left is held against the stated sensor noise, which is less than it can be"
        )
    at_bound = [name for name, p in parameters.items() if p.at_bound]
    if at_bound:
        out.append(
            f"{', '.join(at_bound)} at the edge of the allowed range: widen it in robot.toml, or look on"
        )
    return tuple(out)


def experiments(found: "Found", verdict: Verdict) -> tuple[str, ...]:
    """What to record next: what separates the first cause from its rivals, or repeats and more excitation."""
    if verdict in ("ambiguous", "partly_explained") and found.accepted:
        naming: Naming = found.rounds[0]
        term = naming.chosen.point.hypothesis.terms[-1]
        apart = rivals(found.problem.robot, naming)
        out = [f"To tell {term.key} from {', '.join(apart)}: {term.effect.separate_by}"] if apart else []
        return tuple(out)
    if verdict == "unknown":
        return (
            "Repeat the same commands: what differs from run to run cannot be explained by any simulator",
        )
    return ()


def threshold_note(found: "Found") -> str:
    """Where the threshold comes from."""
    scores = found.threshold.scores
    if not scores:
        return "a default: this robot was not simulated without effects"
    return (
        f"{len(scores)} simulated robots without an effect reached at most {max(scores):.3g} nats under these "
        "commands; by their largest scores one in 100 would exceed the threshold, which more runs make surer"
    )
