"""The maps of examples/maps over a few seconds of measured logs, end to end: folders drafted, logs ingested, stored."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import dynreg
from dynreg.sim.robot import load_robot
from dynreg.verbs.robot_draft import RobotDraftSettings, robot_draft

MAPS = Path(__file__).parents[2] / "examples" / "maps"
LEROBOT = {  # joints of the lerobot map, and of the SAGE table that it is filled from
    "shoulder_pan": "Rotation",
    "shoulder_lift": "Pitch",
    "elbow_flex": "Elbow",
    "wrist_flex": "Wrist_Pitch",
    "wrist_roll": "Wrist_Roll",
}


@pytest.fixture(params=[("go2_stand", "traj_0"), ("tx40", "run_500hz")], ids=["go2_stand", "tx40"])
def drafted(request: pytest.FixtureRequest, data_dir: Path, tmp_path: Path) -> tuple[str, Path, Path]:
    """A set of the data: its name, a robot folder drafted from its model and log, and its first rows as a log."""
    name, run = request.param
    if not (data_dir / name).is_dir():
        pytest.skip(f"no {name} in DYNREG_DATA_DIR: its map is not tried")
    log = tmp_path / f"{run}.parquet"
    pq.write_table(pq.read_table(data_dir / name / f"{run}.parquet").slice(0, 1500), log)
    stated = {"kp": 20.0, "kd": 1.5} if name == "go2_stand" else {}
    settings = RobotDraftSettings(to=tmp_path / name, **stated)
    assert robot_draft(data_dir / name / f"{name}.xml", log, settings).missing == ()
    return name, tmp_path / name, log


def test_a_robot_drafted_from_the_data_takes_its_log_with_the_example_map_and_with_its_own(
    drafted: tuple[str, Path, Path], tmp_path: Path
):
    name, folder, log = drafted
    with dynreg.open(tmp_path / "registry") as session:
        told = session.ingest(log, folder, log_map=MAPS / f"{name}.toml", name="example")
        own = session.ingest(log, folder, name="own")
        stored = session.recording("example")
    joints, episodes, rate = {"go2_stand": (12, 3, 200.0), "tx40": (6, 1, 500.0)}[name]
    assert (told.rows_count, told.episodes) == (1500, episodes) and told.rate == pytest.approx(rate)
    assert len(told.channels) == len(own.channels) == 3 * joints and told.notes == ()
    assert not [found for found in told.findings if found.startswith("error")]
    for name, column in zip(stored.names, np.concatenate([e.values for e in stored.episodes]).T, strict=True):
        share = 0.98 if name.endswith("/velocity") else 1.0  # of few rows no rate is told
        assert np.isfinite(column).mean() >= share
    assert set(load_robot(folder).actions) <= set(stored.names)


def test_arrays_in_the_layout_of_pace(data_dir: Path, tmp_path: Path):
    """One leg of the Go2 on its stand, as the tools that follow PACE keep it."""
    file = data_dir / "go2_stand" / "traj_0.parquet"
    if not file.is_file():
        pytest.skip("no go2_stand in DYNREG_DATA_DIR: the map of PACE's layout is not tried")
    table = pq.read_table(file).slice(0, 1000)
    arrays = {
        key: np.stack([table[f"{column}_FL_{joint}"] for joint in ("hip", "thigh", "calf")], axis=1)
        for key, column in (("dof_pos", "pos"), ("des_dof_pos", "cmd"))
    }
    np.savez(tmp_path / "run.npz", time=np.asarray(table["t_s"]), **arrays)
    with dynreg.open(tmp_path / "registry") as session:
        told = session.ingest(tmp_path / "run.npz", "leg", log_map=MAPS / "pace.toml", name="pace")
        (episode,) = (stored := session.recording("pace")).episodes
    assert episode.name == "run" and told.notes == () and episode.duration == pytest.approx(4.99, abs=0.011)
    knee = episode.values[:, stored.columns(["knee/position"])[0]]
    np.testing.assert_allclose(knee[:100], arrays["dof_pos"][:200:2, 2], atol=1e-3)  # its stamps are rounded


def test_a_lerobot_dataset_of_an_arm(data_dir: Path, tmp_path: Path):
    """Two slices of the SAGE arm as a LeRobot dataset: in degrees, the jaw from 0 to 100, without velocities."""
    folder = data_dir / "sage_so101_arm"
    if not folder.is_dir():
        pytest.skip("no sage_so101_arm in DYNREG_DATA_DIR: the map of LeRobot's layout is not tried")
    tables = [
        pq.read_table(folder / f"{run}.parquet").slice(200, 300) for run in ("chirp_sweep", "multisine")
    ]
    names = [f"{joint}.pos" for joint in (*LEROBOT, "gripper")]
    features = {key: {"dtype": "float32", "names": names} for key in ("observation.state", "action")}
    rows = {"timestamp": [np.arange(300) / 50] * 2, "episode_index": [np.full(300, k) for k in range(2)]}
    for key, column in (("observation.state", "pos"), ("action", "cmd")):
        rows[key] = [list(_frames(table, column)) for table in tables]
    data = tmp_path / "set" / "data" / "chunk-000"
    data.mkdir(parents=True)
    (tmp_path / "set" / "meta").mkdir()
    (tmp_path / "set" / "meta" / "info.json").write_text(json.dumps({"fps": 50, "features": features}))
    whole = {key: [row for part in parts for row in part] for key, parts in rows.items()}
    pq.write_table(pa.table(whole), data / "file-000.parquet")
    with dynreg.open(tmp_path / "registry") as session:
        told = session.ingest(tmp_path / "set", "so101", log_map=MAPS / "lerobot.toml", name="arm")
        stored = session.recording("arm")
    assert (told.episodes, told.rows_count, told.notes) == (2, 600, ())
    for episode, table in zip(stored.episodes, tables, strict=True):
        elbow = episode.values[:, stored.columns(["elbow/position"])[0]]
        np.testing.assert_allclose(elbow, table["pos_Elbow"], atol=1e-6)


def _frames(table: pa.Table, column: str) -> np.ndarray:
    """(T, 6) positions as LeRobot keeps those of an SO-101."""
    degrees = [np.degrees(table[f"{column}_{joint}"]) for joint in LEROBOT.values()]
    return np.stack([*degrees, 100 * np.asarray(table[f"{column}_Jaw"])], axis=1)
