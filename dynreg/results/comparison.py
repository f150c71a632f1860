"""The answer of `compare`: how far each model's predictions of displacements are off, and which differ."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Result


class Spread(Result):
    """Of absolute errors in `unit`."""

    mean: float
    min: float
    max: float
    sd: float
    unit: str


class Pair(Result):
    """Two models on one axis: mean error of the first less that of the second, with its 95 % interval (Tukey).

    tukey : p-value that allows for all pairs and takes the models' errors for independent samples, as the paper's.
    paired : p-value of Wilcoxon's test on the same commands, which they are, by Holm for all pairs of the axis.
    """

    axis: str
    first: str
    second: str
    difference: float
    low: float
    high: float
    unit: str
    tukey: float
    paired: float


class Variance(Result):
    """One-way analysis of variance of the absolute errors on one axis."""

    axis: str
    f: float
    between: int
    within: int
    p: float


class Comparison(Result):
    """Models of a wheeled robot on commands that none of them was fitted to.

    models : {name: {axis: errors}}. displacements : {axis: mean absolute displacement}, what the errors are of.
    """

    schema_: Literal["dynreg/comparison/1"] = Field(default="dynreg/comparison/1", alias="schema")
    commands: int
    models: dict[str, dict[str, Spread]]
    displacements: dict[str, float]
    variance: tuple[Variance, ...]
    pairs: tuple[Pair, ...]

    def rows(self) -> list[dict[str, Any]]:
        return [
            {"model": name, "axis": axis, **spread.to_dict()}
            for name, axes in self.models.items()
            for axis, spread in axes.items()
        ]

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        return {
            "errors": self.rows(),
            "analysis of variance": [v.to_dict() for v in self.variance],
            "pairs": [p.to_dict() for p in self.pairs],
        }
