"""Effects as parameters of a robot folder: what an effect changes before anything moves can be said in robot.toml.

The changes of model fields and ports are read off the effect itself, so a plugin's effects are carried as well.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from dynreg.sim.effects import Effect, Term, Terms, unit_of
from dynreg.sim.effects.on_slides import unit_at
from dynreg.sim.engines.acting import acting, configure_terms
from dynreg.sim.engines.mujoco_model import assign, configure
from dynreg.sim.fields import names_of
from dynreg.sim.ports import Ports
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run
from dynreg.sim.sets import Assignment

MOVING = (
    "remodel",
    "feedback",
    "command",
    "encoder",
    "drive",
    "friction",
    "roll",
    "observe",
)  # ports that no parameter can stand for
SAME = 1e-12  # relative: values that one parameter can set
LEAST = 0.1  # of a factor, that stays above nothing
SPREAD = 0.1  # tolerance of the parameters that stand for effects
ADDED = MappingProxyType(  # what effects add to, and its unit at a hinge; elsewhere they scale
    {
        "port.friction.coulomb": "N*m",
        "port.friction.viscous": "N*m*s/rad",
        "port.sensor.offset": "rad",
        "port.drive.lag": "s",
        "mj.dof_armature": "kg*m^2",
        "mj.body_ipos": "m",
        "mj.opt.gravity": "m/s^2",
    }
)


@dataclass
class Fields:
    """Model fields and ports of one simulator, as an engine would set them; `changed` fields by name, each (1, ...).

    kind : of their elements; numbers, or objects that stand for numbers.
    """

    robot: Robot
    changed: dict[str, np.ndarray]
    ports: Ports
    kind: type = float

    @classmethod
    def of(cls, robot: Robot, values: np.ndarray) -> "Fields":
        """Of parameters (P,) at nominal settings."""
        made = cls(robot, {}, None)
        run = Run(np.zeros((1, 1, len(robot.actions))))
        made.ports = configure(robot, made, robot.model, values[None], run)
        return made

    def expand(self, field: str) -> np.ndarray:
        """The field (1, ...), to be changed in place."""
        if field not in self.changed:
            owner, name = self.robot.model, field
            if field.startswith("opt."):
                owner, name = owner.opt, field[4:]
            self.changed[field] = np.array(getattr(owner, name), dtype=float).astype(self.kind)[None]
        return self.changed[field]

    def write(self, assignment: Assignment, value: Any) -> None:
        """Let one number, or what stands for it, do what an entry of `sets` says."""
        assign(self, self.robot.model, self.ports, assignment, np.array([value], dtype=self.kind))

    def apply(self, terms: Terms) -> None:
        """Let the effects of one simulator write what they write before anything moves."""
        configure_terms(self.robot, acting(self.robot, terms), self.ports, self.expand)

    def arrays(self) -> dict[str, np.ndarray]:
        """{"mj.<field>", "port.<port>.<key>" or "control.<key>": copy of its values, without the simulators' axis}."""
        out = {f"mj.{name}": array[0].copy() for name, array in self.changed.items()}
        for port in ("drive", "friction", "sensor"):
            out |= {f"port.{port}.{key}": a[0].copy() for key, a in getattr(self.ports, port).items()}
        return out | {f"control.{key}": a[0].copy() for key, a in self.ports.control.items()}


@dataclass(frozen=True)
class Carrier:
    """A parameter of robot.toml that stands for (a part of) an effect: its value, unit, range and `sets`."""

    name: str
    unit: str
    value: float
    low: float
    high: float
    sets: tuple[str, ...]

    @property
    def neutral(self) -> float:
        """The value at which it does nothing."""
        return 0.0 if self.sets[0].endswith("+=") else 1.0


def carries(effect: Effect) -> bool:
    """Whether robot.toml can stand for an effect: it acts before anything moves, and only then."""
    return effect.configure is not None and all(getattr(effect, port) is None for port in MOVING)


def carriers(fields: Fields, term: Term, values: np.ndarray) -> tuple[Carrier, ...] | None:
    """The parameters that do to `fields` what a term with values (K,) does; `fields` has it from then on.

    None where an element that it changes has no name in the model.
    """
    base = re.sub(r"\W", "_", "_".join(["effect", term.effect.id, *term.at]))
    said = term.effect.sets(fields.robot, term.at)
    if said:
        fields.apply(Terms((term,), (values[None],)))
        return tuple(
            Carrier(
                base,
                unit_of(fields.robot, term, p),
                float(value),
                *sorted((0.0, 2.0 * float(value))),
                (said[p.name],),
            )
            for p, value in zip(term.effect.parameters, values, strict=True)
            if value != 0.0  # there is nothing of it to range over
        )
    before = fields.arrays()
    fields.apply(Terms((term,), (values[None],)))
    groups: dict[tuple[str, float], list[tuple[str, tuple[int, ...]]]] = {}
    for target, after in fields.arrays().items():
        old = (
            before[target]
            if target in before
            else Fields(fields.robot, {}, fields.ports).expand(target[3:])[0]
        )
        for place, op, value in _changes(target, old, after):
            same = [key for key in groups if key[0] == op and abs(key[1] - value) <= SAME * abs(value)]
            groups.setdefault(same[0] if same else (op, value), []).append((target, place))
    made = [_carrier(fields, base, *key, places) for key, places in groups.items()]
    if any(one is None for one in made):
        return None
    for i, one in (
        enumerate(made) if len(made) > 1 else ()
    ):  # each has a name of its own, by what it sets first
        path = one.sets[0].split("[")[0].split(" ")[0].rpartition(".")[2]
        index = one.sets[0].rpartition("[")[2].split("]")[0]
        made[i] = replace(one, name=f"{base}_{path}" + (f"_{index}" if index.isdigit() else ""))
    return tuple(made)


def _changes(
    target: str, before: np.ndarray, after: np.ndarray
) -> Iterator[tuple[tuple[int, ...], str, float]]:
    """(place, op, value) of every element that differs."""
    for place in (
        zip(*np.nonzero(after != before), strict=True) if after.ndim else [()] * int(after != before)
    ):
        old, new = float(before[place]), float(after[place])
        if target in ADDED or old == 0.0:
            yield tuple(int(i) for i in place), "+=", new - old
        else:
            yield tuple(int(i) for i in place), "*=", new / old


def _carrier(
    fields: Fields, base: str, op: str, value: float, places: list[tuple[str, tuple[int, ...]]]
) -> Carrier | None:
    """One parameter for all places that change by the same value."""
    by_row: dict[tuple[str, tuple[int, ...]], list[str]] = {}
    units = set()
    for target, place in places:
        name, index = _named(fields, target, place)
        if name is None:
            return None
        by_row.setdefault((target, index), []).append(name)
        units.add(unit_at(fields.robot, [name], ADDED.get(target, "1")))
    sets = tuple(_entry(target, index, names, op) for (target, index), names in by_row.items())
    neutral = 0.0 if op == "+=" else 1.0
    ends = sorted((neutral, 2 * value - neutral))  # from none of it to twice as much
    low = max(ends[0], LEAST * value) if op == "*=" and value >= 0 else ends[0]
    return Carrier(base, units.pop() if len(units) == 1 else "1", value, low, ends[1], sets)


def _entry(target: str, index: tuple[int, ...], names: list[str], op: str) -> str:
    elements = f"[{','.join(n for n in names if n)}]" if any(names) else ""
    return target + elements + "".join(f"[{i}]" for i in index) + f" {op}"


def _named(fields: Fields, target: str, place: tuple[int, ...]) -> tuple[str | None, tuple[int, ...]]:
    """The name by which `sets` finds an element ("" for none needed, None where it has none), and its index."""
    if target.startswith("control."):
        return "", ()
    if target.startswith("mj.opt."):
        return "", place
    if target.startswith("port."):
        name, index = fields.ports.joints[place[0]], ()
    else:
        name, index = names_of(fields.robot.model, target[3:].split("_")[0])[place[0]], place[1:]
    return (name if name and not set(name) & set(",[]*?") else None), index
