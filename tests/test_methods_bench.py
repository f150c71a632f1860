"""The table of all methods: what it prints of lines, and which tables are kept."""

import argparse
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from tiny_registry import QUICK

import dynreg

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def bench_methods(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    import bench_methods

    return bench_methods


def line(method: str, number: int, share: float, told: str | None = None) -> dict:
    key = {"robot": "servo_pendulum", "hidden": "outside", "number": number, "seconds": 50.0}
    return {**key, "method": method, "share": share, "told": told, "rollouts": 600, "core seconds": 1.0}


def test_each_method_is_held_against_the_best_one_in_pairs(bench_methods: ModuleType, capsys) -> None:
    rng = np.random.default_rng(3)
    hard = rng.uniform(0.5, 2.0, 12)  # robots differ more than methods do
    lines = [line("diagnose", i, 0.1 * h, "right" if i else "wrong") for i, h in enumerate(hard)]
    lines += [line("cma", i, 0.12 * h) for i, h in enumerate(hard)]
    lines += [line("es", i, (0.104 + 0.01 * (-1) ** i) * h) for i, h in enumerate(hard)]
    lines += [line(bench_methods.TRUE, i, 0.01) for i in range(12)]
    bench_methods.show(lines)
    head, *rows = capsys.readouterr().out.splitlines()
    assert "12 robots; best is diagnose" in head, "the robot itself is no method"
    told = {row.split()[0]: row for row in rows}
    assert "11 right, 1 wrong" in told["diagnose"] and " p " not in told["diagnose"]
    assert "p 0.001" in told["cma"] and "not sure" in told["es"]


def test_of_some_searches_the_middle_one_by_its_speed_on_the_robot_counts(
    bench_methods: ModuleType, monkeypatch, capsys
) -> None:
    """Five searches find gaits of as many genes; each is tried three times, and one of them falls once."""
    import methods_walk

    from dynreg.evidence.truth import Hidden
    from dynreg.sim.config import SimConfig

    robot = bench_methods.described("quadruped")
    nominal = robot.space.nominal
    walks = methods_walk.Walks(robot, Hidden((), (), nominal, 5, None), 1)
    asked, scores = [], iter([3.0, 3.0, None, 9.0, 9.0, 9.0, 1.0, 1.0, 1.0, 7.0, 7.0, 7.0, 5.0, 5.0, 5.0])

    def seek(trials, settings):
        asked.append((settings.seed, settings.packaged))
        value = argparse.Namespace(value=10.0 * len(asked) * walks.task.seconds)
        return argparse.Namespace(genes=trials.space.bounds.mean(axis=1), found=value)

    monkeypatch.setattr(methods_walk, "seek", seek)
    monkeypatch.setattr(methods_walk, "rank_correlation", lambda sim, real: np.array([0.5]))
    monkeypatch.setattr(methods_walk.Walks, "ranked", np.zeros(methods_walk.FIXED))
    monkeypatch.setattr(
        methods_walk.Walks,
        "_score",
        lambda own, real, row, name: (x := next(scores)) and x * own.task.seconds,
    )
    found = walks.figures(SimConfig.of(robot, nominal), 5)
    assert found == {"speed": 5.0, "simulated": 50.0, "falls": 1, "trials": 15, "rank": 0.5}
    assert asked == [(5 + number, False) for number in range(5)]
    bench_methods.show(
        [line(bench_methods.TRUE, 0, 0.1) | {"walk": found}, line("cma", 0, 0.2) | {"walk": found}]
    )
    assert (
        "cma              walks  500.0 cm/s  1.00 of the oracle's, 1 of 15 trials fell"
        in capsys.readouterr().out
    )


def test_robots_outside_hide_each_another_cause_and_those_inside_none(bench_methods: ModuleType) -> None:
    given = argparse.Namespace(robots=6, seconds=[10.0])
    for robot in ("servo_pendulum", "quadruped"):
        drawn = [*bench_methods.secrets(robot, given, 5)]
        assert [s.cause for s in drawn[:6]] == [None] * 6 and len({s.cause for s in drawn[6:]}) == 6
        assert len({s.seed for s in drawn}) == 12


def test_a_name_is_right_where_no_command_tells_it_from_the_hidden_cause(bench_methods: ModuleType) -> None:
    secret = bench_methods.Secret("servo_pendulum", "outside", 0, 12.5, "torque_limit", 5)
    hidden, log = secret.log()
    robot = bench_methods.described("servo_pendulum")
    assert bench_methods.named(robot, hidden, ["duty_limit"]) == "right", "no command tells the two apart"
    assert bench_methods.named(robot, hidden, ["backlash"]) == "wrong"
    assert bench_methods.named(robot, hidden, []) == "none"
    assert bench_methods.named(robot, hidden, None) is None
    assert {e.name.split("_")[0] for e in log.episodes} == {"fit", "select", "test"}


def test_a_small_run_keeps_no_table(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys) -> None:
    monkeypatch.syspath_prepend(BENCHMARKS)
    from kept import keep

    parser = argparse.ArgumentParser()
    parser.add_argument("--robots", type=int, default=12)
    parser.add_argument("--threads", type=int, default=0)
    path = tmp_path / "results" / "table.json"
    assert not keep(path, {"a": 1}, parser, parser.parse_args(["--robots", "1"])) and not path.exists()
    assert "table.json stays as it is: robots" in capsys.readouterr().out
    assert (
        keep(path, {"a": 1}, parser, parser.parse_args(["--threads", "1"])) and '"a": 1' in path.read_text()
    )


@pytest.fixture(scope="module")
def small_table(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], dict]:
    """{(hidden, method): line} of two servos, one of which hides a friction that grows with the load."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(BENCHMARKS)
        import bench_methods
    asked = ["nearest", "synthesis", "diagnose"]
    given = argparse.Namespace(methods=asked, threads=1, quick=True)
    hidden = (("in the family", None, 11), ("outside", "load_friction", 12))
    with dynreg.open(tmp_path_factory.mktemp("small") / "registry") as session:
        session.populate("servo_pendulum", 24, seed=3, threads=1, training=QUICK)
        lines = [
            line
            for kind, cause, seed in hidden
            for line in bench_methods.answers(
                session, bench_methods.Secret("servo_pendulum", kind, 0, 25.0, cause, seed), given, set()
            )
        ]
    return {(line["hidden"], line["method"]): line for line in lines}


def test_only_a_diagnosis_comes_near_a_servo_outside_of_the_family(small_table: dict) -> None:
    share = {key: line["share"] for key, line in small_table.items()}
    outside = {m: share["outside", m] for m in ("nearest", "synthesis", "diagnose")}
    assert outside["diagnose"] < 0.5 and outside["diagnose"] < 0.5 * min(
        outside["nearest"], outside["synthesis"]
    )
    inside = {m: share["in the family", m] for m in outside}
    assert max(inside["diagnose"], inside["synthesis"]) < 0.5, "the model has all that this robot has"
    assert inside["nearest"] > inside["synthesis"], "a registered simulator as it is does not fit"


def test_only_a_diagnosis_names_the_cause_and_none_where_there_is_none(small_table: dict) -> None:
    told = {key: line["told"] for key, line in small_table.items()}
    assert told["outside", "diagnose"] == "right" and told["in the family", "diagnose"] == "none"
    assert {told[kind, m] for kind, m in told if m != "diagnose"} == {None}


def test_fewer_episodes_shape_an_answer_and_the_same_are_held_out(bench_methods: ModuleType) -> None:
    whole = bench_methods.Secret("servo_pendulum", "in the family", 0, 50.0, None, 5)
    episodes = [e.name for e in whole.log()[1].episodes]
    tests = [name for name in episodes if name.startswith("test")]
    for many in (1, 3):
        some = [e.name for e in replace(whole, episodes=many).log()[1].episodes]
        assert some[-len(tests) :] == tests and len(some) == many + len(tests)
    assert some[:3] == ["fit_0", "fit_1", "select_0"]
    assert replace(whole, episodes=1).key != whole.key and "episodes" not in whole.key


def test_the_figure_has_a_point_for_what_a_robot_had_to_move(
    bench_methods: ModuleType, tmp_path: Path
) -> None:
    import methods_pictures

    asked = [(1, 0.5), (1, 0.7), (10, 0.2)]
    lines = [line("cma", i, share) | {"episodes": many} for i, (many, share) in enumerate(asked)]
    seconds, share = methods_pictures.medians(lines, "cma")
    assert seconds.tolist() == [2.5, 25.0] and share == pytest.approx([0.6, 0.2])
    feet = line("btr", 0, 0.8) | {"robot": "quadruped", "real seconds": 1900.0}
    assert methods_pictures.seconds(feet) == 1900.0
    problem = {k: v for k, v in lines[0].items() if k != "share"} | {"problem": "too few"}
    assert len(methods_pictures.medians([problem], "cma")[0]) == 0
    assert methods_pictures.draw([*lines, feet], tmp_path).read_bytes().startswith(b"\x89PNG")
