"""What parameters and effects do to the fields of a MuJoCo model, as formulas: the simulator's own code, traced.

Parameters are written into arrays of objects by the code that engines and exports write numbers with.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynreg.extend.carry import Fields, carries
from dynreg.extend.formula import Formula, Untold
from dynreg.extend.plain import says, write_drives
from dynreg.sim.effects import Site, Term, Terms
from dynreg.sim.engines.acting import Acting, acting
from dynreg.sim.fields import names_of
from dynreg.sim.ports import nominal_ports, servo_law
from dynreg.sim.robot import Robot

GROUPS = ("drive", "friction", "sensor", "control", "base")
DRIVEN = ("drive", "friction")  # ports that become fields of the plain model
MODEL, ENGINE = "model", "engine"
Ranges = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Assignment:
    """A product that is set, or added, to elements of a field or a port; in order they make up the field.

    target : "actuator_gainprm", "control.noise". operation : "=" or "+=". elements : their names in the model, ""
    without one. indices : of each in the field's array. factors : of each; powers : of the parameters in the product.
    """

    target: str
    operation: str
    elements: tuple[str, ...]
    indices: tuple[tuple[int, ...], ...]
    factors: tuple[float, ...]
    powers: Mapping[str, float]


@dataclass(frozen=True)
class Traced:
    """What free quantities do. fields : of the plain MJCF; ports : what no field of it is.

    held : {name of a free quantity or key of an effect: (why, where its value is)} that no formula tells: the exported
    model has it at one value (`MODEL`), or only dynreg's engines have it (`ENGINE`).
    """

    fields: tuple[Assignment, ...]
    ports: tuple[Assignment, ...]
    held: Mapping[str, tuple[str, str]]


def traced(robot: Robot, values: np.ndarray, terms: Terms, ranges: Ranges) -> Traced:
    """What the quantities in `ranges` ({name: (low, high)}) do around a simulator.

    values : (P,) parameters of the simulator. terms : its effects, one row of values each. Names are of parameters, and
    of sizes of effects as "payload.share".
    """
    ports = nominal_ports(robot, 1)
    groups = {name: {k: v.astype(object) for k, v in getattr(ports, name).items()} for name in GROUPS}
    fields = Fields(robot, {}, replace(ports, **groups), kind=object)
    held: dict[str, tuple[str, str]] = {}
    _parameters(robot, fields, values, ranges, held)
    moving = _effects(robot, fields, terms, ranges, held)
    if not robot.planar:
        _drives(robot, fields, terms, moving, held)
    written = {
        f"{group}.{key}": array[0]
        for group in GROUPS
        if robot.planar or group not in DRIVEN
        for key, array in getattr(fields.ports, group).items()
    }
    changed = {} if robot.planar else {name: array[0] for name, array in fields.changed.items()}
    return Traced(
        tuple(a for name, array in changed.items() for a in _assignments(name, array, _rows(robot, name))),
        tuple(a for name, array in written.items() for a in _assignments(name, array, _owners(fields, name))),
        held,
    )


def _parameters(
    robot: Robot, fields: Fields, values: np.ndarray, ranges: Ranges, held: dict[str, tuple[str, str]]
) -> None:
    """Write parameters and nominal settings; a parameter that no formula can tell at its value, which is noted."""

    def write(setters: Sequence[Any], value: Any) -> None:
        for one in setters:
            fields.write(one, value)

    for parameter, setters, value in zip(robot.space.parameters, robot.setters, values, strict=True):
        symbol = Formula.of(parameter.name, ranges) if parameter.name in ranges else float(value)
        why = _tried(fields, lambda s=setters, v=symbol: write(s, v))
        if why:
            write(setters, float(value))
            held[parameter.name] = (why, ENGINE if robot.planar else MODEL)
    for setting, setters in zip(robot.file.settings, robot.setting_setters, strict=True):
        write(setters, float(setting.nominal))


def _effects(
    robot: Robot, fields: Fields, terms: Terms, ranges: Ranges, held: dict[str, tuple[str, str]]
) -> dict[tuple[str, int], Any]:
    """Let effects that act before anything moves write, in the order of the engines.

    {(id, action): first value} of those that act while the robot moves, and that MJCF says.
    """
    moving: dict[tuple[str, int], Any] = {}
    for one in acting(robot, terms):
        key = one.key
        names = {name: f"{key}.{name}" for name in one.values}
        symbols = {k: Formula.of(n, ranges) if n in ranges else one.values[k][0, 0] for k, n in names.items()}
        if not robot.planar and says(robot, Term(one.effect, one.at)):
            first = next(iter(symbols.values()))
            for action in one.joints:
                moving[one.effect.id, int(action)] = moving.get((one.effect.id, int(action)), 0.0) + first
            if one.effect.id == "command_delay":
                held[key] = ("the model keeps as many past commands as one delay needs", MODEL)
        elif not carries(one.effect):
            held[key] = ("it acts while the robot moves", ENGINE)
        else:
            why = _tried(fields, lambda o=one, s=symbols: _configured(robot, fields, o, s))
            if why:
                _configured(
                    robot, fields, one, {k: float(v[0, 0]) for k, v in one.values.items()}, kind=float
                )
                held[key] = (why, ENGINE if robot.planar or one.effect.acts_on == "sensor" else MODEL)
    return moving


def _drives(
    robot: Robot,
    fields: Fields,
    terms: Terms,
    moving: Mapping[tuple[str, int], Any],
    held: dict[str, tuple[str, str]],
) -> None:
    """Write the law of the drives and their friction into the fields of the plain model."""

    def write() -> None:
        law = servo_law(fields.ports, robot.input_defaults[None])
        write_drives(robot, fields, law, lambda key, action: moving.get((key, action), 0.0))

    names = {
        n
        for key in ("speed_limit", "profile_speed", "profile_acceleration", "integral_gain")
        for place, f in enumerate(fields.ports.drive[key].flat)
        if isinstance(f, Formula)
        and not (key == "speed_limit" and fields.ports.drive["back_emf"].flat[place])
        for n in f.names
    }
    held.update(dict.fromkeys(sorted(names), ("no field of MJCF has it", ENGINE)))
    why = _tried(fields, write)
    if why:
        parts = [a for group in DRIVEN for a in getattr(fields.ports, group).values()]
        names = {n for part in parts for f in part.flat if isinstance(f, Formula) for n in f.names}
        held.update(dict.fromkeys(sorted(names), (why, MODEL)))


def _tried(fields: Fields, write: Callable[[], None]) -> str:
    """Let `write` change the fields; where no formula tells what it does they stay as they were, and why is said."""
    before = copy.deepcopy(fields.changed), copy.deepcopy(fields.ports)
    try:
        write()
    except Untold as problem:
        why = f"no product of powers tells it: {problem}"
    except TypeError:  # numpy has no sine of an object
        why = "no product of powers tells it: a function such as a sine"
    else:
        return ""
    fields.changed, fields.ports = before
    return why


def _configured(
    robot: Robot, fields: Fields, one: Acting, symbols: Mapping[str, Any], kind: Any = object
) -> None:
    """Let an effect write with these values of its parameters, before anything moves."""
    values = {name: np.array([[value]], dtype=kind) for name, value in symbols.items()}
    one.effect.configure(Site(robot, fields.ports, one.rows, one.joints, fields.expand, {}, one.at), values)


def _rows(robot: Robot, field: str) -> list[str] | None:
    """Names of the rows of a model field; None where these have none."""
    prefix = "qpos" if field in ("qpos0", "qpos_spring") else field.split("_")[0]
    return None if field.startswith("opt.") else names_of(robot.model, prefix)


def _owners(fields: Fields, port: str) -> list[str] | None:
    """The joint, or the action, of each element of a port; None where there is one for the robot."""
    if port.split(".")[0] in ("control", "base"):
        return None
    joints = fields.ports.joints
    return joints if len(set(joints)) == len(joints) else fields.ports.actions


def _assignments(target: str, array: Any, rows: Sequence[str] | None) -> list[Assignment]:
    """Assignments that make up an array of objects: of each element one for each product in its formula."""
    found: dict[tuple[int, tuple], list[tuple[str, tuple[int, ...], float]]] = {}
    array = np.array(array, dtype=object)
    for place in np.ndindex(array.shape):
        formula = array[place]
        if isinstance(formula, Formula) and formula.names:
            for number, (powers, factor) in enumerate(formula.terms.items()):
                name = rows[place[0]] if rows else ""
                found.setdefault((number, powers), []).append((name, place, factor))
    return [
        Assignment(target, "+=" if number else "=", *zip(*elements, strict=True), dict(powers))
        for (number, powers), elements in sorted(found.items(), key=lambda one: one[0][0])
    ]
