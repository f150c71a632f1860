"""The folder of legs that hang free: what is played, the robot on its stand, and the operator's note."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynreg.data.ingest import read_recording
from dynreg.errors import UsageError
from dynreg.excite.limits import Limits
from dynreg.session import Session
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run
from dynreg.verbs.experiment import commanded


def test_the_folder_holds_all_that_the_operator_needs(tmp_path: Path) -> None:
    folder = tmp_path / "hanging"
    told = Session.excite_legs("quadruped", ("rr",), folder=folder, seconds=15.0)
    assert sorted(p.name for p in folder.iterdir()) == ["README.md", "robot", "rr.csv"]
    (leg,) = told.legs
    stand = load_robot(told.stand)
    assert not stand.floating and (told.robot, leg.joints) == (
        "quadruped",
        ("rr_hip", "rr_shoulder", "rr_elbow"),
    )
    spec = stand.recording_spec
    played = replace(spec, channels=tuple(c for c in spec.channels if c.kind == "action"))
    commands = read_recording(folder / leg.file, played)
    assert [e.name for e in commands.episodes] == list(leg.episodes) and {*leg.held_out} < {*leg.episodes}
    moved = np.ptp(np.concatenate([e.values for e in commands.episodes]), axis=0)
    columns = [commands.names.index(action) for action in stand.actions]
    assert (moved[columns][9:] > 0.1).all() and (moved[columns][:9] == 0.0).all()
    note = (folder / "README.md").read_text(encoding="utf-8")
    assert leg.operator in note and "--joints rr_hip,rr_shoulder,rr_elbow --hold-out test_0,test_1" in note
    assert "the last row of each holds its targets." in note and "No speed limit" not in note
    kept = {limit.name: limit for limit in told.limits}
    assert kept["rr_hip/target"].low <= kept["rr_hip/target"].least < kept["rr_hip/target"].most
    with pytest.raises(UsageError, match="hanging"):
        Session.excite_legs("quadruped", ("rr",), folder=folder)


def test_a_command_that_never_changes_has_no_negative_rate() -> None:
    robot = load_robot("two_joint_arm")
    rate = commanded(robot, Limits.of(robot), Run(np.zeros((1, 4, 2)), period=0.01))[1]
    assert (rate.name, str(rate.least), str(rate.most)) == ("shoulder/target rate", "0.0", "0.0")
