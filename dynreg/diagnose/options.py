"""The options of a diagnosis, as plain values."""

from dataclasses import dataclass
from typing import Literal

Ranker = Literal["auto", "make", "off"]


@dataclass(frozen=True)
class DiagnosisOptions:
    """How a recording is cut into rollouts, which effects are candidates, and the limits of the search.

    hold_out : the test part; see `replay.parts`. effects : ids of the candidate effects; None for all that the robot
        can have. without : ids to leave out. max_causes : most causes to name. engine : one of the robot's engines;
        None for its first. threshold_runs : simulations without an effect that determine the threshold; 0 takes the
        default threshold. threads : simulation threads, 0 for all cores. horizon : longest rollout [s]; None takes the
        robot's, or 10 s. tolerance : factor on the tolerances of the nameplate; above 1 if the stated parameters are
        rough guesses. joints : only these are diagnosed, and the channels of the others do not count; None for all.
        windows : most rollouts to fit, and most to select by, drawn over all episodes by the seed; None takes all, and
        splits them by episode.
    ranker : what says which causes to refit first, and whether none of the known ones looks like the log: simulators
        with one effect each under its commands. "auto" takes those that the cache holds, but for robots that
        stand on feet: what slips hides the cause there. "make" makes them where it holds none, "off" does without.
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
    ranker: Ranker = "auto"
