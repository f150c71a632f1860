"""What all results have in common, and the small ones that several hold."""

import html
import json
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import BaseModel, ConfigDict
from pydantic_core import PydanticSerializationError

from dynreg.axes import chosen, curves, draw_each
from dynreg.foreign import visible

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.axes import Axes

BRIEF = 6  # fields in a result's short form
HASH = re.compile("[0-9a-f]{64}")


class Result(BaseModel):
    """Base of all results: frozen, strict about its fields, shown as a table in notebooks."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        ser_json_inf_nan="null",
        populate_by_name=True,
        from_attributes=True,  # parts may be given as the plain values that were found, with the same fields
    )

    @classmethod
    def schema_name(cls) -> str:
        """`neighbours` where its schema is "dynreg/neighbours/1"; "" of a part, which has no schema of its own."""
        field = cls.model_fields.get("schema_")
        return field.default.split("/")[1] if field else ""

    def to_json(self, indent: int | None = None) -> str:
        """The JSON document of the result, as its schema says; numbers that are not finite become null."""
        return json.dumps(self.to_dict(), indent=indent)

    def to_dict(self) -> dict[str, Any]:
        """The JSON document as plain data."""
        try:
            text = self.model_dump_json(by_alias=True)
        except PydanticSerializationError:  # of half a surrogate pair, as a file's name has that is no UTF-8
            text = self.visible().model_dump_json(by_alias=True)
        return json.loads(text)

    def brief(self) -> str:
        """What it says, in a few words: its texts and numbers, ids cut short."""
        plain = ((name, getattr(self, name)) for name in type(self).model_fields if name != "schema_")
        shown = [(name, value) for name, value in plain if isinstance(value, str | int | float)]
        return ", ".join(f"{name}={_short(value)}" for name, value in shown[:BRIEF])

    def __repr__(self) -> str:
        """`<Kind what it says>` in one line; a part, which has no schema of its own, field by field."""
        if not self.schema_name():
            return super().__repr__()
        return f"<{type(self).__name__} {visible(self.brief())}>"

    def visible(self) -> Self:
        """The same result with all its text fit to be shown; see `foreign.visible`."""
        return _visible(self)

    def rows(self) -> list[dict[str, Any]]:
        """The result as a table, one dict a row."""
        return [self.to_dict()]

    def to_frame(self):
        """The rows as a pandas DataFrame."""
        import pandas as pd

        return pd.DataFrame(self.rows())

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        """What a notebook shows, by title: the rows, where a result has no more to show."""
        return {"": self.rows()}

    def _repr_html_(self) -> str:
        import pandas as pd

        # a sentence of its own, not pydantic's field by field
        shown = self.visible()
        said = type(self).__str__ is not BaseModel.__str__
        parts = [f"<p>{html.escape(str(shown))}</p>"] if said else []
        for title, rows in shown.tables().items():
            if title and rows:
                parts.append(f"<h4>{html.escape(title)}</h4>")
            if rows or not title:
                parts.append(pd.DataFrame(rows).to_html(index=False, float_format="%.4g", na_rep="-"))
        return "".join(parts)


class Interval(Result):
    """A number between two bounds, all in `unit`."""

    value: float
    low: float
    high: float
    unit: str


class Estimate(Interval):
    """A parameter with its 90 % interval, in `unit`; the interval holds if the model is right.

    at_bound : the value lies on the edge of the population's range, so the interval says little.
    limits : that range (low, high), where there is one.
    """

    nominal: float
    at_bound: bool = False
    limits: tuple[float, float] | None = None


class Curves(Result):
    """Measured values of one channel in one episode, and the nominal simulator's under the same commands; time [s]."""

    episode: str
    channel: str
    unit: str
    time: list[float]
    measured: list[float | None]
    nominal: list[float | None]


class Gain(Result):
    """A relative gain with its 90 % interval; null where the test part has too few windows for one.

    over : what the interval counts: episodes, or their windows where there are fewer than three; null without an
    interval, for gains of a `compare`, and in documents that were stored before it was told.
    """

    value: float
    low: float | None
    high: float | None
    over: Literal["episodes", "windows"] | None = None

    @property
    def worse(self) -> bool:
        """Whether the error is higher: the interval, where there is one, does not hold 0."""
        return self.value < 0 and (self.high is None or self.high < 0)


def change(gain: float) -> str:
    """A relative gain as the change of an error.

    >>> change(0.31), change(-0.02), change(-0.001)
    ('31 % lower', '2 % higher', '0.1 % higher')
    """
    percent = round(100 * gain) or round(100 * gain, 1)  # on which side of 0 it is decides
    return f"{abs(percent):g} % {'higher' if percent < 0 else 'lower'}"


class Cost(Result):
    """What a result cost.

    evaluations : distances evaluated; rollouts : simulators run through the fit and select parts to choose the
    answer; test_rollouts : simulators run through the test part to judge it; seconds : wall time.
    """

    evaluations: int
    rollouts: int
    test_rollouts: int = 0
    seconds: float


def plot_curves(
    found: Sequence[Curves], order: Sequence[str], channel: str | None, ax: "Axes | None"
) -> "np.ndarray":
    """(n,) matplotlib axes with what was measured and simulated, one for each of n curves or those of a channel."""
    wanted = chosen(list(dict.fromkeys(c.channel for c in found)), channel, "channel")

    def draw(place: "Axes", c: Curves) -> None:
        named = {name: getattr(c, name) for name in order}
        curves(place, c.time, named, f"{c.channel} [{c.unit}]", f"episode {c.episode}")

    return draw_each([c for c in found if c.channel in wanted], draw, ax, what="curves")


def _short(value: Any) -> str:
    if isinstance(value, str):
        return value[:12] if HASH.fullmatch(value) else repr(value)
    return f"{value:.4g}" if isinstance(value, float) else f"{value}"


def _visible(value: Any) -> Any:
    """A value, however deep, with its text fit to be shown; keys as well."""
    if isinstance(value, str):
        return visible(value)
    if isinstance(value, BaseModel):
        fields = {name: _visible(getattr(value, name)) for name in type(value).model_fields}
        return value.model_copy(update=fields)
    if isinstance(value, dict):
        return {_visible(key): _visible(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(_visible, value))
    return value
