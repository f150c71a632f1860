"""The nouns of a population: what its entries share, and the entries held ready. Distances exist only inside one."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynreg.distance.cross_loss import CrossLoss
from dynreg.distance.embedding import Embedding
from dynreg.distance.rows import Rows, bank_rows, thin
from dynreg.errors import UsageError
from dynreg.models.mlp import MlpStack
from dynreg.models.normaliser import Normaliser
from dynreg.models.train import Passes, train
from dynreg.rng import stream_seed
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, motor_noise

BASE_CONFIGURATIONS = 96  # pooled into the base model; drawn apart from the entries
JUDGED_ON = 64  # held-out rows of each entry on which cross-losses are measured


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
    """A population held ready for queries: shared part, entries, their models, and the embedding (M, D') of these."""

    id: str
    shared: Shared
    entries: Entries
    stack: MlpStack
    embedding: Embedding
    vectors: np.ndarray

    def __len__(self) -> int:
        return len(self.stack)

    @cached_property
    def unit(self) -> np.ndarray:
        """(M, P) parameters of the entries in [0, 1]."""
        return self.shared.robot.space.to_unit(self.entries.values)

    @cached_property
    def cross_loss(self) -> CrossLoss:
        """The paper's distance with held-out own losses; needs the entries' states."""
        return cross_loss(self.shared, self.entries.states, self.stack)

    @cached_property
    def cross_loss_train(self) -> CrossLoss:
        """The same with training own losses."""
        return cross_loss(self.shared, self.entries.states, self.stack, own=self.entries.train_loss)


def cross_loss(
    shared: Shared,
    states: np.ndarray,
    stack: MlpStack,
    *,
    own: np.ndarray | None = None,
    threads: int = 0,
) -> CrossLoss:
    """The paper's distance between entries with states (M, E, T+1, S), on up to 64 held-out rows of each.

    own : (M,) own losses; those on these rows where None.
    """
    inputs, targets = shared.rows(states).held
    some = thin(inputs.shape[1], JUDGED_ON, shared.seed, "judged")
    return CrossLoss(stack, inputs[:, some], targets[:, some], own, threads=threads or None)


def context_of(run: Run) -> np.ndarray:
    """(E, T, K) inputs, then settings, of each step: the context of dynamics models."""
    episodes, steps = run.episodes, run.steps
    inputs = run.inputs if run.inputs is not None else np.zeros((episodes, steps, 0))
    settings = run.settings if run.settings is not None else np.zeros((episodes, 0))
    return np.concatenate([inputs, np.repeat(settings[:, None], steps, axis=1)], axis=-1)
