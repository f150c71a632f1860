"""What a log leaves open, as a file for training: draws of it replay the log, and are the engine's own simulators."""

import sys
import tomllib
from importlib import import_module
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest

from dynreg.replay.data import data
from dynreg.replay.windows import Replayer, errors
from dynreg.rng import stream
from dynreg.session import Session
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import Arena
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

EXAMPLES = Path(__file__).parents[2] / "examples"
EXACT = 1e-9
DIGITS = 1e-5  # of numbers in an MJCF file
MANY = 20_000


def written(opened: Session, ref: str, path: Path) -> dict:
    opened.export_ranges(ref, path)
    return tomllib.loads(path.read_text(encoding="utf-8"))


def columns(drawn: list[dict[str, float]], ranges: dict) -> np.ndarray:
    """(N, D) of draws, in the order of the file."""
    return np.array([[one[q["name"]] for q in ranges["free"]] for one in drawn])


def within(ranges: dict) -> bool:
    """Whether no range cuts the posterior off."""
    return all(3 * q["deviation"] < q["centre"] < 1 - 3 * q["deviation"] for q in ranges["free"])


def test_draws_have_the_intervals_of_the_result(servos, asked, example, tmp_path: Path) -> None:
    """To 3 % of their width where no range cuts the posterior off; elsewhere they are no wider."""
    space, exact = load_robot("servo_pendulum").space, 0
    for number, one in enumerate(asked):
        ranges = written(servos, f"secret {number}", tmp_path / f"{number}.toml")
        rows = columns(example.draw(ranges, MANY, stream(0, "ranges", number)), ranges)
        found = np.quantile(space.to_unit(rows), (0.05, 0.95), axis=0)
        estimates = one.answer.synthesised.parameters.values()
        told = space.to_unit(np.array([(e.low, e.high) for e in estimates]).T)
        slack = 0.03 * (told[1] - told[0])
        assert (found[0] > told[0] - slack).all() and (found[1] < told[1] + slack).all()
        if within(ranges):
            assert (np.abs(found - told) < slack).all()
            exact += 1
    assert exact


def test_what_is_clipped_takes_along_what_makes_up_for_it(example) -> None:
    """Of two quantities only their sum is known: it stays as it is where one of them meets the end of its range."""
    one = {"scale": "linear", "limits": [0.0, 1.0], "draw": "normal"}
    free = [
        one | {"name": "a", "centre": 0.8, "deviation": 0.3},
        one | {"name": "b", "centre": 0.4, "deviation": 0.15},
    ]
    told = {"free": free, "correlations": [[1.0, -1.0], [-1.0, 1.0]]}
    a, b = columns(example.draw(told, 500, stream(0, "clipped")), told).T
    assert 50 < (a == 1.0).sum() < 200
    np.testing.assert_allclose(0.5 * a + b, 0.8, atol=1e-6)


def test_draws_with_their_correlations_replay_the_log_better_than_the_box(
    servos, asked, example, tmp_path: Path
) -> None:
    """Mass trades against gain: drawn apart, most simulators move otherwise than the robot, by 8 to 100 times more."""
    robot = load_robot("servo_pendulum")
    for number, one in enumerate(asked[:4]):
        ranges = written(servos, f"secret {number}", tmp_path / f"{number}.toml")
        cut, rng = data(robot, one.recording), stream(0, "box", number)
        replayer = Replayer(robot, cut.windows, 1)
        box = rng.uniform(*np.array([q["interval"] for q in ranges["free"]]).T, (30, len(ranges["free"])))
        drawn = columns(example.draw(ranges, 30, rng), ranges)
        apart, together = (
            errors(replayer.residuals(v, np.arange(len(cut.windows)))).mean() for v in (box, drawn)
        )
        assert together < 0.2 * apart


def test_the_example_makes_the_simulators_of_the_engine(
    servos, asked, example, tmp_path: Path, capsys
) -> None:
    robot = load_robot("servo_pendulum")
    ranges = written(servos, "secret 0", tmp_path / "ranges.toml")
    folder = servos.export_robot(ranges["simulator"], tmp_path / "robot")
    assert Path(folder.mjcf).name == ranges["model"]["file"]
    example.main([str(tmp_path / "ranges.toml"), folder.mjcf, "-n", "3"])
    assert capsys.readouterr().out.count("after 1 s qpos") == 3
    plain, drawn = mujoco.MjModel.from_xml_path(folder.mjcf), example.draw(ranges, 5, stream(0, "example"))
    values = np.array([robot.space.from_dict(one) for one in drawn])
    same(example, plain, ranges, drawn, Arena(robot, values, Run(np.zeros((1, 1, 1)))))
    assert plain.opt.timestep == pytest.approx(ranges["model"]["timestep"])


def test_sizes_of_effects_are_drawn_and_are_those_of_the_engine(diagnosed, example, tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    ranges = written(diagnosed, "payload", tmp_path / "ranges.toml")
    assert [(e["key"], e["carried_by"]) for e in ranges["effect"]] == [("payload", "fields")]
    assert ranges["free"][-1]["name"] == "payload.mass" and ranges["verdict"] == "named"
    folder = diagnosed.export_robot(ranges["simulator"], tmp_path / "robot")
    drawn = example.draw(ranges, 4, stream(0, "example"))
    masses = np.array([[one.pop("payload.mass")] for one in drawn])
    values = np.array([robot.space.from_dict(one) for one in drawn])
    arena = Arena(robot, values, Run(np.zeros((1, 1, 1))), terms=Terms((term("payload"),), (masses,)))
    for one, mass in zip(drawn, masses[:, 0], strict=True):
        one["payload.mass"] = float(mass)
    same(example, mujoco.MjModel.from_xml_path(folder.mjcf), ranges, drawn, arena)


def same(example: ModuleType, plain: mujoco.MjModel, ranges: dict, drawn: list[dict], arena: Arena) -> None:
    """Whether fields with draws in them are those of the engine, and differ from draw to draw."""
    for target in {one["target"] for one in ranges["assignment"]}:
        made = [np.array(getattr(example.apply(plain, ranges, one), target)) for one in drawn]
        for number, ours in enumerate(made):
            theirs = np.array(getattr(arena.model(number), target))
            touched = [a for a in ranges["assignment"] if a["target"] == target]
            at = tuple(np.array([i for a in touched for i in a["indices"]]).T)
            np.testing.assert_allclose(ours[at], theirs[at], rtol=EXACT, err_msg=target)
            np.testing.assert_allclose(ours, theirs, atol=DIGITS, rtol=DIGITS, err_msg=target)
        assert not np.array_equal(made[0], made[1])


def test_an_effect_that_no_model_can_say_is_told(diagnosed, tmp_path: Path) -> None:
    told = diagnosed.export_ranges("load_friction", tmp_path / "ranges.toml")
    ranges = tomllib.loads((tmp_path / "ranges.toml").read_text(encoding="utf-8"))
    assert [(e.effect, e.carried_by) for e in told.effects] == [("load_friction", "engine")]
    assert set(told.left_out) == {"load_friction.coefficient"}
    (size,) = (q for q in ranges["free"] if q["name"] == "load_friction.coefficient")
    low, high = size["interval"]
    assert (
        0 < low < size["value"] < high and "moves" in size["left_out"] and size["effect"] == "load_friction"
    )
    assert size["unit"] == "1"


def test_the_posterior_of_a_diagnosis_has_its_intervals(diagnosed, example, tmp_path: Path) -> None:
    ranges = written(diagnosed, "payload", tmp_path / "ranges.toml")
    found = diagnosed.result("payload")
    rows = columns(example.draw(ranges, MANY, stream(0, "diagnosis")), ranges)
    told = {**found.parameters, "payload.mass": found.causes[0].parameters["mass"]}
    for q, (low, high) in zip(ranges["free"], np.quantile(rows, (0.05, 0.95), axis=0).T, strict=True):
        e = told[q["name"]]
        slack = 0.04 * (
            e.high - e.low
        )  # of chance, and as an interval is one of its value, not of its logarithm
        assert abs(low - e.low) < slack and abs(high - e.high) < slack, q["name"]


def test_the_example_for_playground_draws_the_same(servos, asked, tmp_path: Path) -> None:
    """In JAX, where that is installed: fields of 200 draws are those that MuJoCo's example makes of them."""
    pytest.importorskip("jax", reason="no jax: the example for MuJoCo Playground is not run")
    pytest.importorskip("mujoco.mjx", reason="no mujoco-mjx: the example for MuJoCo Playground is not run")
    import jax
    from mujoco import mjx

    sys.path.insert(0, str(EXAMPLES))
    try:
        ours, theirs = import_module("randomise_mjmodel"), import_module("randomise_playground")
    finally:
        sys.path.remove(str(EXAMPLES))
    ranges = written(servos, "secret 0", tmp_path / "ranges.toml")
    plain = mujoco.MjModel.from_xml_path(servos.export_robot(ranges["simulator"], tmp_path / "robot").mjcf)
    keys = jax.random.split(jax.random.PRNGKey(0), 200)
    model, in_axes = theirs.domain_randomize(mjx.put_model(plain), keys, ranges)
    drawn = jax.vmap(lambda key: theirs.draw(ranges, key))(keys)
    one = ours.apply(plain, ranges, {name: float(value[7]) for name, value in drawn.items()})
    for target in {a["target"] for a in ranges["assignment"]}:
        np.testing.assert_allclose(getattr(model, target)[7], getattr(one, target), rtol=1e-5, atol=1e-6)
        assert getattr(in_axes, target) == 0
    assert theirs.main(
        [str(tmp_path / "ranges.toml"), str(tmp_path / "robot" / "mujoco.xml"), "-n", "4"]
    ).shape == (4, 1)
