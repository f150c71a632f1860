"""The answer of `diagnose`: which physical causes a simulator lacks, how sure that is, and what is left."""

from typing import Any, Literal

from pydantic import Field, model_validator

from dynreg.results.result import Cost, Curves, Estimate, Gain, Interval, Result

Verdict = Literal["named", "ambiguous", "partly_explained", "unknown", "none"]
CauseVerdict = Literal["named", "ambiguous", "partly_explained"]
Simulator = Literal["nominal", "calibrated", "extended"]


def cause_key(effect: str, joints: tuple[str, ...]) -> str:
    """The name of an effect on some joints, as the ranking and the equivalents give it.

    >>> cause_key("load_friction", ()), cause_key("backlash", ("hip", "knee"))
    ('load_friction', 'backlash[hip,knee]')
    """
    return effect + (f"[{','.join(joints)}]" if joints else "")


class EffectOn(Result):
    """An effect on some joints; none for all of them, or for the robot as a whole."""

    effect: str
    joints: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """`effect[joints]`."""
        return cause_key(self.effect, self.joints)


class EffectEstimate(Interval):
    """A parameter of a cause with its 90 % interval, in `unit`; the interval holds if the cause is the right one.

    at_bound : the value lies on the edge of what a fit may reach. sizes : the weak, medium and strong size.
    """

    at_bound: bool = False
    sizes: tuple[float, float, float] | None = None


class Cause(EffectOn):
    """A physical effect that the simulator lacks.

    joints : those that have it; none for all of them, or for the robot as a whole.
    evidence_nats : gain of the log-likelihood on the fit and select parts, less what its parameters cost.
    equivalent : keys of the causes that explain the data as well; separate_by : the experiment that tells them apart.
    inseparable : those of them that no commands tell apart, the rest of its exact group.
    gain : by how much it lowers the error on the test part; null where nothing was held out.
    """

    title: str = ""
    verdict: CauseVerdict
    parameters: dict[str, EffectEstimate]
    evidence_nats: float
    equivalent: tuple[str, ...] = ()
    inseparable: tuple[str, ...] = ()
    separate_by: str = ""
    gain: Gain | None = None


class Looked(EffectOn):
    """How large the effect may be that was looked at most closely: the first cause, or without one that asked for, or
    the best ranked.

    alone : its parameters with 90 % intervals (value: the median), if nothing else is amiss. rivals : its neighbours
    that move the robot most like it. whatever : intervals that hold with each of them acting, too.
    """

    rivals: tuple[str, ...]
    alone: dict[str, EffectEstimate]
    whatever: dict[str, EffectEstimate]


class Inseparable(Result):
    """Two causes that the recording cannot tell apart: the interval of one grows when the other may act as well.

    between : keys of the cause looked at and its rival. cause, rival : parameters of both, with 90 % intervals, if both
    may act (value: the median). growth : how many times wider the interval of the cause's first parameter gets when it
    has to hold in both cases. absent : whether it then reaches down to where the cause is not worth naming.
    experiment : the command that writes an experiment which separates them.
    """

    between: tuple[str, str]
    cause: dict[str, EffectEstimate]
    rival: dict[str, EffectEstimate]
    growth: float
    absent: bool
    experiment: str


class Ranked(EffectOn):
    """A hypothesis and what it scored in round `round` (the first cause is found in round 1); note : why it lost."""

    score_nats: float
    round: int = 1
    note: str = ""


class Pulled(Estimate):
    """A parameter of the model beside the cause, in the extended simulator (the calibrated one without a cause).

    pulled_sigma : how far it lies from its nameplate, in standard deviations of that; null where none is stated.
    """

    pulled_sigma: float | None = None


class Moved(Result):
    """A parameter that took another value when the cause was added: before it had made up for the cause."""

    name: str
    before: float
    after: float
    unit: str


class Threshold(Result):
    """How the evidence that a cause needs was found: from `runs` simulations of this robot without any effect.

    cached : they were run for an earlier diagnosis. runs is 0 where a default was taken.
    """

    runs: int
    cached: bool = False
    note: str = ""


class RolloutError(Result):
    """The error of one channel on one part of the recording, in `unit`.

    repeatability : by how much two runs of the same commands differ; null where no run was repeated.
    """

    channel: str
    unit: str
    metric: Literal["rollout_mae"] = "rollout_mae"
    nominal: float
    calibrated: float | None
    extended: float | None
    repeatability: float | None = None
    part: Literal["test", "select", "fit"] = "test"


class Where(Result):
    """The share of a simulator's whole error that lies on one channel in one regime of the motion.

    Regimes overlap: a reversal is mostly slow, too; "overall" stands for all samples. error : mean error there in
    `unit`. ratio : that over the mean error elsewhere; null where there is no elsewhere.
    """

    channel: str
    regime: str
    share: float
    simulator: Simulator = "calibrated"
    joint: str | None = None
    unit: str = ""
    error: float | None = None
    ratio: float | None = None


class Noise(Result):
    """What the best simulator leaves of one channel, against what no simulator can explain; both 1 sigma in `unit`.

    left : where contacts make rollouts rough, the mean of its logarithm over the windows.
    basis : what the floor comes from; stated noise is also that of the pose which a planar base begins with, and which
    it carries along. white : whether what is left looks like white noise; null where unknown.
    """

    channel: str
    unit: str
    left: float
    floor: float
    basis: Literal["repeatability", "stated_noise"]
    ratio: float | None
    white: bool | None = None


class ResidualShare(Result):
    """The share of what is left of a joint's motion that one signal of it tells, on trajectories not seen before."""

    joint: str
    signal: str
    share: float


class Rest(Result):
    """How much of what the best simulator leaves of a joint's acceleration can be told from the joint's signals.

    left : 1 sigma in `unit`. told : the share of its variance that a small model predicts on trajectories that it has
    not seen; what a cause that no library has could take off at most, as far as this joint's signals show it.
    chance : the same for residuals paired with the signals of other trajectories.
    """

    joint: str
    unit: str
    left: float
    told: float
    chance: float
    samples: int
    trajectories: int


class DiagnosisTrace(Curves):
    """Measured and simulated values of one channel in one episode; time [s]; null where there is no such simulator."""

    calibrated: list[float | None] | None = None
    extended: list[float | None] | None = None


class Diagnosis(Result):
    """What a simulator lacks, by a recording of the robot.

    start : from which simulator it began ("nominal", "nearest" or an id); simulator : that one's id, where it has one.
    verdict : of the first cause; "unknown": something is amiss that no effect explains; "none": nothing is.
    sentence : the verdict for a person. gain : of all causes together over the calibrated simulator, on the test part;
    null without causes or where nothing was held out. threshold_nats : the evidence below which no cause is named.
    error : of the channel that matters most; errors : of every channel. finding : the sentence of `where`.
    rest, residual : where something is left, how much of it each joint's signals tell, and on which of them it
    depends; null where nothing is, or where the log does not say from which states to predict.
    looked : how large the first cause may be, whatever else acts. inseparable : the rivals that the recording cannot
    tell from it.
    inputs : what the log measured and the simulators were driven by. notes : what else a reader must know.
    """

    schema_: Literal["dynreg/diagnosis/1"] = Field(default="dynreg/diagnosis/1", alias="schema")
    robot: str
    recording: str
    recording_name: str = ""
    start: str = "nominal"
    simulator: str | None
    verdict: Verdict
    sentence: str
    causes: tuple[Cause, ...]
    gain: Gain | None = None
    ranking: tuple[Ranked, ...]
    threshold_nats: float
    threshold: Threshold
    parameters: dict[str, Pulled]
    moved: tuple[Moved, ...] = ()
    error: RolloutError
    errors: tuple[RolloutError, ...] = ()
    where: tuple[Where, ...]
    finding: str = ""
    looked: Looked | None = None
    inseparable: tuple[Inseparable, ...] = ()
    noise: Noise | None
    rest: tuple[Rest, ...] | None = None
    residual: tuple[ResidualShare, ...] | None = None
    experiments: tuple[str, ...]
    parts: dict[Literal["fit", "select", "test"], tuple[str, ...]]
    traces: tuple[DiagnosisTrace, ...] = ()
    inputs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    calibrated_simulator: str | None = None
    extended_simulator: str | None
    engine: str = ""
    seed: int = 0
    cost: Cost

    @model_validator(mode="after")
    def _verdict_fits_causes(self) -> "Diagnosis":
        stated = self.verdict in ("named", "ambiguous", "partly_explained")
        if stated and (not self.causes or self.causes[0].verdict != self.verdict):
            raise ValueError(f"verdict {self.verdict!r} without a first cause of that verdict")
        if self.verdict == "none" and self.causes:
            raise ValueError(f"verdict 'none' with the cause {self.causes[0].key!r}")
        return self

    def rows(self) -> list[dict[str, Any]]:
        """The ranking."""
        return [
            {"effect": r.effect, "joints": ", ".join(r.joints), "nats": r.score_nats} for r in self.ranking
        ]

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        """Causes with their parameters, the ranking, the other parameters, and the error of every channel."""
        causes = [
            {"cause": c.key, "verdict": c.verdict, "nats": c.evidence_nats, "parameter": name}
            | e.model_dump(exclude={"sizes", "at_bound"})
            for c in self.causes
            for name, e in c.parameters.items()
        ]
        return {
            "causes": causes,
            f"ranking (a cause needs {self.threshold_nats:.3g} nats)": self.rows(),
            "parameters": [
                {"parameter": name, **p.model_dump(exclude={"limits"})} for name, p in self.parameters.items()
            ],
            "error": [e.model_dump(exclude={"metric"}) for e in self.errors or (self.error,)],
        }

    def __str__(self) -> str:
        return self.sentence
