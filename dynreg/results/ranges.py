"""What a log leaves open, as `export --as ranges` wrote it."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Interval, Result


class FreeQuantity(Interval):
    """A parameter, or a size of an effect, that is drawn; with its 90 % interval.

    draw : "normal" with its correlations, or "uniform" over its range. told : by what it is known. reaches : fields of
    the model that it changes, and ports outside it.
    """

    name: str
    draw: Literal["normal", "uniform"]
    told: str
    at_bound: bool = False
    reaches: tuple[str, ...] = ()


class CarriedBy(Result):
    """An effect, and what has it: "fields" that are drawn, the exported "model" at one value, or dynreg's "engine"."""

    effect: str
    carried_by: Literal["fields", "model", "engine"]
    why: str = ""


class RangesFile(Result):
    """A file from which a trainer draws simulators.

    result, kind : the stored result that it is of. simulator : the one in its middle. correlated : whether
    correlations are known; results of older versions have none. reliable : whether some simulator is known to fit;
    warning : what speaks against relying on it. complete_in_model : whether a MuJoCo model with the draws in its
    fields has all that was fitted; incomplete : which effect it does not have, and what to do instead. fixed :
    parameters that are not drawn. left_out : what no field of a model can say.
    """

    schema_: Literal["dynreg/ranges_file/1"] = Field(default="dynreg/ranges_file/1", alias="schema")
    robot: str
    recording_name: str
    result: str
    kind: Literal["neighbours", "diagnosis"]
    simulator: str
    file: str
    correlated: bool
    reliable: bool
    warning: str = ""
    complete_in_model: bool = True
    incomplete: str = ""
    free: tuple[FreeQuantity, ...] = ()
    fixed: tuple[str, ...] = ()
    effects: tuple[CarriedBy, ...] = ()
    left_out: dict[str, str] = {}
    notes: tuple[str, ...] = ()

    def rows(self) -> list[dict[str, Any]]:
        return [one.to_dict() for one in self.free]

    def __str__(self) -> str:
        return f"{self.file}: {len(self.free)} free quantities of {self.robot} about simulator {self.simulator[:12]}"
