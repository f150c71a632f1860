"""The gait of the paper: its genes, its joint commands, and what is feasible before anything moves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynreg.errors import RobotError, UsageError
from dynreg.gait.sines import Sines
from dynreg.gait.space import gait_space
from dynreg.rng import stream
from dynreg.sim.robot import load_robot

FINE = np.linspace(0.0, 4.0, 2001)


def drawn(space, count: int, seed: int = 0) -> np.ndarray:
    return space.from_unit(stream(seed, "gaits").uniform(size=(count, len(space))))


def test_a_quadruped_of_three_joints_a_leg_has_the_papers_thirteen_genes(quadruped) -> None:
    space = gait_space(quadruped)
    assert len(space) == 13 and len(set(space.names)) == 13
    assert space.names[0] == "frequency" and sum(space.periodic) == 6
    assert {g.unit for g in space.genes} == {"Hz", "rad"}


def test_the_targets_are_the_formula_of_the_paper(quadruped) -> None:
    """After the ramp, joint by joint; the hips of the right legs are mirrored."""
    space = gait_space(quadruped)
    genes = drawn(space, 1)
    g = space.as_dict(genes[0])
    t = 2.345
    told = dict(zip(space.actions, space.targets(genes, np.array([t]))[0, 0], strict=True))
    for leg in ("fl", "fr", "rl", "rr"):
        for role in ("hip", "shoulder", "elbow"):
            phase = g.get(f"phase_{leg}", 0.0) + g[f"phase_{role}"]
            wanted = g[f"offset_{role}"] + g[f"amplitude_{role}"] * np.sin(
                2 * np.pi * g["frequency"] * t + phase
            )
            sign = -1 if role == "hip" and leg in ("fr", "rr") else 1
            assert told[f"{leg}_{role}/target"] == pytest.approx(sign * wanted)


def test_a_gait_begins_at_rest_and_fades_in(quadruped) -> None:
    space = gait_space(quadruped)
    told = space.targets(drawn(space, 4), FINE)
    assert np.allclose(told[:, 0], space.pose)
    assert np.abs(np.diff(told, axis=1)).max() < 0.1  # 2 ms apart


def test_units_and_names_come_back(quadruped) -> None:
    space = gait_space(quadruped)
    genes = drawn(space, 5)
    assert np.allclose(space.from_unit(space.to_unit(genes)), genes)
    assert np.array_equal(space.from_dict(space.as_dict(genes[0])), genes[0])
    with pytest.raises(UsageError, match="phase_tail"):
        space.from_dict({**space.as_dict(genes[0]), "phase_tail": 1.0})


def test_phases_run_round_and_the_others_end_at_their_bounds(quadruped) -> None:
    space = gait_space(quadruped)
    out = space.from_unit(np.full(13, 1.25))
    assert np.allclose(out[space.periodic], -np.pi / 2)
    assert np.allclose(out[~space.periodic], space.bounds[~space.periodic, 1])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_what_is_made_feasible_keeps_every_limit_at_every_time(seed: int) -> None:
    space = gait_space(load_robot("quadruped"))
    genes = space.feasible(drawn(space, 3, seed))
    assert all(space.problems(g) == () for g in genes)
    told = space.targets(genes, FINE)
    assert (told >= space.low - 1e-9).all() and (told <= space.high + 1e-9).all()
    assert (np.abs(np.diff(told, axis=1)) / FINE[1] <= space.speed + 1e-6).all()
    assert np.allclose(space.feasible(genes), genes)  # what is feasible stays as it is


def test_a_gait_past_its_limits_is_refused_with_the_joint_and_the_limit(quadruped) -> None:
    space = gait_space(quadruped)
    good = space.from_dict({**space.as_dict(space.bounds.mean(axis=1)), **space.first[0]})
    space.require(good)
    fast = good.copy()
    fast[[0, 2]] = 2.5, 0.6
    with pytest.raises(UsageError, match=r"fl_shoulder/target would turn at .* past its limit 6.50"):
        space.require(fast)
    outside = good.copy()
    outside[0] = 9.0
    with pytest.raises(UsageError, match=r"frequency = 9 Hz lies outside \[0.5, 2.5\]"):
        space.require(outside)


@pytest.mark.parametrize(
    ("written", "many"),
    [("", 0), ("start = {}", 0), ("start = { frequency = 1.5 }", 1), ("[gait.start]\nfrequency = 1.5", 1)],
)
def test_one_gait_to_start_with_may_be_a_table(written: str, many: int, brief_folder, tmp_path) -> None:
    import re
    import shutil

    shutil.copytree(brief_folder, tmp_path / "one")
    path = tmp_path / "one" / "robot.toml"
    text = re.sub(r"\[\[gait\.start\]\][^\[]*", "", path.read_text(encoding="utf-8"))
    path.write_text(text.replace("[[gait.roles]]", f"{written}\n[[gait.roles]]", 1), encoding="utf-8")
    space = gait_space(load_robot(tmp_path / "one"))
    assert space.starts.shape == (many, 13)
    assert all(space.from_unit(s)[0] == pytest.approx(1.5) for s in space.starts)


def test_a_robot_without_legs_has_no_gait() -> None:
    with pytest.raises(RobotError, match="no walking task"):
        gait_space(load_robot("servo_pendulum"))


MOTION = '[[motions]]\nname = "wave"\njoints = ["fl_shoulder"]\n'


@pytest.mark.parametrize(("kind", "number"), [("torque", "gain"), ("speed", "rate_gain")])
def test_a_leg_that_is_told_no_angles_has_no_gait(kind: str, number: str, brief_folder, tmp_path) -> None:
    import shutil

    shutil.copytree(brief_folder, tmp_path / "own")
    path = tmp_path / "own" / "robot.toml"
    text = path.read_text(encoding="utf-8")
    drive = f'[[drives]]\njoint = "fl_elbow"\ntype = "{kind}"\n{number} = 1.0\n\n[[drives]]'
    path.write_text(text.replace("[[drives]]", drive, 1) + MOTION, encoding="utf-8")
    robot = load_robot(tmp_path / "own")
    with pytest.raises(RobotError, match=f"'fl_elbow' .* has a drive of type '{kind}', and a gait tells"):
        gait_space(robot)
    # a motion that leaves this joint alone may be made
    assert gait_space(robot, "wave").names[0] == "fl_shoulder_1"


BAD = {
    'elbow = "fl_elbow"': ('elbow = "fl_knee"', "no action drives joint 'fl_knee'"),
    'mirrored = ["hip"]': ('mirrored = ["wing"]', "mirrors"),
    "frequency = [0.5, 2.5]": ("frequency = [2.5, 0.5]", "low 2.5 is not below high 0.5"),
    "frequency = 2.3": ("frequency = 23.0", r"start: frequency = 23.0 lies outside \[0.5, 2.5\]"),
    "phase_rr = 0.0": ("phase_tail = 0.0", "start names 'phase_tail', not one of"),
    "frequency = 2.406": ("frequency = 0.0", "start: frequency = 0.0 lies outside"),  # of the second
    'shoulder = "fr_shoulder"': ('shoulder = "fl_shoulder"', "joint 'fl_shoulder' is in two places"),
    'name = "fr"': ('name = "elbow"', "two of the roles and legs have one name"),
    'name = "turn"': ('name = "forward"', "named twice"),
}


@pytest.mark.parametrize("old", BAD)
def test_a_wrong_gait_table_is_an_error_with_its_line(old: str, brief_folder, tmp_path) -> None:
    import shutil

    new, says = BAD[old]
    shutil.copytree(brief_folder, tmp_path / "bad")
    path = tmp_path / "bad" / "robot.toml"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(RobotError, match=says) as caught:
        load_robot(tmp_path / "bad")
    assert "line" in str(caught.value)


def test_draws_about_rest_are_small_and_keep_legs_in_or_against_phase(quadruped) -> None:
    space = gait_space(quadruped)
    unit = space.about_rest(400, stream(3, "rest"))
    assert unit.shape == (400, 13) and (unit >= 0).all() and (unit <= 1).all()
    genes = {name: space.from_unit(unit)[:, i] for i, name in enumerate(space.names)}
    rest = dict(zip(space.roles, (space.signs * space.pose[space.columns]).mean(axis=0), strict=True))
    for role in space.roles:
        low, high = space.bounds[space.names.index(f"offset_{role}")]
        assert abs(np.median(genes[f"offset_{role}"]) - rest[role]) < 0.05 * (high - low)
        largest = space.bounds[space.names.index(f"amplitude_{role}"), 1]
        assert genes[f"amplitude_{role}"].max() <= 0.36 * largest
    ordered = np.abs(np.sin(genes["phase_fr"])) < 0.6
    assert 0.7 < ordered.mean() < 0.9, "the others have any phase"
    assert 0.4 < (np.cos(genes["phase_fr"][ordered]) < 0).mean() < 0.6


def test_a_family_of_a_plugin_is_sought_as_the_packaged_ones(brief_folder, tmp_path, monkeypatch) -> None:
    import shutil
    from importlib.metadata import EntryPoint

    from dynreg import plugins
    from dynreg.gait import space

    class Bounce(Sines):
        kind = "bounce"

    shutil.copytree(brief_folder, tmp_path / "own")
    path = tmp_path / "own" / "robot.toml"
    text = path.read_text(encoding="utf-8")
    bare = "\n".join(
        line for line in text.splitlines() if not line.startswith(("amplitude = [", "offset = ["))
    )
    bare = bare.replace("frequency = [0.5, 2.5]", 'kind = "bounce"')
    path.write_text(bare, encoding="utf-8")
    robot = load_robot(tmp_path / "own")
    with pytest.raises(RobotError, match="unknown kind 'bounce'.*'sines'"):
        gait_space(robot)
    monkeypatch.setattr(Bounce, "of", classmethod(lambda cls, robot, table: ("of", robot.name, table.kind)))
    point = EntryPoint("bounce", "here:Bounce", "dynreg.gaits")
    monkeypatch.setattr(EntryPoint, "load", lambda self: Bounce)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [point] if group == "dynreg.gaits" else [])
    space.families.cache_clear()
    try:
        assert gait_space(robot) == ("of", "quadruped", "bounce")
        monkeypatch.setattr(EntryPoint, "load", lambda self: object)
        space.families.cache_clear()
        with pytest.raises(RobotError, match="derived from dynreg.gait.family.Family"):
            gait_space(robot)
    finally:
        space.families.cache_clear()
