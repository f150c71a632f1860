"""Curves on matplotlib axes, for notebooks: matplotlib is imported when something is drawn, and not before."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynreg.errors import UsageError, one_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# the colours of the pages; the nominal line is dashed, so that what runs together with it shows through
STYLES: Mapping[str, Mapping[str, Any]] = {
    "measured": {"color": "#1b1f24", "alpha": 0.6, "linewidth": 2.0},
    "nominal": {"color": "#d9822b", "linestyle": "--"},
    "calibrated": {"color": "#3f8f5b", "linestyle": ":"},
    "answer": {"color": "#0b63ce"},
    "extended": {"color": "#0b63ce"},
}
SIZE = (8.0, 2.0)  # inches that an axes takes


def axes_for(count: int, ax: "Axes | None", *, what: str, height: float = SIZE[1]) -> "np.ndarray":
    """(count,) axes, one below the other in a new figure; `ax` alone where it is given.

    Raises UsageError where there is nothing to draw, or more than fits into one axes.
    """
    if count == 0:
        raise UsageError(
            f"no {what} to draw", expected="at least one", do="name another, or draw another result"
        )
    if ax is not None:
        if count > 1:
            raise UsageError(
                f"{count} {what} for one axes",
                expected="one of them with ax=",
                do="name one, or leave ax out",
            )
        return np.array([ax], dtype=object)
    from matplotlib import pyplot

    size = (SIZE[0], height * count)
    return pyplot.subplots(count, 1, squeeze=False, figsize=size, layout="constrained")[1][:, 0]


def draw_each(
    things: Sequence[Any], draw: Callable[[Any, Any], None], ax: "Axes | None", *, what: str
) -> "np.ndarray":
    """(n,) axes with one of n things on each, drawn by draw(axes, thing); see `axes_for`."""
    places = axes_for(len(things), ax, what=what)
    for place, thing in zip(places, things, strict=True):
        draw(place, thing)
    return places


def curves(
    ax: "Axes",
    x: Sequence[float],
    named: Mapping[str, Sequence[float | None] | None],
    label: str,
    title: str = "",
) -> None:
    """Curves over time [s], each with its name and style; those that are None are left out, None in them is a gap."""
    for name, values in named.items():
        if values is not None:
            ax.plot(x, np.array(values, dtype=float), label=name, **STYLES.get(name, {}))
    ax.set(xlabel="time [s]", ylabel=label, title=title)
    if len(named) > 1:
        ax.legend(loc="best", fontsize="small")


def with_intervals(
    ax: "Axes",
    y: Sequence[Any],
    values: Sequence[tuple[float, float | None, float | None]],
    **look: Any,
) -> None:
    """Points at heights or words y, each (value, low, high) with its interval lying across; none where low is None."""
    numbers = np.array(
        [(v, v if low is None else low, v if high is None else high) for v, low, high in values]
    )
    middle, low, high = numbers.T
    ax.errorbar(middle, y, xerr=np.stack([middle - low, high - middle]).clip(0.0), fmt="o", capsize=3, **look)


def chosen(names: Sequence[str], wanted: str | Sequence[str] | None, what: str) -> list[str]:
    """Those of `names` that are wanted, all without a wish; UsageError for one that there is not."""
    if wanted is None:
        return list(names)
    asked = [wanted] if isinstance(wanted, str) else list(wanted)
    for name in asked:
        if name not in names:
            raise UsageError(f"{what} {name!r}", expected=one_of(names, name), do="choose one of them")
    return asked
