"""A URDF says nothing of how its base stands: a log tells whether it moves."""

from pathlib import Path

import numpy as np
import pytest
import strangers

from dynreg.data.series import RawLog, Series
from dynreg.draft.base import with_base
from dynreg.draft.entry import DraftOptions, Notes
from dynreg.draft.source import Source

TRUNK = (
    '<link name="base_link"><inertial><mass value="3"/><inertia ixx="0.1" iyy="0.1" izz="0.1" '
    'ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
LEGGED = strangers.URDF.replace('<link name="base_link"/>', TRUNK)
HELD = LEGGED.replace(
    "</robot>",
    '<link name="world"/><joint name="bolted" type="fixed"><parent link="world"/><child link="base_link"/></joint>'
    "</robot>",
)
SWAY, STILL = 0.05, 1e-4  # m, 1 sigma of noise and of motion


def logged(*sources: str, moved: float = SWAY, topic: str = "") -> RawLog:
    """Ten seconds in which the signals sway by [m or rad], with noise."""
    time = np.arange(0.0, 10.0, 0.01)
    noise = STILL * np.random.default_rng(0).standard_normal((len(sources), len(time)))
    told = {s: Series(time, moved * np.sin(2.0 * time) + n) for s, n in zip(sources, noise, strict=True)}
    return RawLog(Path("log.mcap"), told, {"topics": [topic]} if topic else {})


def settled(text: str, log: RawLog | None, free: bool | None = None) -> tuple[bool | None, str]:
    """Whether the base is free, and what is said of it."""
    notes = Notes()
    source = Source("dog.urdf", "dog.urdf", {"dog.urdf": text.encode()})
    return with_base(source, DraftOptions(free_base=free), log, notes).free_base, " ".join(notes.lines)


ODOMETRY = logged("/odom.pose.pose.position.x", topic="/odom")


@pytest.mark.parametrize(
    "log",
    [
        ODOMETRY,
        logged("/tf[odom->base_link].translation.x", topic="/tf"),
        logged("base_x", "base_y"),
    ],
    ids=["odometry", "tf", "table"],
)
def test_a_base_that_the_log_sees_moving_is_free(log: RawLog) -> None:
    free, said = settled(LEGGED, log)
    assert free and "it moves freely. --fixed-base keeps it fixed" in said


@pytest.mark.parametrize(
    "text, log",
    [
        (HELD, ODOMETRY),
        (strangers.ARM, ODOMETRY),
        (LEGGED, None),
        (LEGGED, logged("/odom.pose.pose.position.x", moved=0.0, topic="/odom")),
        (LEGGED, logged("/tf[base_link->tool0].translation.x", topic="/tf")),
        (LEGGED, logged("/tool_pose.pose.position.x", topic="/tool_pose")),
        (LEGGED, logged("x", "y", "z")),
        (LEGGED.replace("joint_a", "base_yaw"), logged("base_yaw")),
    ],
    ids=[
        "bolted to a world",
        "an MJCF",
        "no log",
        "still",
        "tf of a tool",
        "pose of a tool",
        "table of anything",
        "a joint",
    ],
)
def test_other_bases_stay_as_they_are(text: str, log: RawLog | None) -> None:
    assert settled(text, log) == (None, "")


def test_what_the_user_states_stays() -> None:
    assert settled(LEGGED, ODOMETRY, free=False) == (False, "")
    assert settled(LEGGED, ODOMETRY, free=True) == (True, "")


def test_where_it_is_not_sure_the_note_names_the_option() -> None:
    for text, log in (
        (LEGGED, logged("imu_roll")),
        (strangers.URDF, ODOMETRY),
    ):  # it may be on a tool; a base without a mass
        free, said = settled(text, log)
        assert free is None and "this base is fixed: --free-base lets it move" in said


def test_the_draft_has_the_base(tmp_path: Path) -> None:
    (tmp_path / "dog.urdf").write_text(LEGGED)
    made = strangers.draft(tmp_path / "dog.urdf", "dog", log=ODOMETRY, drive="position", kp=20.0, kd=1.0)
    assert made.base == "base" and "base/x" in made.robot.channels
