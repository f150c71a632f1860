"""How well commands separate two hypotheses: the evidence that one of them, refitted, lacks where the other holds.

To first order: every rival (a hypothesis at some coordinates) is simulated once, and refitted to each truth of the
other hypothesis with the derivatives of its rollouts by the nominal parameters (within their nameplate) and by its
own. Evidence of episodes adds up, so any choice of them is judged without another simulation.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dynreg.evidence.hypothesis import Coordinates, Hypothesis, effect_bounds
from dynreg.excite.candidates import Pool
from dynreg.excite.limits import followed, reached_by
from dynreg.replay.known import nominal_known
from dynreg.replay.samples import effective_samples
from dynreg.rng import stream
from dynreg.sim.effects import Term, Terms, stacked
from dynreg.sim.engines import rollout
from dynreg.sim.real import LEAST_NOISE, disturbance, draws
from dynreg.sim.robot import Robot
from dynreg.sim.run import Rollout, Run

STEP = 0.3  # central differences, wide: these derivatives have to hold as far as a parameter is pulled
REACH = 2.0  # times its size that a refit moves an effect
ROUNDS = 4  # of reweighting, for the size of a residual counts by its logarithm
AT_ONCE = 3_000_000  # numbers in one batch of rollouts


@dataclass(frozen=True)
class Pair:
    """Two effects on a robot, and the coordinates in which both are fitted."""

    robot: Robot
    terms: tuple[Term, Term]
    seed: int = 0
    threads: int = 0

    @property
    def engine(self) -> str:
        """The fastest one that the robot offers: both hypotheses run on it."""
        quick = (name for name, engine in self.robot.engines.items() if engine.vectorised)
        return next(quick, self.robot.running())

    @cached_property
    def coordinates(self) -> Coordinates:
        """Those of a log that tells the rate of its commands."""
        return Coordinates(self.robot, nominal_known(self.robot))

    @cached_property
    def hypotheses(self) -> tuple[Hypothesis, Hypothesis]:
        return tuple(Hypothesis((one,)) for one in self.terms)

    @cached_property
    def truths(self) -> tuple[tuple[int, np.ndarray], ...]:
        """(hypothesis, coordinates (D,)) of every case that is taken for true."""
        return tuple((which, z) for which in (0, 1) for z in self.medium(which))

    def medium(self, number: int) -> np.ndarray:
        """(N, D) coordinates at which hypothesis `number` is true: the nameplate, medium size, either sign."""
        parameters = self.hypotheses[number].parameters
        sizes = np.array([0.0 if p.shape else 1.0 for p in parameters])
        size = np.stack([sizes, np.where(np.arange(len(sizes)) == 0, -1.0, 1.0) * sizes])
        free = len(self.coordinates)
        return np.pad(size[: 2 if parameters[0].signed else 1], ((0, 0), (free, 0)))

    def bounds(self, number: int) -> np.ndarray:
        """(D, 2) lowest and highest coordinates of hypothesis `number`."""
        return np.concatenate([self.coordinates.nominal_bounds, effect_bounds(self.hypotheses[number])])

    def simulate(self, rows: list[tuple[int, np.ndarray]], run: Run, disturbed: bool = False) -> Rollout:
        """Rollouts of rows (hypothesis, coordinates (D,)); `disturbed` by noise of the drives, as hidden ones."""
        c = self.coordinates
        free = len(c)
        parts = []
        for number, hypothesis in enumerate(self.hypotheses):
            members = [i for i, (which, _) in enumerate(rows) if which == number]
            z = np.array([rows[i][1][free:] for i in members])
            if members:
                parts.append((members, Terms(hypothesis.terms, tuple(c.effect_values(hypothesis, z)))))
        if disturbed:
            rng = stream(self.seed, "excite", self.robot.name, "disturbance")
            noise = draws((run.steps,), c.drive_limits, rng)
            run = replace(run, draws=np.broadcast_to(noise, (run.episodes, *noise.shape)))
            parts.append((np.arange(len(rows)), disturbance(self.robot, c.drive_limits).tiled(len(rows))))
        nominal = c.values(np.array([at[:free] for _, at in rows]))
        acting = stacked(len(rows), parts)
        return rollout(self.robot, nominal, run, engine=self.engine, threads=self.threads, terms=acting)


@dataclass(frozen=True)
class Rival:
    """A hypothesis at coordinates `begin` (D,), next to N truths of the other one, in E episodes.

    gram (E, C, D, D), pull (N, E, C, D), square (N, E, C) : sums over the rows of an episode of the products of
    derivatives and residuals, in units of each channel's noise. low, high (D,) : how far a refit may move it;
    prior (D,) : curvature of its coordinates' penalty.
    """

    begin: np.ndarray
    low: np.ndarray
    high: np.ndarray
    prior: np.ndarray
    gram: np.ndarray
    pull: np.ndarray
    square: np.ndarray

    def refit(
        self, truth: int, chosen: np.ndarray, noise: np.ndarray, effective: np.ndarray, rows: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Evidence (n,) [nats] that the rival lacks where a truth holds, refitted in the episodes chosen (n, k); and
        where the refit ends (n, D).

        noise, effective : (E, C) variance of what nothing explains, and its independent samples, in `rows` rows.
        """
        gram, pull, square = self.gram[chosen], self.pull[truth][chosen], self.square[truth][chosen]
        noise, effective = noise[chosen], effective[chosen]
        out, ends = np.full(len(chosen), np.inf), np.tile(self.begin, (len(chosen), 1))
        # two valleys: parameters stay near the nameplate, or the residual becomes as small as it can
        for mean in (square / rows, np.zeros_like(square)):
            for _ in range(ROUNDS):
                weight = effective / (rows * (mean + noise))
                move = self._moved(
                    np.einsum("nec,necij->nij", weight, gram), np.einsum("nec,neci->ni", weight, pull)
                )
                left = square + 2 * np.einsum("neci,ni->nec", pull, move)
                left = left + np.einsum("ni,necij,nj->nec", move, gram, move, optimize=True)
                mean = np.maximum(left, 0.0) / rows
                nats = 0.5 * (effective * np.log1p(mean / noise)).sum(axis=(1, 2))
                nats += 0.5 * (self.prior * (self.begin + move) ** 2).sum(axis=1)
                ends = np.where((nats < out)[:, None], self.begin + move, ends)
                out = np.minimum(out, nats)
        return out, ends

    def take(self, chosen: np.ndarray) -> "Rival":
        """Only these episodes (numbers)."""
        return replace(self, gram=self.gram[chosen], pull=self.pull[:, chosen], square=self.square[:, chosen])

    def _moved(self, gram: np.ndarray, pull: np.ndarray) -> np.ndarray:
        """(n, D) best moves; coordinates that leave their room stay on its edge."""
        matrix = gram + np.diag(self.prior + 1e-9)
        wanted = -pull - self.prior * self.begin
        move = np.linalg.solve(matrix, wanted[..., None])[..., 0]
        stuck = np.zeros(move.shape, dtype=bool)
        for _ in range(2):
            stuck |= (move < self.low) | (move > self.high)
            if not stuck.any():
                break
            edge = np.where(stuck, np.clip(move, self.low, self.high), 0.0)
            rest = np.where(stuck, edge, wanted - np.einsum("nij,nj->ni", matrix, edge))
            kept = np.where(stuck[:, :, None] | stuck[:, None, :], np.eye(len(self.begin)), matrix)
            move = np.linalg.solve(kept, rest[..., None])[..., 0]
        return np.clip(move, self.low, self.high)


@dataclass
class Judge:
    """What the episodes of a pool are expected to tell between two hypotheses, given the rivals found so far.

    noise, effective : (E, C), as `Rival.refit` takes them. reached : (E, 2, S) lowest and highest true states.
    usable : (E,) where nothing fell, diverged, left its range or hit a stop. rivals : of each hypothesis.
    """

    pair: Pair
    pool: Pool
    rivals: tuple[list[Rival], list[Rival]] = field(default_factory=lambda: ([], []))

    def __post_init__(self):
        pair, robot = self.pair, self.pair.robot
        self.truths = list(pair.truths)
        plain = [(-1, np.zeros(len(pair.coordinates)))]
        made = pair.simulate(plain + self.truths, self.pool.run)
        disturbed = pair.simulate(plain, self.pool.run, disturbed=True)
        self.usable, self.reached = reached_by(robot, made.states, made.fell, self.pool.run.period)
        self.usable &= followed(disturbed.states, disturbed.fell)
        seen = self._seen(made)
        self._true = seen[1:]
        draw = stream(pair.seed, "excite", robot.name, "sensors")
        unexplained = self._seen(disturbed)[0] - seen[0] + draw.standard_normal(seen[0].shape)
        self.noise = (unexplained**2).mean(axis=1)
        self.effective = np.maximum(effective_samples(unexplained), 1.0)

    def add(self, number: int, z: np.ndarray) -> None:
        """Let hypothesis `number` at coordinates z (D,) be a rival wherever the other one is true."""
        limits = self.pair.bounds(number)
        up, down = np.minimum(z + STEP, limits[:, 1]), np.maximum(z - STEP, limits[:, 0])
        ends = [np.where(np.eye(len(z), dtype=bool), end, z) for end in (up, down)]
        points = [(number, at) for at in (z, *ends[0], *ends[1])]
        truths = [i for i, (which, _) in enumerate(self.truths) if which != number]
        grams, pulls, squares = [], [], []
        many = max(1, AT_ONCE // (len(points) * self.pool.run.steps * len(self.pair.robot.channels)))
        for start in range(0, len(self.pool), many):
            some = np.arange(start, min(start + many, len(self.pool)))
            seen = self._seen(self.pair.simulate(points, self.pool.run.take(some)))
            slope = (seen[1 : 1 + len(z)] - seen[1 + len(z) :]) / (up - down)[:, None, None, None]
            residual = seen[0] - self._true[truths][:, some]
            grams.append(np.einsum("ietc,jetc->ecij", slope, slope, optimize=True))
            pulls.append(np.einsum("ietc,netc->neci", slope, residual, optimize=True))
            squares.append((residual**2).sum(axis=2))
        low, high, prior = self._room(number, z)
        sums = np.concatenate(grams), np.concatenate(pulls, axis=1), np.concatenate(squares, axis=1)
        self.rivals[number].append(Rival(z, low, high, prior, *sums))

    def keep(self, chosen: np.ndarray) -> None:
        """Go on with these episodes only (numbers)."""
        self.pool, self._true = self.pool.take(chosen), self._true[:, chosen]
        for name in ("usable", "reached", "noise", "effective"):
            setattr(self, name, getattr(self, name)[chosen])
        self.rivals = tuple([rival.take(chosen) for rival in rivals] for rivals in self.rivals)

    def nats(self, chosen: np.ndarray) -> np.ndarray:
        """(n, N) evidence expected of the episodes chosen (n, k), for each truth: against its best rival."""
        each = [self._refits(truth, chosen) for truth in range(len(self.truths))]
        return np.stack([np.min([nats for nats, _ in refits], axis=0) for refits in each], axis=1)

    def nearest(self, truth: int, chosen: np.ndarray) -> list[np.ndarray]:
        """Coordinates (D,) of the refitted rivals of a truth in the episodes chosen (k,), the strongest first."""
        refits = self._refits(truth, chosen[None])
        return [ends[0] for _, ends in sorted(refits, key=lambda refit: float(refit[0][0]))]

    def _refits(self, truth: int, chosen: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        which = self.truths[truth][0]
        among = [i for i, (other, _) in enumerate(self.truths) if other == which].index(truth)
        return [
            rival.refit(among, chosen, self.noise, self.effective, self.pool.run.steps)
            for rival in self.rivals[1 - which]
        ]

    def _seen(self, made: Rollout) -> np.ndarray:
        """(n, E, T, C) weighted channels after the start, in units of their noise; zero where nothing can be used."""
        robot = self.pair.robot
        use = np.flatnonzero([c.weight > 0 for c in robot.file.channels])
        stated = robot.sensor_noise
        scaled = made.states[:, :, 1:, use] / np.where(stated > 0, stated, LEAST_NOISE)[use]
        return np.clip(np.nan_to_num(scaled, posinf=0.0, neginf=0.0), -1e6, 1e6)

    def _room(self, number: int, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(D,) each: how far a refit may move down and up from z, and the prior's curvature."""
        limits, free = self.pair.bounds(number), len(self.pair.coordinates)
        low, high = limits[:, 0] - z, limits[:, 1] - z
        prior = np.ones(len(z))
        for i, p in enumerate(self.pair.hypotheses[number].parameters, start=free):
            if not p.shape:
                prior[i] = 0.0
                high[i] = min(high[i], (REACH - 1.0) * abs(z[i]) if z[i] > 0 else -z[i])
                low[i] = max(low[i], (1.0 - REACH) * abs(z[i]) if z[i] < 0 else -z[i])
        return low, high, prior
