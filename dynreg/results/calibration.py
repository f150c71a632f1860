"""The answer of `calibrate`."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Cost, Estimate, Result


class CalibrationStep(Result):
    """The best objective after so many simulations."""

    simulations: int
    error: float


class Calibration(Result):
    """Parameters fitted to a recording by a search."""

    schema_: Literal["dynreg/calibration/1"] = Field(default="dynreg/calibration/1", alias="schema")
    robot: str
    recording: str
    method: str
    simulator: str
    parameters: dict[str, Estimate]
    train_error: float
    test_error: float | None
    nominal_train_error: float
    nominal_test_error: float | None
    history: tuple[CalibrationStep, ...]
    cost: Cost

    def rows(self) -> list[dict[str, Any]]:
        return [{"parameter": name, **e.to_dict()} for name, e in self.parameters.items()]
