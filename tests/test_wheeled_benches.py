"""The benches of wheeled robots: their hidden robots, what drives plans, their figures and pictures."""

import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dynreg.rng import stream
from dynreg.sim.config import SimConfig
from dynreg.sim.real import Spent
from dynreg.sim.robot import load_robot
from dynreg.timed.commands import drawn
from dynreg.timed.goal import Trials
from dynreg.timed.navigation import Plan, driven
from dynreg.timed.told import told
from dynreg.timed.unicycle import LAUT, unicycle

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
SEED = 65  # of the development


@pytest.fixture
def robots(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    import wheeled_robots

    return wheeled_robots


@pytest.fixture
def navigation(robots: ModuleType) -> ModuleType:
    import bench_wheeled_navigation

    return bench_wheeled_navigation


@pytest.fixture
def drift(robots: ModuleType) -> ModuleType:
    import bench_wheeled_drift

    return bench_wheeled_drift


@pytest.fixture
def pictures(robots: ModuleType) -> ModuleType:
    import wheeled_pictures

    return wheeled_pictures


@pytest.fixture
def plans() -> Plan:
    return Plan.of(stream(7, "genes").uniform(size=(5, 40)))


def off(one, other) -> float:
    """Largest distance [m] of two paths' points."""
    apart = np.linalg.norm((one.points - other.points)[..., :2], axis=-1)
    assert np.array_equal(np.isnan(one.points), np.isnan(other.points))
    return float(np.nanmax(apart))


def test_four_robots_hide_four_effects_of_the_stated_sizes(robots: ModuleType) -> None:
    truths = [robots.hidden(SEED, n) for n in range(8)]
    for four in (truths[:4], truths[4:]):
        assert {t.cause for t in four} == {*robots.SIZES}
    for t in truths:
        assert {k: abs(v) for k, v in t.values.items()} == dict(robots.SIZES[t.cause])
        assert t.parameters["track"] != 0.0884 and abs(t.parameters["track"] - 0.0884) < 0.003
    assert len({t.seed for t in truths}) == 8 and robots.hidden(SEED, 3) == truths[3]
    gains = [robots.hidden(seed, n) for seed in range(6) for n in range(4)]
    assert {np.sign(t.values["difference"]) for t in gains if t.cause == "wheel_gain"} == {-1.0, 1.0}


def test_a_log_holds_the_commands_of_the_paper(robots: ModuleType) -> None:
    log = robots.log_of(robots.hidden(SEED, 0))
    found = told(load_robot("diffdrive"), log)
    assert abs(len(found.commands) - 1460) < 40
    assert sum(e.time[-1] - e.time[0] for e in log.episodes[-robots.HELD_OUT :]) > 230 * 1.05
    assert np.abs(found.commands.left).max() == pytest.approx(0.22, abs=0.002)


@pytest.mark.parametrize("number", range(4))
def test_the_compiled_equations_drive_as_the_truth_does(robots: ModuleType, plans: Plan, number: int) -> None:
    """In steps of 20 ms, beside 1 ms."""
    truth = robots.hidden(SEED, number)
    with_it = robots.Rolling(robots.rows_of(truth.parameters, {truth.cause: truth.values}))
    without = robots.Rolling(robots.rows_of(truth.parameters, {}))
    exact = driven(plans, robots.Exact(truth))
    assert off(driven(plans, with_it), exact) < 0.002
    assert off(driven(plans, without), exact) > 0.01
    noisy = driven(plans, robots.Exact(truth, noisy=True, salt=3))
    assert 0.001 < off(noisy, exact) < 0.03
    again = driven(plans, robots.Exact(truth, noisy=True, salt=3))
    assert np.array_equal(noisy.points, again.points, equal_nan=True)
    assert off(driven(plans, robots.Exact(truth, noisy=True, salt=4)), noisy) > 0.001


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"wheel_gain": {"difference": 0.1}},
        {"wheel_slip": {"grip": 1.0}, "command_deadband": {"width": 0.5}},
        {"drive_inertia": {"time": 0.05}},
    ],
)
def test_the_compiled_equations_drive_as_the_registrys_engine_does(
    robots: ModuleType, plans: Plan, effects: dict
) -> None:
    robot = load_robot("diffdrive")
    config = SimConfig.of(robot, robot.space.nominal, effects)
    engine = driven(plans, robots.Extended(robot, config))
    assert off(driven(plans, robots.Rolling(robots.rows_of(config.values, effects))), engine) < 0.002
    if effects:
        plain = robots.Rolling(robots.rows_of(config.values, {}))
        assert off(driven(plans, plain), engine) > 0.005


def test_an_effect_that_the_equations_lack_is_no_silent_nothing(robots: ModuleType) -> None:
    values = load_robot("diffdrive").space.as_dict(load_robot("diffdrive").space.nominal)
    with pytest.raises(KeyError):
        robots.rows_of(values, {"backlash": {"gap": 0.1}})


def test_least_squares_find_the_parameters_that_moved_a_robot(robots: ModuleType) -> None:
    commands = drawn(80, stream(5, "commands"), seconds=(0.1, 0.6))
    found = robots.fitted(commands, unicycle(commands, LAUT, 0.0884, step=0.02), 0.0884)
    assert found == pytest.approx(LAUT, abs=1e-3)


def row(kind: str, number: int, simulated: float, real: float, thought: int, blocks: int) -> dict:
    return {
        "kind": kind,
        "number": number,
        "hidden": "wheel_gain" if number % 2 else "wheel_slip",
        "simulated": simulated,
        "thought": thought,
        "real": real,
        "blocks": blocks,
        "share": 0.5,
        "often": 20.0,
        "after": [3000.0 + number],
        "ways": {"simulator": [[0, 0], [300, 100]], "robot": [[0, 0], [290, 120]]},
        "core": 2.0,
    }


def made(number: int) -> dict:
    errors = {
        k: {a: [1.0 + number, 0.0, 9.0, 0.5] for a in ("dx", "dy", "dtheta")}
        for k in ("kinematic", "dynamic", "network", "extended")
    }
    return {
        "robot": number,
        "core": 5.0,
        "hidden": ["x", {}],
        "verdict": "named",
        "named": [],
        "errors": errors,
    }


def test_the_table_counts_blocks_gaps_and_tests(navigation: ModuleType, capsys) -> None:
    rows = [made(0), made(1)]
    rows += [row("kinematic", n, 3900.0, 2900.0 - n, 4, 3) for n in range(4)]
    rows += [row("extended", 0, 2900.0, 2890.0, 3, 3)]
    rows += [row("extended", n, 3900.0, 3890.0, 4, 4) for n in range(1, 4)]
    found = navigation.show(rows)
    assert found["kinematic"]["missed"] == [0, 4, 0, 0, 0] and found["extended"]["missed"] == [3, 1, 0, 0, 0]
    assert found["kinematic"]["gap"][0] == pytest.approx(1001.5)
    assert found["kinematic"]["least and most"] == [1000.0, 1003.0]
    assert found["extended"]["four in the simulator"] == found["extended"]["kept of those"] == 3
    assert found["kinematic"]["kept of those"] == 0
    assert found["extended"]["by effect"] == {"wheel_gain": [2, 2], "wheel_slip": [1, 2]}
    assert found["fisher"]["kinematic and extended"] == pytest.approx(8 / 56)  # 3 of 4 against 0 of 4
    assert found["robots"]["errors"]["dynamic"] == [[1.5, 0.5]] * 3 and found["robots"]["core"] == 10.0
    assert "published (745.81, 21.33, 2271.56)" in capsys.readouterr().out


def test_a_way_begins_in_the_middle_and_ends_where_the_path_does(navigation: ModuleType, plans: Plan) -> None:
    path = driven(plans, navigation.Exact(navigation.hidden(SEED, 1)))
    way = navigation._way(path)
    assert way[0] == [0, 0] and way[-1] == np.round(1e3 * path.end[0, :2]).astype(int).tolist()
    assert navigation._reached(((3, 1.0), (210, 5.0), (900, 7.0)), 800) == 5.0


@pytest.mark.parametrize("kind", ["static", "changing"])
def test_robots_of_the_drift_bench(drift: ModuleType, kind: str) -> None:
    plan = drift.Plan(SEED, 4, 2000, "bits", kind)
    losses = []
    for number in range(4):
        robot, table = drift.robot_of(plan, number)
        off = np.linalg.norm((table.moments()[1] - robot.truth(np.arange(400)))[:, :2], axis=1).mean()
        sides = robot.worn if kind == "static" else robot.drifts[0]
        assert sorted((sides.left, sides.right))[1] == 1.0 and 0.6 <= min(sides.left, sides.right) <= 0.8
        losses.append(min(sides.left, sides.right))
        if kind == "static":
            assert not robot.drifts and robot.spent == Spent() and off > 0.003
        else:
            assert robot.drifts[0].generation == 800 and robot.spent == Spent(400, 2000.0) and off < 0.001
    assert len(set(losses)) == 4


def test_a_gap_is_a_distance_at_the_same_step_by_heading(drift: ModuleType) -> None:
    here = Trials(np.zeros((2, 4)), np.zeros((2, 4)), np.zeros((2, 4, 41, 3)))
    ways = here.ways.copy()
    ways[:, :2, :, 0], ways[:, 2:, :, 1] = 0.03, -0.05
    ways[..., 2] = 7.0  # headings do not count
    assert drift._gap(here, replace(here, ways=ways)) == pytest.approx([0.03, 0.05])
    assert drift._ways(replace(here, ways=ways))[1][0] == [0, -50]


def evolved(number: int, update: bool, share: float) -> dict:
    reached = [n < 10 * share for n in range(10)]
    return {
        "number": number,
        "update": update,
        "up": reached,
        "right": [True] * 10,
        "in the table": [1.0, 1.0, 0.5, 0.5],
        "gap": [0.02, 0.04],
        "ways": {"table": [[[400, 400], [500, 900]]] * 2, "robot": [[[400, 400], [600, 800]]] * 2},
        "history": [0.1, 0.6],
        "leaders": [0.0, 1.0],
        "error": [0.006, 0.004],
        "visited": 3,
        "apart": [0.006, 0.002] if update else None,
        "tests": [[1, 10]],
        "steps": 100,
        "core": 3.0,
    }


def test_the_drift_table_and_both_pictures(
    drift: ModuleType, navigation: ModuleType, pictures: ModuleType, tmp_path: Path, capsys
) -> None:
    rows = [evolved(n, True, 1.0 - 0.8 * n) for n in range(2)] + [evolved(0, False, 0.0)]
    found = drift.show(rows, {"student": {"share": 0.05, "tests": 100, "robots with any": 1.0}})
    own = found["with update"]
    assert own["up"][0] == pytest.approx(0.6) and own["right"][0] == 1.0
    assert own["success"][0] == pytest.approx(0.8) and own["good"] == 1 and own["by evolution"] == [1.0, 0.6]
    assert own["gap, up and right [mm]"][1] == pytest.approx([40.0] * 3)
    assert own["in the table, up and right"] == [1.0, 0.5] and found["without"]["success"][0] == 0.5
    out = capsys.readouterr().out
    assert "(published (40, 100, 70))" in out and "(published (10, 0, 5))" in out
    (tmp_path / "wheeled_static_operon.json").write_text(json.dumps(found))
    table = navigation.show(
        [made(0), row("kinematic", 0, 1.0, 2.0, 4, 3), row("extended", 0, 1.0, 1.0, 4, 4)]
    )
    (tmp_path / "wheeled_navigation.json").write_text(json.dumps(table))
    pictures.main(["--results", str(tmp_path), "--out", str(tmp_path / "docs")])
    for name in ("navigation.png", "displacements.png"):
        drawn_ = (tmp_path / "docs" / name).read_bytes()
        assert drawn_.startswith(b"\x89PNG") and len(drawn_) < 150_000


def test_the_picture_of_plans_has_a_panel_for_each_simulator(
    navigation: ModuleType, pictures: ModuleType
) -> None:
    figure = pictures.navigation(
        navigation.show([made(0), row("kinematic", 0, 1.0, 2.0, 4, 3), row("extended", 0, 1.0, 1.0, 4, 4)])
    )
    assert [axes.get_title() for axes in figure.axes] == ["closed form", "extended simulator"]
    for axes in figure.axes:
        real, real_end, simulated, _ = axes.lines
        assert (real.get_label(), simulated.get_label()) == ("on the robot", "in the simulator")
        assert real.get_xydata() == pytest.approx(np.array([[0.0, 0.0], [0.29, 0.12]]))
        assert simulated.get_xydata() == pytest.approx(np.array([[0.0, 0.0], [0.3, 0.1]]))
        assert real_end.get_xydata() == pytest.approx(np.array([[0.29, 0.12]]))
        assert len(axes.patches) == 5  # four blocks and the area
    assert [text.get_text() for text in figure.legends[0].texts] == ["on the robot", "in the simulator"]
    pictures.plt.close(figure)


def test_the_picture_of_tables_has_ways_and_what_evolves(drift: ModuleType, pictures: ModuleType) -> None:
    rows = [evolved(0, True, 1.0), evolved(0, False, 0.0)]
    figure = pictures.displacements(drift.show(rows, {}))
    *ways, fitness, success = figure.axes
    assert [axes.get_title() for axes in ways] == ["with the table's update", "without"]
    for axes in ways:
        real, _, simulated, *_ = axes.lines
        assert len(axes.lines) == 8  # two ways, twice, and the end of each
        assert real.get_xydata() == pytest.approx(np.array([[0.4, 0.4], [0.6, 0.8]]))
        assert simulated.get_xydata() == pytest.approx(np.array([[0.4, 0.4], [0.5, 0.9]]))
    assert fitness.get_title() == "best fitness in the table" and success.get_title().startswith("share of")
    for axes, values in ((fitness, [0.1, 0.6]), (success, [0.0, 1.0])):
        assert [line.get_label() for line in axes.lines] == ["with the table's update", "without"]
        for line in axes.lines:
            assert [*line.get_xdata()] == [50, 100] and [*line.get_ydata()] == values
    pictures.plt.close(figure)


def test_no_generations_get_below_the_minimum(robots: ModuleType, capsys) -> None:
    import bench_wheeled_ga as ga

    commands, moved = ga.log_of(SEED, "Laut")
    part = commands.take(slice(0, 60))
    clean = unicycle(part, LAUT, 0.0884, step=0.02)
    assert ga.cost(part, clean, LAUT) == 0.0
    scaled = clean + 0.1 * clean.std(axis=0)
    assert ga.cost(part, scaled, LAUT) == pytest.approx(0.03)
    assert ga.errors(
        part, unicycle(part, LAUT, 0.0884) + [0.01, 0.02, np.radians(3.0)], LAUT
    ) == pytest.approx([1.0, 2.0, 3.0])
    found = ga.bred("Laut", SEED, (3, 8))
    assert list(found) == ["least squares", "3 generations", "8 generations"]
    least, few, more = (found[name]["cost"] for name in found)
    assert least < more < few and len(found["3 generations"]["errors"]) == 3
    ga.show("Laut", found)
    assert "least squares" in capsys.readouterr().out
