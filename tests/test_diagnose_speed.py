"""The speed of diagnoses: logs and robots reach the timed process as they are, and tables say what differs."""

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.sim.robot import load_robot

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
NAMES = ("bench_diagnose_speed", "diagnosis_jobs", "timed_diagnosis")


@pytest.fixture
def modules(monkeypatch: pytest.MonkeyPatch) -> tuple[ModuleType, ...]:
    """The benchmark, its jobs and what it times."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    return tuple(import_module(name) for name in NAMES)


def test_a_log_is_read_back_to_the_bit(modules, tmp_path: Path) -> None:
    timed = modules[2]
    episodes = [
        Episode("a", np.array([0.1, 0.2, 0.7]), np.array([[1 / 3, np.nan]] * 3), {"kp": 0.1}),
        Episode("b", np.array([0.0, 1.0]), np.array([[-0.0, 1e-300]] * 2)),
    ]
    recording = Recording((Channel("arm/position", "rad"), Channel("arm/target", "rad")), tuple(episodes))
    timed.write_log(recording, tmp_path / "log.npz")
    back = timed.read_log(tmp_path / "log.npz")
    assert (back.id, back.measured) == (recording.id, recording.measured)


def test_a_robot_whose_parts_were_measured_is_read_back_from_its_folder(modules, tmp_path: Path) -> None:
    jobs = modules[1]
    robot = jobs.measured(load_robot("quadruped"))
    back = load_robot(jobs.write_robot(robot, tmp_path / "measured"))
    assert back.space == robot.space
    assert (back.file.channels, back.file.drives) == (robot.file.channels, robot.file.drives)


@pytest.mark.parametrize("width", [1, 3, 8])
def test_every_candidate_has_an_effect_and_every_effect_a_candidate(modules, width: int) -> None:
    terms = modules[2].shared([("backlash", [0.01]), ("payload", [0.1]), ("command_delay", [0.02])], width)
    has = np.array([np.isfinite(v).all(axis=1) for v in terms.values])
    assert has.shape == (3, width) and has.any(axis=0).all() and has.any(axis=1).all()


def test_a_rate_is_told_for_each_width_and_number_of_effects(modules, tmp_path: Path, monkeypatch) -> None:
    timed = modules[2]
    monkeypatch.setattr(timed, "LEAST", 0.001)
    np.savez(tmp_path / "commands.npz", actions=np.zeros((1, 5, 1)), period=0.01)
    job = {"robot": "servo_pendulum", "engine": "joint", "commands": tmp_path / "commands.npz"}
    told = timed.rates(job | {"widths": [1, 2], "effects": [[], [("backlash", [0.01])]]})
    assert [(row["width"], row["effects"]) for row in told] == [(1, 0), (1, 1), (2, 0), (2, 1)]
    assert all(row["rate"] > 0 for row in told)


def answer(process: float, *causes: str) -> dict:
    return {
        "case": "leg in the air",
        "hides": f"{process:g}",
        "process": process,
        "wall": 2 * process,
        "stages": {"calibrate": 0.1 * process, "causes": 0.5 * process},
        "verdict": "named" if causes else "none",
        "causes": list(causes),
    }


def test_a_table_has_the_ratio_the_aim_and_what_is_said_otherwise(modules, capsys) -> None:
    bench = modules[0]
    pairs = [
        {"before": answer(30.0, "backlash"), "now": answer(10.0, "backlash")},
        {"before": answer(20.0, "backlash"), "now": answer(12.0)},
        {"before": answer(44.0), "now": answer(11.0)},
    ]
    rows = bench.case_rows(pairs)
    row = rows["leg in the air"]
    assert row["now process"] == {"median": 11.0, "largest": 12.0}
    assert (row["faster"], row["differ"]) == (3.0, ["12"])
    bench.print_cases(rows)
    (line,) = (one for one in capsys.readouterr().out.splitlines() if "DIFFER" in one)
    assert "10 not met" in line and line.endswith("15.0 -> 5.5  DIFFER: 12")
    assert "THEY DIFFER" in bench.told(pairs[1]) and "DIFFER" not in bench.told(pairs[2])


def test_a_step_in_the_journal_is_not_run_again(modules, tmp_path: Path, monkeypatch) -> None:
    bench = modules[0]
    journal = bench.Journal(tmp_path / "journal.jsonl", {"now": "code"})
    journal.begin()
    job = {"robot": "leg", "widths": (1,), "round": 0}
    journal.add({"step": {"side": "now", "job": job}, "answers": [{"rate": 1.0}]})
    monkeypatch.setattr(bench.subprocess, "run", None)
    assert bench.done(job, tmp_path, "now", tmp_path, journal) == [{"rate": 1.0}]
