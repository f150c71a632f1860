"""Every form of a dataset holds the numbers of the registry, and is what its own library expects."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import tiny_registry
from mcap.reader import make_reader
from safetensors import safe_open

from dynreg.data.readers import ReadOptions
from dynreg.data.readers.lerobot import read as read_lerobot
from dynreg.data.recording import Recording
from dynreg.datasets.formats import FORMATS
from dynreg.errors import UsageError

STATES = ["arm/position", "arm/velocity"]
ACTION = "arm/target"
Rows = dict[str, tuple[np.ndarray, np.ndarray]]


def of_frame(frame: pd.DataFrame) -> Rows:
    return {
        entry: (rows[STATES].to_numpy(np.float32), rows[ACTION].to_numpy(np.float32))
        for entry, rows in frame.groupby("entry")
    }


def parquet(place: Path) -> Rows:
    return of_frame(pd.read_parquet(place / "data"))


def csv(place: Path) -> Rows:
    return of_frame(pd.read_csv(place))


def mcap(place: Path) -> Rows:
    rows: Rows = {}
    ids = {identity[:12]: identity for identity in csv(place.parent / "csv")}
    for file in sorted(place.glob("*.mcap")):
        with open(file, "rb") as stream:
            messages = [
                json.loads(m.data) for _, channel, m in make_reader(stream).iter_messages(topics=["/arm"])
            ]
        states = [[m["position"], m["velocity"]] for m in messages]
        actions = [m.get("target", np.nan) for m in messages]
        rows[ids[file.stem[4:]]] = (np.array(states, np.float32), np.array(actions, np.float32))
    return rows


def lerobot(place: Path) -> Rows:
    frame = pd.read_parquet(place / "data")
    entries = pd.read_parquet(place / "meta" / "entries.parquet")["id"]
    return {
        entries[i]: (np.stack(rows["observation.state"]), rows["action"].to_numpy())
        for i, rows in frame.groupby("entry_index")
    }


def minari(place: Path) -> Rows:
    rows: dict[str, list] = {}
    for i in range(json.loads((place / "data" / "metadata.json").read_text())["total_episodes"]):
        entry = json.loads((place / "data" / str(i) / "metadata.json").read_text())["entry"]
        table = pa.ipc.open_file(place / "data" / str(i) / "part-0.arrow").read_all()
        states, actions = (np.stack(table[name].to_pylist()) for name in ("observations", "actions"))
        rows.setdefault(entry, []).append((states, actions[:, 0]))
    return {entry: tuple(map(np.concatenate, zip(*some, strict=True))) for entry, some in rows.items()}


DOORS: dict[str, Callable[[Path], Rows]] = {f.__name__: f for f in (parquet, csv, mcap, lerobot, minari)}


@pytest.mark.parametrize("form", [form for form in FORMATS if form != "safetensors"])
def test_the_same_numbers_go_through_every_door(form: str, exported) -> None:
    found = DOORS[form](exported.folder / form)
    registry = exported.opened.registry
    held, told = registry.load(exported.population), registry.population(exported.population)
    assert set(found) == set(held.ids) and len(found) == 12
    for i, identity in enumerate(held.ids):
        states, actions = found[identity]
        episodes, rows = held.states.shape[1:3]
        assert np.array_equal(states.astype(np.float32).reshape(held.states.shape[1:]), held.states[i])
        commands = actions.reshape(episodes, rows)[:, :-1]
        bank = told.arrays["bank.actions"][:, : rows - 1, 0]
        assert np.array_equal(commands.astype(np.float32), bank.astype(np.float32))


def test_some_entries_are_those_and_no_others(exported, tmp_path: Path) -> None:
    opened = exported.opened
    held = opened.registry.load(exported.population)
    chosen = [held.ids[i] for i in (10, 2, 8)]
    opened.export_dataset(chosen, tmp_path / "rows", "parquet")
    found, kept = parquet(tmp_path / "rows"), pq.read_table(tmp_path / "rows" / "entries.parquet")
    assert kept["number"].to_pylist() == [2, 8, 10] and set(found) == set(chosen)
    for i in (2, 8, 10):
        assert np.array_equal(found[held.ids[i]][0], held.states[i].reshape(-1, 2))
    opened.export_dataset(chosen, tmp_path / "models", "safetensors")
    with safe_open(tmp_path / "models" / "models.safetensors", framework="numpy") as file:
        assert np.array_equal(file.get_tensor("weight1"), held.weights["weight1"][[2, 8, 10]])


def test_a_parquet_file_explains_itself(exported) -> None:
    schema = pq.read_schema(exported.folder / "parquet" / "data" / "train-00000.parquet")
    assert schema.field("arm/velocity").metadata == {b"unit": b"rad/s", b"role": b"state"}
    about = json.loads(schema.metadata[b"dynreg"])
    assert about["schema"] == "dynreg/dataset/1" and about["robot"]["name"] == "servo_pendulum"
    assert about["populations"][0]["id"] == exported.population
    assert about["populations"][0]["spec"]["excitation"]["episodes"] == 40
    entries = pq.read_table(exported.folder / "parquet" / "entries.parquet")
    frame = exported.opened.population(exported.population)
    assert entries.schema.field("resistance").metadata == {b"unit": b"ohm"}
    for name in ("id", "resistance", "own_loss"):
        assert entries[name].to_pylist() == frame[name].tolist()
    rows = pd.read_parquet(exported.folder / "parquet" / "data")
    assert rows[ACTION].isna().sum() == 12 * 40 and rows["time"].max() == pytest.approx(0.5)


def test_a_csv_has_the_columns_of_the_dataset(exported) -> None:
    frame = pd.read_csv(exported.folder / "csv")
    assert list(frame) == exported.opened.dataset(exported.population).to_arrow().schema.names
    assert len(frame) == 12 * 40 * 51 and frame["number"].nunique() == 12


def numbers_of(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    return (
        np.concatenate([e.values for e in recording.episodes]),
        np.concatenate([e.time - e.time[0] for e in recording.episodes]),
    )


@pytest.mark.parametrize("form", ["csv", "mcap"])
def test_a_recording_is_ingested_again(form: str, exported, tmp_path: Path) -> None:
    opened, place = exported.opened, tmp_path / f"bench.{form}"
    opened.export_dataset("bench", place, form)
    log_map = tmp_path / "bench.mcap.toml" if form == "mcap" else None
    again = opened.ingest(place, "servo_pendulum", log_map=log_map, name=f"again as {form}")
    first, second = opened.recording("bench"), opened.recording(again.recording)
    assert first.channels == second.channels
    assert [e.settings for e in first.episodes] == [e.settings for e in second.episodes]
    for one, other in zip(numbers_of(first), numbers_of(second), strict=True):
        assert np.allclose(one, other, rtol=0, atol=1e-9)


def test_an_entry_is_ingested_from_its_log(exported, tmp_path: Path) -> None:
    opened = exported.opened
    entry = opened.registry.load(exported.population, ()).ids[2]
    opened.export_dataset(entry, tmp_path / "one.mcap", "mcap")
    told = opened.ingest(
        tmp_path / "one.mcap", "servo_pendulum", log_map=tmp_path / "one.mcap.toml", name="an entry"
    )
    assert told.episodes == 40 and told.rate == pytest.approx(100.0)
    first = opened.recording(told.recording).episodes[0]
    states = opened.registry.load_entry(entry).states[
        0, :-1
    ]  # no command follows the last: it is no row of a log
    assert np.allclose(first.values[:, :2], states, rtol=0, atol=1e-9)


def test_a_lerobot_dataset_is_one_by_its_structure_and_for_dynreg(exported) -> None:
    place = exported.folder / "lerobot"
    info = json.loads((place / "meta" / "info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["fps"] == 100 and info["splits"] == {"train": "0:480"}
    assert info["features"]["observation.state"] == {"dtype": "float32", "shape": [2], "names": STATES}
    rows = pq.read_table(place / info["data_path"].format(chunk_index=0, file_index=0))
    assert rows.schema.names == list(info["features"]) and rows.num_rows == info["total_frames"] == 24480
    assert rows["index"].to_pylist() == list(range(24480))
    assert np.allclose(rows["timestamp"].to_numpy(), rows["frame_index"].to_numpy() / 100)
    assert np.isfinite(np.stack(rows["observation.environment_state"].to_pylist())).all()
    episodes = pq.read_table(place / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    assert [e["episode_index"] for e in episodes] == list(range(480))
    for before, after in zip(episodes, episodes[1:], strict=False):
        assert before["dataset_to_index"] == after["dataset_from_index"]
    assert all(e["dataset_to_index"] - e["dataset_from_index"] == e["length"] == 51 for e in episodes)
    stats = json.loads((place / "meta" / "stats.json").read_text())["observation.state"]
    states = np.stack(rows["observation.state"].to_pylist())
    assert np.allclose(stats["std"], states.std(axis=0)) and stats["count"] == [24480]
    assert np.allclose(stats["max"], states.max(axis=0))
    assert pd.read_parquet(place / "meta" / "tasks.parquet").iloc[0].name == "follow the commands"
    log = read_lerobot(place, ReadOptions())
    assert log.metadata["fps"] == 100 and log.metadata["episode_column"] == "episode_index"
    assert np.array_equal(log.sources["observation.state[arm/velocity]"].values, states[:, 1])


def test_a_minari_dataset_is_one_by_its_structure(exported) -> None:
    place = exported.folder / "minari" / "data"
    about = json.loads((place / "metadata.json").read_text())
    assert about["data_format"] == "arrow" and about["total_steps"] == 480 * 50
    assert json.loads(about["observation_space"])["shape"] == [2]
    table = pa.ipc.open_file(place / "7" / "part-0.arrow").read_all()
    assert (
        table.num_rows == 51 and json.loads((place / "7" / "metadata.json").read_text())["total_steps"] == 50
    )
    assert table["observations"].type == pa.list_(pa.float32(), 2)
    assert table["truncations"].to_pylist() == [False] * 49 + [True, False]
    assert not any(table["terminations"].to_pylist()) and not any(table["rewards"].to_pylist())
    assert {f.name for f in table["infos"].type} == {"time", "supply", "arm/enabled", "kp", "added_mass"}


PREDICTED = """
import sys
rng = np.random.default_rng(0)
states, actions = rng.normal(size=(20, 2)), rng.normal(size=(20, 1))
print(json.dumps([predict(entry, states, actions).tolist() for entry in range(12)]))
assert "dynreg" not in sys.modules
"""


def test_the_models_predict_without_dynreg_as_with_it(exported) -> None:
    """By the card's own words, run as they stand there."""
    card = (exported.folder / "safetensors" / "README.md").read_text(encoding="utf-8")
    (code,) = (part.partition("```")[0] for part in card.split("```python\n")[1:])
    line = [sys.executable, "-c", code + PREDICTED]
    done = subprocess.run(line, cwd=exported.folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    model, rng = exported.opened.model(exported.population), np.random.default_rng(0)
    states, actions = rng.normal(size=(20, 2)), rng.normal(size=(20, 1))
    expected = model.predict(np.tile(states, (12, 1, 1)), actions)
    assert np.allclose(json.loads(done.stdout), expected, rtol=1e-5, atol=1e-6)
    with safe_open(exported.folder / "safetensors" / "models.safetensors", framework="numpy") as file:
        about = json.loads(file.metadata()["dynreg"])
        held = exported.opened.registry.load(exported.population, ("weights",))
        assert about["entries"] == list(held.ids) and about["states"][1] == ["arm/velocity", "rad/s"]
        for name, array in held.weights.items():
            assert np.array_equal(file.get_tensor(name), array) and file.get_tensor(name).dtype == array.dtype


def test_the_model_of_a_recording_is_exported_beside_those_of_simulators(exported, tmp_path):
    reg = exported.opened
    reg.query("bench", replay=False, synthesise=False)
    recording = reg.recording("bench").id
    (own,) = [one for one in reg.list("measured").items if reg.show(one.id).detail["recording"] == recording]
    entry = reg.population(exported.population).id[3]
    made = reg.export_dataset([own.id, entry], tmp_path / "models", "safetensors")
    assert (made.entries, made.recordings) == (1, 1)
    with safe_open(tmp_path / "models" / "models.safetensors", framework="numpy") as file:
        about = json.loads(file.metadata()["dynreg"])
        weights = file.get_tensor("weight0")
    assert about["entries"] == [entry, own.id] and about["numbers"] == [3, None]
    table = pq.read_table(tmp_path / "models" / "entries.parquet").to_pylist()
    assert [(row["id"], row["kind"], row["number"]) for row in table] == [
        (entry, "simulated", 3),
        (own.id, "measured", None),
    ]
    assert table[1]["population"] == exported.population
    assert table[1]["own_loss"] == reg.registry.measured(own.id).own_loss
    models = reg.model([entry, own.id])
    np.testing.assert_array_equal(weights.astype(np.float32), models.stack.weights[0])
    with pytest.raises(UsageError, match="simulated or measured"):
        reg.export_dataset(["bench"], tmp_path / "nothing", "safetensors")
    assert not (tmp_path / "nothing").exists()


def test_models_of_recordings_come_once_in_the_order_of_their_table(exported, tmp_path: Path) -> None:
    reg = exported.opened
    (tmp_path / "other.csv").write_text(
        tiny_registry.bench_csv(lambda i, row: [row[0], row[1] / 2, *row[2:]])
    )
    reg.ingest(tmp_path / "other.csv", "servo_pendulum", name="other")
    for name in ("bench", "other"):
        reg.query(name, replay=False, synthesise=False)
    names = {reg.recording(name).id for name in ("bench", "other")}
    own = [i.id for i in reg.list("measured").items if reg.show(i.id).detail["recording"] in names]
    for place, refs in (("once", own), ("twice", [own[1], own[0], own[1]])):
        assert reg.export_dataset(refs, tmp_path / place, "safetensors").models == 2
        table = pq.read_table(tmp_path / place / "entries.parquet").to_pylist()
        with safe_open(tmp_path / place / "models.safetensors", framework="numpy") as file:
            assert json.loads(file.metadata()["dynreg"])["entries"] == [row["id"] for row in table]
            for i, row in enumerate(table):
                weights = reg.registry.measured(row["id"]).weights
                assert np.array_equal(file.get_tensor("weight0")[i], weights["weight0"])
    once, twice = ((tmp_path / place / "models.safetensors").read_bytes() for place in ("once", "twice"))
    assert once == twice
