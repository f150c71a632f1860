"""The options of a diagnosis, as plain values."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnosisOptions:
    """How a recording is cut, what may be named in it, and how long the search takes.

    hold_out : the test part; see `replay.parts`. effects : ids of the effects that may be named, None for all that the
        robot can have; without : left out. max_causes : after how many causes to stop. engine : one of the robot's,
        its first by default. threshold_runs : simulations without any effect from which the threshold is found; 0
        takes the default threshold. threads : simulation threads, 0 for all cores. horizon : episodes are cut into
        rollouts of at most so many seconds; None takes the robot's, or 10 s. tolerance : factor on the nameplate's
        tolerances: above 1 where the stated parameters are rough guesses. joints : these alone are diagnosed, the
        others' channels do not count; None for all. windows : the most rollouts to fit, and as many to select by,
        drawn over all episodes by the seed, so that both parts see each; None takes them all, and parts them by
        episode.
    """

    hold_out: str | None = None
    effects: tuple[str, ...] | None = None
    without: tuple[str, ...] = ()
    max_causes: int = 3  # one more than any bench hides
    engine: str | None = None
    seed: int = 0
    threshold_runs: int = 20  # as the tables of legs in the air and of quadrupeds have
    threads: int = 0
    horizon: float | None = None
    tolerance: float = 1.0
    joints: tuple[str, ...] | None = None
    windows: int | None = None
