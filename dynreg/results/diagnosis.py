"""The answer of `diagnose`: which physical causes a simulator lacks, how sure that is, and the unexplained error."""

import html
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, model_validator

from dynreg.axes import axes_for
from dynreg.diagnose.kinds import DoubtKind, Verdict
from dynreg.results.posterior import Posterior
from dynreg.results.refit import Refit
from dynreg.results.result import Cost, Curves, Estimate, Gain, Interval, Result, change, plot_curves

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.axes import Axes

CauseVerdict = Literal["named", "ambiguous", "partly_explained"]
Simulator = Literal["nominal", "calibrated", "extended"]


def cause_key(effect: str, places: tuple[str, ...]) -> str:
    """The name of an effect at a place, as the ranking and the equivalents give it.

    >>> cause_key("load_friction", ()), cause_key("backlash", ("hip", "knee")), cause_key("payload", ("flange",))
    ('load_friction', 'backlash[hip,knee]', 'payload[flange]')
    """
    return effect + (f"[{','.join(places)}]" if places else "")


class EffectOn(Result):
    """An effect on some joints; none for all of them, or for the robot as a whole.

    bodies : the body, tool frame or material that has an effect of one; none for what it takes for granted.
    """

    effect: str
    joints: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()

    @property
    def places(self) -> tuple[str, ...]:
        """Its joints, or its body, tool frame or material."""
        return self.joints or self.bodies

    @property
    def key(self) -> str:
        """`effect[joints]`, or `effect[body]`."""
        return cause_key(self.effect, self.places)


class EffectEstimate(Interval):
    """A parameter of a cause with its 90 % interval, in `unit`; the interval holds if the cause is the right one.

    at_bound : the value lies on the edge of what a fit may reach. sizes : the weak, medium and strong size.
    """

    at_bound: bool = False
    sizes: tuple[float, float, float] | None = None


class Cause(EffectOn):
    """A physical effect that the simulator lacks.

    joints : those that have it; none for all of them, or for the robot as a whole.
    evidence_nats : gain of the log-likelihood on the fit and select parts, less what its parameters cost. replaced :
    whether calibrated parameters, far from their nameplate, stand in for it: then its gain over them says little.
    equivalent : keys of the causes that explain the data as well, by what they scored or because they are of its exact
    group and were not fitted; separate_by : the experiment that separates them.
    inseparable : the others of its exact group, which commands alone do not separate, whatever they scored.
    gain : by how much it lowers the error on the test part; null where nothing was held out.
    """

    title: str = ""
    verdict: CauseVerdict
    parameters: dict[str, EffectEstimate]
    evidence_nats: float
    replaced: bool = False
    equivalent: tuple[str, ...] = ()
    inseparable: tuple[str, ...] = ()
    separate_by: str = ""
    gain: Gain | None = None


class Doubt(Result):
    """A reason not to call the causes named, however much evidence they have.

    kind : "pulled": a parameter left its nameplate by `value` sigma. "parameter_at_bound", "size_at_bound": a
    parameter, or the size of a cause [medium sizes], ended at the edge of its range. "small": after the last fit a
    cause is under half its weak size; `value` is the size over the weak one. "no_gain": a cause raises the held-out
    error; `value` is its gain. "no_better": the last simulator errs more than a robot that holds still or just
    follows its commands; `value` is its error over theirs. "unlike": no simulator with one of the known causes looks
    like the recording; `value` is how much the nearest does, up to 1.
    of : the parameter or the key of the cause; "" of the whole simulator.
    """

    kind: DoubtKind
    of: str
    value: float


class Looked(EffectOn):
    """How large the effect may be that was looked at most closely: the first cause, or without one that asked for, or
    the best ranked.

    alone : its parameters with 90 % intervals (value: the median), if nothing else is wrong. rivals : its neighbours
    that move the robot most like it. whatever : intervals that hold with each of them acting, too.
    """

    rivals: tuple[str, ...]
    alone: dict[str, EffectEstimate]
    whatever: dict[str, EffectEstimate]


class Inseparable(Result):
    """Two causes that the recording does not separate: the interval of one grows when the other may act as well.

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

    low, high : null where it was not fitted (earlier versions wrote the value there): then `value` is what the
    simulator at the start has. pulled_sigma : how far it lies from its nameplate, in standard deviations as robot.toml
    states them, whatever the search began with; null where none is stated. share : of what calibration gains on the
    data that it was fitted to, what this parameter makes alone, by its calibrated value in the simulator at the start;
    null where calibration gains nothing there.
    """

    low: float | None
    high: float | None
    pulled_sigma: float | None = None
    share: float | None = None

    @property
    def fitted(self) -> bool:
        """Whether the recording had a say in its value."""
        return self.low is not None and (self.low != self.high or self.at_bound)


class Moved(Result):
    """A parameter that changed when the cause was added; without the cause it had compensated for it."""

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

    repeatability : by how much two runs of the same commands differ; null where no run was repeated. unpenalised : of
    the simulator that was calibrated without the prior of the nameplate. held, followed : of a robot that holds still,
    and of one whose joints just follow their commands with a lag; null where the channel has none, and in documents
    that were stored before they were told.
    """

    channel: str
    unit: str
    metric: Literal["rollout_mae"] = "rollout_mae"
    nominal: float
    calibrated: float | None
    extended: float | None
    repeatability: float | None = None
    unpenalised: float | None = None
    held: float | None = None
    followed: float | None = None
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
    """The unexplained error of one channel and its noise floor, which no simulator can explain; 1 sigma in `unit`.

    left : the unexplained error of the best simulator; where contacts make rollouts rough, the mean of its logarithm
    over the windows. basis : the source of the floor. The stated noise of a planar base includes that of its first
    pose, which the whole path carries along. ratio : left / floor; null, and the floor 0, where no run was repeated and
    no noise is stated. limit : the ratio up to which it counts as explained, with the sampling
    error of both. white : whether the residual looks like white noise; null where unknown. usual : whether simulated
    robots without an effect leave as much; null where none were simulated. explained : whether any of these explains
    it; null in documents that were stored before that was told.
    """

    channel: str
    unit: str
    left: float
    floor: float
    basis: Literal["repeatability", "stated_noise"]
    ratio: float | None
    limit: float | None = None
    white: bool | None = None
    usual: bool | None = None
    explained: bool | None = None


class ResidualShare(Result):
    """The share of a joint's residual that one of its signals predicts, on unseen trajectories."""

    joint: str
    signal: str
    share: float


class Rest(Result):
    """How well the signals of a joint predict the residual of its acceleration under the best simulator.

    left : the residual, 1 sigma in `unit`. told : the share of its variance that a small model predicts on unseen
    trajectories. A cause that depends on this joint's signals can remove no more than that.
    chance : the same for residuals paired with the signals of other trajectories.
    """

    joint: str
    unit: str
    left: float
    told: float
    chance: float
    samples: int
    trajectories: int


class Resemblance(Result):
    """What simulators with one effect each, under the recording's commands, say that it looks like.

    causes : the likeliest first. resemblance : 1 where the nearest of these simulators shows all that the recording has
    beyond noise, 0 where it shows nothing. outside : none of the known causes looks like this; one cause alone then
    explains part of the error at most. entries : how many simulators.
    """

    causes: tuple[str, ...]
    resemblance: float
    outside: bool
    entries: int


class DiagnosisTrace(Curves):
    """Measured and simulated values of one channel in one episode; time [s]; null where there is no such simulator."""

    calibrated: list[float | None] | None = None
    extended: list[float | None] | None = None


class Diagnosis(Result):
    """What a simulator lacks, by a recording of the robot.

    start : from which simulator it began ("nominal", "nearest" or an id); simulator : that one's id, where it has one.
    verdict : of the first cause; "unknown": there is an error that no effect explains; "none": nothing is.
    sentence : the verdict for a person. gain : of all causes together over the better calibration, on the test part;
    null without causes or where nothing was held out. rival : that calibration, with the prior of the nameplate
    ("calibrated") or without ("unpenalised"); null in documents that were stored before it was told. calibration : of
    the calibrated simulator over that at the start, on the test part. over_start : of the simulator that it leaves (the
    extended one, else the calibrated one) over that at the start; below 0 where that one predicts it better.
    doubts : what speaks against the causes; with any of them the verdict is at most "partly_explained".
    threshold_nats : the evidence below which no cause is named.
    posterior : of the free parameters and the sizes of the effects, in the simulator that it leaves; null in documents
    that were stored before it was kept.
    error : of the channel that matters most; errors : of every channel. finding : the sentence of `where`.
    rest, residual : how well each joint's signals predict its unexplained acceleration, and which of them do; null
    where no error is unexplained, or where the log does not tell the states to predict from.
    looked : how large the first cause may be, whatever else acts. inseparable : the rivals that the recording does
    not separate from it.
    resembles : what the recording looks like beside simulators with one effect each; null where there were none.
    asked : the options that decide the answer, by name; null in documents that were stored before they were kept.
    recordings : names of several that were asked about at once; stable : what is the same in all of them, and what not.
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
    rival: Literal["calibrated", "unpenalised"] | None = None
    calibration: Gain | None = None
    over_start: Gain | None = None
    doubts: tuple[Doubt, ...] = ()
    ranking: tuple[Ranked, ...]
    threshold_nats: float
    threshold: Threshold
    parameters: dict[str, Pulled]
    posterior: Posterior | None = None
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
    recordings: tuple[str, ...] = ()
    stable: tuple[Refit, ...] = ()
    resembles: Resemblance | None = None
    asked: dict[str, Any] | None = None
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

    @property
    def worse(self) -> bool:
        """Whether the simulator that it began with predicts the test part better than the one that it leaves.

        The 90 % interval of the difference does not hold 0, where there is an interval.
        """
        return self.over_start is not None and self.over_start.worse

    @property
    def unclear(self) -> bool:
        """Whether the test part does not show that the simulator it leaves is better, nor that it is worse."""
        gain = self.over_start
        return gain is not None and not self.worse and gain.low is not None and gain.low <= 0

    @property
    def began(self) -> str:
        """The simulator that it began with, in words."""
        return "the nominal simulator" if self.start == "nominal" else "the simulator at the start"

    @property
    def left(self) -> str:
        """What the simulator that it leaves is called."""
        return "extended" if self.extended_simulator else "calibrated"

    @property
    def leaves(self) -> bool:
        """Whether an error is left that is more than noise; of documents that do not tell, the verdict says so."""
        if self.noise is None or self.noise.explained is None:
            return self.verdict in ("partly_explained", "unknown")
        return not self.noise.explained

    @property
    def unexplained(self) -> bool:
        """Whether the model is known to lack something that no effect of the library is.

        A parameter then makes up for what is missing, and its interval is too narrow.
        """
        return self.verdict == "unknown"

    @property
    def reliance(self) -> str:
        """How far the intervals of the parameters can be relied on, in words."""
        if self.unexplained:
            return "Do not rely on these intervals: they hold only if the model is complete, and it is not."
        if self.verdict == "partly_explained" and self.leaves:
            return "These intervals hold only if the model is complete, and part of the error is unexplained."
        if self.verdict == "partly_explained":
            return "These intervals hold only if the model is complete, and what is said above speaks against that."
        held = "These intervals hold if the model is complete."
        if self.noise is not None and self.noise.white is False:
            return f"{held} What is left is no white noise, and they are wider for it."
        return held

    def rows(self) -> list[dict[str, Any]]:
        """The ranking."""
        return [
            {
                "effect": r.effect,
                "joints": ", ".join(r.joints),
                "bodies": ", ".join(r.bodies),
                "nats": r.score_nats,
            }
            for r in self.ranking
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
                {"parameter": name, **p.model_dump(exclude={"limits"}), "fitted": p.fitted}
                for name, p in self.parameters.items()
            ],
            "error": [e.model_dump(exclude={"metric"}) for e in self.errors or (self.error,)],
        }

    def _repr_html_(self) -> str:
        return f"{super()._repr_html_()}<p>Intervals of the parameters: {html.escape(self.reliance)}</p>"

    def plot(
        self,
        what: Literal["curves", "ranking"] = "curves",
        channel: str | None = None,
        ax: "Axes | None" = None,
    ) -> "np.ndarray":
        """What was measured and simulated in a held-out episode, or how the causes rank; (n,) matplotlib axes.

        what : "curves", one axes a channel, or "ranking", one axes: evidence [nats] in the first round, with what a
        cause needs. channel : only this one, which `ax` can take. Raises UsageError where there is nothing to draw.
        """
        if what == "curves":
            return plot_curves(self.traces, ("measured", "extended", "calibrated", "nominal"), channel, ax)
        first = [r for r in self.ranking if r.round == 1]
        places = axes_for(min(1, len(first)), ax, what="rankings", height=1.0 + 0.25 * len(first))
        places[0].barh([r.key for r in reversed(first)], [r.score_nats for r in reversed(first)])
        places[0].axvline(self.threshold_nats, color="black", linestyle=":", label="needed")
        places[0].set(xlabel="evidence [nats]", title=f"ranking of causes, {self.recording_name}")
        places[0].legend()
        return places

    def brief(self) -> str:
        causes = " and ".join(cause.key for cause in self.causes)
        gain = f", held-out error {change(self.gain.value)}" if self.gain else ""
        return f"of {self.recording_name or self.recording[:12]}: {self.verdict} {causes}".rstrip() + gain

    def __str__(self) -> str:
        return self.sentence
