"""The answer of `calibrate`."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Cost, Result


class CalibrationStep(Result):
    """The best replay error on the train part after so many simulations."""

    simulations: int
    error: float


class Fitted(Result):
    """A parameter fitted by a search, in `unit`.

    low, high : null, because a search gives no interval (earlier versions wrote the value there). at_bound : the value
    is at the edge of its range. limits : the range (low, high).
    """

    value: float
    low: float | None = None
    high: float | None = None
    unit: str
    nominal: float
    at_bound: bool = False
    limits: tuple[float, float] | None = None


class Calibration(Result):
    """Parameters fitted to a recording by a search."""

    schema_: Literal["dynreg/calibration/1"] = Field(default="dynreg/calibration/1", alias="schema")
    robot: str
    recording: str
    method: str
    simulator: str
    parameters: dict[str, Fitted]
    train_error: float
    test_error: float | None
    nominal_train_error: float
    nominal_test_error: float | None
    history: tuple[CalibrationStep, ...]
    cost: Cost

    def rows(self) -> list[dict[str, Any]]:
        return [{"parameter": name, **e.to_dict()} for name, e in self.parameters.items()]
