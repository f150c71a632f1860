"""The nouns of a population: what its entries share, and the entries held ready. Distances exist only inside one."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynreg.distance.cross_loss import CrossLoss, Judged, judged_on
from dynreg.distance.embedding import Embedding
from dynreg.distance.rows import Rows, bank_rows
from dynreg.errors import UsageError
from dynreg.index import Graph
from dynreg.models.mlp import MlpStack, Models
from dynreg.models.normaliser import Normaliser
from dynreg.models.train import Passes, train
from dynreg.rng import stream_seed
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, motor_noise

BASE_CONFIGURATIONS = 96  # pooled into the base model; drawn apart from the entries


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
            Passes(self.epochs, self.learning_rate, self.batch_size, stream_seed(seed, "train") % 2**31),
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
        return context_of(self.run)

    def rows(self, states: np.ndarray) -> Rows:
        """Rows of entries (M, E, T+1, S)."""
        return bank_rows(states, self.run.actions, self.context, self.normaliser)

    def with_noise(self, numbers: np.ndarray) -> Run:
        """The bank with the motor noise of the entries `numbers`: each entry's is its own."""
        seeds = np.array([stream_seed(self.seed, "entry", int(i)) % 2**62 for i in numbers])
        return replace(self.run, noise=motor_noise(seeds, *self.run.actions.shape))


@dataclass(frozen=True)
class Entries:
    """The entries of a population, in the order of their numbers.

    ids : (M,) what each is called; numbers : (M,) in the population; values : (M, P) parameters in their units;
    states : (M, E, T+1, S), None where nothing asks for them; train_loss : (M,).
    """

    ids: tuple[str, ...]
    numbers: np.ndarray
    values: np.ndarray
    states: np.ndarray | None
    train_loss: np.ndarray


@dataclass(frozen=True)
class Population:
    """A population held ready for queries.

    shared : what was there before its entries. stack : the models of these; vectors : (M, D') their embedding.
    graph : over them, None where they are not linked. judged : the rows on which cross-losses are measured, None where
    nothing asks for them.
    """

    id: str
    shared: Shared
    entries: Entries
    stack: Models
    embedding: Embedding
    vectors: np.ndarray
    graph: Graph | None = None
    judged: Judged | None = None

    def __len__(self) -> int:
        return len(self.stack)

    @cached_property
    def unit(self) -> np.ndarray:
        """(M, P) parameters of the entries in [0, 1]."""
        return self.shared.robot.space.to_unit(self.entries.values)

    @property
    def cross_loss(self) -> CrossLoss:
        """The paper's distance with held-out own losses; needs `judged`."""
        return CrossLoss(self.stack, self.judged.inputs, self.judged.targets, self.judged.own)

    @property
    def cross_loss_train(self) -> CrossLoss:
        """The same with training own losses."""
        return CrossLoss(self.stack, self.judged.inputs, self.judged.targets, self.entries.train_loss)


def judged_entries(shared: Shared, states: np.ndarray, stack: Models, pivots: MlpStack) -> Judged:
    """The rows on which entries with states (M, E, T+1, S) and models (M) are judged by the paper's distance."""
    return judged_on(stack, pivots, *shared.rows(states).held, shared.seed)


def context_of(run: Run) -> np.ndarray:
    """(E, T, K) inputs, then settings, of each step: the context of dynamics models."""
    episodes, steps = run.episodes, run.steps
    inputs = run.inputs if run.inputs is not None else np.zeros((episodes, steps, 0))
    settings = run.settings if run.settings is not None else np.zeros((episodes, 0))
    return np.concatenate([inputs, np.repeat(settings[:, None], steps, axis=1)], axis=-1)
