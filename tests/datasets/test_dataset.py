"""Datasets of stored things: the same rows through every door, part by part."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import tiny_registry

import dynreg
from dynreg.data.recording import Channel
from dynreg.data.trajectories import Columns, Trajectories
from dynreg.errors import NoMatchError, UsageError

torch = pytest.importorskip("torch")


@pytest.fixture(scope="module")
def reg(registry_folder: Path, tmp_path_factory: pytest.TempPathFactory):
    """The tiny registry, in shards of three."""
    folder = tmp_path_factory.mktemp("datasets") / "registry"
    shutil.copytree(registry_folder, folder)
    with dynreg.open(folder) as reg:
        reg.populate("servo_pendulum", 8, seed=3, training=tiny_registry.QUICK, shard_size=3, link=False)
        reg.three = next(p.id for p in reg.populations().items if p.detail["seed"] == 3)
        reg.linked = next(p.id for p in reg.populations().items if p.detail["seed"] == 0)
        yield reg


def stacked(reg, population: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States, actions and context as the store holds them: what every door must give."""
    held, record = reg.registry.load(population), reg.registry.population(population)
    shape = held.states.shape[:2] + (held.states.shape[2] - 1,)
    actions = np.broadcast_to(record.arrays["bank.actions"], (*shape, 1))
    settings = np.repeat(record.arrays["bank.settings"][:, None], shape[2], axis=1)
    context = np.concatenate([record.arrays["bank.inputs"], settings], axis=-1)
    return held.states, actions.astype(np.float32), np.broadcast_to(context, (*shape, 4)).astype(np.float32)


def flat(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, values.shape[-1])


def test_the_same_numbers_through_every_door(reg):
    states, actions, context = stacked(reg, reg.three)
    data = reg.dataset(reg.three)
    assert len(data) == 8 * 40 * 50 and [len(part.entries) for part in data.parts] == [3, 3, 2]

    whole = data.to_numpy()
    np.testing.assert_array_equal(whole.states, flat(states[:, :, :-1]))
    np.testing.assert_array_equal(whole.next_states, flat(states[:, :, 1:]))
    np.testing.assert_array_equal(whole.actions, flat(actions))
    np.testing.assert_array_equal(whole.context, flat(context))
    assert (whole.episode.reshape(8, 40, 50) == np.arange(40)[:, None]).all()

    batches = list(data.to_torch(rows=1000))
    assert max(len(b.state) for b in batches) <= 1000 and batches[0].state.dtype == torch.float32
    for name, right in (("state", whole.states), ("action", whole.actions), ("context", whole.context)):
        np.testing.assert_array_equal(torch.cat([getattr(b, name) for b in batches]).numpy(), right)

    frame = data.to_frame()
    names = [c.name for c in data.columns.all]
    assert list(frame.columns) == ["entry", "number", "episode", "step", "time", *names]
    np.testing.assert_array_equal(frame[["arm/position", "arm/velocity"]].to_numpy(), flat(states))
    told = frame[frame.step < 50]
    np.testing.assert_array_equal(told[["arm/target"]].to_numpy(), flat(actions))
    np.testing.assert_array_equal(told[names[3:]].to_numpy(), flat(context))
    assert frame[frame.step == 50]["arm/target"].isna().all() and frame["kp"].notna().all()
    np.testing.assert_allclose(frame["time"], frame["step"] / 100.0)
    ids = reg.population(reg.three).id
    assert (frame["entry"].astype(str).to_numpy().reshape(8, -1)[:, 0] == ids.to_numpy()).all()

    on_disk = sorted((reg.path / "shards").glob(f"{reg.three[:16]}*.parquet"))
    pd.testing.assert_frame_equal(
        pd.concat([pq.read_table(path).to_pandas() for path in on_disk], ignore_index=True)[names],
        frame[names],
    )
    schema = data.to_arrow().schema
    assert schema.field("arm/velocity").metadata == {b"role": b"state", b"unit": b"rad/s"}


def test_entries_of_a_shard_are_their_rows_of_the_whole(reg):
    frame = reg.population(reg.three)
    some = reg.dataset([frame.id[6], frame.id[1], frame.id[2][:20]])
    assert some.entries == (frame.id[1], frame.id[2], frame.id[6])
    states = stacked(reg, reg.three)[0][[1, 2, 6]]
    np.testing.assert_array_equal(some.to_numpy().states, flat(states[:, :, :-1]))
    assert set(some.to_frame()["number"]) == {1, 2, 6}


def test_an_order_is_drawn_from_a_seed_and_loses_no_row(reg):
    data = reg.dataset(reg.three)

    def rows(seed):
        return np.concatenate([b.states for b in data.batches(777, seed=seed)])

    whole = data.to_numpy().states
    np.testing.assert_array_equal(rows(1), rows(1))
    assert (rows(1) != rows(2)).any() and (rows(1) != whole).any()
    for drawn in (rows(1), rows(2)):
        np.testing.assert_array_equal(np.sort(drawn[:, 0]), np.sort(whole[:, 0]))


@pytest.mark.parametrize("workers", [0, 2])
def test_workers_of_a_loader_share_the_parts(reg, workers):
    from torch.utils.data import DataLoader

    loader = DataLoader(reg.dataset(reg.three).to_torch(rows=500), batch_size=None, num_workers=workers)
    found = torch.cat([batch.state for batch in loader]).numpy()
    whole = reg.dataset(reg.three).to_numpy().states
    np.testing.assert_array_equal(np.sort(found[:, 0]), np.sort(whole[:, 0]))


def test_a_recording_comes_in_its_robots_columns_beside_simulators(reg):
    frame = reg.population(reg.three)
    both = reg.dataset(["bench", frame.id[0]])
    measured = reg.recording("bench")
    assert both.entries == (frame.id[0], measured.id)
    rows = both.to_frame()
    own = rows[rows.entry == measured.id]
    assert own["number"].isna().all() and list(own.episode.astype(str).unique()) == [
        "e0",
        "e1",
        "e2",
        "e3",
        "e4",
    ]
    expected = measured.to_frame()
    np.testing.assert_array_equal(own["arm/position"], expected["arm/position"].astype(np.float32))
    np.testing.assert_array_equal(own["time"], expected["time"])
    assert (own["arm/enabled"] == 1.0).all(), "what the log does not hold is the robot's default"
    assert len(both) == 40 * 50 + 5 * 199 == len(both.to_numpy())


def test_rows_in_which_something_was_not_measured_are_no_transitions(reg):
    whole = reg.recording("bench")
    values = [e.values.copy() for e in whole.episodes]
    values[1][50, 0] = np.nan
    gap = replace(
        whole, episodes=tuple(replace(e, values=v) for e, v in zip(whole.episodes, values, strict=True))
    )
    reg.ingest(gap, "servo_pendulum", name="gap")
    data = reg.dataset("gap").to_numpy()
    assert len(data) == len(reg.dataset("gap")) == 5 * 199 - 2
    assert np.isfinite(data.states).all() and np.isfinite(data.next_states).all()
    for rows in (50, 4096):
        batches = list(reg.dataset("gap").to_torch(rows=rows))
        np.testing.assert_array_equal(np.concatenate([b.state.numpy() for b in batches]), data.states)
        batches[0].state.zero_()
        assert batches[0].next_state.abs().sum() > 0, "what follows is memory of its own"


def test_the_order_in_which_things_are_named_changes_nothing(reg):
    ids = [reg.population(reg.three).id[i] for i in (5, 0)]
    one, other = reg.dataset(["bench", reg.linked, *ids]), reg.dataset([*ids[::-1], reg.linked, "bench"])
    assert one.entries == other.entries
    np.testing.assert_array_equal(one.to_numpy().states, other.to_numpy().states)


def test_rows_tell_their_entry_and_their_time_step(reg):
    frame = reg.population(reg.three)
    data = reg.dataset([reg.three, "bench"])
    whole = data.to_numpy()
    assert [data.entries[i] for i in (0, 7)] == [frame.id[0], frame.id[7]]
    np.testing.assert_array_equal(whole.entry[: 8 * 2000], np.repeat(np.arange(8), 2000))
    assert set(whole.entry[8 * 2000 :]) == {8}
    np.testing.assert_allclose(whole.period, 0.01, rtol=1e-5)
    shuffled = list(data.to_torch(rows=700, seed=3))
    entry, state = (torch.cat([getattr(b, n) for b in shuffled]).numpy() for n in ("entry", "state"))
    for i in (0, 4, 8):
        own = np.sort(whole.states[whole.entry == i][:, 0])
        np.testing.assert_array_equal(np.sort(state[entry == i][:, 0]), own)


def test_an_epoch_draws_an_order_of_its_own(reg):
    data = reg.dataset(reg.three).to_torch(rows=500, seed=1)
    first = next(iter(data)).state
    data.set_epoch(1)
    second = next(iter(data)).state
    assert not torch.equal(first, second) and torch.equal(second, next(iter(data)).state)


@pytest.mark.parametrize("rows", [0, -4, 2.5, True])
def test_the_size_of_a_batch_is_checked_when_it_is_asked_for(reg, rows):
    for ask in (reg.dataset(reg.three).to_torch, reg.dataset(reg.three).batches):
        with pytest.raises(UsageError, match="whole number of at least 1"):
            ask(rows)


def test_things_are_found_by_the_names_that_lists_show(reg):
    reg.query("bench", population=reg.linked, replay=False, synthesise=False)
    ids = reg.population(reg.linked).id
    with pytest.raises(NoMatchError, match="more than one"):
        reg.model("servo_pendulum-3")  # two populations have an entry 3
    reg.populate("leg", 2, training=tiny_registry.QUICK, link=False)
    assert reg.show("leg-1").detail["number"] == 1
    assert reg.neighbours("bench", k=2).kind[0] == "entry" and reg.distance("bench", ids[0]) > 0


def test_the_frame_of_a_population_tells_its_entries(reg):
    frame = reg.population(reg.three)
    held = reg.registry.load(reg.three, ())
    assert list(frame.index) == list(range(8)) and tuple(frame.id) == held.ids
    np.testing.assert_array_equal(frame[list(held.parameters)].to_numpy(), held.values)
    np.testing.assert_array_equal(frame.own_loss, held.own_loss)
    assert frame.attrs["robot"] == "servo_pendulum" and frame.attrs["units"]["tip_mass"] == "kg"
    assert "links" not in frame
    assert all(
        set(links) <= set(range(8)) and i not in links
        for i, links in reg.population(reg.linked).links.items()
    )


def test_what_cannot_be_one_dataset_is_refused(reg, tmp_path):
    with pytest.raises(UsageError, match="nothing"):
        reg.dataset([])
    with pytest.raises(NoMatchError):
        reg.dataset("no such thing")
    reg.populate("leg", 2, training=tiny_registry.QUICK, link=False)
    with pytest.raises(UsageError, match="leg and servo_pendulum"):
        reg.dataset(["leg", reg.three])


def test_one_population_gives_its_normaliser_and_several_none(reg):
    data = reg.dataset(reg.three)
    inputs = data.normaliser.inputs(*(getattr(data.to_numpy(), n) for n in ("states", "actions", "context")))
    assert abs(float(inputs[:, 0].mean())) < 1.0 and data.to_torch().normaliser is data.normaliser
    assert reg.dataset([reg.three, reg.linked]).normaliser is None
    assert len(reg.dataset([reg.three, reg.linked])) == 2 * len(data)


def test_sql_reads_the_shards_and_recordings_as_they_lie(reg):
    duckdb = pytest.importorskip("duckdb")
    shards = reg.path / "shards" / f"{reg.three[:16]}*.parquet"
    found = duckdb.sql(f"""
        SELECT number, count(*) AS rows, avg("arm/position") AS mean, count("arm/target") AS commands
        FROM read_parquet('{shards}') GROUP BY number ORDER BY number
    """).df()
    states, actions, _ = stacked(reg, reg.three)
    assert list(found["number"]) == list(range(8)) and set(found["rows"]) == {40 * 51}
    assert set(found["commands"]) == {actions[0].size}
    np.testing.assert_allclose(found["mean"], states[..., 0].mean(axis=(1, 2)), atol=1e-6)
    recordings = reg.path / "recordings" / "*.parquet"
    by_gain = duckdb.sql(
        f"SELECT kp, count(*) FROM read_parquet('{recordings}', union_by_name=true) GROUP BY kp"
    )
    assert 400.0 in {row[0] for row in by_gain.fetchall()}


def test_a_dataset_counts_entries_and_recordings_apart(exported) -> None:
    both = exported.opened.dataset(["bench", exported.population])
    assert repr(both).startswith("<Dataset of servo_pendulum: 12 entries and 1 recording, 24995 transitions")
    assert "servo_pendulum: 1 recording, 995" in repr(exported.opened.dataset("bench"))
    one = exported.opened.registry.load(exported.population, ()).ids[2]
    assert "servo_pendulum: 1 entry, 2000" in repr(exported.opened.dataset(one))


@pytest.mark.parametrize("rows, kind", [(32_768, "int16"), (32_769, "int32")])
def test_the_rows_of_a_long_episode_are_numbered_to_its_end(rows: int, kind: str) -> None:
    one = Trajectories(
        Columns((Channel("arm/position", "rad"),)),
        entries=("a",),
        numbers=None,
        episodes=np.arange(1),
        time=None,
        states=np.zeros((1, 1, rows, 1), np.float32),
        actions=np.zeros((1, rows, 0), np.float32),
        inputs=np.zeros((1, rows, 0), np.float32),
        settings=np.zeros((1, 0), np.float32),
    )
    steps = one.table()["step"]
    assert str(steps.type) == kind and np.array_equal(steps.to_numpy(), np.arange(rows))
