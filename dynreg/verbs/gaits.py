"""Stored gaits: read, tried again in their simulators, and named as the source of a recording."""

from dataclasses import replace
from pathlib import Path

from pydantic import ValidationError

from dynreg.data.recording import Recording
from dynreg.errors import AmbiguousError, NoMatchError, UsageError, command
from dynreg.gait.play import require_own
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import task_of
from dynreg.gait.trials import Trials, simulators_of
from dynreg.registry import Registry, ResultRecord
from dynreg.results.gait import Gait
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.simulators import simulator, told_last


def gait_of(registry: Registry, ref: str | Path) -> Gait:
    """A gait by its id, `@last`, the path of its JSON document, or the id of a recording (its last gait).

    Raises NoMatchError if there is none, UsageError if `ref` is not a gait or, for a robot of the registry, if the
    genes or limits in the file are not those of its robot.
    """
    if not Path(ref).is_file():
        return Gait.model_validate(_record(registry, str(ref)).document)
    try:
        gait = Gait.model_validate_json(Path(ref).read_bytes())
    except ValidationError as problem:
        first = problem.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise UsageError(
            f"{str(ref)!r} is not a gait: {where}: {first['msg']}".replace(": :", ":"),
            expected="the JSON document that `dynreg gait --json` prints",
            do="name that file, or a stored gait",
        ) from None
    if gait.robot_hash in registry.robots():
        robot = load_robot(registry.robot_folder(gait.robot_hash))
        require_own(gait_space(robot, task_of(robot, gait.task).motion), genes_of(gait), gait)
    return gait


def is_gait(registry: Registry, ref: str) -> bool:
    """Whether a gait is meant by a ref: `@last`, the path of a JSON document, or a result.

    NoMatchError where nothing stored is called so.
    """
    if ref == "@last" or Path(ref).is_file():
        return True
    named = told_last(registry, ref)
    try:  # a population has its robot's name
        return registry.resolve(named, ("population", "entry", "measured", "recording")) is None
    except AmbiguousError:
        raise
    except NoMatchError:
        return registry.resolve(named)[0] == "result"


def genes_of(gait: Gait) -> dict[str, float]:
    """{name: value} of a gait."""
    return {name: gene.value for name, gene in gait.genes.items()}


def trials_of(registry: Registry, gait: Gait, seconds: float, rate: float) -> tuple[Trials, int]:
    """Trials of `seconds` at `rate` [Hz] in the simulators of a gait, and the index of the one that shows it.

    Raises NoMatchError if the robot or a simulator is not in the registry.
    """
    robot = load_robot(registry.robot_folder(gait.robot_hash))
    task = task_of(robot, gait.task)
    task.seconds = seconds
    configs = [
        replace(simulator(registry, t.simulator, robot).config, values=t.parameters) for t in gait.trials
    ]
    trials = Trials(robot, task, simulators_of(robot, configs), rate=rate, seed=gait.seed)
    return trials, gait.shown


def trial_of(registry: Registry, recording: Recording, ref: str, robot: Robot) -> Recording:
    """The recording with the id of the played gait in its provenance.

    Raises NoMatchError if there is no such gait, UsageError if it belongs to another robot.
    """
    record = _record(registry, ref)
    owner = record.document["robot_hash"]
    if owner != robot.hash:
        raise UsageError(
            f"gait {record.id[:12]} is of robot {record.document['robot']!r} ({owner[:12]})",
            expected=f"a gait of {robot.name!r} ({robot.hash[:12]})",
            do="name the robot that it was played on, or another gait",
        )
    return replace(recording, provenance={**recording.provenance, "gait": record.id})


def _record(registry: Registry, ref: str) -> ResultRecord:
    if ref == "@last":
        return _latest(registry, None, ref)
    kind, identity = registry.resolve(ref, ("result", "recording"))
    record = registry.result(identity) if kind == "result" else _latest(registry, identity, ref)
    if record.kind != "gait":
        own = (record.document.get("on_robot") or {}).get("document")
        raise UsageError(
            f"result {ref!r} is of kind {record.kind!r}",
            expected=f"a gait{f'; this result found {own[:12]}' if own else ''}",
            do="name that one"
            if own
            else "see `dynreg list --kind result`, or search for one with `dynreg gait`",
        )
    return record


def _latest(registry: Registry, recording: str | None, ref: str) -> ResultRecord:
    """The last gait of all, or about a recording (its id), which is called `ref`."""
    try:
        return registry.latest("gait", recording)
    except NoMatchError:
        search, about = f"search for one with `{command('gait', ref if recording else 'RECORDING')}`", ""
        if recording is None:
            search += ", or name a recording by its name or id to export that"
        else:
            about = f" about recording {ref!r}"
        raise NoMatchError(
            f"no gait is stored{about}",
            expected="a stored gait; @last means the last one wherever a gait can be meant",
            do=search,
        ) from None
