"""Every distance ranks the entries whose dynamics are the recording's first."""

import shutil
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import secret_servo
import tiny_registry
from secret_servo import ENTRIES

from dynreg import session
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.distance.query import DistanceQuery, with_defaults
from dynreg.distance.table import DISTANCES
from dynreg.errors import LogError, UsageError
from dynreg.neighbours.retrieve import Retrieved, retrieve
from dynreg.registry import Registry
from dynreg.replay.cut import windows
from dynreg.replay.known import known_values
from dynreg.replay.windows import Replayer, errors
from dynreg.sim.engines import rollout
from dynreg.verbs import linking, populations
from dynreg.verbs.populations import load_graph, load_population


@pytest.fixture(scope="module")
def population(servos):
    (record,) = servos.registry.populations()
    return load_population(servos.registry, record.id, states=True, judged=True)


@pytest.fixture(scope="module")
def robot(population):
    return population.shared.robot


def ran_the_bank(population, entry: int, noise: float = 0.0) -> Recording:
    """What an entry's own simulator recorded under the population's commands."""
    robot, run = population.shared.robot, population.shared.run
    states = population.entries.states[entry].astype(float)
    states = states + noise * np.random.default_rng(entry).normal(size=states.shape)
    held = lambda a: np.concatenate([a, a[:, -1:]], axis=1)  # noqa: E731
    table = np.concatenate([states, held(run.actions), held(run.inputs)], axis=-1)
    names = (*robot.channels, *robot.actions, *robot.inputs)
    time = np.arange(run.steps + 1) / robot.rate
    episodes = [Episode(f"e{i}", time, table[i], {"kp": run.settings[i, 0]}) for i in range(run.episodes)]
    return Recording(tuple(Channel(n, "1") for n in names), tuple(episodes), measured=False)


def replay_of(population, recording: Recording) -> Callable[[np.ndarray], np.ndarray]:
    robot = population.shared.robot
    replayer = Replayer(robot, windows(robot, recording))
    every = np.arange(len(replayer.windows))
    return lambda unit: errors(replayer.residuals(robot.space.from_unit(unit), every)).mean(axis=1)


@pytest.fixture(scope="module")
def found_in(servos, population) -> Callable[..., Retrieved]:
    """Retrieves from the population for a recording."""

    def found(recording: Recording, distance: str = "auto", *, guess: bool = True, known=None) -> Retrieved:
        query = DistanceQuery(population, recording, replay_of(population, recording), known, wanted=ENTRIES)
        return retrieve(query, distance, guess=guess)

    return found


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("entry", [4, 17])
def test_an_entry_s_own_run_finds_the_entry(found_in, population, distance, entry):
    recording = ran_the_bank(population, entry, 0.001)
    found = found_in(recording, distance).ranked
    at = int(np.flatnonzero(found.order == entry)[0])
    # the printed algorithm returns what its greedy walks met; the training losses are the weaker reading
    assert at == 0 if distance in ("one_sided", "embedding", "trajectory", "replay") else at < 5
    assert len(set(found.order)) == len(found.order) <= ENTRIES, "each is ranked once"
    assert len(found.order) == ENTRIES or distance == "cross_loss_printed"
    known = found.distance[np.isfinite(found.distance)]
    assert (np.diff(known) >= 0).all() and len(known) >= 1


@pytest.mark.parametrize("distance", [d for d in DISTANCES if d != "trajectory"])
def test_near_entries_move_like_the_robot(found_in, population, distance):
    """Over secret servos: the five nearest, on commands that the recording did not show."""
    shares = []
    for seed in (70, 71, 72):
        values = secret_servo.values_of(seed)
        recording = secret_servo.record(values, seed)
        found = found_in(recording, distance, guess=False).ranked
        states = rollout(population.shared.robot, values[None], population.shared.run).states[0]
        apart = np.abs(population.entries.states - states)[..., 0].mean(axis=(1, 2))
        shares.append(apart[found.order[:5]].mean() / apart.mean())
    assert np.mean(shares) < 0.9


def test_trajectory_needs_the_population_s_own_commands(found_in, population):
    recording = secret_servo.record(population.shared.robot.space.nominal, 1)
    with pytest.raises(UsageError, match="whose commands the population's simulators did not run"):
        found_in(recording, "trajectory")


@pytest.mark.parametrize("rows", [2, 10, 20, 22])
def test_a_short_log_is_refused(found_in, population, rows):
    recording = ran_the_bank(population, 4, 0.001)
    (first, *_) = recording.episodes
    short = replace(recording, episodes=(replace(first, time=first.time[:rows], values=first.values[:rows]),))
    with pytest.raises(LogError, match="usable rows.*record longer"):
        found_in(short)


def now_and_then(episode: Episode, population) -> Episode:
    """The states of every tenth row alone, each channel in turn."""
    values, states = episode.values.copy(), len(population.shared.robot.channels)
    for column in range(states):
        values[np.arange(len(values)) % 10 != column, column] = np.nan
    return replace(episode, values=values)


def test_rows_without_successors_are_ranked_by_replay(found_in, population):
    """States measured now and then: one-step errors have nothing to judge, and are tried only where asked for."""
    recording = ran_the_bank(population, 4, 0.001)
    recording = replace(recording, episodes=tuple(now_and_then(e, population) for e in recording.episodes))
    found = found_in(recording)
    ranked = found.ranked
    assert found.distance_name == "replay" and ranked.order[0] == 4 and found.guess is None
    assert ranked.distance == pytest.approx(replay_of(population, recording)(population.unit[ranked.order]))
    with pytest.raises(LogError, match="and in the next as well.*--distance replay"):
        found_in(recording, "one_sided")


def test_entries_far_from_what_is_known_are_left_out(found_in, population, robot):
    known = np.full(len(robot.space), np.nan)
    known[0] = robot.space.bounds[0, 1]
    recording = ran_the_bank(population, 4)
    found = found_in(recording, known=known).ranked
    left = np.setdiff1d(np.arange(ENTRIES), found.order)
    assert len(found.order) == 20 and population.unit[left, 0].max() <= population.unit[found.order, 0].min()


def test_a_recording_tells_nothing_of_parameters_that_are_not_marked_known(robot, population):
    assert np.isnan(known_values(robot, ran_the_bank(population, 0))).all()


def test_defaults_stand_where_inputs_and_settings_are_missing(robot, population):
    recording = ran_the_bank(population, 0)
    keep = recording.columns([*robot.channels, *robot.actions, "supply"])
    values = recording.episodes[0].values[:, keep].copy()
    values[3, -1] = np.nan
    bare = Recording(
        tuple(recording.channels[i] for i in keep), (Episode("e", recording.episodes[0].time, values),)
    )
    filled = with_defaults(robot, bare)
    (episode,) = filled.episodes
    assert episode.settings == {"kp": 400.0, "added_mass": 0.0}
    column = {c.name: i for i, c in enumerate(filled.channels)}
    assert (
        episode.values[3, column["supply"]] == 7.4 and (episode.values[:, column["arm/enabled"]] == 1).all()
    )
    np.testing.assert_array_equal(episode.values[:3, column["supply"]], values[:3, -1])


def test_the_graph_holds_all_entries_until_the_population_grows(servos, population):
    graph = load_graph(servos.registry, population.id)
    assert len(graph) == ENTRIES


def test_an_embedding_that_the_index_lacks_is_computed_again(servos, population, monkeypatch):
    monkeypatch.setattr(type(servos.registry), "index", lambda self, *given: None)
    again = load_population(servos.registry, population.id)
    np.testing.assert_allclose(again.vectors, population.vectors, rtol=1e-6, atol=1e-8)


def test_what_was_linked_while_others_added_entries_is_not_kept(registry_folder, tmp_path, monkeypatch):
    with session.open(shutil.copytree(registry_folder, tmp_path / "registry")) as opened:
        (identity,) = [item.id for item in opened.list("population").items]
        before = opened.registry.load(identity, ()).ids

        def grow_first(*given):
            monkeypatch.undo()
            opened.populate("servo_pendulum", 10, training=tiny_registry.QUICK)
            return linking.fit_embedding(*given)

        monkeypatch.setattr(linking, "fit_embedding", grow_first)
        assert populations.link(opened.registry, identity)[0] == len(before) == 8
        assert len(opened.registry.index(identity, "embedding")["vectors"]) == 10
        assert len(load_population(opened.registry, identity).vectors) == 10
        assert len(load_graph(opened.registry, identity)) == 10
        assert load_graph(opened.registry, identity, before) is None


def test_states_are_those_of_the_listed_entries_where_others_come_meanwhile(
    registry_folder, tmp_path, monkeypatch
):
    with session.open(shutil.copytree(registry_folder, tmp_path / "registry")) as opened:
        (identity,) = [item.id for item in opened.list("population").items]
        index = Registry.index

        def grow_first(*given):
            monkeypatch.undo()
            opened.populate("servo_pendulum", 10, training=tiny_registry.QUICK, link=False)
            return index(*given)

        monkeypatch.setattr(Registry, "index", grow_first)
        held = load_population(opened.registry, identity, states=True)
        assert opened.registry.count(identity) == 10
        assert len(held) == len(held.entries.states) == len(held.entries.ids) == 8
