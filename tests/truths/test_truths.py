"""Hidden robots by other code: the library's physics where nothing is hidden and for the same cause."""

import numpy as np
import pytest
from trials_of_truths import commands_of, places, plain, plan_of, simulated, told

from dynreg.errors import UsageError
from dynreg.evidence.hypothesis import Coordinates
from dynreg.replay.known import nominal_known
from dynreg.sim.effects import Terms, applicable, effect, term
from dynreg.sim.engines import rollout
from dynreg.sim.real import finer
from dynreg.sim.robot import load_robot
from dynreg.truths.causes import CAUSES, SIZES
from dynreg.truths.table import KINDS, causes_of, log, sized
from dynreg.truths.truth import Commands, Truth

# rad and m over 2.5 s, against the library's Runge and Kutta steps of 0.25 to 0.5 ms
NEAR = {"servo_pendulum": 2e-4, "two_joint_arm": 5e-4, "six_joint_arm": 1.5e-3, "diffdrive": 1e-5}
# What is left between both codes' changes, over the change. Springs ring longer here than the library's (a damping
# ratio of 0.5, not 0.7): 0.08 on the servo, 0.17 on the arm.
ALIKE = 0.03
ROUGH = {("servo_pendulum", "joint_elasticity"): 0.12, ("two_joint_arm", "joint_elasticity"): 0.2}


@pytest.mark.parametrize("name", KINDS)
def test_with_nothing_hidden_both_codes_agree(name):
    own, library = told(name, episodes=2), simulated(name, episodes=2)
    apart = np.sqrt(((own - library)[..., places(name)] ** 2).mean(axis=(0, 1)))
    assert apart.max() < NEAR[name]
    assert own[..., places(name)].std(axis=1).max() > 100 * NEAR[name], "the robot moves"


def changes(name: str, cause: str, size: str = "medium") -> tuple[np.ndarray, np.ndarray]:
    """What the cause changes in the truth, and what the library's effect of the same values does."""
    values, at = sized(name, cause, size, 1), places(name)
    own, other = told(name, cause, values), simulated(name, cause, values)
    own, other = (changed - usual for changed, usual in zip((own, other), plain(name), strict=True))
    return own[..., at].ravel(), other[..., at].ravel()


PAIRS = [
    *(("servo_pendulum", c) for c in causes_of("servo_pendulum", "same")),
    *(("diffdrive", c) for c in causes_of("diffdrive", "same")),
    *(
        ("two_joint_arm", c)
        for c in (
            "coulomb_friction",
            "load_friction",
            "cogging",
            "gravity_tilt",
            "com_offset",
            "joint_elasticity",
            "encoder_eccentricity",
            "sensor_delay",
        )
    ),
]


@pytest.mark.parametrize(("name", "cause"), PAIRS)
def test_a_cause_of_the_librarys_physics_moves_the_robot_as_the_librarys_effect_does(name, cause):
    own, library = changes(name, cause)
    assert own.std() > 1e-4, "it changes something"
    assert np.sqrt(np.mean((own - library) ** 2)) < ROUGH.get((name, cause), ALIKE) * own.std()


def test_a_disc_that_runs_far_out_of_true_stands_where_both_codes_say_as_a_log_begins():
    own, library = changes("two_joint_arm", "encoder_eccentricity", "strong")
    apart = np.sqrt(np.mean((own - library) ** 2))
    assert apart < 0.02 * own.std(), "0.014; where the start is found in one turn, 0.026"


def test_cogging_counts_from_the_encoders_zero():
    robot, plan = plan_of("servo_pendulum", 2)
    parameters = robot.space.as_dict(robot.space.nominal) | {"zero_offset": 0.02}
    values = sized("servo_pendulum", "cogging", "medium", 1)
    own = log(Truth("servo_pendulum", parameters, "cogging", values, exact=True), commands_of(robot.name, 2))
    hidden = term("cogging")
    sizes = np.array([[values[p.name] for p in hidden.effect.parameters]])
    row = robot.space.from_dict(parameters)[None]
    library = rollout(finer(robot), row, plan.run, terms=Terms((hidden,), (sizes,)), threads=1).states[0]
    assert np.sqrt(np.mean((own - library)[..., 0] ** 2)) < NEAR["servo_pendulum"]


@pytest.mark.parametrize("name", KINDS)
def test_sensors_and_units_are_those_that_the_robot_folder_states(name):
    robot, own = load_robot(name), KINDS[name]
    assert [s.channel for s in own.sensors] == list(robot.channels)
    for sensor, channel in zip(own.sensors, robot.file.channels, strict=True):
        least = 0.0005 if channel.name.endswith("position") else 0.0
        assert (sensor.noise, sensor.quantum) == (max(channel.noise, least), channel.quantum)
    scales = Coordinates(robot, nominal_known(robot)).scales
    for unit, values in scales.items():
        assert own.units.of(unit) == pytest.approx(values.mean(), rel=0.01), unit


def test_sizes_of_shared_causes_are_the_librarys():
    compared = 0
    for name, cause in CAUSES.items():
        if not cause.same:
            continue
        parameters = {p.name: p for p in effect(name).parameters}
        for key in cause.sizes.keys() & parameters.keys():
            for size in SIZES:
                assert getattr(cause.sizes[key], size) == pytest.approx(parameters[key].size(size)), (
                    name,
                    key,
                )
            assert cause.sizes[key].per == parameters[key].per
            assert cause.sizes[key].signed == parameters[key].signed
            compared += 1
    assert compared > 40


@pytest.mark.parametrize("name", KINDS)
def test_a_truth_can_hide_all_that_the_library_looks_for(name):
    same, other = ({*causes_of(name, physics)} for physics in ("same", "other"))
    assert same | (other & {*applicable(load_robot(name))}) == {*applicable(load_robot(name))} & {*CAUSES}
    assert other


def test_a_log_depends_on_its_seed_alone():
    parameters = load_robot("servo_pendulum").space
    parameters = parameters.as_dict(parameters.nominal)
    first, again, other = (
        log(Truth("servo_pendulum", parameters, seed=seed), commands_of("servo_pendulum", 2))
        for seed in (1, 1, 2)
    )
    assert (first == again).all() and not (first == other).all()
    steps = first[..., 0] / 0.001534
    assert np.abs(steps - np.rint(steps)).max() < 1e-6, "the encoder counts"


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"kind": "leg"}, "robot 'leg' has no independent truth"),
        ({"joints": ("knee",)}, "no joint 'knee'"),
        ({"parameters": {}}, "without 'torque_constant'"),
        ({"cause": "backlash"}, "without 'gap'"),
        ({"cause": "rust"}, "no cause 'rust'"),
        ({"cause": "wheel_slip", "values": {"grip": 1.0}}, "wheel_slip"),
    ],
)
def test_what_a_truth_cannot_be_is_refused(changed, said):
    space = load_robot("servo_pendulum").space
    given = {"kind": "servo_pendulum", "parameters": space.as_dict(space.nominal)} | changed
    with pytest.raises(UsageError, match=said):
        log(Truth(**given), commands_of("servo_pendulum", 1))


def test_causes_that_a_robot_cannot_have_are_refused():
    with pytest.raises(UsageError, match="expected one of"):
        sized("servo_pendulum", "cable_coupling", "medium", 1)
    with pytest.raises(UsageError, match="expected one of"):
        sized("diffdrive", "backlash", "medium", 1)


def test_commands_have_a_shape():
    with pytest.raises(UsageError, match="reshape"):
        Commands(np.zeros((3, 2)), 0.01, np.zeros(3))
