"""The room of the library of effects."""

from rich.console import Group
from rich.text import Text

from dynreg.data.units import suffix
from dynreg.report.grid import table
from dynreg.report.words import number
from dynreg.results.effects import EffectSize, EffectsList

PER = {
    "torque": ("tau", "the drive's torque limit"),
    "stiffness": ("1/k", "divided by the stiffness of the servo"),
    "inertia": ("I", "the joint's inertia"),
    "length": ("l", "from the joint to the centre of mass"),
    "mass": ("m", "the mass of the heaviest body that moves"),
    "command": (
        "u",
        "the largest speed command of a velocity drive; 1 rad for a position drive",
    ),
}


def tables(result: EffectsList, near: bool = False) -> Group:
    """Each effect with its sizes, and the groups that usual logs do not separate.

    near : also the effects that only suitable commands separate.
    """
    fitting = [e for e in result.effects if e.applies is not False]
    rows = [(e.id, e.acts_on, e.title, _size(e.parameters[0]) if e.parameters else "-") for e in fitting]
    title = f"effects of {result.robot}" if result.robot else "effects"
    parts = [table(("effect", "acts on", "what it is", "weak / medium / strong"), rows, title)]
    used = [per for per in PER if any(e.parameters and e.parameters[0].per == per for e in fitting)]
    parts += [Text("; ".join(f"{PER[per][0]}: {PER[per][1]}" for per in used))] if used else []
    groups = {tuple(sorted((e.id, *e.group))): e.separate_by for e in reversed(fitting) if e.group}
    if groups:
        rows = [(", ".join(group), how) for group, how in reversed(groups.items())]
        title = "effects that no usual log separates (at the same joint)"
        parts.append(table(("effects", "experiment that separates them"), rows, title))
    near_ones = [(e.id, ", ".join(e.near), e.separate_by) for e in fitting if e.near and near]
    if near_ones:
        columns = ("effect", "similar to", "experiment that separates them")
        parts.append(table(columns, near_ones, "effects that only suitable commands separate"))
    lacking = [(e.id, e.why_not or "") for e in result.effects if e.applies is False]
    if lacking:
        parts.append(table(("effect", "reason"), lacking, f"effects that cannot act on {result.robot}"))
    return Group(*parts)


def _size(size: EffectSize) -> str:
    numbers = " / ".join(number(value) for value in (size.weak, size.medium, size.strong))
    return numbers + suffix(PER[size.per][0] if size.per in PER else size.unit)
