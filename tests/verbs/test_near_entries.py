"""The graph between entries, simulated and measured, and distances in it."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import tiny_registry

import dynreg
from dynreg.errors import Damaged, NoMatchError, UsageError
from dynreg.verbs.populations import load_population


@pytest.fixture
def reg(registry_folder: Path, tmp_path: Path):
    shutil.copytree(registry_folder, tmp_path / "registry")
    with dynreg.open(tmp_path / "registry") as reg:
        yield reg


def scaled(factor: float) -> str:
    """The log of a bench whose position reads a little smaller."""
    return tiny_registry.bench_csv(lambda i, row: [row[0], round(row[1] * factor, 5), *row[2:]])


def test_neighbours_are_the_nearest_by_brute_force(reg):
    ids = list(reg.population("servo_pendulum").id)
    population = load_population(reg.registry, "servo_pendulum", judged=True)
    matrix = population.cross_loss.matrix()
    for own in (0, 5):
        near = reg.neighbours(ids[own], 3)
        others = [i for i in np.argsort(matrix[own], kind="stable") if i != own][:3]
        assert list(near.id) == [ids[i] for i in others] and set(near.kind) == {"entry"}
        np.testing.assert_allclose(near.distance, matrix[own, others], rtol=1e-5)
        assert near.name[0] == f"servo_pendulum-{others[0]}"
    assert reg.distance(ids[0], ids[1]) == pytest.approx(matrix[0, 1], rel=1e-5)
    assert reg.distance(ids[3], ids[3]) == 1.0 and reg.distance(ids[1], ids[0]) == reg.distance(
        ids[0], ids[1]
    )


def test_a_recordings_own_model_is_an_entry_like_any_other(reg, tmp_path):
    first = reg.query("bench", replay=False, synthesise=False)
    assert first.measured == ()
    (own,) = reg.list("measured").items
    assert own.name == "bench" and own.robot == "servo_pendulum"
    shown = reg.show(own.id)
    assert shown.kind == "measured" and shown.detail["recording"] == reg.recording("bench").id
    near = reg.neighbours(own.id, 3)
    assert len(near) == 3 and own.id not in set(near.id)
    assert near.distance[0] == pytest.approx(reg.distance(own.id, near.id[0]))
    entries = reg.population("servo_pendulum").id
    assert own.id in set(reg.neighbours(entries[0], 8).id)
    states, actions = reg.recording("bench").episodes[0].values[:5, :2], np.zeros((5, 1))
    assert reg.model(own.id).predict(states, actions).shape == (5, 2)

    (tmp_path / "second.csv").write_text(scaled(0.98))
    reg.ingest(tmp_path / "second.csv", "servo_pendulum", name="second")
    found = reg.query("second", replay=False, synthesise=False)
    (other,) = found.measured
    assert other.entry == own.id and other.name == "bench"
    assert other.distance < found.neighbours[0].distance, "the same bench is nearer than any simulator"
    assert [item.name for item in reg.list("measured").items] != []
    assert reg.query("bench", replay=False, synthesise=False).measured[0].name == "second"
    assert len(reg.list("measured").items) == 2, "each recording has one"


def test_a_damaged_model_of_a_recording_is_passed_over(reg, tmp_path):
    entries = reg.population("servo_pendulum").id
    reg.query("bench", replay=False, synthesise=False)
    (own,) = reg.list("measured").items
    (file,) = (tmp_path / "registry" / "measured").iterdir()
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.warns(Damaged, match="is passed over"):
        assert own.id not in set(reg.neighbours(entries[0], 8).id)
    (tmp_path / "second.csv").write_text(scaled(0.98))
    reg.ingest(tmp_path / "second.csv", "servo_pendulum", name="second")
    with pytest.warns(Damaged, match="is passed over"):
        assert reg.query("second", replay=False, synthesise=False).measured == ()


def test_the_held_out_part_of_a_query_does_not_see_the_stored_model(reg):
    before = reg.query("bench", hold_out="kp=400")
    again = reg.query("bench", hold_out="kp=400")
    assert before.neighbours == again.neighbours and before.answer == again.answer
    assert before.stages == again.stages


def test_what_cannot_be_asked_is_told(reg):
    ids = reg.population("servo_pendulum").id
    with pytest.raises(UsageError, match="at least 1"):
        reg.neighbours(ids[0], 0)
    with pytest.raises(NoMatchError):
        reg.neighbours("bench")
    reg.populate("servo_pendulum", 3, seed=4, training=tiny_registry.QUICK, link=False)
    other = next(p.id for p in reg.populations().items if p.detail["seed"] == 4)
    with pytest.raises(UsageError, match="not linked"):
        reg.neighbours(reg.population(other).id[0])
    with pytest.raises(UsageError, match="distances exist only inside one"):
        reg.distance(ids[0], reg.population(other).id[0])
