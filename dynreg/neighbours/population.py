"""What a population's entries share: commands, normaliser, base model; and its entries held ready."""

import hashlib
import json
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynreg.data.recording import Channel
from dynreg.data.transitions import Transitions
from dynreg.distance.cross_loss import CrossLoss
from dynreg.distance.embedding import Embedding
from dynreg.distance.rows import Rows, bank_rows, recording_rows, thin
from dynreg.errors import UsageError
from dynreg.models.mlp import MlpStack
from dynreg.models.normaliser import Normaliser, fit_normaliser
from dynreg.models.train import train
from dynreg.registry import PopulationArrays, PopulationRecord
from dynreg.rng import stream_seed
from dynreg.sim.excitation import bank_period, excitation
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, motor_noise

BASE_CONFIGURATIONS = 96  # pooled into the base model; drawn apart from the entries
JUDGED_ON = 64  # held-out rows of each entry on which cross-losses are measured
PROBES = 128  # states on which models are compared by what they predict


@dataclass(frozen=True)
class Training:
    """How dynamics models are trained; part of the population's identity.

    Raises UsageError where any of it is not positive.
    """

    epochs: int = 3
    learning_rate: float = 1e-3
    batch_size: int = 40
    base_configurations: int = BASE_CONFIGURATIONS
    base_epochs: int = 12

    def __post_init__(self):
        for name, value in vars(self).items():
            if not value > 0:
                raise UsageError(f"training with {name} = {value}", expected="more than 0", do="raise it")

    def entries(
        self, base: MlpStack, inputs: np.ndarray, targets: np.ndarray, seed: int, threads: int
    ) -> MlpStack:
        """Models (M) warm-started from the base on rows (M, N, D), (M, N, S), as they are stored (fp16)."""
        trained = train(
            base,
            inputs,
            targets,
            epochs=self.epochs,
            learning_rate=self.learning_rate,
            batch_size=self.batch_size,
            seed=stream_seed(seed, "train") % 2**31,
            threads=threads or None,
        )
        return MlpStack.from_arrays(trained.as_arrays())


@dataclass(frozen=True)
class Shared:
    """The part of a population that is there before its first entry.

    run : the bank of commands that every simulator executes.
    probes : (128, D) normalised model inputs.
    """

    robot: Robot
    seed: int
    run: Run
    normaliser: Normaliser
    base: MlpStack
    probes: np.ndarray
    training: Training

    @cached_property
    def context(self) -> np.ndarray:
        """(E, T, K) inputs and settings of each step of the bank."""
        return context_of(self.robot, self.run)

    def rows(self, states: np.ndarray) -> Rows:
        """Rows of entries (M, E, T+1, S)."""
        return bank_rows(states, self.run.actions, self.context, self.normaliser)

    def recording_rows(self, rows: Transitions) -> Rows:
        """Rows of a recording of the same robot."""
        return recording_rows(rows, self.normaliser)

    def with_noise(self, numbers: np.ndarray) -> Run:
        """The bank with the motor noise of the entries `numbers`: each entry's is its own."""
        seeds = np.array([stream_seed(self.seed, "entry", int(i)) % 2**62 for i in numbers])
        shape = self.run.actions.shape
        return replace(self.run, noise=motor_noise(seeds, *shape))


@dataclass(frozen=True)
class Population:
    """A population held ready for queries: shared part, entries, models and embedding."""

    record: PopulationRecord
    shared: Shared
    entries: PopulationArrays
    stack: MlpStack
    embedding: Embedding | None
    vectors: np.ndarray | None

    def __len__(self) -> int:
        return len(self.entries)

    @cached_property
    def unit(self) -> np.ndarray:
        """(M, P) parameters of the entries in [0, 1]."""
        return self.shared.robot.space.to_unit(self.entries.values)

    @cached_property
    def cross_loss(self) -> CrossLoss:
        """The paper's distance with held-out own losses; needs the entries' states."""
        return cross_loss(self.shared, self.entries, self.stack)

    @cached_property
    def cross_loss_train(self) -> CrossLoss:
        """The same with training own losses."""
        return cross_loss(self.shared, self.entries, self.stack, own="training")


def cross_loss(
    shared: Shared, entries: PopulationArrays, stack: MlpStack, *, own: str = "held-out", threads: int = 0
) -> CrossLoss:
    """The paper's distance between a population's entries on up to 64 held-out rows of each.

    own : "held-out" own losses on those rows, or "training" ones.
    """
    inputs, targets = shared.rows(entries.states).held
    some = thin(inputs.shape[1], JUDGED_ON, shared.seed, "judged")
    losses = entries.train_loss if own == "training" else None
    return CrossLoss(stack, inputs[:, some], targets[:, some], losses, threads=threads or None)


def context_of(robot: Robot, run: Run) -> np.ndarray:
    """(E, T, K) inputs, then settings, of each step: the context of dynamics models."""
    episodes, steps = run.episodes, run.steps
    inputs = run.inputs if run.inputs is not None else np.zeros((episodes, steps, 0))
    settings = run.settings if run.settings is not None else np.zeros((episodes, 0))
    return np.concatenate([inputs, np.repeat(settings[:, None], steps, axis=1)], axis=-1)


def population_id(robot: Robot, seed: int, training: Training) -> str:
    """Content hash of what entries share; the number of entries is not part of it."""
    return hashlib.sha256(
        json.dumps(population_spec(robot, seed, training), sort_keys=True).encode()
    ).hexdigest()


def population_spec(robot: Robot, seed: int, training: Training) -> dict:
    """JSON description of a population's shared part."""
    return {
        "robot": robot.hash,
        "seed": seed,
        "ranges": {p.name: [p.low, p.high, p.scale] for p in robot.space.parameters},
        "excitation": robot.file.excitation.model_dump(),
        "training": vars(training) | {"network": "3x128 ReLU"},
        **({} if bank_period(robot) is None else {"period": bank_period(robot)}),
    }


def make_shared(robot: Robot, seed: int, training: Training, threads: int) -> Shared:
    """Simulate the base configurations and train the base model: everything that entries will share.

    Base configurations run commands of their own, eight to a bank: a base that saw the entries' commands alone
    would know those trajectories rather than the dynamics.
    """
    from dynreg.models.base import train_base

    run = excitation(robot, seed=seed)
    parts = [
        _base_rows(robot, seed, training, first, threads)
        for first in range(0, training.base_configurations, 8)
    ]
    states, actions, context, after = (np.concatenate(column) for column in zip(*parts, strict=True))
    normaliser = fit_normaliser(states, actions, context, after)
    inputs, targets = normaliser.inputs(states, actions, context), normaliser.targets(states, after)
    base = train_base(
        inputs,
        targets,
        epochs=training.base_epochs,
        seed=stream_seed(seed, "base model") % 2**31,
        threads=threads or None,
    )
    probes = inputs[thin(len(inputs), PROBES, seed, "probes")]
    return Shared(robot, seed, run, normaliser, base, probes, training)


def _base_rows(
    robot: Robot, seed: int, training: Training, first: int, threads: int
) -> tuple[np.ndarray, ...]:
    """States, actions, context and next states (N, .) of up to eight base configurations on one bank."""
    from dynreg.sim.engines import rollout

    stop = min(first + 8, training.base_configurations)
    run = excitation(robot, seed=seed, name=f"base {first}")
    values = robot.space.sample(first, stop, stream_seed(seed, "base") % 2**31)
    seeds = np.array([stream_seed(seed, "base", i) % 2**62 for i in range(first, stop)])
    noise = motor_noise(seeds, *run.actions.shape)
    states = rollout(robot, values, replace(run, noise=noise), threads=threads).states.astype(np.float32)
    context = context_of(robot, run)
    count = int(np.prod(states.shape[:2])) * run.steps
    flat = lambda a: np.broadcast_to(a, (len(states), *a.shape[-3:])).reshape(count, a.shape[-1])  # noqa: E731
    columns = (flat(states[:, :, :-1]), flat(run.actions), flat(context), flat(states[:, :, 1:]))
    good = np.isfinite(columns[0]).all(axis=1) & np.isfinite(columns[3]).all(axis=1)
    return tuple(column[good].astype(np.float32) for column in columns)


def shared_arrays(shared: Shared) -> dict[str, np.ndarray]:
    """Arrays of the shared part, for the registry."""
    return {
        "bank.actions": shared.run.actions,
        "bank.inputs": shared.run.inputs,
        "bank.settings": shared.run.settings,
        **({} if shared.run.initial is None else {"bank.initial": shared.run.initial}),
        "probes": shared.probes,
        **{f"normaliser.{k}": v for k, v in shared.normaliser.as_arrays().items()},
        **{f"base.{k}": v for k, v in shared.base.as_arrays(np.float32).items()},
    }


def shared_from(robot: Robot, record: PopulationRecord) -> Shared:
    """The shared part as the registry holds it."""

    def part(prefix: str) -> dict[str, np.ndarray]:
        return {k.removeprefix(prefix): v for k, v in record.arrays.items() if k.startswith(prefix)}

    bank = part("bank.")
    settings = dict(record.spec["training"])
    settings.pop("network")
    return Shared(
        robot,
        record.seed,
        Run(
            bank["actions"],
            inputs=bank["inputs"],
            settings=bank["settings"],
            initial=bank.get("initial"),
            period=bank_period(robot),
        ),
        Normaliser.from_arrays(part("normaliser.")),
        MlpStack.from_arrays(part("base.")),
        record.arrays["probes"],
        Training(**settings),
    )


def channels_of(robot: Robot) -> tuple[Channel, ...]:
    """State channels with their units."""
    return tuple(Channel(c.name, c.unit) for c in robot.file.channels)
