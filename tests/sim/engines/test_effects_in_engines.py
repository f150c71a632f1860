"""How engines call effects: what effects see, when, and what it costs."""

import time
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from effect_benches import Bench, bench, plain, values_at

from dynreg.errors import SimulationError, UsageError
from dynreg.sim.effects import Effect, EffectParameter, Moment, Term, Terms, effects, term
from dynreg.sim.engines import rollout
from dynreg.sim.engines.acting import Clock, acting
from dynreg.sim.excitation import excitation, reset_pose
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

BENCHES = ("servo", "servo_mujoco", "air", "stand", "lean")


class Idle(Effect):
    """Changes nothing."""

    id, acts_on, title = "idle", "drive", "nothing"
    parameters = (EffectParameter("nothing", "1", "no meaning", 1.0, 1.0, 1.0, 1.0),)

    def command(self, u: np.ndarray, x: Moment, p) -> np.ndarray:
        return u

    def drive(self, torque: np.ndarray, x: Moment, p) -> np.ndarray:
        return torque

    def friction(self, x: Moment, p) -> np.ndarray:
        return np.zeros_like(x.v)


class Witness(Idle):
    """Remembers what it saw, too; engines that compile their effects call it no more than a few times."""

    id = "witness"

    def __init__(self):
        self.seen: list[dict[str, np.ndarray]] = []

    def drive(self, torque: np.ndarray, x: Moment, p) -> np.ndarray:
        names = ("q", "v", "load", "time", "limit", "stiffness", "inertia")
        self.seen.append({"torque": torque.copy()} | {n: np.array(getattr(x, n)) for n in names})
        return torque


class Levelled(Idle):
    """Takes the pendulum's weight off by what the engine says, and puts it on by its own reckoning."""

    id = "levelled"
    parameters = (EffectParameter("tip", "N*m", "its weight", 1.0, 1.0, 1.0, 1.0),)

    def drive(self, torque: np.ndarray, x: Moment, p) -> np.ndarray:
        return (torque + x.load - p["tip"] * np.sin(x.q)) * (x.inertia / (0.49 * 0.1**2 + 1e-6 + 0.0018))


@pytest.mark.usefixtures("own_effects_alone")
@pytest.mark.parametrize("name", BENCHES)
def test_an_effect_that_does_nothing_changes_no_bit(name: str):
    """One time step at a time is as many at once, and a drive's torque is what the engine itself makes of it."""
    b = bench(name)
    np.testing.assert_array_equal(b.states({Idle(): 1.0})[0], plain(b))


def _tip(b: Bench) -> float:
    """[N m] of the pendulum's weight."""
    return b.robot.space.as_dict(b.robot.space.nominal)["tip_mass"] * 9.80665 * 0.1


@pytest.mark.usefixtures("own_effects_alone")
def test_the_load_and_the_inertia_of_the_servo_are_its_pendulum_s():
    b = bench("servo")
    run = replace(b.run, begin=None)
    terms = Terms((Term(Levelled()),), (np.array([[_tip(b)]]),))
    nominal = b.robot.space.nominal[None]
    states = rollout(b.robot, nominal, run, engine="joint", terms=terms).states
    changed = states - rollout(b.robot, nominal, run, engine="joint").states
    assert np.abs(changed).max() < 0.02 * np.abs(states).max()


@pytest.mark.parametrize(("key", "goes_on"), [("thermal_fade", False), ("friction_drift", True)])
def test_time_goes_on_from_where_an_episode_begins_and_memory_does_not(key: str, goes_on: bool):
    """A motor is cold as a window begins, 100 s into its log as at the start."""
    b = bench("servo")
    alone = [replace(b.run, begin=np.full(b.run.episodes, begin)) for begin in (0.0, 100.0)]
    terms = Terms((term(key),), (np.array([[0.4]]),))
    early, late = (rollout(b.robot, b.robot.space.nominal[None], run, terms=terms).states for run in alone)
    assert np.array_equal(early, late) != goes_on


def test_the_load_of_the_servo_in_mujoco_is_that_of_the_time_step_before():
    b, witness = bench("servo_mujoco"), Witness()
    b.states({witness: 1.0})
    tip = _tip(b)
    for seen in witness.seen[5::50]:
        np.testing.assert_allclose(seen["load"], tip * np.sin(seen["q"]), atol=0.03 * tip)
        np.testing.assert_allclose(seen["inertia"], 0.49 * 0.1**2 + 1e-6 + 0.0018, rtol=0.01)


def test_the_load_of_a_leg_is_gravity_in_the_air_and_the_robot_s_weight_on_the_ground():
    robot = load_robot("leg")
    crouch = np.tile(reset_pose(robot), (1, 150, 1))
    loads = {}
    for height in (0.5, 0.2):
        witness = Witness()
        run = Run(crouch, settings=np.array([[height]]))
        Bench(f"hold {height}", robot, run, "mujoco").states({witness: 1.0})
        loads[height] = witness.seen[-1]
    data = mujoco.MjData(robot.model)
    data.qpos[1:] = loads[0.5]["q"][0]
    mujoco.mj_forward(robot.model, data)
    np.testing.assert_allclose(loads[0.5]["load"][0], data.qfrc_bias[1:], atol=1e-3)
    # standing still, what the drives give is what the load takes, and the ground's force on the foot that
    # makes this load out of gravity's lifts the whole robot
    np.testing.assert_allclose(loads[0.2]["load"], loads[0.2]["torque"], atol=0.05)
    data.qpos[1:] = loads[0.2]["q"][0]
    mujoco.mj_forward(robot.model, data)
    jacobian = np.zeros((3, robot.model.nv))
    foot = robot.model.geom("foot")
    mujoco.mj_jac(robot.model, data, jacobian, None, data.geom_xpos[foot.id], foot.bodyid[0])
    pushed = data.qfrc_bias[2:] - loads[0.2]["load"][0, 1:]
    force = np.linalg.solve(jacobian[[0, 2], 2:].T, pushed)
    assert force[1] == pytest.approx(robot.model.body_mass.sum() * 9.80665, rel=0.05)


def test_time_goes_on_from_episode_to_episode():
    b, witness = bench("servo_mujoco"), Witness()
    b.states({witness: 1.0})
    times = np.array([seen["time"][:, 0] for seen in witness.seen])
    np.testing.assert_allclose(times[0], b.run.begin, atol=1e-12)
    step = 1 / b.robot.rate / b.robot.substeps(1 / b.robot.rate)
    np.testing.assert_allclose(np.diff(times, axis=0), step, atol=1e-9)


@pytest.mark.parametrize("name", ["servo", "servo_mujoco", "air"])
def test_known_starts_are_what_the_encoders_read(name: str):
    b = bench(name)
    off = b.states({effects()["encoder_offset"]: "strong", effects()["encoder_scale"]: "strong"})[0]
    known = ~np.isnan(b.run.initial)
    np.testing.assert_allclose(off[:, 0][known], b.run.initial[known], atol=1e-12)
    assert np.abs(off - plain(b)).max() > 0.01


def test_delayed_commands_are_blended_within_a_time_step():
    """At 10 ms a command and 2 ms a time step: 3 ms late is the last command, then half of both, then the new."""
    commands = np.array([[[0.0], [1.0], [5.0]]])
    clock = Clock(commands, np.array([0.01]), np.array([0.002]), np.array([0.0]))
    late = acting(load_robot("servo_pendulum"), Terms((term("command_delay"),), (np.array([[0.003]]),)))[0]
    clock.step, seen = 1, []
    for clock.substep in range(5):
        seen.append(float(clock.past(late, np.array([[0.003]]))[0, 0]))
    np.testing.assert_allclose(seen, [0.0, 0.5, 1.0, 1.0, 1.0], atol=1e-9)


def test_effects_that_a_planar_base_cannot_have_are_told():
    husky = load_robot("husky")
    run = excitation(husky, seed=0, episodes=2, steps=5)
    values = husky.space.nominal[None]
    with pytest.raises(UsageError, match="load_friction.*husky.*no driven joint"):
        rollout(husky, values, run, terms=Terms((term("load_friction"),), (np.array([[0.1]]),)))
    anywhere = type("Anywhere", (Witness,), {"why_not": lambda self, robot: None})()
    with pytest.raises(SimulationError, match="'witness' acts on torques.*planar base"):
        rollout(husky, values, run, terms=Terms((Term(anywhere),), (np.array([[1.0]]),)))


def test_a_planar_base_has_effects_on_ports_and_on_its_log():
    class Slip(Effect):
        """The base is slower than it was told, and its log is read in reverse."""

        id, acts_on, title = "slip", "drive", "wheels slip"
        parameters = (EffectParameter("loss", "1", "share of the speed", 0.05, 0.1, 0.2, 0.9),)

        def why_not(self, robot) -> None:
            return None

        def configure(self, site, p) -> None:
            site.drive("gain_factor", lambda f: f)
            site.drive("gain", lambda g: g * (1.0 - p["loss"]))

        def observe(self, states, columns, times, p) -> np.ndarray:
            return -states

    husky = load_robot("husky")
    run = excitation(husky, seed=0, episodes=2, steps=20)
    values = husky.space.nominal[None]
    half = rollout(husky, values, replace(run, actions=0.5 * run.actions)).states
    slip = rollout(husky, values, run, terms=Terms((Term(Slip()),), (np.array([[0.5]]),))).states
    np.testing.assert_allclose(slip, -half, atol=1e-12)


@pytest.mark.slow
def test_effects_between_time_steps_cost_64_quadrupeds_little():
    """Load friction on all joints against plain dry friction, which costs MuJoCo itself; prints both."""
    robot = load_robot("quadruped")
    run = excitation(robot, seed=0, episodes=1, steps=100)
    values = np.tile(robot.space.nominal, (64, 1))
    seconds: dict[str, list[float]] = {"": [], "coulomb_friction": [], "load_friction": []}
    for _ in range(5):
        for key, measured in seconds.items():
            rows = np.tile(values_at(effects()[key], robot, "weak"), (64, 1)) if key else None
            terms = Terms((term(key),), (rows,)) if key else None
            before = time.perf_counter()
            rollout(robot, values, run, threads=1, terms=terms)
            measured.append(time.perf_counter() - before)
    plain_s, dry, load = (min(s) for s in seconds.values())
    print(f"plain {plain_s:.3f} s, dry friction x{dry / plain_s:.2f}, load friction x{load / plain_s:.2f}")
    assert load < 1.25 * dry
