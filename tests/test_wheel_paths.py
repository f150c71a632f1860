"""The picture of a diagnosed wheeled robot: paths of held-out rollouts, from where the robot stood."""

import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from driven_robot import commands, config, logged

import dynreg
from dynreg.errors import NoMatchError
from dynreg.session import Session
from dynreg.sim.robot import load_robot

EXAMPLES = Path(__file__).parents[1] / "examples"
LONG = 3.0  # s of a rollout
SLOW_IN_TURNS = {"turn_slowdown": {"arm": 0.05}}


@pytest.fixture(scope="module")
def paths_of() -> Iterator[ModuleType]:
    """The script as a module."""
    sys.path.insert(0, str(EXAMPLES))
    yield import_module("wheel_paths")
    sys.path.remove(str(EXAMPLES))


@pytest.fixture(scope="module")
def registry(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """A diagnosed Create that loses speed in turns and does not start in the origin."""
    create = load_robot("create")
    told = [commands(create, 24, seed) for seed in range(5)]
    log = logged(create, config(create, effects=SLOW_IN_TURNS), told, noise=1.0)
    with dynreg.open(tmp_path_factory.mktemp("paths") / "registry") as session:
        session.ingest(log, "create", name="yard")
        for hold_out in ("0", "run_3,run_4"):
            session.diagnose(
                "yard",
                hold_out=hold_out,
                effects=["turn_slowdown"],
                threshold_runs=0,
                threads=1,
                horizon=LONG,
            )
        yield session


def test_the_true_cause_follows_the_robot_and_the_nominal_simulator_does_not(
    registry: Session, paths_of: ModuleType
) -> None:
    found = registry.result("@last")
    paths = paths_of.held_out(registry, found, horizon=LONG)
    assert len(paths.measured) == len(found.parts["test"]) > 2 and paths.period == pytest.approx(0.02)
    assert list(paths.simulated) == ["nominal", "calibrated", "extended"]
    for states in (paths.measured, *paths.simulated.values()):
        assert np.abs(states[:, 0]).max() < 0.005  # all stand where the robot stood
    off = {name: np.sqrt(np.mean(paths.ends(name) ** 2)) for name in paths.simulated}
    assert off["extended"] < 0.25 * off["nominal"] and off["nominal"] > 0.02
    error = next(e for e in found.errors if e.channel == "base/x")
    assert np.nanmean(paths.apart("nominal")) > error.nominal  # of two axes, one
    assert np.nanmean(paths.apart("extended")[:, 1:]) < 2.0 * error.extended * np.sqrt(2)


def test_paths_begin_ahead_of_the_robot(paths_of: ModuleType) -> None:
    """A robot that looks along y and drives there goes ahead; one that turns left from there goes to the left."""
    poses = np.array([[[1.0, 2.0, np.pi / 2], [1.0, 2.5, np.pi / 2], [0.8, 2.5, np.pi]]])
    np.testing.assert_allclose(
        paths_of._from_start(poses, poses[:, 0]), [[[0.0, 0.0], [0.5, 0.0], [0.5, 0.2]]], atol=1e-12
    )


def test_the_end_is_the_last_row_that_was_measured(paths_of: ModuleType) -> None:
    measured = np.zeros((2, 4, 2))
    measured[1, 2:] = np.nan
    simulated = np.stack([np.full((4, 2), 3.0), np.arange(8.0).reshape(4, 2)])
    paths = paths_of.Paths(measured, {"nominal": simulated}, 0.1)
    np.testing.assert_allclose(paths.ends("nominal"), [3.0 * np.sqrt(2), np.hypot(2.0, 3.0)])


def test_the_least_straight_ways_are_shown(paths_of: ModuleType) -> None:
    along = np.linspace(0.0, 1.0, 20)
    ways = [np.stack([along, bend * along**2], axis=1) for bend in (0.0, 0.4, 0.1, 0.0, 3.0)]
    ways[4][15:] = np.nan
    paths = paths_of.Paths(np.stack(ways), {}, 0.1)
    np.testing.assert_array_equal(paths_of.bent(paths), [1, 2, 4])
    np.testing.assert_array_equal(paths_of.bent(paths, 1), [4])


def test_the_command_draws_a_picture_and_refuses_a_diagnosis_that_held_nothing_out(
    registry: Session, paths_of: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths_of.main(
        [str(registry.path), "yard", "--horizon", "3", "--out", str(tmp_path / "new" / "wheels.png")]
    )
    assert (tmp_path / "new" / "wheels.png").read_bytes().startswith(b"\x89PNG")
    out = capsys.readouterr().out
    assert out.startswith("nominal: ") and "cm off at the end (root mean square of" in out
    first = next(i for i in registry.list("result").items if not registry.result(i.id).parts["test"])
    with pytest.raises(NoMatchError, match="held nothing out"):
        paths_of.held_out(registry, registry.result(first.id))
    with pytest.raises(NoMatchError, match=r"no rollout 'run_3\[0\]'.*give the horizon"):
        paths_of.held_out(registry, registry.result("yard"))
