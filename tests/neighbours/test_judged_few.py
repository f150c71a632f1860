"""A query judges some entries: it finds what judging all finds, and reads no more models than it counts."""

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import secret_servo
from secret_servo import ENTRIES, TRAINING

from dynreg import session
from dynreg.distance import ahead, foreseen, linked, one_sided, query
from dynreg.distance.cross_loss import PIVOTS
from dynreg.distance.query import DistanceQuery
from dynreg.distance.table import DISTANCES
from dynreg.errors import CorruptError
from dynreg.index import GraphSettings, build
from dynreg.models.losses import losses
from dynreg.neighbours import retrieve as retrieve_module
from dynreg.registry.directory import Directory
from dynreg.verbs import linking
from dynreg.verbs.populations import link, load_graph, load_population


@pytest.fixture
def searching(monkeypatch):
    """Searches are worth it from five entries on, and judge eight at least."""
    monkeypatch.setattr(query, "JUDGED_ALL", 4)
    monkeypatch.setattr(one_sided, "FIRST", 4)
    for name in ("HUBS", "LIKE", "RANDOM"):
        monkeypatch.setattr(linked, name, 2)
    for room, told in ((one_sided, {"beside": 0.0}), (linked, {})):
        effort = partial(_few, room.effort, told | {"least": 8, "each": 4})
        monkeypatch.setattr(room, "effort", effort)


def _few(effort, told, entries):
    return replace(effort(entries), **told)


@pytest.fixture
def copy(populated, tmp_path):
    with session.open(shutil.copytree(populated, tmp_path / "registry")) as opened:
        yield opened


def test_the_more_there_are_the_more_are_judged():
    """By both distances; `one_sided` judges as many of 300 as of 4,000."""
    sided, crossed = (
        [room.effort(n).least for n in (300, 4000, 8000, 30_000)] for room in (one_sided, linked)
    )
    assert sided[0] == sided[1] == one_sided.LEAST < sided[2] < sided[3] < 2 * sided[1]
    assert crossed == sorted(set(crossed)) and crossed[1] < 450, (
        "wanted among 10,000 quadrupeds, 3,600 allowed"
    )


def id_of(opened) -> str:
    (record,) = opened.registry.populations()
    return record.id


def asked(opened, seed: int, **how) -> DistanceQuery:
    recording = secret_servo.record(secret_servo.values_of(seed), seed)
    return DistanceQuery(load_population(opened.registry, id_of(opened), judged=True), recording, len, **how)


@pytest.mark.parametrize("distance", ["one_sided", "cross_loss"])
def test_a_search_finds_what_judging_all_finds_and_judges_fewer(servos, searching, distance):
    recalls, judged = [], []
    for seed in range(4):
        given = asked(servos, seed)
        found, exact = (DISTANCES[distance].rank(q) for q in (given, replace(given, exact=True)))
        assert len(exact.order) == exact.evaluations == ENTRIES
        far = dict(zip(exact.order.tolist(), exact.distance.tolist(), strict=True))
        np.testing.assert_allclose(found.distance, [far[i] for i in found.order.tolist()], rtol=1e-5)
        recalls.append(np.isin(exact.order[:5], found.order[:5]).mean())
        judged.append(found.evaluations)
    assert np.mean(recalls) >= 0.9 and np.mean(judged) < ENTRIES


@pytest.mark.parametrize("how", [{}, {"exact": True}, {"threads": 1}, {"wanted": 20}])
def test_no_more_models_are_read_than_are_counted(servos, searching, how):
    given = asked(servos, 1, **how)
    models, vector = given.population.stack.mapped, given.vector
    assert models.read == 0 and vector.shape == (given.population.vectors.shape[1],)
    found = DISTANCES["one_sided"].rank(given)
    assert models.read == found.evaluations <= ENTRIES
    assert len(found.order) >= how.get("wanted", 8)
    DISTANCES["embedding"].rank(given)
    assert models.read == found.evaluations, "vectors are in the index"


def test_a_walk_that_finds_too_few_is_counted_beside_all_that_are_judged_then(servos):
    found = DISTANCES["cross_loss_printed"].rank(asked(servos, 1, at_least=ENTRIES))
    assert found.evaluations > len(found.order) == ENTRIES


def test_a_search_is_the_same_on_any_number_of_threads(servos, searching, monkeypatch):
    """Its threads share what is judged at once: here two products of models and a part of one."""
    monkeypatch.setattr(one_sided, "FIRST", 2 * ahead.AT_ONCE + 3)
    products, missed = [], ahead.Ahead._missed
    monkeypatch.setattr(
        ahead.Ahead, "_missed", lambda own, stack: (products.append(len(stack)), missed(own, stack))[1]
    )
    found, sizes = [], []
    for threads in (1, 3):
        products.clear()
        found.append(DISTANCES["one_sided"].rank(asked(servos, 2, threads=threads)))
        sizes.append(sorted(products))
    one, three = found
    np.testing.assert_array_equal(one.order, three.order)
    np.testing.assert_array_equal(one.distance, three.distance)
    assert sizes[0] == sizes[1] and sizes[0].count(ahead.AT_ONCE) >= 2, (
        "last bits hang on what is in a product"
    )


def test_the_answer_tells_how_many_of_how_many_were_evaluated(servos, searching):
    recording = servos.ingest(secret_servo.record(secret_servo.values_of(9), 9), "servo_pendulum")
    told = {"replay": False, "synthesise": False, "k": 3, "distance": "one_sided"}
    some, every = servos.query(recording, **told), servos.query(recording, **told, exact=True)
    assert some.simulators == every.simulators == every.cost.evaluations == ENTRIES
    assert 8 <= some.cost.evaluations <= ENTRIES
    assert some.neighbours[0].entry == every.neighbours[0].entry


def test_a_model_that_is_not_as_it_was_registered_is_not_judged(copy, searching):
    (path,) = (copy.path / "shards").glob("*.safetensors")
    data = bytearray(path.read_bytes())
    data[-1000] ^= 1  # in the last tensor, of the last entry
    path.write_bytes(data)
    with pytest.raises(CorruptError, match="not the one that was registered"):
        DISTANCES["one_sided"].rank(asked(copy, 1, exact=True))


def index_of(opened) -> dict[str, np.ndarray]:
    identity = id_of(opened)
    arrays = {key: opened.registry.index(identity, key) for key in ("graph", "embedding", "judged")}
    return {f"{key}/{name}": a for key, some in arrays.items() for name, a in some.items()}


def test_a_search_by_cross_loss_judges_first_the_entries_whose_rows_pivots_predict_best(
    servos, searching, monkeypatch
):
    given, first = asked(servos, 3), []

    def seek(places, missed, wanted, ids, effort):
        first.extend(ids)
        return foreseen.seek(places, missed, wanted, ids, effort)

    monkeypatch.setattr(linked, "seek", seek)
    DISTANCES["cross_loss"].rank(given)
    judged = given.population.judged
    pivots = given.population.stack[np.arange(PIVOTS)]
    rows = zip(judged.inputs, judged.targets, strict=True)
    crossed = np.array([losses(pivots, *one) for one in rows])
    np.testing.assert_allclose(judged.crossed, crossed, rtol=1e-4)
    easy = np.log(crossed / judged.own[:, None]).mean(axis=1)
    assert set(np.argsort(easy)[: linked.HUBS]) <= set(first)


def test_an_index_without_what_pivots_tell_finds_the_same_and_is_made_anew_by_linking(copy, searching):
    identity, ids = id_of(copy), tuple(copy.registry.numbers(id_of(copy)))
    wanted = DISTANCES["cross_loss"].rank(asked(copy, 2))
    older = dict(copy.registry.index(identity, "judged", ids))
    crossed = older.pop("crossed")
    copy.registry.put_index(identity, "judged", older, ids)
    found = DISTANCES["cross_loss"].rank(asked(copy, 2))
    np.testing.assert_array_equal(found.order, wanted.order)
    np.testing.assert_array_equal(found.distance, wanted.distance)
    assert copy.populate("servo_pendulum", ENTRIES, training=TRAINING).linked == ENTRIES
    np.testing.assert_array_equal(copy.registry.index(identity, "judged", ids)["crossed"], crossed)


def test_a_population_that_grew_has_the_index_of_one_that_came_at_once(servos, tmp_path, monkeypatch):
    """From the number of entries on to which the embedding is fitted, only those that came are linked."""
    monkeypatch.setattr(linking, "FITTED", 10)
    wanted, evaluations = None, []
    for name, steps in (("once", [ENTRIES]), ("grown", [6, 12, 20, ENTRIES])):
        with session.open(tmp_path / name) as opened:
            for n in steps:
                told = opened.populate("servo_pendulum", n, training=TRAINING)
                evaluations.append(told.evaluations)
                assert told.linked == n
            found = index_of(opened)
            wanted = wanted or found
    assert found.keys() == wanted.keys()
    for name, array in wanted.items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)
    assert evaluations[-1] == sum(range(20, ENTRIES)), "the new ones alone, each with all before it"


def test_linking_those_that_came_reads_whole_the_files_of_these_alone(copy, monkeypatch):
    monkeypatch.setattr(linking, "FITTED", 10)
    before, whole, checked = set(copy.path.glob("shards/*.safetensors")), [], Directory.checked

    def watched(self, *names):
        whole.extend(Path(name).name for name in names)
        return checked(self, *names)

    monkeypatch.setattr(Directory, "checked", watched)
    told = copy.populate("servo_pendulum", ENTRIES + 4, training=TRAINING, link=False)
    assert told.added == 4
    whole.clear()
    assert link(copy.registry, id_of(copy))[0] == ENTRIES + 4
    new = {path.name for path in copy.path.glob("shards/*.safetensors") if path not in before}
    assert {name for name in whole if name.endswith(".safetensors")} == new


def test_a_model_that_was_changed_since_is_not_linked_to(copy, monkeypatch):
    monkeypatch.setattr(linking, "FITTED", 10)
    (path,) = (copy.path / "shards").glob("*.safetensors")
    copy.populate("servo_pendulum", ENTRIES + 4, training=TRAINING, link=False)
    data = bytearray(path.read_bytes())
    data[-1000] ^= 1  # in the last tensor, of the last entry
    path.write_bytes(data)
    with pytest.raises(CorruptError, match="not the one that was registered"):
        link(copy.registry, id_of(copy))


def test_relinking_makes_the_same_index_again(copy):
    before = index_of(copy)
    told = copy.populate("servo_pendulum", ENTRIES, training=TRAINING, relink=True)
    assert told.added == 0 and told.linked == ENTRIES and told.evaluations > 0
    for name, array in index_of(copy).items():
        np.testing.assert_array_equal(before[name], array, err_msg=name)


def test_an_index_of_an_older_version_is_asked_and_grows(copy, searching):
    """It has no digests, no rows that judge, and a graph that was built by walks."""
    registry, identity = copy.registry, id_of(copy)
    ids, arrays = tuple(registry.numbers(identity)), registry.index(identity, "embedding")
    old = {name: arrays[name] for name in ("probes", "base", "mean", "components", "vectors")}
    distance = load_population(registry, identity, judged=True).cross_loss
    registry.put_index(identity, "embedding", old, ids)
    registry.put_index(identity, "graph", build(distance, ENTRIES, GraphSettings(seed=0)).to_arrays(), ids)
    for path in (copy.path / "index").glob("*-judged-*"):
        path.unlink()
    for name in ("one_sided", "cross_loss", "embedding"):
        found = DISTANCES[name].rank(asked(copy, 3))
        right = DISTANCES[name].rank(asked(copy, 3, exact=True))
        assert np.isin(right.order[:3], found.order[:8]).all()
    copy.populate("servo_pendulum", ENTRIES + 4, training=TRAINING)
    assert len(load_graph(registry, identity)) == ENTRIES + 4
    assert load_graph(registry, identity).settings.batch == 1


@pytest.mark.parametrize("key", ["embedding", "judged", "graph"])
def test_populating_again_links_anew_where_a_part_of_the_index_is_lost(copy, key):
    before = index_of(copy)
    for path in (copy.path / "index").glob(f"*-{key}-*"):
        path.unlink()
    assert copy.populate("servo_pendulum", ENTRIES, training=TRAINING).linked == ENTRIES
    for name, array in index_of(copy).items():
        np.testing.assert_array_equal(before[name], array, err_msg=name)


def test_linking_runs_matrix_products_on_one_core(copy, monkeypatch):
    """Products of several cores round otherwise."""
    from threadpoolctl import threadpool_info, threadpool_limits

    seen, link_entries = [], linking.link_entries

    def watched(*told):
        seen.extend(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas")
        return link_entries(*told)

    monkeypatch.setattr(linking, "link_entries", watched)
    with threadpool_limits(2):
        copy.populate("servo_pendulum", ENTRIES, training=TRAINING, relink=True)
    assert seen and set(seen) == {1}


def test_a_fall_back_to_the_embedding_counts_what_was_judged_before(servos, monkeypatch):
    given = asked(servos, 1)
    sided = DISTANCES["one_sided"].rank(given)
    far = replace(sided, distance=sided.distance + 10.0)
    table = {**DISTANCES, "one_sided": SimpleNamespace(rank=lambda _: far, models=True)}
    monkeypatch.setattr(retrieve_module, "DISTANCES", table)
    found = retrieve_module.retrieve(given, guess=False)
    own = DISTANCES["embedding"].rank(given).evaluations
    assert found.distance_name == "embedding" and found.ranked.evaluations == own + sided.evaluations > own
