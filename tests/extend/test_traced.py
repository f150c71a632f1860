"""Formulas of parameters and effects: a model with them in its fields is the one that the engine simulates."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dynreg.evidence.estimate import free_quantities
from dynreg.evidence.hypothesis import Coordinates, Hypothesis
from dynreg.extend.formula import Formula, Untold
from dynreg.extend.traced import ENGINE, MODEL, Traced, traced
from dynreg.rng import stream
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import Arena
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

EXACT = 1e-9
RANGES = {"a": (1.0, 2.0), "b": (3.0, 4.0), "c": (-1.0, 1.0)}
CASES = {
    "servo_pendulum": (
        "payload",
        "com_offset",
        "inertia",
        "coulomb_friction",
        "torque_limit",
        "encoder_scale",
    ),
    "leg": ("coulomb_friction[knee]", "drive_gain[hip_roll]", "viscous_friction", "encoder_offset"),
    "quadruped": ("payload", "ground_friction", "contact_compliance"),
    "so101": ("payload", "drive_gain"),
    "double_pendulum": ("payload",),
    "emps": ("coulomb_friction",),
}


def middle(robot: Robot, keys: tuple[str, ...]) -> tuple[Hypothesis, Terms, dict[str, tuple[float, float]]]:
    """Effects of medium size, and the ranges of all that may be free."""
    c = Coordinates(robot, np.full(len(robot.space), np.nan))
    hypothesis = Hypothesis(tuple(map(term, keys)))
    sizes = tuple(np.array([[c.scale(t, p) for p in t.effect.parameters]]) for t in hypothesis.terms)
    names, _, limits = free_quantities(c, hypothesis)
    return hypothesis, Terms(hypothesis.terms, sizes), dict(zip(names, map(tuple, limits), strict=True))


def test_a_speed_that_only_limits_is_no_field_of_the_model():
    """With a back-EMF the no-load speed is damping; without, only dynreg's engines know it."""
    quadruped = load_robot("quadruped")
    (drive,) = quadruped.file.drives
    current = replace(
        quadruped,
        file=quadruped.file.model_copy(update={"drives": [drive.model_copy(update={"back_emf": False})]}),
    )
    (name,) = (
        p.name
        for p, setters in zip(quadruped.space.parameters, quadruped.setters, strict=True)
        if any(a.path == "drive.speed_limit" for a in setters)
    )
    for robot, where in ((quadruped, None), (current, ENGINE)):
        does = traced(robot, robot.space.nominal, Terms(), {name: (4.0, 10.0)})
        assert (does.held[name][1] if name in does.held else None) == where
        assert any(name in one.powers for one in does.fields) == (where is None)


def simulated(robot: Robot, values: np.ndarray, terms: Terms) -> mujoco.MjModel:
    return Arena(robot, values[None], Run(np.zeros((1, 1, len(robot.actions)))), terms=terms).model(0)


def applied(model: mujoco.MjModel, does: Traced, values: dict[str, float]) -> mujoco.MjModel:
    model = copy.copy(model)
    for one in does.fields:
        owner, _, field = one.target.rpartition(".")
        array = getattr(model.opt if owner else model, field)
        product = np.prod([values[name] ** power for name, power in one.powers.items()])
        for place, factor in zip(one.indices, one.factors, strict=True):
            array[place] = (array[place] if one.operation == "+=" else 0.0) + factor * product
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


@pytest.mark.parametrize("name", CASES)
def test_a_model_with_a_draw_in_its_fields_is_that_of_the_engine(name: str) -> None:
    """All fields of the model, what follows from others included; none is left as it was by mistake."""
    robot = load_robot(name)
    hypothesis, terms, ranges = middle(robot, CASES[name])
    begun = robot.space.nominal
    does = traced(robot, begun, terms, ranges)
    assert not does.held
    rng = stream(0, "draw", name)
    values = robot.space.from_unit(rng.uniform(0.2, 0.8, len(robot.space)))
    sizes = tuple(one * rng.uniform(0.5, 1.5, one.shape) for one in terms.values)
    drawn = robot.space.as_dict(values)
    for t, row in zip(terms.terms, sizes, strict=True):
        drawn |= {f"{t.key}.{p.name}": v for p, v in zip(t.effect.parameters, row[0], strict=True)}
    before, wanted = simulated(robot, begun, terms), simulated(robot, values, Terms(terms.terms, sizes))
    made, changed = applied(before, does, drawn), 0
    for field in fields(wanted):
        ours, theirs, old = (np.array(getattr(model, field)) for model in (made, wanted, before))
        np.testing.assert_allclose(ours, theirs, rtol=EXACT, atol=EXACT, err_msg=field)
        changed += not np.array_equal(theirs, old)
    assert changed >= len({one.target for one in does.fields} - {"opt.gravity"}) > 0
    np.testing.assert_allclose(made.opt.gravity, wanted.opt.gravity, atol=EXACT)
    told = {n for one in (*does.fields, *does.ports) for n in one.powers}
    assert told == set(ranges), "every parameter and size is told of"


def fields(model: mujoco.MjModel) -> list[str]:
    """Names of all arrays of numbers of a model."""
    found = []
    for name in dir(model):
        value = None if name.startswith("_") else getattr(model, name)
        if isinstance(value, np.ndarray) and value.dtype.kind == "f":
            found.append(name)
    return found


def test_what_no_product_tells_keeps_its_value_and_is_told() -> None:
    robot = load_robot("servo_pendulum")
    keys = ("gravity_tilt", "clock_error", "load_friction", "command_delay", "command_gain", "force_offset")
    _, terms, ranges = middle(robot, keys)
    does = traced(robot, robot.space.nominal, terms, ranges)
    assert {key: where for key, (_, where) in does.held.items()} == {
        "gravity_tilt": MODEL,
        "clock_error": ENGINE,
        "load_friction": ENGINE,
        "command_delay": MODEL,
    }
    drawn = {name for one in does.fields for name in one.powers}
    assert {"command_gain.gain", "force_offset.torque"} <= drawn and set(robot.space.names) <= drawn


def test_a_base_on_wheels_has_ports_and_no_fields() -> None:
    robot = load_robot("diffdrive")
    _, terms, ranges = middle(robot, ("wheel_gain",))
    does = traced(robot, robot.space.nominal, terms, ranges)
    assert not does.fields and {n for one in does.ports for n in one.powers} == set(ranges)


def test_what_is_not_a_field_of_the_model_is_a_port() -> None:
    robot = load_robot("quadruped")
    ranges = {p.name: (p.low, p.high) for p in robot.space.parameters}
    does = traced(robot, robot.space.nominal, Terms(), ranges)
    assert {one.target for one in does.ports} == {"control.rate", "control.max_step", "control.noise"}


# ---- formulas ----


def test_a_formula_is_the_number_that_it_stands_for() -> None:
    a, b, c = (Formula.of(name, RANGES) for name in RANGES)
    values = {"a": 1.3, "b": 3.7, "c": -0.4}
    x, y, z = values.values()
    made = 2.0 * a**2 / b - (1.0 - c) * b + a * np.float64(3.0) + 1.0 / (a * b)
    assert made.value(values) == pytest.approx(2 * x**2 / y - (1 - z) * y + 3 * x + 1 / (x * y), abs=1e-12)
    assert (np.array([a, 2.0], dtype=object) * np.array([b, a], dtype=object))[0].value(values) == x * y


def test_comparisons_are_decided_by_the_ranges() -> None:
    a, b, c = (Formula.of(name, RANGES) for name in RANGES)
    assert a < b and not a > b and a * b < 9 and b >= 3 and a <= 2 and not c < -1
    for undecided in (lambda: a < 1.5, lambda: c > 0, lambda: np.maximum(np.array([c], dtype=object), 0.0)):
        with pytest.raises(Untold):
            undecided()


def test_a_division_by_a_sum_is_no_sum_of_products() -> None:
    a = Formula.of("a", RANGES)
    with pytest.raises(Untold):
        1.0 / (1.0 + a)
    with pytest.raises(TypeError):
        np.cos(np.array([a], dtype=object))
