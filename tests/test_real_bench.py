"""The table of real robots: what it takes from a journal, which errors it averages, what it holds against the truth."""

from importlib import import_module
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from dynreg.results.diagnosis import RolloutError

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return import_module("bench_diagnose_real")


def error(channel: str, calibrated: float, held: float | None = None) -> RolloutError:
    return RolloutError(
        channel=channel, unit="rad", nominal=1.0, calibrated=calibrated, extended=0.5, held=held
    )


def test_the_last_line_of_a_step_counts_and_half_a_bench_is_no_row(bench: ModuleType) -> None:
    lines = [
        {"bench": "emps", "step": "diagnosis", "document": {"long": 1}, "simulators": {}},
        {"bench": "emps", "step": "known", "verdict": "unknown", "errors": {}},
        {"bench": "tx40", "step": "diagnosis", "document": {}, "simulators": {}},
        {"bench": "emps", "step": "known", "verdict": "named", "errors": {}},
        {"bench": "emps", "step": "cmaes", "cmaes": {"held_out": 0.1}},
    ]
    assert bench.merged(lines) == {"emps": {"verdict": "named", "errors": {}, "cmaes": {"held_out": 0.1}}}


def test_errors_are_means_over_positions_and_none_where_one_is_not_told(bench: ModuleType) -> None:
    errors = [error("a/position", 0.2, 3.0), error("b/position", 0.4), error("a/velocity", 100.0, 1.0)]
    told = bench.errors_told(errors)
    assert told["calibrated"] == pytest.approx(0.3) and told["nominal"] == 1.0
    assert told["held"] is None and told["unpenalised"] is None


@pytest.mark.parametrize(("off", "holds"), [(0.14, True), (0.16, False)])
def test_a_friction_that_parameters_and_causes_share_is_held_against_the_known_one(
    bench: ModuleType, off: float, holds: bool
) -> None:
    values = {f"joint_{j}_friction": 0.5 * bench.COULOMB[j - 1] for j in range(1, 5)}
    values |= {f"joint_{j}_damping": bench.VISCOUS[j - 1] for j in range(1, 5)}
    causes = {f"coulomb_friction[joint_{j}]": 0.5 * bench.COULOMB[j - 1] for j in range(1, 5)}
    causes["coulomb_friction[joint_2]"] += off * bench.COULOMB[1]
    seen = SimpleNamespace(
        best=SimpleNamespace(values=values),
        size=lambda key, _parameter: causes.get(key, 0.0),
        keys=("cable_coupling[joint_4,joint_5]",),
    )
    friction, damping, wrist = bench.known_tx40(seen)
    assert (friction.holds, damping.holds, wrist.holds) == (holds, True, False)
    seen.keys = ("inertia[joint_1]", "cable_coupling[joint_5,joint_6]")
    assert bench.known_tx40(seen)[2].holds


def test_a_simulator_that_breaks_down_errs_by_more_than_any_that_does_not(bench: ModuleType) -> None:
    peers = import_module("servo_peers")
    measured = np.zeros((2, 4, 2))
    windows = SimpleNamespace(measured=measured, spread=np.ones(2))
    data, robot = (
        SimpleNamespace(use=np.array([0, 1]), windows=windows),
        SimpleNamespace(channels=("a/position", "a/velocity")),
    )
    states = np.full((2, 2, 4, 2), 0.1)
    states[0, :, :, 1] = 50.0  # velocities do not count
    states[1, 1, 2:] = np.nan
    whole, broken = peers.missed(robot, data, states, np.arange(2))
    assert whole == pytest.approx(0.1)
    assert broken == pytest.approx((4 * 0.1 + 2 * peers.LOST) / 6)
