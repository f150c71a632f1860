"""What a log leaves open, as a file from which a trainer draws simulators: a posterior, and what it does to a model."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynreg.evidence.gaussian import Gaussian
from dynreg.extend.traced import Assignment, Traced
from dynreg.tomlfile import literal

FORMAT = "dynreg/ranges/1"
DIGITS = 12  # of the numbers of the posterior
TRADED = 0.1  # share of a parameter's variance that others tell, from which on it is drawn with them
PARTNER = 0.3  # correlation from which on a parameter is named as one of those
MEANINGS = {
    "control.rate": "commands a second; the time step of the model divides the time between two",
    "control.noise": "standard deviation of the noise on every command",
    "control.max_step": "largest change from a command to the next",
    "control.clock": "simulated seconds for one second of the log",
    "sensor.offset": "encoders read scale * (position + offset), to the drives (the model has that) and to the log",
    "sensor.scale": "encoders read scale * (position + offset), to the drives (the model has that) and to the log",
}
HEAD = """\
# Simulators of a robot as far as a log tells them, for training (domain randomisation).
#
# Draw: coordinate = centre + deviation * (standard normals with these `correlations`; their rows are the [[free]], in
# this order). A coordinate is 0 at the lower limit and 1 at the upper one, and runs in between as `scale` says: of the
# value, of its logarithm, or of -1 / value. In these coordinates the posterior is about normal. What lies beyond 0 or
# 1 is clipped, and takes the others along as far as they are correlated: else what makes up for it would stay behind.
# Where draw = "uniform" the coordinate is uniform between 0 and 1, and goes with no other.
# `value` is what the result gives, in its unit; `centre` is the middle of the draws, as a coordinate: they can differ.
# `interval` holds 90 % and ends on a limit where the log allows values up to it; `at_bound` tells of `value` alone.
# Apply: field[index] = (or +=) factor * product of values ** powers, one [[assignment]] after the other, to `model`.
# Then mj_setConst. [[outside]] is what no field of the model is: apply it yourself, or run dynreg.
"""


@dataclass(frozen=True)
class Quantity:
    """A parameter, or a size of an effect, that the log leaves open.

    effect : key of the effect whose size it is. interval : 90 %, limits : of the range, in its unit. draw : "normal" or
    "uniform". told : by what. sets : entries of robot.toml. reaches : fields of the model, and what lies outside it;
    left_out : why there is none of them.
    """

    name: str
    unit: str
    value: float
    interval: tuple[float, float]
    limits: tuple[float, float]
    scale: str
    centre: float
    deviation: float
    draw: str
    told: str
    at_bound: bool
    nominal: float | None = None
    effect: str | None = None
    sets: tuple[str, ...] = ()
    reaches: tuple[str, ...] = ()
    left_out: str | None = None


@dataclass(frozen=True)
class Fixed:
    """A parameter that is not drawn, its value in the simulator, and why."""

    name: str
    unit: str
    value: float
    why: str
    sets: tuple[str, ...] = ()


@dataclass(frozen=True)
class Carried:
    """An effect of the simulator. carried_by : "fields" that are drawn, the "model" at one value, or the "engine"."""

    key: str
    title: str
    carried_by: str
    why: str = ""


@dataclass(frozen=True, eq=False)
class Open:
    """What a log leaves open. about, model : facts of the whole, by name. correlations : of the free (D, D)."""

    about: Mapping[str, Any]
    model: Mapping[str, Any]
    correlations: np.ndarray
    free: tuple[Quantity, ...]
    fixed: tuple[Fixed, ...]
    effects: tuple[Carried, ...]
    traced: Traced


def uniform(posterior: Gaussian, whole: tuple[str, ...]) -> np.ndarray:
    """(D,) which quantities are drawn uniformly, apart from all others.

    whole : names of those whose interval is their whole range. Where others tell something of one, it is drawn with
    them: what trades must not come apart.
    """
    size = len(posterior.names)
    alone = np.linalg.inv(posterior.correlations + 1e-9 * np.eye(size))
    told_by_others = 1.0 - 1.0 / np.maximum(np.diag(alone), 1.0)
    return np.isin(posterior.names, whole) & (told_by_others < TRADED)


def partners(posterior: Gaussian, name: str) -> tuple[str, ...]:
    """Names of the quantities that a quantity trades with, the closest first."""
    row = np.abs(posterior.correlations[posterior.names.index(name)])
    order = [posterior.names[i] for i in np.argsort(-row, kind="stable") if row[i] >= PARTNER]
    return tuple(one for one in order if one != name)


def reached(traced: Traced, name: str) -> tuple[str, ...]:
    """Fields and ports that a quantity changes."""
    found = [a.target for a in (*traced.fields, *traced.ports) if name in a.powers]
    return tuple(dict.fromkeys(found))


def text(found: Open) -> str:
    """The file, in TOML."""
    warnings = [found.about[name] for name in ("warning", "incomplete") if found.about.get(name)]
    lines = [HEAD.rstrip(), *(f"#\n# WARNING: {warning}" for warning in warnings)]
    lines += ["", *_entries({"format": FORMAT, **found.about})]
    rows = ",\n".join(f"    {literal(row, DIGITS)}" for row in found.correlations.tolist())
    lines += [f"correlations = [\n{rows},\n]" if rows else "correlations = []"]
    lines += ["", "[model]", *_entries(found.model)]
    for title, things in (("free", found.free), ("fixed", found.fixed), ("effect", found.effects)):
        for one in things:
            lines += ["", f"[[{title}]]", *_entries(vars(one))]
    for title, assignments in (("assignment", found.traced.fields), ("outside", found.traced.ports)):
        for one in assignments:
            lines += ["", f"[[{title}]]", *_assignment(one)]
            if title == "outside":
                lines.append(f"meaning = {literal(MEANINGS.get(one.target, 'a port of dynreg'))}")
    return "\n".join(lines) + "\n"


def _assignment(one: Assignment) -> Iterator[str]:
    elements = one.elements if any(one.elements) else ()
    yield from _entries({"target": one.target, "operation": one.operation, "elements": elements})
    yield f"indices = {literal(one.indices)}"
    yield f"factors = {literal(one.factors)}"
    powers = ", ".join(f"{literal(name)} = {literal(float(power))}" for name, power in one.powers.items())
    yield f"powers = {{ {powers} }}" if powers else "powers = {}"


def _entries(table: Mapping[str, Any]) -> Iterator[str]:
    """Lines of a table; what is None or an empty list is left out."""
    for key, value in table.items():
        if value is not None and value != ():
            yield f"{key} = {literal(value, DIGITS)}"
