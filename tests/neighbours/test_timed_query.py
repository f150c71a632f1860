"""A log with a row for each command is asked about like any other: its simulators are ranked by replay."""

from pathlib import Path

import pytest
from secret_servo import TRAINING
from timed_khepera import timed_folder, timed_log

from dynreg import session
from dynreg.errors import UsageError
from dynreg.sim.check import problems
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot


def test_a_slower_khepera_with_timed_commands_is_found(tmp_path: Path):
    folder = timed_folder(tmp_path)
    recording = timed_log(load_robot(folder), 200, noise=0.3, speed_lag=0.13)
    with session.open(tmp_path / "registry") as opened:
        opened.populate(folder, 20, training=TRAINING)
        opened.populate(folder, 24, training=TRAINING)
        (grown,) = opened.registry.populations()
        states = opened.registry.load(grown.id).states
        assert (states.std(axis=(1, 2)) > 0.01).all(), "simulators of a population that grows move, too"
        found = opened.query(opened.ingest(recording, folder, name="drive"))
        with pytest.raises(UsageError, match="'one_sided' of 'timed_khepera', whose control is timed"):
            opened.query("drive", distance="one_sided")
        ranked = opened.query("drive", distance="replay", replay=False, synthesise=False)
    assert ranked.cost.rollouts == 24 < found.cost.rollouts
    assert [n.distance for n in ranked.neighbours] == [n.replay_error for n in ranked.neighbours]
    assert found.distance == "replay" and found.fits
    lag = found.synthesised.parameters["speed_lag"]
    assert lag.low < 0.13 < lag.high and lag.high - lag.low < 0.05
    stages = {s.stage: s.test for s in found.stages}
    assert stages["answer"] < 0.5 * stages["nominal"]


def test_simulators_of_a_timed_robot_move(tmp_path: Path):
    robot = load_robot(timed_folder(tmp_path))
    assert not problems(robot)
    run = excitation(robot, seed=0)
    states = rollout(robot, robot.space.nominal[None], run).states
    assert (states.reshape(-1, 3).std(axis=0) > 0.02).all()
