"""Effects of planar bases: on both engines alike, composable, and each where a base would show it."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from effect_benches import rms, values_at

from dynreg.sim.effects import Effect, Term, Terms, applicable, effects, placed, term
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

DIFFDRIVE = load_robot("diffdrive")
ABLE = tuple(applicable(DIFFDRIVE).values())
RUN = excitation(DIFFDRIVE, seed=3, name="wheels", episodes=4, steps=60)
POSE, WHEELS = slice(4, 7), slice(0, 2)
E = effects()


def states(*rows: dict[Effect, str | float], engine: str = "kinematic", run: Run = RUN) -> np.ndarray:
    """(rows, E, T+1, S) of the nominal robot with the effects of each row."""
    every = list(dict.fromkeys(e for row in rows for e in row))
    absent = {e: [np.nan] * len(e.parameters) for e in every}
    columns = [
        np.array([values_at(e, DIFFDRIVE, row[e]) if e in row else absent[e] for row in rows]) for e in every
    ]
    terms = Terms(tuple(Term(e) for e in every), tuple(columns)) if every else None
    nominal = np.tile(DIFFDRIVE.space.nominal, (len(rows), 1))
    return rollout(DIFFDRIVE, nominal, run, engine=engine, terms=terms).states


def test_a_base_has_the_effects_of_commands_wheels_and_logs():
    wanted = {"command_delay", "command_lag", "command_deadband", "command_gain", "rate_limit"}
    wanted |= {"wheel_gain", "drive_inertia", "wheel_slip", "encoder_scale", "sensor_delay", "turn_slowdown"}
    assert set(applicable(DIFFDRIVE)) == wanted
    husky = set(applicable(load_robot("husky")))  # commanded as a whole, without encoders
    assert husky == wanted - {"wheel_gain", "wheel_slip", "encoder_scale"}
    for name in ("servo_pendulum", "quadruped"):
        assert not {"wheel_gain", "drive_inertia", "wheel_slip", "turn_slowdown"} & set(
            applicable(load_robot(name))
        )


@pytest.mark.parametrize("size", ["medium", "strong"])
@pytest.mark.parametrize("effect", ABLE, ids=lambda e: e.id)
def test_engines_agree_on_the_change_that_an_effect_makes(effect: Effect, size: str):
    changes = []
    for engine in ("kinematic", "unicycle"):
        plain, changed = states({}, {effect: size}, engine=engine)
        changes.append(changed - plain)
    for columns in (POSE, WHEELS):
        assert rms((changes[0] - changes[1])[..., columns]) <= 0.03 * rms(changes[0][..., columns]) + 1e-6


@pytest.mark.parametrize("engine", ["kinematic", "unicycle"])
def test_rows_are_independent_and_any_two_effects_compose(engine: str):
    rows = [{}, *({e: "strong", f: "medium"} for e, f in combinations(ABLE, 2))]
    run = RUN.take(np.array([0, 1]))
    together = states(*rows, engine=engine, run=run)
    assert np.isfinite(together).all()
    for number in (0, 7, 23, len(rows) - 1):
        np.testing.assert_array_equal(states(rows[number], engine=engine, run=run)[0], together[number])


@pytest.mark.parametrize("engine", ["kinematic", "unicycle"])
def test_simulators_with_other_command_rates_change_nothing(engine: str):
    """Memories of effects in a base that waits for a slower one do not run on."""
    slip, limit, late = E["wheel_slip"], E["rate_limit"], E["command_lag"]
    robot = replace(
        DIFFDRIVE,
        space=replace(
            DIFFDRIVE.space,
            parameters=(
                replace(DIFFDRIVE.space.parameters[0], sets=("control.rate =",), low=1.0, high=99.0),
            ),
        ),
    )
    rates, terms = np.array([[50.0], [7.0], [20.0]]), (Term(slip), Term(limit), Term(late))
    columns = [np.array([values_at(t.effect, DIFFDRIVE, "strong")] * 3) for t in terms]
    together = rollout(robot, rates, RUN, engine=engine, terms=Terms(terms, tuple(columns))).states
    for i in range(3):
        alone = Terms(terms, tuple(c[i : i + 1] for c in columns))
        np.testing.assert_array_equal(
            rollout(robot, rates[i : i + 1], RUN, engine=engine, terms=alone).states[0], together[i]
        )


def test_a_wheel_gain_turns_a_straight_line_into_an_arc_that_encoders_see():
    """At equal commands u the wheels turn at u (1 -+ d/2): yaw rate r u d / (track drag)."""
    run = Run(np.full((1, 100, 2), 8.0), initial=np.array([[0, 0, 8.0, 8.0, 0, 0, 0]]))
    made = rollout(
        DIFFDRIVE,
        DIFFDRIVE.space.nominal[None],
        run,
        terms=Terms((term("wheel_gain"),), (np.array([[0.1]]),)),
    ).states[0, 0]
    b = DIFFDRIVE.file.base
    late = 2.0 - b.yaw_lag / b.yaw_drag
    turned = b.wheel_radius * 8.0 * 0.1 / b.track / b.yaw_drag
    assert made[-1, 6] == pytest.approx(turned * late, rel=1e-3)
    assert made[-1, 1] - made[-1, 0] == pytest.approx(turned * late * b.track / b.wheel_radius, rel=1e-3)


def test_inertia_is_a_longer_lag_of_speed_and_yaw_rate():
    longer = DIFFDRIVE.space.as_dict(DIFFDRIVE.space.nominal)
    longer |= {"speed_lag": longer["speed_lag"] + 0.05, "yaw_lag": longer["yaw_lag"] + 0.05}
    for engine in ("kinematic", "unicycle"):
        by_parameters = rollout(DIFFDRIVE, DIFFDRIVE.space.from_dict(longer)[None], RUN, engine=engine).states
        np.testing.assert_allclose(
            states({E["drive_inertia"]: "medium"}, engine=engine), by_parameters, atol=1e-12
        )


def test_slip_is_what_encoders_do_not_see_and_grip_is_the_fastest_change_on_the_ground():
    plain, slipping = states({}, {E["wheel_slip"]: "strong"})
    np.testing.assert_array_equal(plain[..., :4], slipping[..., :4])
    assert rms((plain - slipping)[..., POSE]) > 0.02
    # a standing start straight ahead: speed t grip until the wheels' speed is reached
    run = Run(np.full((1, 50, 2), 12.0))
    grip = 0.4
    made = rollout(
        DIFFDRIVE,
        DIFFDRIVE.space.nominal[None],
        run,
        terms=Terms((term("wheel_slip"),), (np.array([[grip]]),)),
    ).states[0, 0]
    t = np.arange(51) * 0.02
    until = 0.5  # s: 0.2 m/s of the 0.255 that the wheels have by then
    np.testing.assert_allclose(made[t <= until, 4], grip * t[t <= until] ** 2 / 2, atol=3e-4)
    assert made[-1, 4] < made[-1, 0] * DIFFDRIVE.file.base.wheel_radius - 0.02


def test_a_scaled_encoder_is_driven_to_what_it_reads():
    """Both wheels read 3 % too much: encoders as commanded, the base 3 % slower."""
    plain, scaled = states({}, {E["encoder_scale"]: 3.0})
    np.testing.assert_allclose(scaled[..., :4], plain[..., :4], atol=1e-9)
    np.testing.assert_allclose(scaled[..., 6], plain[..., 6] / 1.03, atol=1e-9)


def test_a_dead_zone_holds_the_wheels_at_small_commands():
    small = np.full((1, 30, 2), [0.2, -0.2])
    width = Terms((term("command_deadband"),), (np.array([[0.25]]),))
    made = rollout(DIFFDRIVE, DIFFDRIVE.space.nominal[None], Run(small), terms=width).states
    assert not made.any()


def test_effects_of_torques_stay_refused():
    assert "no driven joint" in E["load_friction"].why_not(DIFFDRIVE)
    assert "masses" in E["payload"].why_not(DIFFDRIVE) and "masses" in E["clock_error"].why_not(DIFFDRIVE)


def _after_a_circle(robot_name: str, commands: tuple[float, float], arm: float) -> tuple[float, float]:
    """Length of the way [m] and angle turned [rad] in two seconds of held commands, without lags."""
    robot = load_robot(robot_name)
    if robot.file.base:
        still = {"speed_lag": 0.0, "yaw_lag": 0.0, "speed_drag": 1.0, "yaw_drag": 1.0}
        robot = replace(
            robot,
            file=robot.file.model_copy(update={"base": robot.file.base.model_copy(update=still)}),
            space=replace(robot.space, parameters=()),
        )
    steps = round(2.0 * robot.rate)
    run = Run(np.tile(commands, (1, steps, 1)), period=1.0 / robot.rate)
    terms = Terms((term("turn_slowdown"),), (np.array([[arm]]),))
    values = np.empty((1, 0)) if robot.file.base else robot.space.nominal[None]
    states = rollout(robot, values, run, engine="kinematic", terms=terms).states[0, 0]
    x, y, yaw = (states[:, robot.channels.index(f"base/{k}")] for k in ("x", "y", "yaw"))
    return float(np.hypot(np.diff(x), np.diff(y)).sum()), float(yaw[-1])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("ahead", [1.0, -1.0])
def test_turns_cost_speed_on_both_kinds_of_base(side: float, ahead: float):
    """Told 0.1 m/s and 0.8 rad/s with an arm of 5 cm: 0.06 m/s are left, and all of the turning."""
    wheels = DIFFDRIVE.file.base
    spread = np.array([-0.5, 0.5]) * 0.8 * side * wheels.track
    on_wheels = tuple((0.1 * ahead + spread) / wheels.wheel_radius)
    for robot, told in (("create", (0.1 * ahead, 0.8 * side)), ("diffdrive", on_wheels)):
        way, turned = _after_a_circle(robot, told, 0.05)
        assert way == pytest.approx(0.12, rel=1e-3) and turned == pytest.approx(1.6 * side, rel=1e-3)


def test_straight_on_nothing_is_lost_and_no_turn_drives_a_base_backwards():
    assert _after_a_circle("create", (0.1, 0.0), 0.05) == pytest.approx((0.2, 0.0))
    assert _after_a_circle("create", (0.01, 1.0), 0.05) == pytest.approx((0.0, 2.0), abs=1e-9)
    assert _after_a_circle("create", (0.0, 1.0), 0.05) == pytest.approx((0.0, 2.0), abs=1e-9)


def test_one_wheel_has_no_gain_of_its_own_beside_the_difference_of_both():
    assert [t.key for t in placed(DIFFDRIVE, E["command_gain"])] == ["command_gain"]
    assert len(placed(DIFFDRIVE, E["command_delay"])) == 3
    assert len(placed(load_robot("leg"), E["command_gain"])) == 4


def test_a_rate_limit_of_speeds_does_not_depend_on_the_time_step():
    """A wheel that is told 3 rad/s at 150 rad/s^2 is there after two steps of 10 ms, or twenty of 1 ms."""
    fast = Terms((term("rate_limit"),), (np.array([[150.0]]),))
    nominal = DIFFDRIVE.space.nominal[None]
    steps = np.tile([[3.0, 3.0], [-1.5, 2.0], [0.5, 0.0]], (10, 1))
    run = Run(np.repeat(steps, 5, axis=0)[None], period=1.0 / DIFFDRIVE.rate)
    coarse, fine = (
        rollout(r, nominal, run, engine="kinematic", terms=fast).states
        for r in (DIFFDRIVE, DIFFDRIVE.stepped(10))
    )
    plain = rollout(DIFFDRIVE, nominal, run, engine="kinematic").states
    for columns in (WHEELS, POSE):
        assert rms((coarse - fine)[..., columns]) < 0.02 * rms((coarse - plain)[..., columns])
