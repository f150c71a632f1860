"""A population of simulators that carry one effect or none, and what of it a log looks like."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynreg.diagnose.ranking.classifier import Classifier
from dynreg.diagnose.ranking.entries import TOGETHER, Entries, entries
from dynreg.diagnose.ranking.features import Frame
from dynreg.evidence.data import Data
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import NONE, Model
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import Term
from dynreg.sim.robot import Robot

# Directions that features are kept in: 64, 128 and 256 rank robots of the servo bench alike.
DIRECTIONS = 64
OVER, POWERS = (
    16,
    2,
)  # further directions of the sketch, and its power iterations (Halko, Martinsson, Tropp 2011)
SCALE = 4.0  # of unit codes before the classifier: its inputs are then about as large as its weights expect
# How often the classifier sees each entry, each time with the noise of another one that carries nothing. On 93 robots
# of the servo bench 4 put 97 % of the weak causes among the first five, and 1 put 94 %.
SEEN = 4
# What a cosine counts for beside the logarithm of a probability: 10 to 60 rank the servo bench alike.
COSINE = 30.0
# Resemblance below which no entry looks like a log. Of 93 robots of the servo bench with a known cause one lies below,
# two below 0.9; of 20 without any none, and one below 0.9. Of 28 by other code and the library's physics none lies
# below, of 15 with causes of other physics 10 (bench_ranker --tune).
ALIKE = 0.85
TINY = 1e-12  # no energy is smaller


@dataclass(frozen=True, eq=False)
class EffectPopulation:
    """Simulators (n) under the commands of one log: what they carry, and their features.

    terms : that they may carry; carried : (n,) its number of each, -1 for none. points : (n, P' + K) coordinates, 0
    where an effect has fewer. size : (n,) root mean square of each feature, in spreads of the motion. Those that carry
    something have no noise, the others have nothing else.
    directions : (F, D) orthonormal, of features. codes : (n, D) unit features in them. classifier : of these and noise.
    """

    terms: tuple[str, ...]
    carried: np.ndarray
    points: np.ndarray
    size: np.ndarray
    directions: np.ndarray
    codes: np.ndarray
    classifier: Classifier

    def __len__(self) -> int:
        return len(self.carried)

    @cached_property
    def noise(self) -> float:
        """Median size of the features of entries that carry nothing."""
        return float(np.median(self.size[self.carried < 0]))

    @cached_property
    def unit(self) -> np.ndarray:
        """(n, D) codes of length 1: what of a feature lies beyond these directions is left out."""
        codes = self.codes.astype(np.float64)
        return codes / np.maximum(np.linalg.norm(codes, axis=1, keepdims=True), TINY)

    def ranked(self, feature: np.ndarray, among: Sequence[str] | None = None) -> "Ranking":
        """What a log with the feature (F,) looks like: none, or one of the terms `among` (keys), by default all."""
        size = float(np.sqrt(np.mean(feature**2)))
        code = (feature / max(float(np.linalg.norm(feature)), TINY)) @ self.directions
        allowed = [-1, *(i for i, key in enumerate(self.terms) if among is None or key in among)]
        cosines = np.where(np.isin(self.carried, allowed), self.unit @ code, -1.0)
        rows = inputs(size * code[None], self.noise)
        told = self.classifier.logarithms(rows)[0]
        best = np.array([cosines[self.carried == i].max(initial=-1.0) for i in allowed])
        score = told[np.array(allowed) + 1] + COSINE * best
        share = np.exp(score - score.max())
        share /= share.sum()
        order = np.argsort(-score, kind="stable")
        near = float(cosines.max())
        # of the energy, what the nearest entry does not show and noise does not explain
        missed = max((1.0 - near**2) * size**2 - self.noise**2, 0.0) / max(size**2, TINY)
        names = ("", *self.terms)
        return Ranking(
            causes=tuple(Likely(names[allowed[i] + 1], float(share[i]), float(best[i])) for i in order),
            cosines=cosines,
            size=size,
            noise=self.noise,
            resemblance=float(np.sqrt(1.0 - min(missed, 1.0))),
        )

    def as_arrays(self) -> dict[str, np.ndarray]:
        """Its arrays by name; the terms are told apart from them."""
        own = {name: getattr(self, name) for name in ("carried", "points", "size", "directions", "codes")}
        return own | {f"classifier.{k}": v for k, v in self.classifier.as_arrays().items()}

    @classmethod
    def from_arrays(cls, terms: Sequence[str], arrays: Mapping[str, np.ndarray]) -> "EffectPopulation":
        """From `as_arrays` and the keys of its terms."""
        parts = {k: v for k, v in arrays.items() if "." not in k}
        net = {k.partition(".")[2]: v for k, v in arrays.items() if "." in k}
        return cls(tuple(terms), classifier=Classifier.from_arrays(net), **parts)


@dataclass(frozen=True)
class Likely:
    """A cause ("" for none) that a log may have: its share of the belief, and the cosine of its nearest entry."""

    key: str
    share: float
    cosine: float


@dataclass(frozen=True, eq=False)
class Ranking:
    """What a log looks like: causes, the most likely first, and the cosine (n,) of each entry.

    size, noise : root mean square of the log's feature and of those of entries without an effect, in spreads of the
    motion. resemblance : 1 where the nearest entry shows all of the log's feature but noise, 0 where it shows nothing.
    """

    causes: tuple[Likely, ...]
    cosines: np.ndarray
    size: float
    noise: float
    resemblance: float

    @property
    def outside(self) -> bool:
        """Whether none of the known causes looks like this."""
        return self.resemblance < ALIKE

    @property
    def keys(self) -> tuple[str, ...]:
        """The causes without "none", the most likely first."""
        return tuple(one.key for one in self.causes if one.key)


def inputs(codes: np.ndarray, noise: float) -> np.ndarray:
    """(n, 1 + D) what the classifier sees of features by their codes (n, D): the direction, and the size over noise."""
    size = np.maximum(np.linalg.norm(codes, axis=1), TINY)
    return np.column_stack([SCALE * codes / size[:, None], np.log(size / max(noise, TINY))])


def populated(
    model: Model,
    data: Data,
    terms: Sequence[Term],
    robot: Robot,
    count: int,
    seed: int,
    told: Callable[[int], None] | None = None,
) -> Search[EffectPopulation]:
    """`count` entries under the commands of `data`. robot : with the sensor noise of the log.

    told : is called with how many are done.
    """
    frame = yield from bare(model, data)
    parts: list[Entries] = []
    for begin in range(0, count, TOGETHER):
        some = yield from entries(frame, terms, robot, range(begin, min(begin + TOGETHER, count)), seed)
        parts.append(some)
        if told:
            told(sum(len(part.carried) for part in parts))
    carried, points, features = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("carried", "points", "features")
    )
    return gathered([term.key for term in terms], carried, points, features, seed)


def bare(model: Model, data: Data) -> Search[Frame]:
    """The frame of the entries: of the model's own time step, for which nothing is to be corrected."""
    return (yield from Frame.of(replace(model, corrections=NONE), data))


def gathered(
    terms: Sequence[str], carried: np.ndarray, points: np.ndarray, features: np.ndarray, seed: int
) -> EffectPopulation:
    """The population of entries that carry these terms (n,), at points (n, P' + K), with features (n, F)."""
    features = features.astype(np.float32)
    size = np.sqrt(np.mean(features**2, axis=1, dtype=np.float64))
    unit = features / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), TINY)
    # as they are stored, so that a population that was kept ranks as one that was just made
    carries = unit[carried >= 0]
    directions = main_directions(carries, min(DIRECTIONS, *carries.shape), seed).astype(np.float16)
    codes = (unit @ directions.astype(np.float32)).astype(np.float16)
    own = size[:, None] * codes.astype(np.float64)
    noise, rng = float(np.median(size[carried < 0])), stream(seed, "noise of entries")
    seen, labels = _with_noise(own[carried >= 0], carried[carried >= 0], own[carried < 0], rng)
    rows = inputs(seen, noise)
    classifier = Classifier.fitted(rows, labels + 1, len(terms) + 1, stream_seed(seed, "classifier") % 2**31)
    return EffectPopulation(tuple(terms), carried, points, size, directions, codes, classifier)


def _with_noise(
    codes: np.ndarray, carried: np.ndarray, noise: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Codes (m, D) of entries with the noise of others, of either sign, `SEEN` times; of noise alone; their terms (m,).

    To first order noise adds to what calibration leaves.
    """
    signs = lambda many: rng.choice([-1.0, 1.0], (many, 1))  # noqa: E731
    rows = [codes + signs(len(codes)) * noise[rng.integers(len(noise), size=len(codes))] for _ in range(SEEN)]
    rows += [noise, -noise]
    labels = [np.tile(carried, SEEN), np.full(2 * len(noise), -1)]
    return np.concatenate(rows), np.concatenate(labels)


def main_directions(rows: np.ndarray, count: int, seed: int) -> np.ndarray:
    """(F, count) orthonormal: the directions in which rows (n, F) have most of their length, by a random sketch."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # the same bytes on any number of threads
        width = min(count + OVER, *rows.shape)
        sketch = stream(seed, "sketch").standard_normal((len(rows), width)).astype(rows.dtype)
        basis = np.linalg.qr(rows.T @ sketch)[0]
        for _ in range(POWERS):
            basis = np.linalg.qr(rows.T @ (rows @ basis))[0]
        turned = np.linalg.svd(rows @ basis, full_matrices=False)[2]
    return (basis @ turned.T)[:, :count]
