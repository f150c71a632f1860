"""Simulators on rollouts that none of them was fitted to: their errors, and which of them errs least."""

from dynreg.results.result import Gain, Result

NOTABLE = 0.05  # of an error: a tie with a difference of less needs no word


class Horizon(Result):
    """Rollouts of one length, each from a measured state. whole : the longest, as a diagnosis cuts them."""

    seconds: float
    rollouts: int
    whole: bool


class Score(Result):
    """Mean absolute error of one simulator in the rollouts of one horizon, with its 90 % interval, in `unit`.

    channel : null for all channels together, each in units of its own spread and by its weight. gain : the relative
    reduction from the error of the first simulator, on the same rollouts; null for the first itself. tie : the interval
    of the gain holds 0, or the errors differ by less than the stated noise (of all channels together for null), or by
    rounding; null where there is no interval and the difference is larger.
    """

    simulator: str
    channel: str | None
    seconds: float
    error: float
    low: float | None
    high: float | None
    unit: str
    gain: Gain | None = None
    tie: bool | None = None


class ComparedTrace(Result):
    """Measured and simulated values of one channel in one rollout; time [s]; null where nothing was measured."""

    episode: str
    channel: str
    unit: str
    time: list[float]
    measured: list[float | None]
    simulators: dict[str, list[float | None]]


class Rollouts(Result):
    """Simulators on rollouts of a recording that none of them was fitted to or chosen by.

    episodes : that the rollouts are cut from. left_out : episodes, and windows such as "run[3]", that a simulator was
    fitted to. names : of the simulators, in the order in which they were asked for; gains are over the first. best :
    that with the least error in the longest rollouts; alike : those that tie with it. within : of how many runs the
    intervals are over stretches of time, and for which alone they hold; null where they are over episodes. unscored :
    channels of weight 0 or without motion, which the error of all channels together leaves out.
    """

    episodes: tuple[str, ...]
    left_out: tuple[str, ...]
    names: tuple[str, ...]
    horizons: tuple[Horizon, ...]
    best: str
    alike: tuple[str, ...]
    within: int | None = None
    unscored: tuple[str, ...] = ()
    scores: tuple[Score, ...]
    traces: tuple[ComparedTrace, ...] = ()

    def score(self, simulator: str, channel: str | None, seconds: float) -> Score | None:
        """The score of a simulator; None where the channel was not measured in rollouts of this length."""
        asked = (simulator, channel, seconds)
        return next((s for s in self.scores if (s.simulator, s.channel, s.seconds) == asked), None)

    def unit(self, channel: str | None) -> str:
        """Of the scores of a channel; StopIteration where it has none."""
        return next(s.unit for s in self.scores if s.channel == channel)

    @property
    def best_gain(self) -> Gain | None:
        """Of the best simulator in the longest rollouts; None where no other one is better or worse."""
        found = self.score(self.best, None, self.horizons[-1].seconds)
        return found and found.gain

    @property
    def channels(self) -> tuple[str, ...]:
        """With an error, in the robot's order; those that no score counts come last."""
        found = dict.fromkeys(s.channel for s in self.scores if s.channel is not None)
        return tuple(sorted(found, key=lambda channel: channel in self.unscored))

    def __str__(self) -> str:
        longest = self.horizons[-1]
        where = f"In rollouts of {longest.seconds:.3g} s of {_listed(self.episodes)}"
        if self.alike:
            return f"{where}, {self._tied()}"
        gain = self.best_gain
        if gain is None:
            return f"{where}, no simulator errs less than {self.best}"
        return f"{where}, {self.best} errs least: {_less(gain)} than {self.names[0]}"

    def _tied(self) -> str:
        """Who ties, and on which scored channels these differ all the same: the largest difference of each first."""
        alike, seconds = (self.best, *self.alike), self.horizons[-1].seconds
        every = [
            s
            for s in self.scores
            if s.seconds == seconds and s.channel not in (None, *self.unscored) and s.simulator in alike
        ]
        apart = sorted((s for s in every if s.tie is False and s.gain), key=lambda s: -abs(s.gain.value))
        if not apart or self.names[0] not in alike:
            return f"{_and(alike)} tie"
        most = {s.simulator: s for s in reversed(apart)}
        differ = {s.channel for s in apart}
        said = [
            _and(
                tuple(
                    f"{n} errs {_less(s.gain)} than {self.names[0]} on {s.channel}" for n, s in most.items()
                )
            )
        ]
        if more := differ - {s.channel for s in most.values()}:
            said.append(f"They differ on {len(more)} more of the scored channels")
        others = [s for s in every if s.channel not in differ and s.gain]
        if others:
            worst = -min(s.gain.value for s in others)
            by = f", with errors up to {100 * worst:.0f} % higher" if worst >= NOTABLE else ""
            said.append(f"On the other scored channels they tie{by}")
        return ". ".join([*said, "Over all scored channels together they tie"])


def _less(gain: Gain) -> str:
    """How much less an error is, or more, with its interval."""
    sign, more = (-1, "more") if gain.value < 0 else (1, "less")
    bounds = () if gain.low is None or gain.high is None else (gain.low, gain.high)[::sign]
    interval = f" [{', '.join(f'{sign * 100 * end:.0f}' for end in bounds)}]" if bounds else ""
    return f"{sign * 100 * gain.value:.0f}{interval} % {more}"


def _listed(episodes: tuple[str, ...]) -> str:
    """A few by their names, many by their number."""
    return f"held-out {_and(episodes)}" if len(episodes) <= 2 else f"{len(episodes)} held-out episodes"


def _and(names: tuple[str, ...]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
