"""Populate: simulate, train and register the entries of a population, shard by shard."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dynreg.errors import UsageError
from dynreg.models.bank import LossBank
from dynreg.neighbours.population import (
    Shared,
    Training,
    channels_of,
    make_shared,
    population_id,
    population_spec,
    shared_arrays,
    shared_from,
)
from dynreg.registry import PopulationRecord, Registry, ShardData
from dynreg.rng import stream_seed
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot

Progress = Callable[[str, int, int], None]
WAIT = 0.1  # seconds between looks at what other processes have left


@dataclass
class Timing:
    """Seconds spent on each part of a populate."""

    simulate: float = 0.0
    train: float = 0.0
    base: float = 0.0
    store: float = field(default=0.0)


def populate(
    registry: Registry,
    robot: Robot,
    n: int,
    *,
    seed: int = 0,
    training: Training | None = None,
    shard_size: int = 200,
    threads: int = 0,
    progress: Progress | None = None,
) -> tuple[str, int, Timing]:
    """Bring a population to n entries; entries that are there already stay as they are.

    Entry i is row i of the Sobol sequence of the robot's ranges, simulated through the shared bank with motor
    noise of its own, and a model warm-started from the base: its bytes depend on the robot, the seed and i
    alone. A killed populate resumes; several at once share the work, and each returns when all of it is done.

    Returns the population's id, the number of entries added and where the time went.
    Raises UsageError where n is below 1.
    """
    if n < 1:
        raise UsageError(f"{n} simulators", expected="at least 1", do="ask for more, such as -n 1000")
    training = training or Training()
    report = progress or (lambda *_: None)
    timing = Timing()
    identity, shared = _shared(registry, robot, n, seed, training, shard_size, threads, timing, report)
    added = 0
    while spans := registry.missing_spans(identity):
        mine = [_fill(registry, identity, shared, span, threads, timing, report, n) for span in spans]
        added += sum(mine)
        if not any(mine):
            time.sleep(WAIT)  # others have claimed the rest; a claim ends with its process
            report("simulators", min(registry.count(identity), n), n)
    return identity, added, timing


def _fill(
    registry: Registry,
    identity: str,
    shared: Shared,
    span: tuple[int, int],
    threads: int,
    timing: Timing,
    report: Progress,
    n: int,
) -> int:
    """Compute and store one span of entries unless another process has it; the number of entries added."""
    with registry.claim(identity, span[0]) as mine:
        if not mine:
            return 0
        data = make_entries(shared, np.arange(*span), threads, timing)
        began = time.perf_counter()
        added = len(registry.put_shard(identity, span[0], data))
        timing.store += time.perf_counter() - began
    report("simulators", min(registry.count(identity), n), n)
    return added


def make_entries(
    shared: Shared, numbers: np.ndarray, threads: int, timing: Timing | None = None
) -> ShardData:
    """Simulate and train the entries `numbers` (consecutive) of a population."""
    timing = timing or Timing()
    robot = shared.robot
    began = time.perf_counter()
    values = robot.space.sample(
        int(numbers[0]), int(numbers[-1]) + 1, stream_seed(shared.seed, "entries") % 2**31
    )
    done = rollout(robot, values, shared.with_noise(numbers), threads=threads)
    states = done.states.astype(np.float32)
    timing.simulate += time.perf_counter() - began
    began = time.perf_counter()
    # a diverged simulation keeps its place with data nobody is near to: its last finite state, held
    diverged = ~np.isfinite(states).all(axis=(1, 2, 3))
    states = _held(states) if diverged.any() else states
    rows = shared.rows(states)
    stack = shared.training.entries(shared.base, *rows.train, shared.seed, threads)
    own = _own_losses(stack, *rows.held, threads)
    train_loss = _own_losses(stack, *rows.train, threads)
    timing.train += time.perf_counter() - began
    fallen = (done.fell <= shared.run.steps).mean(axis=1)
    return ShardData(
        values,
        states,
        stack.as_arrays(),
        own,
        train_loss,
        {"fallen": fallen, "diverged": diverged.astype(float)},
    )


def _shared(registry, robot, n, seed, training, shard_size, threads, timing, report) -> tuple[str, Shared]:
    identity = population_id(robot, seed, training)
    registry.put_robot(robot.folder, robot.hash, robot.name)
    known = {record.id: record for record in registry.populations()}.get(identity)
    if known is not None:
        record, shared = known, shared_from(robot, known)
    else:
        report("base model", 0, 1)
        began = time.perf_counter()
        shared = make_shared(robot, seed, training, threads)
        timing.base = time.perf_counter() - began
        report("base model", 1, 1)
        record = PopulationRecord(
            id=identity,
            robot_hash=robot.hash,
            name=robot.name,
            channels=channels_of(robot),
            parameters=robot.space.names,
            size=n,
            seed=seed,
            spec=population_spec(robot, seed, training),
            arrays=shared_arrays(shared),
            shard_size=shard_size,
        )
    if known is None or n > known.size:
        fields = {name: getattr(record, name) for name in record.__dataclass_fields__}
        registry.put_population(PopulationRecord(**(fields | {"size": max(n, record.size)})))
    return identity, shared


def _own_losses(stack, inputs: np.ndarray, targets: np.ndarray, threads: int) -> np.ndarray:
    every = np.arange(len(stack))
    return LossBank(stack, inputs, targets, threads=threads or None).pairs(every, every)


def _held(states: np.ndarray) -> np.ndarray:
    """States with everything from the first value that is not finite replaced by the one before it."""
    out = states.copy()
    for t in range(1, out.shape[2]):
        bad = ~np.isfinite(out[:, :, t]).all(axis=-1)
        out[:, :, t][bad] = out[:, :, t - 1][bad]
    return np.nan_to_num(out)
