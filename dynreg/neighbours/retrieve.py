"""Retrieve: the entries whose dynamics look most like the recording's, and a first guess at its parameters."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.data.transitions import Transitions, transitions
from dynreg.distance.one_sided import one_sided
from dynreg.distance.rows import Rows, thin
from dynreg.distance.trajectory import trajectory
from dynreg.errors import LogError, UsageError
from dynreg.index import search, search_printed, vector_index
from dynreg.models.losses import losses
from dynreg.models.mlp import MlpStack
from dynreg.neighbours.link import load_graph
from dynreg.neighbours.population import JUDGED_ON, Population
from dynreg.registry import Registry
from dynreg.rng import stream
from dynreg.sim.robot import Robot

REACHED = 60  # entries that a search of the graph keeps
QUERY_ROWS = 200  # sequences of the recording on which every entry's model is judged,
AHEAD = 2  # steps long each
MODEL_ROWS = 1600  # rows from which the recording's own model is trained, at most
FEWEST = 20  # rows that a model is trained from, at least
AT_ONCE = 32  # entries that are replayed together, at most
DISTANCES = (
    "one_sided",
    "embedding",
    "cross_loss",
    "cross_loss_train",
    "cross_loss_printed",
    "trajectory",
    "replay",
)


@dataclass(frozen=True)
class Retrieved:
    """Entries in order of distance.

    order : (M',) entry numbers, nearest first; distance : (M',) theirs.
    guess : (P,) unit parameters that a ridge map reads off the recording's embedding; None without one.
    evaluations : distances evaluated. replays : of them, simulators that were replayed.
    """

    distance_name: str
    order: np.ndarray
    distance: np.ndarray
    guess: np.ndarray | None
    evaluations: int
    replays: int = 0


def retrieve(
    registry: Registry,
    population: Population,
    recording: Recording,
    *,
    distance: str = "auto",
    known: np.ndarray | None = None,
    guess: bool = True,
    at_least: int = 1,
    replayed: Callable[[np.ndarray], np.ndarray] | None = None,
    threads: int = 0,
) -> Retrieved:
    """Rank the entries of a population by their distance to a recording, all of which is read.

    distance : "auto" (one_sided; embedding where no entry predicts better than the base model, so that one-step
    errors say nothing, as on servos with unmodelled friction; replay where control is timed, or states were measured
    now and then), "one_sided", "embedding", "cross_loss" (the paper's, best-first on the graph, held-out own losses),
    "cross_loss_train" (with training own losses), "cross_loss_printed" (the paper's Algorithm 1 as printed, k = 5,
    4 restarts), "trajectory" (needs the bank's own commands) or "replay" (every entry drives the recording's commands).
    known : (P,) values of the parameters known of the robot, NaN elsewhere; entries far from them are left out.
    guess : whether to read parameters off the recording's own model too; "replay" has none. at_least : entries wanted.
    replayed : (n,) replay errors of unit parameters (n, P); without it "replay" is no choice.
    Raises UsageError for a distance that there is not, or that this robot or population does not have; LogError for a
    recording without rows to judge.
    """
    if distance not in ("auto", *DISTANCES):
        raise UsageError(
            f"distance {distance!r}", expected=f"one of {['auto', *DISTANCES]}", do="choose one of them"
        )
    allowed = _allowed(population, known, at_least)
    told = _transitions(population, recording)
    timed = population.shared.robot.file.robot.control == "timed"
    if distance == "auto" and (timed or (replayed is not None and _sparse(recording, told))):
        distance = "replay"
    if distance == "replay":
        ids, scores, evaluations = _by_replay(population, allowed, replayed)
        return Retrieved("replay", ids, scores, None, evaluations, evaluations)
    if timed:
        raise UsageError(
            f"distance {distance!r} of {population.shared.robot.name!r}, whose control is timed",
            expected="'replay'",
            do="leave --distance out: models predict one time step, and the rows of its logs are commands",
        )
    rows = population.shared.recording_rows(told)
    sided = None
    if distance == "auto":
        sided = _by_one_sided(population, rows, allowed)
        distance = "one_sided" if sided[1][0] < 1.0 else "embedding"
    needs_model = guess or distance == "embedding" or distance.startswith("cross_loss")
    model = _own_model(population, rows, threads) if needs_model else None
    vector = population.embedding.vectors(model)[0] if model is not None else None
    if distance == "embedding":
        ids, scores, evaluations = _by_embedding(population, vector, allowed)
    elif distance == "trajectory":
        every = _by_trajectory(registry, population, recording)
        ids, scores, evaluations = *_sorted(allowed, every[allowed]), len(every)
    elif distance == "one_sided":
        ids, scores, evaluations = sided or _by_one_sided(population, rows, allowed)
    else:
        ids, scores, evaluations = _by_cross_loss(registry, population, rows, model, distance, allowed)
    found = _guess(population, vector) if guess else None
    return Retrieved(distance, ids, scores, found, evaluations)


def recording_rows(population: Population, recording: Recording) -> Rows:
    """Normalised rows of a recording; optional inputs that the log lacks take the robot's defaults."""
    return population.shared.recording_rows(_transitions(population, recording))


def _transitions(population: Population, recording: Recording) -> Transitions:
    robot = population.shared.robot
    filled = with_defaults(robot, recording)
    return transitions(filled, robot.channels, robot.actions, [*robot.inputs, *robot.settings])


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


def _sparse(recording: Recording, told: Transitions) -> bool:
    """Whether a log is long enough and all states were hardly ever measured in two rows in a row."""
    return len(told) < FEWEST and sum(len(e.time) for e in recording.episodes) >= 2 * FEWEST


def _allowed(population: Population, known: np.ndarray | None, at_least: int) -> np.ndarray:
    """Entries within a fifth of the range of what is known, or the nearest fifth where that leaves few."""
    if known is None or np.isnan(known).all():
        return np.arange(len(population))
    space = population.shared.robot.space
    at = np.flatnonzero(~np.isnan(known))
    target = space.to_unit(np.where(np.isnan(known), space.nominal, known))[at]
    apart = np.abs(population.unit[:, at] - target).max(axis=1)
    near, fewest = np.flatnonzero(apart <= 0.2), max(20, len(population) // 5, at_least)
    return near if len(near) >= fewest else np.sort(np.argsort(apart, kind="stable")[:fewest])


def _own_model(population: Population, rows: Rows, threads: int) -> MlpStack:
    inputs, targets = rows.train
    some = thin(len(inputs), MODEL_ROWS, population.shared.seed, "own model")
    if len(some) < FEWEST:
        raise LogError(
            f"{len(some)} usable rows",
            expected=f"at least {FEWEST} rows in which all is measured, and in the next as well",
            do="record longer, or query with --distance replay",
        )
    shared = population.shared
    return shared.training.entries(shared.base, inputs[None, some], targets[None, some], shared.seed, threads)


def _sorted(ids: np.ndarray, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(scores, kind="stable")
    return ids[order], scores[order]


def _by_one_sided(
    population: Population, rows: Rows, allowed: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    inputs, targets = _sequences(rows)
    judged = thin(len(inputs), QUERY_ROWS, population.shared.seed, "query")
    if not len(judged):
        raise LogError(
            "no usable rows",
            expected="rows in which all is measured, and in the next as well",
            do="record longer, or query with --distance replay",
        )
    stack = population.stack if len(allowed) == len(population) else population.stack[allowed]
    shared = population.shared
    scores = one_sided(stack, shared.base, inputs[judged], targets[judged], shared.normaliser)
    return *_sorted(allowed, scores), len(allowed)


def _sequences(rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    """Rows in a row: inputs (N, H, D) and targets (N, H, S), H = `AHEAD`, or 1 where the log is too short for it."""
    starts = np.arange(len(rows.inputs) - AHEAD + 1)
    for step in range(AHEAD - 1):
        starts = starts[rows.follows[starts + step]]
    if not len(starts):
        return rows.inputs[:, None], rows.targets[:, None]
    at = starts[:, None] + np.arange(AHEAD)
    return rows.inputs[at], rows.targets[at]


def _by_replay(
    population: Population, allowed: np.ndarray, replayed: Callable[[np.ndarray], np.ndarray] | None
) -> tuple[np.ndarray, np.ndarray, int]:
    if replayed is None:
        raise UsageError(
            "distance 'replay' without a replay", expected="what replays entries", do="give `replayed`"
        )
    parts = np.array_split(allowed, max(-(-len(allowed) // AT_ONCE), 1))
    return *_sorted(allowed, np.concatenate([replayed(population.unit[p]) for p in parts])), len(allowed)


def _by_embedding(
    population: Population, vector: np.ndarray, allowed: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    index = vector_index(population.vectors.shape[1], seed=population.shared.seed)
    index.add(population.vectors[allowed])
    ids, apart = index.nearest(vector[None], len(allowed))
    return allowed[ids[0]], apart[0], len(allowed)


def _by_cross_loss(
    registry: Registry,
    population: Population,
    rows: Rows,
    model: MlpStack,
    name: str,
    allowed: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Best-first search of the degree-capped graph, with the recording as a new node.

    What the search did not reach comes after what it found, by one-sided distance and without a number.
    """
    ref = population.record.id
    graph = load_graph(registry, ref, population.entries.ids)
    if graph is None:
        raise UsageError(
            f"population {ref[:12]} is not linked",
            expected="a graph over its entries",
            do="run `dynreg populate` again without --no-link, or use --distance one_sided",
        )
    training = name.endswith("train")
    distance = population.cross_loss_train if training else population.cross_loss
    # training own losses are compared with the query's training loss, held-out ones with its held-out loss
    x, y = rows.train if training else rows.held
    some = thin(len(x), JUDGED_ON, population.shared.seed, "query held")
    x, y = x[some], y[some]
    to = distance.query(model, x, y, float(losses(model, x, y)[0]))
    wide = min(REACHED, len(population))
    rng = stream(population.shared.seed, "search")
    printed = name == "cross_loss_printed"
    found = (
        search_printed(graph, to, 5, rng, restarts=4) if printed else search(graph, to, wide, rng, ef=wide)
    )
    keep = np.isin(found.ids, allowed)
    rest, _, _ = _by_one_sided(population, rows, np.setdiff1d(allowed, found.ids))
    scores = np.concatenate([found.distances[keep], np.full(len(rest), np.nan)])
    return np.concatenate([found.ids[keep], rest]), scores, found.evaluations


def _by_trajectory(registry: Registry, population: Population, recording: Recording) -> np.ndarray:
    robot, shared = population.shared.robot, population.shared
    entries = population.entries
    states = entries.states if entries.states is not None else registry.load(population.record.id).states
    some = [episode.values for episode in recording.episodes]
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
