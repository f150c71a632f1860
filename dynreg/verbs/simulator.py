"""A simulator that somebody named, and the words that stand for one: `nominal`, or what the newest result found."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynreg.registry import ResultRecord
    from dynreg.sim.config import SimConfig
    from dynreg.sim.robot import Robot

NOMINAL, POSTERIOR = "nominal", "posterior"
Document = Mapping[str, Any]


@dataclass(frozen=True)
class Word:
    """What a word stands for: the simulator that the newest result of a kind tells.

    made_by : the verb. other : what it stands for where no result of that kind is stored.
    """

    kind: str
    made_by: str
    told: Callable[[Document], str | None]
    other: "Word | None" = None

    def told_by(self, record: "ResultRecord") -> str | None:
        """The id of the simulator that a result of its kind, or of the other one's, tells."""
        word = self.other if self.other is not None and record.kind == self.other.kind else self
        return word.told(record.document)

    def each(self) -> "tuple[Word, ...]":
        """The word, and what it stands for else."""
        return (self,) if self.other is None else (self, self.other)


WORDS: Mapping[str, Word] = {
    "nearest": Word(
        "neighbours", "query", lambda d: d["neighbours"][0]["entry"] if d["neighbours"] else None
    ),
    "synthesised": Word("neighbours", "query", lambda d: (d.get("synthesised") or {}).get("simulator")),
    "@answer": Word("neighbours", "query", lambda d: d["answer"]),
    "calibrated": Word(
        "calibration",
        "calibrate",
        lambda d: d["simulator"],
        other=Word("diagnosis", "diagnose", lambda d: d.get("calibrated_simulator")),
    ),
    "diagnosed": Word(
        "diagnosis", "diagnose", lambda d: d.get("extended_simulator") or d.get("calibrated_simulator")
    ),
}
NAMES = (NOMINAL, *WORDS)
QUERIED = (POSTERIOR, *(word for word, one in WORDS.items() if one.made_by == "query"))  # what a query tells
RECOMMENDED = {
    "neighbours": "@answer",
    "calibration": "calibrated",
    "diagnosis": "diagnosed",
}  # by a kind of result
# what an old word means now
OLD = {"neighbours": "nearest", "query": "@answer", "calibration": "calibrated", "diagnosis": "diagnosed"}


@dataclass(frozen=True)
class Simulator:
    """A simulator that was named: its configuration, effects included, and its robot.

    id : of the simulator or entry; None for the nominal one, which nobody needs to register.
    name : "leg-17" of an entry, else how it came about and the beginning of its id, with the version of its robot where
    that is another one than was asked with. lineage : how it came about.
    source : id of the result that told it, None where it was named itself.
    fitted_to : episodes of the recording to which it was fitted, or by which it was chosen, whole or in part; empty
    where nothing says that it was, None where it was and nothing says to which. parts : of that result, by episode or
    as "episode[3]" where an episode was cut into windows; None where no result says them. asked : the options of that
    result, by name; empty where it says none. inherited : episodes of the recording that shaped those that it came
    from.
    """

    id: str | None
    name: str
    lineage: Mapping[str, Any]
    config: "SimConfig"
    robot: "Robot"
    source: str | None = None
    fitted_to: frozenset[str] | None = frozenset()
    parts: Mapping[str, Sequence[str]] | None = None
    asked: Mapping[str, Any] = field(default_factory=dict)
    inherited: frozenset[str] = frozenset()


def made(lineage: Mapping[str, Any]) -> str:
    """How a simulator was made, in words.

    >>> made({"made_by": "query", "kind": "synthesised"}), made({"made_by": "calibrate cma"})
    ('synthesised', 'calibrated by cma')
    >>> made({"made_by": "calibrate staged", "stage": "air"})
    'calibrated by staged, air'
    """
    by = lineage.get("kind") or (lineage.get("made_by") or "").replace("calibrate", "calibrated by")
    stage = lineage.get("stage")
    return by if stage is None or by.endswith(f" {stage}") else f"{by}, {stage}"
