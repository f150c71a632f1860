"""Drift between recordings of a registry: which is the earlier one, what is kept, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from hidden_wheels import logged, robot

import dynreg
from dynreg.data.recording import Episode, Recording
from dynreg.errors import LogError, NoMatchError, UsageError
from dynreg.session import Session
from dynreg.sim.robot import load_robot


@pytest.fixture(scope="module")
def before() -> Recording:
    return logged(robot(), 1)


@pytest.fixture(scope="module")
def slower() -> Recording:
    return logged(robot("left wheel", 0.8), 2)


@pytest.fixture
def session(tmp_path: Path, before: Recording, slower: Recording) -> Session:
    opened = dynreg.open(tmp_path / "registry")
    for name, recording in (("monday", before), ("friday", slower)):
        opened.ingest(recording, "diffdrive", name=name)
    return opened


def test_a_session_keeps_the_result_and_takes_the_first_recording(
    session: Session, slower: Recording
) -> None:
    result = session.drift("friday", splits=5)
    assert result.chosen and result.earlier.name == "monday" and result.recording_name == "friday"
    assert session.result("friday") == result == session.result("@last")
    assert not session.drift("friday", "monday", splits=0).chosen


def test_what_was_ingested_later_is_no_earlier_recording(session: Session, tmp_path: Path) -> None:
    """But a log that is not registered yet comes after all of them."""
    with pytest.raises(NoMatchError, match="no earlier recording of 'diffdrive'"):
        session.drift("monday", splits=0)
    session.ingest(logged(robot(), 5), "diffdrive", name="sunday")
    assert session.drift("sunday", splits=0).earlier.name == "monday"
    from dynreg.data.table import write_csv

    write_csv(_whole(logged(robot(), 6)), tmp_path / "new.csv")
    assert session.drift(tmp_path / "new.csv", robot="diffdrive", splits=0).earlier.name == "monday"


def test_the_updated_table_holds_all_samples_and_which_still_count(
    session: Session, before: Recording, tmp_path: Path
) -> None:
    import pandas as pd

    assert not session.drift("friday", "monday", splits=0).kept
    result = session.drift("friday", "monday", splits=0, out=tmp_path / "table.parquet")
    assert result.kept
    rows = pd.read_parquet(tmp_path / "table.parquet")
    old, new = rows[rows.born == 0], rows[rows.born == 1]
    assert (len(old), len(new)) == (result.earlier.samples, result.recent.samples)
    kept = rows[["kept_dx", "kept_dy", "kept_dtheta"]]
    assert kept[rows.born == 1].all(axis=None)  # what is new stays
    dropped = rows[~kept.all(axis=1)].cell.unique()
    step = (result.high - result.low) / result.grid
    place = lambda v: np.floor((v - result.low) / step)  # noqa: E731
    moved = {int(result.grid * place(c.left) + place(c.right)) for c in result.moved}
    assert 0 < len(dropped) <= len(moved) and set(dropped) <= moved
    assert (result.grid * place(rows.left) + place(rows.right) == rows.cell).all()
    assert rows.seconds.between(0.4, 0.6).all() and rows.dy.abs().max() < 0.15
    # less of what is held against it than before: the reference was fitted to the earlier recording
    assert rows.off_dtheta[rows.born == 0].std() < 0.2 * rows.dtheta.std()


def test_what_cannot_be_written_leaves_nothing(session: Session, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot write"):
        session.drift("friday", "monday", splits=0, out=tmp_path / "nowhere" / "table.parquet")
    with pytest.raises(NoMatchError, match="no last result"):
        session.result("@last")


def test_a_log_by_its_path_is_registered_once_it_is_judged(
    session: Session, before: Recording, tmp_path: Path
) -> None:
    from dynreg.data.table import write_csv

    write_csv(_whole(logged(robot(), 5)), tmp_path / "sunday.csv")
    write_csv(_whole(logged(robot(), 6, ticks=(1, 1), each=20)), tmp_path / "short.csv")
    with pytest.raises(LogError):
        session.drift(tmp_path / "short.csv", "monday", robot="diffdrive")
    assert len(session.list("recording").items) == 2
    result = session.drift(tmp_path / "sunday.csv", "monday", robot="diffdrive", splits=0)
    assert len(session.list("recording").items) == 3 and session.show(result.recording).kind == "recording"


def _whole(recording: Recording) -> Recording:
    """With the wheels' own sensors, which a log of the packaged robot has."""
    from dynreg.data.recording import Channel

    wheels = [f"{side}_wheel/{what}" for what in ("position", "velocity") for side in ("left", "right")]
    channels = tuple(Channel(w, "rad" if "position" in w else "rad/s") for w in wheels)
    episodes = []
    for e in recording.episodes:
        speed = e.values[:, 3:5]
        turned = np.cumsum(np.gradient(e.time)[:, None] * speed, axis=0)
        episodes.append(Episode(e.name, e.time, np.concatenate([turned, speed, e.values], axis=1)))
    return Recording(channels + recording.channels, tuple(episodes))


def test_other_robots_and_a_lonely_recording_are_refused(
    session: Session, tmp_path: Path, before: Recording
) -> None:
    import shutil

    folder = tmp_path / "cousin"
    shutil.copytree(load_robot("diffdrive").folder, folder)
    text = (folder / "robot.toml").read_text()
    (folder / "robot.toml").write_text(text.replace('name = "diffdrive"', 'name = "cousin"', 1))
    session.ingest(logged(robot(), 7), folder, name="other")
    with pytest.raises(UsageError, match=r"'friday' is of robot 'diffdrive' .*'cousin'"):
        session.drift("friday", "other")
    with pytest.raises(NoMatchError, match="no earlier recording of 'cousin'.*--against"):
        session.drift("other")
