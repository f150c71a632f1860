"""The answer of `query` on a population of effects: which causes a recording looks like."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.diagnosis import EffectOn
from dynreg.results.result import Cost, Result


class LikelyCause(EffectOn):
    """A cause that the recording may have; effect : its id, "" for none at all.

    belief : by the classifier and the nearest entry together; they add up to 1. near : its share of the k nearest
    entries. cosine : of its nearest entry with the recording, and entry : the id of that one.
    """

    belief: float
    near: float
    cosine: float
    entry: str


class Causes(Result):
    """Which causes a recording looks like, by simulators that carry one effect each, or none, under its commands.

    It is no verdict: it says what to look at first, and `diagnose` weighs the evidence.
    causes : the likeliest first. resemblance : 1 where the nearest entry shows all that the recording has beyond noise,
    0 where it shows nothing. outside : whether that is so little that none of the known causes looks like this.
    size, noise : root mean square of what the calibrated simulator leaves of the recording, and of entries without an
    effect, both in spreads of the motion.
    """

    schema_: Literal["dynreg/causes/1"] = Field(default="dynreg/causes/1", alias="schema")
    robot: str
    population: str
    recording: str
    recording_name: str
    entries: int
    k: int
    causes: tuple[LikelyCause, ...]
    resemblance: float
    outside: bool
    size: float
    noise: float
    cost: Cost

    def rows(self) -> list[dict[str, Any]]:
        """The causes, the likeliest first."""
        return [one.model_dump() for one in self.causes]

    def brief(self) -> str:
        return f"of {self.recording_name}: {self}"

    def __str__(self) -> str:
        first = self.causes[0]
        if self.outside:
            return f"{self.recording_name}: none of the known causes looks like this."
        where = f" of {', '.join(first.places)}" if first.places else ""
        like = first.effect + where if first.effect else "a robot without effects"
        return f"{self.recording_name} looks like {like}."
