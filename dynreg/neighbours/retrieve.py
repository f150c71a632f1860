"""Retrieve: the entries whose dynamics look most like the recording's, and a first guess at its parameters."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.data.transitions import transitions
from dynreg.distance.one_sided import one_sided
from dynreg.distance.rows import Rows, thin
from dynreg.distance.trajectory import trajectory
from dynreg.errors import LogError, UsageError
from dynreg.index import Found, search, search_printed, vector_index
from dynreg.models.losses import losses
from dynreg.models.mlp import MlpStack
from dynreg.neighbours.link import cross_loss, load_graph
from dynreg.neighbours.population import Population
from dynreg.registry import Registry
from dynreg.rng import stream
from dynreg.sim.robot import Robot

QUERY_ROWS = 300  # rows of the recording on which every entry's model is judged
MODEL_ROWS = 1600  # rows from which the recording's own model is trained, at most
DISTANCES = ("one_sided", "embedding", "cross_loss", "cross_loss_train", "trajectory")


@dataclass(frozen=True)
class Retrieved:
    """Entries in order of distance.

    order : (M',) entry numbers, nearest first; distance : (M',) theirs.
    guess : (P,) unit parameters that a ridge map reads off the recording's embedding; None without one.
    base_loss, best_loss : loss of the base model (1 by definition) and of the best entry on the recording.
    evaluations : distances evaluated.
    """

    distance_name: str
    order: np.ndarray
    distance: np.ndarray
    guess: np.ndarray | None
    best_loss: float
    evaluations: int


def retrieve(
    registry: Registry,
    population: Population,
    recording: Recording,
    episodes: np.ndarray,
    *,
    distance: str = "one_sided",
    known: np.ndarray | None = None,
    threads: int = 0,
) -> Retrieved:
    """Rank the entries of a population by their distance to some episodes (numbers) of a recording.

    distance : "one_sided", "embedding", "cross_loss" (Algorithm 1 on the graph, held-out own losses),
    "cross_loss_train" (the same with training own losses) or "trajectory" (needs the bank's own commands).
    known : (P,) values of the parameters known of the robot, NaN elsewhere; entries far from them are left out.
    """
    if distance not in DISTANCES:
        raise UsageError(
            f"distance {distance!r}", expected=f"one of {list(DISTANCES)}", do="choose one of them"
        )
    rows = recording_rows(population, recording, episodes)
    allowed = _allowed(population, known)
    model = _own_model(population, rows, threads)
    vector = population.embedding.vectors(model)[0]
    judged = thin(len(rows.inputs), QUERY_ROWS, population.shared.seed, "query")
    sided = one_sided(population.stack, population.shared.base, rows.inputs[judged], rows.targets[judged])
    evaluations = len(sided)
    if distance == "one_sided":
        ids = allowed[np.argsort(sided[allowed], kind="stable")]
        scores = sided[ids]
    elif distance == "embedding":
        ids, scores = _by_embedding(population, vector, allowed)
    elif distance == "trajectory":
        every = _by_trajectory(registry, population, recording, episodes)
        ids = allowed[np.argsort(every[allowed], kind="stable")]
        scores = every[ids]
    else:
        found = _by_cross_loss(registry, population, rows, model, distance, threads)
        keep = np.isin(found.ids, allowed)
        ids, scores, evaluations = found.ids[keep], found.distances[keep], found.evaluations
        rest = np.setdiff1d(allowed, ids)
        rest = rest[np.argsort(sided[rest], kind="stable")]
        ids, scores = np.concatenate([ids, rest]), np.concatenate([scores, np.full(len(rest), np.nan)])
    guess = _guess(population, vector)
    return Retrieved(distance, ids, scores, guess, float(sided[allowed].min()), evaluations)


def recording_rows(population: Population, recording: Recording, episodes: np.ndarray) -> Rows:
    """Normalised rows of some episodes; optional inputs that the log lacks take the robot's defaults."""
    robot = population.shared.robot
    some = recording.select([recording.episodes[i].name for i in episodes])
    filled = with_defaults(robot, some)
    return population.shared.recording_rows(
        transitions(filled, robot.channels, robot.actions, [*robot.inputs, *robot.settings])
    )


def with_defaults(robot: Robot, recording: Recording) -> Recording:
    """The recording with the robot's default inputs and settings where it has none, or NaN."""
    from dynreg.data.recording import Channel, Episode

    missing = [i for i, name in enumerate(robot.inputs) if name not in recording.names]
    channels = recording.channels + tuple(Channel(robot.inputs[i], "1") for i in missing)
    nominal = {s.name: s.nominal for s in robot.file.settings}
    defaults = robot.input_defaults
    episodes = []
    for e in recording.episodes:
        values = np.concatenate([e.values, np.tile(defaults[missing], (len(e.time), 1))], axis=1)
        for i, name in enumerate(robot.inputs):
            column = [c.name for c in channels].index(name)
            values[:, column] = np.where(np.isnan(values[:, column]), defaults[i], values[:, column])
        episodes.append(Episode(e.name, e.time, values, nominal | dict(e.settings)))
    return Recording(channels, tuple(episodes), recording.measured, recording.provenance)


def _allowed(population: Population, known: np.ndarray | None) -> np.ndarray:
    """Entries within a tenth of the range of what is known, or the nearest fifth where that leaves few."""
    if known is None or np.isnan(known).all():
        return np.arange(len(population))
    space = population.shared.robot.space
    at = np.flatnonzero(~np.isnan(known))
    target = space.to_unit(np.where(np.isnan(known), space.nominal, known))[at]
    apart = np.abs(population.unit[:, at] - target).max(axis=1)
    near = np.flatnonzero(apart <= 0.1)
    if len(near) >= max(20, len(population) // 5):
        return near
    return np.sort(np.argsort(apart, kind="stable")[: max(20, len(population) // 5)])


def _own_model(population: Population, rows: Rows, threads: int) -> MlpStack:
    inputs, targets = rows.train
    some = thin(len(inputs), MODEL_ROWS, population.shared.seed, "own model")
    if len(some) < 20:
        raise LogError(
            f"{len(some)} usable rows", expected="at least 20 transitions without NaN", do="record longer"
        )
    shared = population.shared
    return shared.training.entries(shared.base, inputs[None, some], targets[None, some], shared.seed, threads)


def _by_embedding(
    population: Population, vector: np.ndarray, allowed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    index = vector_index(population.vectors.shape[1], seed=population.shared.seed)
    index.add(population.vectors[allowed])
    ids, apart = index.nearest(vector[None], len(allowed))
    return allowed[ids[0]], apart[0]


def _by_cross_loss(
    registry: Registry, population: Population, rows: Rows, model: MlpStack, name: str, threads: int
) -> Found:
    """Algorithm 1 (degree-capped graph, best-first) with the recording as a new node."""
    ref = population.record.id
    graph = load_graph(registry, ref)
    if graph is None:
        raise UsageError(
            f"population {ref[:12]} is not linked",
            expected="a graph over its entries",
            do="run `dynreg populate` again without --no-link, or use --distance one_sided",
        )
    entries = population.entries if population.entries.states is not None else registry.load(ref)
    own = "training" if name.endswith("train") else "held-out"
    distance = cross_loss(population.shared, entries, population.stack, own=own, threads=threads)
    x, y = rows.held
    held = thin(len(x), 64, population.shared.seed, "query held")
    x, y = x[held], y[held]
    mine = float(losses(model, x, y)[0])
    to = distance.query(model, x, y, mine)
    return search(graph, to, min(60, len(population)), stream(population.shared.seed, "search"), ef=60)


def _by_trajectory(
    registry: Registry, population: Population, recording: Recording, episodes: np.ndarray
) -> np.ndarray:
    robot, shared = population.shared.robot, population.shared
    entries = population.entries
    states = entries.states if entries.states is not None else registry.load(population.record.id).states
    some = [recording.episodes[i].values for i in episodes]
    rows = min(len(values) for values in some)
    measured = np.stack([values[:rows, recording.columns(robot.channels)] for values in some])
    commands = np.stack([values[: rows - 1, recording.columns(robot.actions)] for values in some])
    spread = states.reshape(-1, states.shape[-1]).std(axis=0) + 1e-9
    return trajectory(states, shared.run.actions, measured, commands, spread)


def _guess(population: Population, vector: np.ndarray) -> np.ndarray | None:
    """(P,) ridge regression from embeddings to unit parameters, at the recording's embedding."""
    if len(population) < 50:
        return None
    from sklearn.linear_model import RidgeCV

    vectors = population.vectors
    mean, scale = vectors.mean(axis=0), vectors.std(axis=0).max()
    model = RidgeCV(np.logspace(-4, 2, 13)).fit((vectors - mean) / scale, population.unit)
    return np.clip(model.predict(((vector - mean) / scale)[None])[0], 0.0, 1.0)
