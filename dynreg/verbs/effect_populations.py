"""Populations of simulators that carry one effect or none, under the commands of a recording: begun, filled, held."""

import hashlib
import json
from dataclasses import dataclass, replace

import numpy as np

from dynreg.diagnose.diagnose import offered
from dynreg.diagnose.guided import population_key
from dynreg.diagnose.noise import noisier, own_noise
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem, planned
from dynreg.diagnose.ranking.draws import NONE_OF
from dynreg.diagnose.ranking.entries import Entries, entries
from dynreg.diagnose.ranking.features import Frame
from dynreg.diagnose.ranking.population import EffectPopulation, bare, gathered
from dynreg.diagnose.threshold import commands
from dynreg.errors import CorruptError, NoMatchError, UsageError
from dynreg.evidence.lockstep import run
from dynreg.neighbours.entries import Stopwatch
from dynreg.registry import PopulationRecord, Registry, ShardData, persistent
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.accepted import accept
from dynreg.verbs.populations import columns_of
from dynreg.verbs.subjects import EFFECTS, Recorded

INDEX = "effects"  # under which the features' directions and the classifier are kept
SHARD = 256  # entries that are stored together: whole groups of `entries.TOGETHER`
LEAST = 3  # entries for each term: fewer tell a classifier nothing


@dataclass(frozen=True, eq=False)
class Posed:
    """A recording of a robot as a problem, its sensors' own noise, and the id of the population under its commands."""

    problem: Problem
    noise: dict[str, float]
    recording: str
    seed: int
    id: str

    @property
    def keys(self) -> tuple[str, ...]:
        """Of the terms that entries carry."""
        return tuple(term.key for term in self.problem.terms)


_HELD: dict[str, tuple[Posed, Frame]] = {}  # of what this process makes entries, by population


def posed(asked: Recorded, seed: int, threads: int) -> Posed:
    """A recording as a problem. Raises as `pose` and `offered`."""
    options = DiagnosisOptions(seed=seed, threads=threads)
    model, data = pose(asked.robot, asked.recording, options)
    problem = run(planned(model, data, offered(model, data, options)), threads=threads)
    noise = own_noise(asked.robot, problem.train_part(asked.recording))
    told = {"seed": seed, "commands": commands(problem.data).round(6).tolist()}
    says = population_key(problem, noise) | told
    identity = hashlib.sha256(json.dumps(says, sort_keys=True).encode()).hexdigest()
    return Posed(problem, noise, asked.recording.id, seed, identity)


def begin(registry: Registry, robot: Robot, given: Posed, n: int) -> str:
    """The id of the population, registered with at least n planned entries.

    Raises UsageError where n leaves some effects without entries.
    """
    least = LEAST * (1 + len(given.keys)) * NONE_OF // (NONE_OF - 1)
    if n < least:
        raise UsageError(
            f"{n} simulators for {len(given.keys)} effects of {robot.name!r}",
            expected=f"at least {least}: {LEAST} for each, and some without any",
            do=f"ask for more, such as -n {10 * least}",
        )
    accept(registry, robot)
    registry.put_robot(robot.files, robot.hash, robot.name)
    try:
        known = registry.population(given.id)
    except (NoMatchError, CorruptError):
        known = None
    if known is not None:
        if n > known.size:
            registry.put_population(replace(known, size=n))
        return given.id
    data, columns = given.problem.data, columns_of(robot)
    bank = data.windows.run.take(data.both)
    told = {"actions": bank.actions, "inputs": bank.inputs, "settings": bank.settings}
    held = {
        name: a for name, a in told.items() if a is not None and a.shape[-1] == len(getattr(columns, name))
    }
    record = PopulationRecord(
        id=given.id,
        robot_hash=robot.hash,
        name=robot.name,
        channels=columns.states,
        parameters=robot.space.names,
        size=n,
        seed=given.seed,
        spec={"kind": EFFECTS, "like": given.recording, "terms": list(given.keys)},
        arrays={f"bank.{name}": a for name, a in held.items()},
        shard_size=SHARD,
        **{name: getattr(columns, name) for name in held},
        parameter_units=tuple(p.unit for p in robot.space.parameters),
    )
    registry.put_population(record)
    return given.id


def hold(given: Posed, threads: int) -> None:
    """Keep a posed recording, with the simulators without an effect beside which entries are told, for `fill_span`."""
    problem = given.problem
    _HELD.clear()  # one alone: it is large
    _HELD[given.id] = given, run(bare(problem.model, problem.data), threads=threads)


def fill_span(
    registry: str, population: str, span: tuple[int, int], threads: int
) -> tuple[int, dict[str, float]]:
    """Make and store the entries of a missing span; see `populations.fill_span`.

    A process that does not hold the population poses its recording, as the registry has it, anew. Raises CorruptError
    where that is another one than the population's.
    """
    watch = Stopwatch()
    with persistent(Registry.open)(registry) as opened, opened.claim(population, span[0]) as mine:
        if not mine:
            return 0, {}
        with watch.of("simulate"):
            if population not in _HELD:
                hold(_posed_anew(opened, population, threads), threads)
            given, frame = _HELD[population]
            problem = given.problem
            robot = noisier(problem.model.robot, given.noise)
            made = run(entries(frame, problem.terms, robot, range(*span), given.seed), threads=threads)
        added = len(opened.put_shard(population, span[0], _shard(made, problem)))
    return added, dict(watch.seconds)


def _posed_anew(registry: Registry, population: str, threads: int) -> Posed:
    record = registry.population(population)
    robot = load_robot(registry.robot_folder(record.robot_hash))
    like = str(record.spec["like"])
    given = posed(Recorded(registry, robot, registry.recording(like), like), record.seed, threads)
    if given.id != population:
        raise CorruptError(
            f"recording {like[:12]} does not give the problem of population {population[:12]}",
            expected="the recording, the robot and the version of dynreg that the population was begun with",
            do="run `dynreg verify`, or begin another population",
        )
    return given


def _shard(made: Entries, problem: Problem) -> ShardData:
    """Entries as the registry stores them: what they did, what they carry, and their features in place of a model's
    weights."""
    count, windows = made.states.shape[:2]
    nothing = np.zeros(count)  # no model was trained, and none has a loss
    held = {name: getattr(made, name) for name in ("carried", "effects", "points", "features")}
    periods = np.full((count, windows), problem.data.windows.period)
    return ShardData(made.values, made.states, held, nothing, nothing, periods=periods)


def held(registry: Registry, identity: str) -> tuple[EffectPopulation, tuple[str, ...], np.ndarray]:
    """A population held ready for questions, the ids of its entries, and their numbers.

    What is computed from all entries is kept in the registry's index, and rebuilt where that lacks it.
    """
    record = registry.population(identity)
    stored = registry.load(identity, ("weights",))
    arrays = registry.index(identity, INDEX, stored.ids)
    terms = record.spec["terms"]
    if arrays is None:
        of = (stored.weights[name] for name in ("carried", "points", "features"))
        population = gathered(terms, *of, seed=record.seed)
        if not registry.read_only:
            registry.put_index(identity, INDEX, population.as_arrays(), stored.ids)
    else:
        population = EffectPopulation.from_arrays(terms, arrays)
    return population, stored.ids, stored.numbers
