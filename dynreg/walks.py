"""From a recording to a gait: the simulators that stand for its robot, the search in them, the result."""

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from dynreg.data.recording import Recording
from dynreg.errors import NoMatchError, UsageError
from dynreg.gait.methods import SOURCES
from dynreg.gait.play import commands, joints, require_new, require_playable, write_new
from dynreg.gait.seek import QUARTILE, SearchSettings, Sought, accepted, seek
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import YAW, X, Y, task_of
from dynreg.gait.trials import Trials, simulators_of
from dynreg.registry import Registry, ResultRecord
from dynreg.replay.known import command_rate, known_values
from dynreg.results import Cost, Fitness, Gait, GaitFinals, GaitGene, GaitStep, GaitTrial, Neighbours
from dynreg.rng import stream, stream_seed
from dynreg.sim.config import SimConfig
from dynreg.sim.film import draw, moments
from dynreg.sim.robot import Robot, load_robot

POINTS = 100  # of a way that is kept
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class WalkSettings:
    """What is asked for. on : one of SOURCES, or ids of simulators and entries with commas between them."""

    on: str = SOURCES[0]
    k: int = 5
    task: str | None = None
    search: SearchSettings = SearchSettings()
    resume: bool = False
    threads: int = 0


@dataclass(frozen=True)
class Chosen:
    """Simulators by id, how each came about, their configurations, and the result that named them."""

    ids: tuple[str, ...]
    kinds: tuple[str, ...]
    configs: tuple[SimConfig, ...]
    source: str | None = None


@dataclass(frozen=True)
class Asked:
    """Who wants a gait: the robot, its recording; `query` and `population` ask the registry when it is needed."""

    registry: Registry
    robot: Robot
    recording: Recording
    name: str
    query: Callable[[], Neighbours]
    population: Callable[[], str]
    known: np.ndarray = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "known", known_values(self.robot, self.recording))


def walk(asked: Asked, settings: WalkSettings, progress: Progress | None = None) -> Gait:
    """A gait for the recording's robot, sought in the simulators that `settings.on` names, and stored.

    Raises RobotError where the robot has no such task, NoMatchError where no simulator is close enough, UsageError
    where there are too few.
    """
    began = time.perf_counter()
    robot = asked.robot
    task = task_of(robot, settings.task)
    gait_space(robot)  # before anything is asked of the registry
    if settings.k < 1:
        raise UsageError(f"k = {settings.k}", expected="1 or more", do="ask for at least one simulator")
    chosen = choose(asked, settings)
    trials = Trials(
        robot,
        task,
        simulators_of(robot, chosen.configs, asked.known),
        rate=command_rate(robot, asked.known),
        seed=settings.search.seed,
        threads=settings.threads,
    )
    key = {"robot": robot.hash, "recording": asked.recording.id, "task": task.name, "simulators": chosen.ids}
    key |= {"values": trials.simulators.values.tolist(), **asdict(settings.search)}
    name = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:24]
    journal = asked.registry.journal_path(name)
    sought = seek(
        trials, settings.search, journal=journal, resume=settings.resume, key=key, progress=progress
    )
    gait = _document(asked, settings, chosen, trials, sought, time.perf_counter() - began)
    asked.registry.put_result("gait", asked.recording.id, gait.to_dict())
    journal.unlink(missing_ok=True)  # not before the gait is stored
    return gait


def _document(
    asked: Asked, settings: WalkSettings, chosen: Chosen, trials: Trials, sought: Sought, seconds: float
) -> Gait:
    robot, task, space, found = asked.robot, trials.task, trials.space, sought.found
    values, how, finals = sought.fitness, settings.search.accept, sought.finals
    return Gait(
        robot=robot.name,
        robot_hash=robot.hash,
        recording=asked.recording.id,
        recording_name=asked.name,
        on=settings.on,
        k=len(trials.simulators),
        source=chosen.source,
        task=task.name,
        unit=task.unit,
        success=task.success,
        seconds=task.seconds,
        rate=trials.rate,
        ramp=space.ramp,
        frequency=float(sought.genes[0]),
        genes={
            g.name: GaitGene(value=float(v), low=g.low, high=g.high, unit=g.unit)
            for g, v in zip(space.genes, sought.genes, strict=True)
        },
        joints=joints(space, sought.genes),
        accept=how,
        value=float(accepted(values[None], how)[0]),
        fitness=Fitness(
            min=float(values.min()), mean=float(values.mean()), quantile=float(np.quantile(values, QUARTILE))
        ),
        finals=finals and GaitFinals(runs=finals.runs, falls=finals.falls, value=finals.value),
        succeeded=bool(
            not sought.fell.any() and not (finals and finals.falls) and values.min() >= task.success
        ),
        trials=_trials(robot, chosen, trials.simulators.values, sought, trials.rate),
        method=settings.search.method,
        seed=settings.search.seed,
        ended=found.ended,
        history=tuple(GaitStep(evaluations=n, value=v) for n, v in found.history),
        evaluations=found.evaluations,
        resumed=found.resumed,
        notes=_notes(sought.helpless, how),
        cost=Cost(evaluations=0, rollouts=trials.rollouts, seconds=seconds),
    )


def _notes(helpless: np.ndarray, accept: str) -> tuple[str, ...]:
    """What must be said where every gait that was tried fell in some of the simulators (k,)."""
    if not helpless.any():
        return ()
    many = f"{helpless.sum()} of {len(helpless)} simulators"
    return (f"in {many} every gait that was tried fell, which counts as 0 in the {accept}",)


def gait_of(registry: Registry, ref: str | Path) -> Gait:
    """A gait by its id, a recording's (its last gait), `@last`, or the path of its JSON document.

    Raises NoMatchError where there is none, UsageError where it is something else, or the file's genes and limits are
    not those of its robot, where the registry holds that.
    """
    if Path(ref).is_file():
        try:
            gait = Gait.model_validate_json(Path(ref).read_bytes())
        except ValidationError as problem:
            first = problem.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise UsageError(
                f"{str(ref)!r} is no gait: {where}: {first['msg']}".replace(": :", ":"),
                expected="the JSON document that `dynreg gait --json` prints",
                do="name that file, or a stored gait",
            ) from None
        if gait.robot_hash in registry.robots():
            _require_its_own(load_robot(registry.robot_folder(gait.robot_hash)), gait)
        return gait
    return Gait.model_validate(_record(registry, str(ref)).document)


def _require_its_own(robot: Robot, gait: Gait) -> None:
    """UsageError where the genes cannot be run on the gait's robot, or it states limits that are not the robot's."""
    space = gait_space(robot)
    genes = space.from_dict({name: gene.value for name, gene in gait.genes.items()})
    space.require(genes)
    stated, own = (
        [(j.action, j.low, j.high, j.speed) for j in of] for of in (gait.joints, joints(space, genes))
    )
    if stated != own:
        wrong = next((a[0] for a, b in zip(stated, own, strict=False) if a != b), "the number of joints")
        raise UsageError(
            f"this gait cannot be run on robot {robot.name!r}: {wrong} is not stated as the robot has it",
            expected="the robot's own joints, with their limits of angle and rate",
            do="use the gait as `dynreg gait` found it",
        )


def film(registry: Registry, gait: Gait, path: Path, form: str) -> None:
    """Draw a gait in the simulator in which it walks least: a GIF of it all, or as PNG one period in four stills.

    The simulation is the very one that the gait's document tells of; the ground of a slope is drawn level.
    Raises UsageError for a gait that cannot be played and a file that cannot be written, NoMatchError where the
    registry lacks the robot or the simulators, PictureError where this machine cannot draw.
    """
    require_playable(gait)
    require_new(path)  # before time is spent on it
    trials, least = trials_of(registry, gait, gait.seconds, gait.rate)
    model, poses = trials.poses(told(trials, gait), least)
    times = moments(gait.seconds, form, 1.0 / gait.frequency)
    write_new(path, draw(model, poses, gait.rate, times, form))


def trials_of(registry: Registry, gait: Gait, seconds: float, rate: float) -> tuple[Trials, int]:
    """Trials of `seconds` with `rate` commands a second in a gait's simulators, and in which of them it walks least.

    Raises NoMatchError where the registry lacks the robot or the simulators.
    """
    robot = load_robot(registry.robot_folder(gait.robot_hash))
    task = task_of(robot, gait.task)
    task.seconds = seconds
    configs = [replace(_config(registry, t.simulator)[2], values=t.parameters) for t in gait.trials]
    trials = Trials(robot, task, simulators_of(robot, configs), rate=rate, seed=gait.seed)
    return trials, min(range(len(configs)), key=lambda i: gait.trials[i].fitness)


def told(trials: Trials, gait: Gait) -> np.ndarray:
    """(T, A) joint commands: to the last bit those of the search, where nobody has changed them since."""
    space = trials.space
    genes = space.from_dict({name: gene.value for name, gene in gait.genes.items()})
    if joints(space, genes) == gait.joints:
        return space.targets(genes[None], trials.times)[0]
    return commands(gait)[1]


def of_gait(registry: Registry, recording: Recording, ref: str, robot: Robot) -> Recording:
    """A recording that tells in its provenance which stored gait was played.

    Raises NoMatchError where there is no such gait, UsageError where it is another robot's.
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
        return registry.latest("gait")
    kind, identity = registry.resolve(ref, ("result", "recording"))
    record = registry.result(identity) if kind == "result" else registry.latest("gait", identity)
    if record.kind != "gait":
        raise UsageError(
            f"result {ref!r} is of kind {record.kind!r}",
            expected="a gait",
            do="see `dynreg list --kind result`, or seek one with `dynreg gait`",
        )
    return record


def choose(asked: Asked, settings: WalkSettings) -> Chosen:
    """The simulators in which a gait is sought."""
    if settings.on in _CHOICES:
        return _CHOICES[settings.on](asked, settings)
    return _named(asked, [ref.strip() for ref in settings.on.split(",")])


def _close_enough(asked: Asked) -> Neighbours:
    found = asked.query()
    if not found.fits:
        raise NoMatchError(
            f"no simulator is close enough to {asked.name!r}: {found.alarm}",
            expected="a recording that the population can explain",
            do=f"find what the simulators lack with `dynreg diagnose {asked.name}`, then add --on diagnosed",
        )
    return found


def _neighbours(asked: Asked, settings: WalkSettings) -> Chosen:
    found = _close_enough(asked).neighbours
    configs = tuple(SimConfig(asked.robot.hash, asked.robot.name, n.parameters) for n in found)
    source = asked.registry.latest("neighbours", asked.recording.id).id
    return Chosen(tuple(n.entry for n in found), ("neighbour",) * len(found), configs, source)


def _synthesised(asked: Asked, settings: WalkSettings) -> Chosen:
    found = _close_enough(asked).synthesised
    if found is None:
        raise NoMatchError(
            f"the query about {asked.name!r} synthesised no simulator",
            expected="a population large enough to synthesise from",
            do="populate more simulators, or use --on neighbours",
        )
    source = asked.registry.latest("neighbours", asked.recording.id).id
    return replace(_named(asked, [found.simulator]), kinds=("synthesised",), source=source)


def _diagnosed(asked: Asked, settings: WalkSettings) -> Chosen:
    record = asked.registry.latest("diagnosis", asked.recording.id)
    simulator = record.document.get("extended_simulator") or record.document.get("calibrated_simulator")
    if not simulator:
        raise NoMatchError(
            f"the last diagnosis of {asked.name!r} left no simulator",
            expected="one with an extended or a calibrated simulator",
            do=f"run `dynreg diagnose {asked.name}` again",
        )
    return replace(_named(asked, [simulator]), kinds=("diagnosed",), source=record.id)


def _nominal(asked: Asked, settings: WalkSettings) -> Chosen:
    return _made(asked, asked.robot.space.nominal[None], "nominal")


def _population(asked: Asked, settings: WalkSettings) -> Chosen:
    """Configurations drawn from the parameters' ranges, as those of a population are."""
    seed = stream_seed(settings.search.seed, "gait simulators")
    return _made(asked, asked.robot.space.sample(0, settings.k, seed), "population")


def _random(asked: Asked, settings: WalkSettings) -> Chosen:
    """Registered simulators, drawn at random: what neighbours must beat."""
    registry, identity = asked.registry, asked.population()
    entries = registry.load(identity, ())
    if settings.k > len(entries.ids):
        raise UsageError(
            f"k = {settings.k}",
            expected=f"1 to {len(entries.ids)}, the simulators of the population",
            do="ask for fewer, or populate more simulators",
        )
    rng = stream(settings.search.seed, "gait simulators")
    ids = [entries.ids[i] for i in rng.choice(len(entries.ids), settings.k, replace=False)]
    return replace(_named(asked, ids), kinds=("random",) * settings.k)


_CHOICES = {
    "neighbours": _neighbours,
    "synthesised": _synthesised,
    "diagnosed": _diagnosed,
    "nominal": _nominal,
    "population": _population,
    "random": _random,
}


def _made(asked: Asked, values: np.ndarray, kind: str) -> Chosen:
    robot = asked.robot
    configs = tuple(SimConfig(robot.hash, robot.name, robot.space.as_dict(row)) for row in values)
    lineage = {"made_by": "gait", "kind": kind}
    ids = tuple(asked.registry.put_simulator(c.as_dict() | {"lineage": lineage}) for c in configs)
    return Chosen(ids, (kind,) * len(configs), configs)


def _named(asked: Asked, refs: list[str]) -> Chosen:
    """Registered simulators and entries; UsageError where one is of another robot."""
    ids, kinds, configs = [], [], []
    for ref in refs:
        kind, identity, config = _config(asked.registry, ref)
        if config.robot != asked.robot.hash:
            raise UsageError(
                f"{kind} {ref!r} is of robot {config.robot_name!r} ({config.robot[:12]})",
                expected=f"simulators of {asked.robot.name!r} ({asked.robot.hash[:12]})",
                do="name others; see `dynreg list --kind simulator`",
            )
        ids.append(identity)
        kinds.append(kind)
        configs.append(config)
    return Chosen(tuple(ids), tuple(kinds), tuple(configs))


def _config(registry: Registry, ref: str) -> tuple[str, str, SimConfig]:
    """Of a registered simulator or entry: which of the two it is, its id and its configuration."""
    kind, identity = registry.resolve(ref, ("simulator", "entry"))
    if kind == "simulator":
        return kind, identity, SimConfig.from_dict(registry.simulator(identity))
    entry = registry.load_entry(identity)
    record = registry.population(entry.population_id)
    return kind, identity, SimConfig(record.robot_hash, record.name, entry.values)


def _trials(
    robot: Robot, chosen: Chosen, values: np.ndarray, sought: Sought, rate: float
) -> tuple[GaitTrial, ...]:
    base, fell = sought.walk.base[:, 0], sought.walk.fell[:, 0]
    out = []
    for i, (identity, kind) in enumerate(zip(chosen.ids, chosen.kinds, strict=True)):
        last = min(int(fell[i]), base.shape[1]) - 1
        at = np.unique(np.linspace(0, max(last, 0), POINTS).astype(int))
        way = {name: base[i, at, column].tolist() for name, column in (("x", X), ("y", Y), ("yaw", YAW))}
        out.append(
            GaitTrial(
                simulator=identity,
                kind=kind,
                fitness=float(sought.fitness[i]),
                fell=bool(sought.fell[i]),
                parameters=robot.space.as_dict(values[i]),
                time=(at / rate).tolist(),
                **way,
                contacts={
                    foot: _spans(touching[i, 0, : last + 1], rate)
                    for foot, touching in sought.walk.contact.items()
                },
            )
        )
    return tuple(out)


def _spans(touching: np.ndarray, rate: float) -> list[tuple[float, float]]:
    """Times [s] between which (T,) flags are set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], touching.astype(int), [0]])))
    return [(float(a / rate), float(b / rate)) for a, b in edges.reshape(-1, 2)]
