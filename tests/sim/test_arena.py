"""Simulators set up once for many runs: every run is the first one, and walks end at a fall."""

import re
from pathlib import Path

import numpy as np
import pytest

from dynreg.errors import SimulationError
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.effects import Terms
from dynreg.sim.engines import Arena, rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot, packaged_robots
from dynreg.sim.run import Run, motor_noise

EFFECTS = {
    "plain": {},
    "one that remembers": {"backlash": {"gap": 0.03}},
    "one that rubs": {"load_friction": {"coefficient": 0.1}},
}


def runs(robot, steps: int = 30) -> tuple[Run, Run]:
    """The same noise, other commands."""
    noise = motor_noise(np.array([1, 2]), 3, steps, len(robot.actions))
    banks = (excitation(robot, seed=s, episodes=3, steps=steps) for s in (1, 2))
    first, second = (Run(b.actions, period=1 / robot.rate, noise=noise) for b in banks)
    return first, second


def effects(robot, name: str) -> Terms | None:
    """The same in two simulators."""
    terms = terms_of(SimConfig(robot.hash, robot.name, {}, EFFECTS[name]), robot)
    return Terms(terms.terms, tuple(np.repeat(v, 2, axis=0) for v in terms.values)) if EFFECTS[name] else None


@pytest.mark.parametrize("name", EFFECTS)
def test_every_run_is_as_if_it_were_the_first(name: str) -> None:
    robot = load_robot("quadruped")
    values = robot.space.sample(0, 2, 0)
    terms = effects(robot, name)
    first, second = runs(robot)
    arena = Arena(robot, values, first, threads=1, terms=terms)
    a, b, again = (arena.rollout(run).states for run in (first, second, first))
    assert np.array_equal(a, again) and not np.array_equal(a, b)
    assert np.array_equal(b, rollout(robot, values, second, threads=1, terms=terms).states)


def test_a_second_run_has_drives_that_went_off_on_again() -> None:
    leg = load_robot("leg")
    bank = excitation(leg, seed=1, episodes=2, steps=30)
    inputs = np.ones((2, 30, len(leg.inputs)))
    on = Run(bank.actions, period=1 / leg.rate, inputs=inputs)
    off = Run(bank.actions, period=1 / leg.rate, inputs=np.where(np.arange(30)[:, None] < 12, inputs, 0.0))
    arena = Arena(leg, leg.space.nominal[None], off, threads=1)
    first, second = arena.rollout(off).states, arena.rollout(off).states
    always = Arena(leg, leg.space.nominal[None], on, threads=1).rollout(on).states
    assert np.array_equal(first, second)
    assert np.array_equal(first[..., :12, :], always[..., :12, :])
    assert np.abs(first - always)[..., -1, :].max() > 0.1


@pytest.mark.parametrize("name", EFFECTS)
def test_a_walk_is_the_same_motion_and_ends_at_the_fall(name: str) -> None:
    robot = load_robot("quadruped")
    values = robot.space.sample(0, 2, 0)
    run, _ = runs(robot, steps=60)
    arena = Arena(robot, values, run, threads=1, terms=effects(robot, name))
    whole, walk = arena.rollout(run), arena.walk(run)
    assert np.array_equal(walk.fell, whole.fell)
    assert (walk.fell <= 60).any() and walk.physics_steps < whole.physics_steps
    assert np.array_equal(arena.walk(run).base, walk.base)
    roll = robot.channels.index("base/roll")
    for b, e in np.ndindex(*walk.fell.shape):
        end = min(walk.fell[b, e], 61)
        assert np.array_equal(walk.base[b, e, :end, 3:], whole.states[b, e, :end, roll : roll + 9])
        assert (walk.base[b, e, end - 1 :] == walk.base[b, e, end - 1]).all()


def test_poses_are_what_the_robot_does_in_the_model_that_it_does_it_in() -> None:
    robot = load_robot("quadruped")
    values = robot.space.sample(0, 2, 0)
    run, _ = runs(robot)
    arena = Arena(robot, values, run, threads=1)
    poses, states = arena.poses(run), arena.rollout(run).states
    assert poses.shape == (2, 3, 31, 19)
    assert np.array_equal(poses[..., 7:], states[..., :12])  # the joints, in the order of the channels
    gravity = robot.space.names.index("gravity")
    assert [arena.model(i).opt.gravity[2] for i in (0, 1)] == pytest.approx(-values[:, gravity])


def test_on_a_slope_a_standing_robot_is_pulled_back() -> None:
    """Uphill is ahead: gravity pulls backwards with its size unchanged."""
    robot = load_robot("quadruped")
    pose = robot.model.keyframe("stance").ctrl
    run = Run(np.tile(pose, (1, 10, 1)), period=1 / robot.rate)
    values = robot.space.from_dict({"friction": 0.3})[None]
    moved = [
        Arena(robot, values, run, threads=1, slope=angle).walk(run).base[0, 0, -1, 0] for angle in (0.0, 0.5)
    ]
    assert moved[1] < moved[0] - 0.05


def test_the_slope_turns_gravity_that_an_effect_has_tilted() -> None:
    """Both turn it about the same axis: only the sum of their angles counts."""
    robot = load_robot("quadruped")
    run = Run(np.tile(robot.model.keyframe("stance").ctrl, (1, 2, 1)), period=1 / robot.rate)

    def gravity(tilt: float, slope: float) -> np.ndarray:
        terms = terms_of(SimConfig(robot.hash, robot.name, {}, {"gravity_tilt": {"angle": tilt}}), robot)
        arena = Arena(robot, robot.space.nominal[None], run, threads=1, terms=terms, slope=slope)
        return arena.model(0).opt.gravity

    assert np.allclose(np.linalg.norm(gravity(0.1, 0.3)), 9.81)
    assert np.allclose(gravity(0.1, 0.3), gravity(0.2, 0.2)) and not np.allclose(
        gravity(0.1, 0.0), gravity(0.2, 0.0)
    )


def test_what_stands_on_a_bench_does_not_walk() -> None:
    robot = load_robot("leg")
    run = Run(np.zeros((1, 3, len(robot.actions))))
    with pytest.raises(SimulationError, match="no floating base"):
        Arena(robot, robot.space.nominal[None], run, threads=1).walk(run)


def test_feet_of_a_standing_robot_touch_the_ground_and_of_a_falling_one_leave_it() -> None:
    robot = load_robot("quadruped")
    pose = np.tile(robot.model.keyframe("stance").ctrl, (2, 20, 1))
    pose[1, 5:, 1] += 0.6  # one leg is lifted
    run = Run(pose, period=1 / robot.rate)
    arena = Arena(robot, robot.space.nominal[None], run, threads=1)
    feet = arena.walk(run, feet=True).contact
    assert sorted(feet) == ["fl_foot", "fr_foot", "rl_foot", "rr_foot"]
    assert all(touching[0, 0, 1:].all() for touching in feet.values())
    assert not feet["fl_foot"][0, 1, 15:].all()
    assert arena.walk(run).contact == {}


def contacts(folder: Path, *changes: tuple[str, str]) -> dict[str, np.ndarray]:
    """Which feet of a standing quadruped touch the ground, where some lines of its model are changed."""
    own = packaged_robots()["quadruped"]
    model = (own / "model.xml").read_text(encoding="utf-8")
    for old, new in changes:
        assert re.search(old, model)
        model = re.sub(old, new, model)
    (folder / "model.xml").write_text(model, encoding="utf-8")
    text = (own / "robot.toml").read_text(encoding="utf-8").replace("[ground,*_foot,torso]", "[ground,torso]")
    (folder / "robot.toml").write_text(text, encoding="utf-8")
    robot = load_robot(folder)
    run = Run(np.tile(robot.model.keyframe("stance").ctrl, (1, 20, 1)), period=1 / robot.rate)
    return Arena(robot, robot.space.nominal[None], run, threads=1).walk(run, feet=True).contact


HOPPER = """<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body pos="0 0 0.3">
      <freejoint name="base"/>
      <geom type="box" size="0.1 0.1 0.03" mass="2"/>
      <body name="leg">
        <joint name="leg" type="slide" axis="0 0 1" range="-0.05 0.05"/>
        <geom name="shin" type="capsule" size="0.02" fromto="0 0 -0.04 0 0 -0.2" mass="0.2"/>
        {foot}
      </body>
    </body>
  </worldbody>
  <actuator><position joint="leg" kp="2000"/></actuator>
</mujoco>"""
HOPPER_TOML = """
[robot]
name = "hopper"
engines = ["mujoco"]
control_rate = 50.0
timestep = 0.001

[[drives]]
joint = "leg"
type = "position"
gain = 2000.0
rate_gain = 50.0

[[actions]]
name = "leg/target"
unit = "m"

[[channels]]
name = "base/z"
unit = "m"

[[parameters]]
name = "size"
unit = "m"
nominal = 0.03
low = 0.02
high = 0.06
sets = ["mj.geom_size[{sized}]{index} ="]

[[parameters]]
name = "length"
unit = "1"
nominal = 1.0
low = 0.5
high = 1.25
sets = ["modifier.link_length[leg] *="]
"""
ROUND = '<geom name="foot" size="0.03" pos="0 0 -0.2" mass="0.1"/>'
FLAT = ROUND.replace('size="0.03"', 'type="box" size="0.03 0.03 0.03"')


@pytest.mark.parametrize(
    ("foot", "sized"),
    [(ROUND, "foot"), (FLAT, "foot"), ("", "shin")],
    ids=["sphere", "box", "capsule alone"],
)
def test_each_robot_stands_on_feet_of_its_own_size(foot: str, sized: str, tmp_path: Path) -> None:
    """All began as high as the nominal one: those with larger feet or longer links in the ground, and flew off."""
    (tmp_path / "model.xml").write_text(HOPPER.format(foot=foot), encoding="utf-8")
    index = "" if foot == FLAT else "[0]"
    (tmp_path / "robot.toml").write_text(HOPPER_TOML.format(sized=sized, index=index), encoding="utf-8")
    robot = load_robot(tmp_path)
    values = np.array([[0.03, 1.0], [0.06, 1.0], [0.02, 1.0], [0.03, 1.25], [0.03, 0.5]])
    run = Run(np.zeros((1, 20, 1)))
    arena = Arena(robot, values, run, threads=1)
    heights = arena.rollout(run).states[:, 0, :, 0]
    np.testing.assert_allclose(heights[:, 0], 0.2 * values[:, 1] + values[:, 0], atol=1e-9)
    assert (heights <= heights[:, :1] + 1e-6).all()
    feet = arena.walk(run, feet=True).contact
    assert all(touching[:, 0, 1:].all() for touching in feet.values()) and len(feet) == (foot == ROUND)


def test_each_foot_has_a_name_of_its_own_where_the_model_names_none(tmp_path) -> None:
    feet = contacts(tmp_path, ('name="[fr][lr]_foot" ', ""))
    assert len(feet) == 4 and all(touching[0, 0, 1:].all() for touching in feet.values())
    assert {name[:3] for name in feet} == {"fl_", "fr_", "rl_", "rr_"}  # their bodies
    # two on one body, which also are at one place
    twice = contacts(tmp_path, ('<geom name="fl_foot" ([^>]*)/>', r"<geom \1/><geom \1/>"))
    assert len(twice) == 5 and sum(name.startswith("geom ") for name in twice) == 2


def test_a_foot_that_the_ground_alone_looks_for_is_one(tmp_path) -> None:
    feet = contacts(
        tmp_path,
        ('mass="0" contype="1"', 'mass="0" conaffinity="1"'),
        ('0.1" conaffinity="1"', '0.1" contype="1"'),
    )
    assert sorted(feet) == ["fl_foot", "fr_foot", "rl_foot", "rr_foot"]
    assert all(touching[0, 0, 1:].all() for touching in feet.values())
