"""Makes what a population's entries share, and the entries: simulated, and a model trained for each."""

import hashlib
import json
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynreg.distance.population import Shared, Training, context_of
from dynreg.distance.rows import thin
from dynreg.errors import Assumed, SimulationError
from dynreg.models.bank import LossBank
from dynreg.models.base import POOLED, train_base
from dynreg.models.mlp import MlpStack
from dynreg.models.normaliser import Normaliser, fit_normaliser
from dynreg.rng import stream_seed
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import bank_period, excitation
from dynreg.sim.ports import log_periods
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, motor_noise

PROBES = 128  # states on which models are compared by what they predict
IN_A_BANK = 8  # base configurations that run the same commands


class Stopwatch:
    """Seconds spent on each part of a work."""

    def __init__(self):
        self.seconds: Counter[str] = Counter()

    @contextmanager
    def of(self, part: str) -> Iterator[None]:
        """Adds the time of the block to a part."""
        began = time.perf_counter()
        yield
        self.seconds[part] += time.perf_counter() - began


@dataclass(frozen=True, eq=False)
class Made:
    """Consecutive entries (n): values (n, P) in their units, states (n, E, T+1, S) float32, models and own losses (n,).

    fallen : (n,) share of the episodes in which it fell. diverged : (n,) whether its simulation left the numbers.
    periods : (n, E) seconds from a row of states to the next.
    """

    values: np.ndarray
    states: np.ndarray
    stack: MlpStack
    own_loss: np.ndarray
    train_loss: np.ndarray
    fallen: np.ndarray
    diverged: np.ndarray
    periods: np.ndarray


def make_entries(
    shared: Shared, numbers: np.ndarray, threads: int = 0, watch: Stopwatch | None = None
) -> Made:
    """Simulate and train the entries `numbers` (consecutive) of a population; `watch` takes the time."""
    watch, robot, every = watch or Stopwatch(), shared.robot, np.arange(len(numbers))
    with watch.of("simulate"):
        values = robot.space.sample(
            int(numbers[0]), int(numbers[-1]) + 1, stream_seed(shared.seed, "entries") % 2**31
        )
        done = rollout(robot, values, shared.with_noise(numbers), threads=threads)
        states = done.states.astype(np.float32)
    with watch.of("train"):
        # a diverged simulation keeps its place with data nobody is near to: its last finite state, held
        diverged = ~np.isfinite(states).all(axis=(1, 2, 3))
        states = _held(states) if diverged.any() else states
        rows = shared.rows(states)
        stack = shared.training.entries(shared.base, *rows.train, shared.seed, threads)
        banks = (LossBank(stack, *part, threads=threads or None) for part in (rows.held, rows.train))
        own, train_loss = (bank.pairs(every, every) for bank in banks)
    fallen = (done.fell <= shared.run.steps).mean(axis=1)
    periods = log_periods(robot, values, shared.run)
    return Made(values, states, stack, own, train_loss, fallen, diverged.astype(float), periods)


def _held(states: np.ndarray) -> np.ndarray:
    """States with everything from the first value that is not finite replaced by the one before it."""
    out = states.copy()
    for t in range(1, out.shape[2]):
        bad = ~np.isfinite(out[:, :, t]).all(axis=-1)
        out[:, :, t][bad] = out[:, :, t - 1][bad]
    return np.nan_to_num(out)


def make_shared(robot: Robot, seed: int, training: Training, threads: int) -> Shared:
    """Simulate the base configurations and train the base model: everything that entries will share.

    Base configurations run commands of their own, eight to a bank: a base that saw the entries' commands alone
    would know those trajectories rather than the dynamics. Episodes that diverge are left out, which is said. Raises
    SimulationError where all of them do.
    """
    run = excitation(robot, seed=seed)
    firsts = range(0, training.base_configurations, IN_A_BANK)
    parts = [_base_rows(robot, seed, training, first, threads) for first in firsts]
    states, actions, context, after = (np.concatenate(column) for column in zip(*parts, strict=True))
    if not len(states):
        raise SimulationError(
            f"every simulated episode of {robot.name!r} diverged",
            expected="a robot that can be simulated over the ranges of its parameters",
            do=f"look for the cause with `dynreg robots check {robot.name}`, or narrow the ranges in robot.toml",
        )
    normaliser = fit_normaliser(states, actions, context, after)
    inputs, targets = normaliser.inputs(states, actions, context), normaliser.targets(states, after)
    base = train_base(
        inputs,
        targets,
        replace(POOLED, epochs=training.base_epochs, seed=stream_seed(seed, "base model") % 2**31),
        threads=threads or None,
    )
    probes = inputs[thin(len(inputs), PROBES, seed, "probes")]
    return Shared(robot, seed, run, normaliser, base, probes, training)


def _base_rows(
    robot: Robot, seed: int, training: Training, first: int, threads: int
) -> tuple[np.ndarray, ...]:
    """States, actions, context and next states (N, .) of up to eight base configurations on one bank."""
    stop = min(first + IN_A_BANK, training.base_configurations)
    run = excitation(robot, seed=seed, name=f"base {first}")
    values = robot.space.sample(first, stop, stream_seed(seed, "base") % 2**31)
    seeds = np.array([stream_seed(seed, "base", i) % 2**62 for i in range(first, stop)])
    noise = motor_noise(seeds, *run.actions.shape)
    states = rollout(robot, values, replace(run, noise=noise), threads=threads).states.astype(np.float32)
    context = context_of(run)
    count = int(np.prod(states.shape[:2])) * run.steps
    flat = lambda a: np.broadcast_to(a, (len(states), *a.shape[-3:])).reshape(count, a.shape[-1])  # noqa: E731
    columns = (flat(states[:, :, :-1]), flat(run.actions), flat(context), flat(states[:, :, 1:]))
    # what runs up to a divergence is no dynamics of the robot, and would set the scale of all that is
    sound = np.isfinite(states).all(axis=(2, 3))
    if not sound.all():
        told = f"{int((~sound).sum())} of {sound.size} simulated episodes of {robot.name!r} diverged: the base model is"
        warnings.warn(f"{told} trained on the others", Assumed, 2)
    good = np.repeat(sound.reshape(-1), run.steps)
    return tuple(column[good].astype(np.float32) for column in columns)


def population_spec(robot: Robot, seed: int, training: Training) -> dict[str, Any]:
    """JSON description of a population's shared part."""
    return {
        "robot": robot.hash,
        "seed": seed,
        "ranges": {p.name: [p.low, p.high, p.scale] for p in robot.space.parameters},
        "excitation": robot.file.excitation.model_dump(),
        "training": vars(training) | {"network": "3x128 ReLU"},
        **({} if bank_period(robot) is None else {"period": bank_period(robot)}),
    }


def population_id(robot: Robot, seed: int, training: Training) -> str:
    """Content hash of what entries share; the number of entries is not part of it."""
    spec = json.dumps(population_spec(robot, seed, training), sort_keys=True)
    return hashlib.sha256(spec.encode()).hexdigest()


def shared_arrays(shared: Shared) -> dict[str, np.ndarray]:
    """Arrays of the shared part by name; `shared_from` reads them."""
    return {
        "bank.actions": shared.run.actions,
        "bank.inputs": shared.run.inputs,
        "bank.settings": shared.run.settings,
        **({} if shared.run.initial is None else {"bank.initial": shared.run.initial}),
        "probes": shared.probes,
        **{f"normaliser.{k}": v for k, v in shared.normaliser.as_arrays().items()},
        **{f"base.{k}": v for k, v in shared.base.as_arrays(np.float32).items()},
    }


def shared_from(robot: Robot, spec: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Shared:
    """The shared part that `population_spec` and `shared_arrays` told of."""

    def part(prefix: str) -> dict[str, np.ndarray]:
        return {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}

    bank = part("bank.")
    training = {k: v for k, v in spec["training"].items() if k != "network"}
    run = Run(
        bank["actions"],
        inputs=bank["inputs"],
        settings=bank["settings"],
        initial=bank.get("initial"),
        period=bank_period(robot),
    )
    normaliser, base = Normaliser.from_arrays(part("normaliser.")), MlpStack.from_arrays(part("base."))
    return Shared(robot, spec["seed"], run, normaliser, base, arrays["probes"], Training(**training))
