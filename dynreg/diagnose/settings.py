"""What a diagnosis and a trial can be told: frozen, and checked when they are made."""

from dataclasses import dataclass
from typing import Literal

from dynreg.errors import UsageError
from dynreg.sim.effects import SIZES, effect, term

MOST_CAUSES = 10


@dataclass(frozen=True)
class Settings:
    """Settings of a diagnosis.

    start : the simulator to begin from: "nominal", "nearest" (the answer of the last query about the recording), or
        the id, unique prefix or name of a stored one. hold_out : the test part; see `replay.parts`.
    effects : ids of the effects that may be named, None for all that the robot can have; without : left out.
    max_causes : after how many causes to stop. engine : one of the robot's, its first by default.
    threshold_runs : simulations without any effect from which the threshold is found; 0 takes the default threshold.
    threads : simulation threads, 0 for all cores. horizon : episodes are cut into rollouts of at most so many
        seconds; None takes the robot's, or 10 s. tolerance : factor on the nameplate's tolerances: above 1 where the
        stated parameters are rough guesses. joints : these alone are diagnosed, the others' channels do not count;
        None for all. windows : the most rollouts to fit, and as many to select by, drawn over all episodes by the
        seed, so that both parts see each; None takes them all, and parts them by episode.
    Raises UsageError for an unknown effect, one that is asked for and left out, or a number that is too small.
    """

    start: str = "nominal"
    hold_out: str | None = None
    effects: tuple[str, ...] | None = None
    without: tuple[str, ...] = ()
    max_causes: int = 3
    engine: str | None = None
    seed: int = 0
    threshold_runs: int = 20
    threads: int = 0
    horizon: float | None = None
    tolerance: float = 1.0
    joints: tuple[str, ...] | None = None
    windows: int | None = None

    def __post_init__(self):
        for name in (*(self.effects or ()), *self.without):
            effect(name)
        both = sorted({*(self.effects or ())} & {*self.without})
        if both:
            raise UsageError(
                f"effects {both} are asked for and left out",
                expected="one of the two",
                do="drop them from one",
            )
        if self.effects is not None and not self.effects:
            raise UsageError(
                "no effects", expected="at least one id", do="name some, or leave the choice out"
            )
        if not self.start:
            raise UsageError(
                "start ''", expected="nominal, nearest or the id of a simulator", do="name one of these"
            )
        if not 0 < self.tolerance < float("inf"):
            raise UsageError(
                f"tolerance {self.tolerance:g}", expected="a positive factor", do="give another number"
            )
        if self.horizon is not None and not 0 < self.horizon < float("inf"):
            raise UsageError(f"horizon {self.horizon:g} s", expected="a positive length", do="give another")
        if self.joints is not None and not self.joints:
            raise UsageError(
                "no joints", expected="at least one", do="name some, or leave the choice out for all"
            )
        if self.windows is not None:
            _whole("windows", self.windows, 1)
        _whole("max_causes", self.max_causes, 1, MOST_CAUSES)
        _whole("threshold_runs", self.threshold_runs, 0)
        _whole("seed", self.seed, 0)
        _whole("threads", self.threads, 0)


@dataclass(frozen=True)
class TrialSettings:
    """Settings of a trial: what robots hide, how many there are, and how long their logs.

    hide : "drawn" (each robot hides an effect drawn for it), "chosen" (those of `effects`, together), "nothing", or
        "every" (each effect that the robot can have, `count` robots with each).
    effects : keys such as "load_friction" or "backlash[fl_hip]", with hide = "chosen" only. size : weak, medium,
        strong. count : robots. seconds : length of each log. threshold_runs, engine, threads : as in `Settings`.
    Raises UsageError where these do not fit together.
    """

    hide: Literal["drawn", "chosen", "nothing", "every"] = "drawn"
    effects: tuple[str, ...] = ()
    size: str = "medium"
    count: int = 1
    seed: int = 0
    seconds: float = 50.0
    engine: str | None = None
    threshold_runs: int = 20
    threads: int = 0

    def __post_init__(self):
        if self.hide not in ("drawn", "chosen", "nothing", "every"):
            raise UsageError(
                f"hide {self.hide!r}", expected="drawn, chosen, nothing or every", do="choose one of these"
            )
        if (self.hide == "chosen") != bool(self.effects):
            raise UsageError(
                f"hide {self.hide!r} with effects {list(self.effects)}",
                expected="effects with 'chosen', and only there",
                do="name effects, or choose another way to hide",
            )
        for key in self.effects:
            term(key)
        if self.size not in SIZES:
            raise UsageError(
                f"size {self.size!r}", expected=f"one of {list(SIZES)}", do="choose one of these"
            )
        if not 0 < self.seconds < float("inf"):
            raise UsageError(f"{self.seconds:g} s", expected="a positive length", do="ask for more seconds")
        _whole("count", self.count, 1)
        _whole("threshold_runs", self.threshold_runs, 0)
        _whole("seed", self.seed, 0)
        _whole("threads", self.threads, 0)


def _whole(name: str, value: int, least: int, most: int | None = None) -> None:
    if value < least or (most is not None and value > most):
        expected = f"a whole number of {least} or more" if most is None else f"{least} to {most}"
        raise UsageError(f"{name} {value}", expected=expected, do="give another number")
