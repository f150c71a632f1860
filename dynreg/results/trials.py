"""The answer of `trial`: how often a diagnosis names the right effect on simulated robots with a hidden effect."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any, Literal

from pydantic import Field

from dynreg.diagnose.kinds import Verdict
from dynreg.results.result import Result
from dynreg.sim.sizes import SIZES, Size


class Rate(Result):
    """`hits` of `of` with the exact (Clopper-Pearson) 90 % interval."""

    hits: int
    of: int
    value: float
    low: float
    high: float


def rate(found: Iterable[bool]) -> Rate | None:
    """The share of True values; None of an empty sequence.

    >>> r = rate([True] * 9 + [False])
    >>> r.value, round(r.low, 3), round(r.high, 3)
    (0.9, 0.606, 0.995)
    """
    from scipy.stats import beta

    all_ = list(found)
    hits, of = sum(all_), len(all_)
    if not of:
        return None
    low = float(beta.ppf(0.05, hits, of - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.95, hits + 1, of - hits)) if hits < of else 1.0
    return Rate(hits=hits, of=of, value=hits / of, low=low, high=high)


def confident(verdict: str) -> bool:
    """Whether a verdict says that the first cause explains the log."""
    return verdict in ("named", "ambiguous")


class TrialResult(Result):
    """One simulated robot with a hidden effect (or none), and its diagnosis.

    hidden : id of the effect ("a+b" for two), null without one. size : weak, medium or strong.
    joints, bodies : those that have it, as `EffectOn` has them.
    hidden_values : true values of the effect's parameters. true_parameters : true values of the robot's parameters.
    outside : the library has no name for what is hidden; then right means that no cause was named with confidence.
    named : key of the first cause. causes : keys of all causes.
    right : with a hidden effect: the verdict is named or ambiguous, and the first cause is the true effect or one of
    its exact group; of several hidden effects, each is among the causes in this sense. Without one: no cause was named.
    in_part : the causes are right, and the verdict says that they explain a part only.
    joint_right : the first cause acts on the joint (body, tool frame) of the true effect; null if that has no such.
    false_alarm : a cause was named, and there is no hidden effect. in_set : the true effect is the first cause or one
    of its equivalents. size_of_set : number of these. share_of_attainable_gain : (calibrated - extended) /
    (calibrated - true structure refitted), of the error on the test part. parameter_error : relative error of the
    effect's size. covered : the 90 % interval of the size covers the truth; null if that was not checked.
    seconds : wall time of the diagnosis. core_seconds : processor time on all cores.
    """

    schema_: Literal["dynreg/trial/1"] = Field(default="dynreg/trial/1", alias="schema")
    robot: str
    seed: int
    hidden: str | None
    outside: bool = False
    size: Size | None = None
    joints: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    hidden_values: dict[str, float] = {}
    true_parameters: dict[str, float] = {}
    named: str | None
    causes: tuple[str, ...] = ()
    verdict: Verdict
    right: bool
    in_part: bool = False
    joint_right: bool | None = None
    false_alarm: bool
    in_set: bool | None = None
    size_of_set: int = 0
    share_of_attainable_gain: float | None = None
    parameter_error: float | None = None
    covered: bool | None = None
    seconds: float
    core_seconds: float | None = None

    @property
    def judged(self) -> str:
        """right, in part, wrong or missed; of a robot without a hidden effect right or wrong."""
        return "right" if self.right else "in part" if self.in_part else "wrong" if self.wrong else "missed"

    @property
    def wrong(self) -> bool:
        """Whether a wrong cause was named; an effect that is missed, or named as a part, is no wrong one."""
        return self.named is not None and not self.right and not self.in_part


class TrialGroup(Result):
    """The trials with the same hidden effect; hidden is null for those without one."""

    hidden: str | None
    trials: int
    right: Rate
    in_set: Rate | None


class Confusion(Result):
    """How often a hidden effect was named as another one, or named right for a part; null stands for no effect."""

    hidden: str | None
    named: str | None
    in_part: bool = False
    count: int


class TrialTable(Result):
    """Many trials with their rates. `TrialTable.of` makes it.

    right, in_part, in_set, wrong : over the trials with a hidden effect that has a name; wrong counts wrong causes.
    outside : how often a cause was named with confidence where the library has no name for what is hidden.
    joint_right : over those whose effect acts on some joints only. false_alarm : over the trials without a hidden
    effect. not_none : how often these got another verdict than none. by_size, by_effect : `right` by size and by
    effect. set_median, set_p95 : median and 95th percentile of `size_of_set`.
    """

    schema_: Literal["dynreg/trials/1"] = Field(default="dynreg/trials/1", alias="schema")
    robot: str
    trials: tuple[TrialResult, ...]
    right: Rate | None
    in_part: Rate | None = None
    joint_right: Rate | None = None
    covered: Rate | None = None
    in_set: Rate | None
    wrong: Rate | None
    false_alarm: Rate | None
    not_none: Rate | None = None
    outside: Rate | None = None
    by_size: dict[str, Rate]
    by_effect: tuple[TrialGroup, ...]
    confusions: tuple[Confusion, ...]
    set_median: float | None
    set_p95: float | None
    gain_share_median: float | None
    parameter_error_median: float | None
    seconds_median: float | None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, robot: str, trials: Sequence[TrialResult], notes: Sequence[str] = ()) -> "TrialTable":
        """The table of these trials."""
        with_effect = [t for t in trials if t.hidden is not None and not t.outside]
        sets = sorted(t.size_of_set for t in with_effect if t.size_of_set)
        sizes = [s for s in SIZES if any(t.size == s for t in with_effect)]
        return cls(
            robot=robot,
            trials=tuple(trials),
            right=rate(t.right for t in with_effect),
            in_part=rate(t.in_part for t in with_effect),
            joint_right=rate(t.joint_right for t in with_effect if t.joint_right is not None),
            covered=rate(t.covered for t in with_effect if t.covered is not None),
            in_set=_in_set(with_effect),
            wrong=rate(t.wrong for t in with_effect),
            false_alarm=rate(t.false_alarm for t in trials if t.hidden is None),
            not_none=rate(t.verdict != "none" for t in trials if t.hidden is None),
            outside=rate(confident(t.verdict) for t in trials if t.outside),
            by_size={s: rate(t.right for t in with_effect if t.size == s) for s in sizes},
            by_effect=_groups(trials),
            confusions=_confusions(trials),
            set_median=median(sets) if sets else None,
            set_p95=float(sets[math.ceil(0.95 * len(sets)) - 1]) if sets else None,
            gain_share_median=_median(t.share_of_attainable_gain for t in with_effect),
            parameter_error_median=_median(t.parameter_error for t in with_effect if t.right),
            seconds_median=_median(t.seconds for t in trials),
            notes=tuple(notes),
        )

    def rows(self) -> list[dict[str, Any]]:
        """One row for each trial."""
        left_out = ("schema", "hidden_values", "true_parameters")
        rows = [
            t.to_dict() | {key: ", ".join(getattr(t, key)) for key in ("joints", "bodies", "causes")}
            for t in self.trials
        ]
        return [{k: v for k, v in row.items() if k not in left_out} for row in rows]

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        """Rates with their intervals, and the trials."""
        named = [
            ("right", self.right),
            ("right in part", self.in_part),
            ("joint right", self.joint_right),
            ("in set", self.in_set),
            ("wrong name", self.wrong),
            ("not none", self.not_none),
            ("named, outside the library", self.outside),
        ]
        named += [("false alarm", self.false_alarm), *((f"right, {s}", r) for s, r in self.by_size.items())]
        named += [(f"right, {g.hidden or 'no hidden effect'}", g.right) for g in self.by_effect]
        return {
            "rates": [{"": name} | r.to_dict() for name, r in named if r is not None],
            "trials": self.rows(),
        }

    def __str__(self) -> str:
        parts = [
            f"{name} {r.hits} of {r.of}"
            for name, r in (
                ("right", self.right),
                ("right in part", self.in_part if self.in_part and self.in_part.hits else None),
                ("joint right", self.joint_right),
                ("wrong name", self.wrong),
                ("false alarm", self.false_alarm),
            )
            if r is not None
        ]
        return f"{self.robot}: {', '.join(parts) or 'no trials'}"


def _in_set(trials: Iterable[TrialResult]) -> Rate | None:
    return rate(t.in_set for t in trials if t.in_set is not None)


def _groups(trials: Sequence[TrialResult]) -> tuple[TrialGroup, ...]:
    found = []
    for hidden in dict.fromkeys(t.hidden for t in trials):
        mine = [t for t in trials if t.hidden == hidden]
        found.append(
            TrialGroup(
                hidden=hidden,
                trials=len(mine),
                right=rate(t.right for t in mine),
                in_set=_in_set(mine),
            )
        )
    return tuple(sorted(found, key=lambda g: (g.hidden is None, g.hidden or "")))


def _confusions(trials: Sequence[TrialResult]) -> tuple[Confusion, ...]:
    """The trials that are not right, by hidden and named effect, the most frequent first; joints are ignored."""
    plain = [
        (t.hidden, t.named and re.sub(r"\[[^]]*\]", "", t.named), t.in_part) for t in trials if not t.right
    ]
    pairs = sorted(Counter(plain).items(), key=lambda item: (-item[1], item[0][0] or "", item[0][1] or ""))
    return tuple(Confusion(hidden=h, named=named, in_part=part, count=n) for (h, named, part), n in pairs)


def _median(values: Iterable[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return median(known) if known else None
