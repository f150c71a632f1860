"""Slow drives and short ramps: every gait of a search keeps the limits, or the robot is refused before one begins."""

import re
from pathlib import Path

import numpy as np
import pytest
import toy_dog

from dynreg.errors import RobotError
from dynreg.gait.family import Family
from dynreg.gait.space import gait_space
from dynreg.rng import stream
from dynreg.sim.robot import load_robot, packaged_robots

FINE = np.linspace(0.0, 2.0, 2001)


def sines(folder: Path, *changes: tuple[str, str]) -> Family:
    """The quadruped's gaits, with some lines of its table changed and without gaits to start from."""
    own = packaged_robots()["quadruped"]
    (folder / "model.xml").write_bytes((own / "model.xml").read_bytes())
    text = re.sub(r"\[\[gait\.start\]\][^\[]*", "", (own / "robot.toml").read_text(encoding="utf-8"))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "robot.toml").write_text(text, encoding="utf-8")
    return gait_space(load_robot(folder))


def locus(folder: Path, limit: float, more: str = "") -> Family:
    """The toy dog's gaits, with drives of `limit` [rad/s]."""
    gait = toy_dog.walking().replace('kind = "locus"\n', f'kind = "locus"\n{more}\n')
    made = toy_dog.folder(folder / "dog", gait)
    text = (made / "robot.toml").read_text(encoding="utf-8")
    changed = text.replace("speed_limit = 12.0", f"speed_limit = {limit}")
    (made / "robot.toml").write_text(changed, encoding="utf-8")
    return gait_space(load_robot(made))


def require_feasible(space: Family, count: int) -> None:
    genes = space.feasible(space.from_unit(stream(0, "gaits").uniform(size=(count, len(space)))))
    assert [space.problems(one) for one in genes] == [()] * count
    told = space.targets(genes, FINE)
    assert (np.abs(np.diff(told, axis=1)) / FINE[1] <= space.speed + 1e-6).all()
    assert np.allclose(space.feasible(genes), genes)


RAMP = ("ramp = 1.0", "ramp = 0.1")
LEAST = ("amplitude = [0.0", "amplitude = [0.1")


@pytest.mark.parametrize("changes", [[RAMP], [], [LEAST], [LEAST, RAMP]])
def test_sines_pull_offsets_to_rest_until_the_fade_is_slow_enough(changes: list, tmp_path) -> None:
    limit = 3.0 if RAMP in changes else 0.5
    require_feasible(sines(tmp_path, ("speed_limit = 6.5", f"speed_limit = {limit}"), *changes), 200)


def test_an_amplitude_is_not_made_smaller_than_its_gene_allows(tmp_path) -> None:
    space = sines(tmp_path, LEAST, ("speed_limit = 6.5", "speed_limit = 1.0"))
    genes = space.feasible(space.bounds[None, :, 1])  # the fastest and widest
    assert (genes[0, space.amplitudes] >= space.bounds[space.amplitudes, 0]).all()
    assert genes[0, 0] < space.bounds[0, 1]  # slower instead


@pytest.mark.parametrize("limit", [2.0, 0.5])
def test_a_locus_goes_toward_the_smallest_gait_until_no_joint_is_too_fast(limit: float, tmp_path) -> None:
    require_feasible(locus(tmp_path, limit), 60)


def test_the_smallest_locus_is_not_stepped_too_often(tmp_path) -> None:
    require_feasible(locus(tmp_path, 4.0, "ranges = { length = [0.002, 0.08] }"), 20)


def test_a_robot_that_can_run_no_gait_is_refused_before_a_search(tmp_path) -> None:
    with pytest.raises(RobotError, match="no gait of robot 'dog' keeps its limits: .* past its limit 0.20"):
        locus(tmp_path, 0.2)
    with pytest.raises(
        RobotError, match="no gait of robot 'quadruped' keeps its limits: in the smallest, fl_hip"
    ):
        sines(tmp_path, LEAST, ("speed_limit = 6.5", "speed_limit = 0.3"))
