"""What a population holds depends on the robot, the seed and the number of each entry alone."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from secret_servo import ENTRIES, TRAINING

from dynreg import session
from dynreg.distance.population import Training
from dynreg.errors import Assumed, LimitError, SimulationError, UsageError
from dynreg.neighbours import entries as module
from dynreg.neighbours.entries import make_entries, population_id
from dynreg.registry import Registry, verify
from dynreg.sim.robot import load_robot
from dynreg.verbs import populations
from dynreg.verbs.populate import PopulateSettings, populate
from dynreg.verbs.populations import shard, shared_of

POPULATION = population_id(load_robot("servo_pendulum"), 0, TRAINING)


@pytest.fixture(scope="module")
def shared(servos):
    record = servos.registry.population(POPULATION)
    return shared_of(servos.registry, record)


@pytest.fixture
def registry(tmp_path):
    with Registry.open(tmp_path / "registry", create=True) as opened:
        yield opened


def fill(registry: Registry, n: int = ENTRIES, progress=None, **settings) -> int:
    robot, asked = load_robot("servo_pendulum"), PopulateSettings(link=False, **settings)
    return populate(registry, robot, n, asked, training=TRAINING, progress=progress).added


def ids(registry: Registry) -> tuple[str, ...]:
    return registry.load(POPULATION, ()).ids


def test_shards_threads_and_growth_leave_the_entries_as_they_are(registry, servos):
    assert fill(registry, 8, shard_size=5, threads=1) == 8
    first = ids(registry)
    assert fill(registry, shard_size=7, threads=2) == ENTRIES - 8
    assert ids(registry)[:8] == first
    assert ids(registry) == ids(servos.registry)


@pytest.mark.parametrize("numbers", [[0], [3, 4, 5], range(17, 24)])
@pytest.mark.parametrize("threads", [1, 2])
def test_an_entry_does_not_depend_on_those_simulated_and_trained_with_it(shared, servos, numbers, threads):
    data = shard(make_entries(shared, np.array(numbers), threads))
    expected = [ids(servos.registry)[i] for i in numbers]
    assert list(data.entry_ids(POPULATION)) == expected


def test_populating_again_adds_nothing(populated, tmp_path, registry_snapshot):
    path = shutil.copytree(populated, tmp_path / "copy")
    before = registry_snapshot(path)
    with session.open(path) as opened:
        for n in (ENTRIES, 8):
            again = opened.populate("servo_pendulum", n, training=TRAINING)
            assert again.added == 0 and again.entries == again.planned == ENTRIES and again.evaluations == 0
    assert registry_snapshot(path) == before


def test_a_populate_that_was_stopped_goes_on_where_it_was(registry, servos):
    class Stopped(Exception):
        pass

    def stop(stage: str, done: int, total: int) -> None:
        if stage == "simulators" and done >= 10:
            raise Stopped

    with pytest.raises(Stopped):
        fill(registry, shard_size=5, progress=stop)
    assert registry.count(POPULATION) == 10
    report = verify(registry.path)
    assert report.faults == () and report.leftovers == ()
    seen = []
    added = fill(registry, progress=lambda *told: seen.append(told))
    assert added == ENTRIES - 10 and ids(registry) == ids(servos.registry)
    assert [s for s in seen if s[0] == "base model"] == [], "what is shared was kept"
    assert seen[-1] == ("simulators", ENTRIES, ENTRIES)


def test_more_than_the_limit_of_entries_is_refused_before_anything_is_stored(registry, monkeypatch):
    monkeypatch.setenv("DYNREG_MAX_ENTRIES", "10")
    with pytest.raises(UsageError, match="11 simulators; expected at most 10; .*DYNREG_MAX_ENTRIES"):
        fill(registry, 11)
    assert registry.populations() == () and not registry.robots()


def test_a_population_beyond_the_limit_is_not_taken_for_lost_and_begun_anew(registry, monkeypatch):
    fill(registry, 8, shard_size=8)
    monkeypatch.setenv("DYNREG_MAX_ENTRIES", "7")
    monkeypatch.setattr(
        populations, "make_shared", lambda *_: pytest.fail("its base model was trained again")
    )
    with pytest.raises(LimitError, match="DYNREG_MAX_ENTRIES"):
        fill(registry, 7)


def test_a_populate_waits_for_what_another_one_has_claimed(registry, monkeypatch):
    """It takes its claim again when the other one has died, and returns only when all is there."""
    fill(registry, 4, shard_size=4)
    claim = registry.claim(POPULATION, 4)
    fill_in = []

    def other_dies(seconds: float) -> None:
        fill_in.append(registry.count(POPULATION))
        claim.__exit__(None, None, None)

    monkeypatch.setattr(populations.time, "sleep", other_dies)
    record = registry.population(POPULATION)
    registry.put_population(type(record)(**(vars(record) | {"size": 12})))
    assert claim.__enter__()
    assert fill(registry, 12) == 8
    assert registry.count(POPULATION) == 12
    assert fill_in == [8], "it did the rest first, and waited once"


def test_the_base_model_that_was_registered_first_counts(registry, monkeypatch):
    """Another machine, whose processor rounds in another way, trained it meanwhile."""
    put, theirs = Registry.put_population, {}

    def after_another(self, record):
        monkeypatch.setattr(Registry, "put_population", put)
        theirs.update({name: np.nextafter(a, a.dtype.type(9)) for name, a in record.arrays.items()})
        self.put_population(replace(record, size=4, arrays=theirs))
        self.put_population(record)

    monkeypatch.setattr(Registry, "put_population", after_another)
    assert fill(registry, 8) == 8
    held = registry.population(POPULATION)
    assert held.size == 8 and all((held.arrays[name] == array).all() for name, array in theirs.items())


def test_other_seeds_ranges_and_training_are_other_populations():
    robot = load_robot("servo_pendulum")
    narrower = replace(robot, space=robot.space.with_ranges({"tip_mass": (0.45, 0.55)}))
    all_ids = [
        population_id(*told)
        for told in (
            (robot, 0, TRAINING),
            (robot, 1, TRAINING),
            (robot, 0, Training()),
            (narrower, 0, TRAINING),
        )
    ]
    assert len(set(all_ids)) == 4


def test_entries_are_spread_over_the_ranges(servos):
    values = servos.registry.load(POPULATION, ()).values
    unit = load_robot("servo_pendulum").space.to_unit(values)
    assert unit.min() >= 0 and unit.max() <= 1
    halves = (unit < 0.5).mean(axis=0)
    np.testing.assert_allclose(halves, 0.5, atol=0.1)


def test_a_simulation_that_diverges_keeps_its_place_and_moves_no_other(shared, servos, monkeypatch):
    simulate = module.rollout

    def diverging(*told, **named):
        done = simulate(*told, **named)
        done.states[1, 3, 20:] = np.nan
        return done

    monkeypatch.setattr(module, "rollout", diverging)
    data = shard(make_entries(shared, np.arange(3), 1))
    assert np.isfinite(data.states).all() and np.isfinite(data.own_loss).all()
    np.testing.assert_array_equal(data.extra["diverged"], [0, 1, 0])
    np.testing.assert_array_equal(data.states[1, 3, 20:], np.tile(data.states[1, 3, 19], (31, 1)))
    made, held = data.entry_ids(POPULATION), ids(servos.registry)[:3]
    assert (made[0], made[2]) == (held[0], held[2]) and made[1] != held[1]


@pytest.mark.parametrize("n", [0, -3])
def test_there_is_no_population_of_nothing(registry, n):
    with pytest.raises(UsageError, match=f"{n} simulators"):
        fill(registry, n)
    assert registry.populations() == ()


@pytest.mark.parametrize("wrong", [{"epochs": 0}, {"base_configurations": 0}, {"learning_rate": -1e-3}])
def test_training_must_be_something(wrong):
    with pytest.raises(UsageError, match=next(iter(wrong))):
        Training(**wrong)


def test_base_simulations_that_diverge_are_left_out_with_their_run_up(registry, shared, monkeypatch):
    simulate = module.rollout

    def diverging(robot, values, run, **named):
        done = simulate(robot, values, run, **named)
        done.states[0, 0, 20:24] = np.array([10.0, 100.0, 1000.0, 9000.0])[:, None]
        done.states[0, 0, 24:] = np.nan
        return done

    monkeypatch.setattr(module, "rollout", diverging)
    with pytest.warns(Assumed, match="1 of .* simulated episodes of 'servo_pendulum' diverged"):
        made = module.make_shared(load_robot("servo_pendulum"), 0, TRAINING, 1)
    for name, array in made.normaliser.as_arrays().items():
        np.testing.assert_allclose(array, shared.normaliser.as_arrays()[name], rtol=0.3, atol=0.05)


def test_a_robot_whose_every_base_simulation_diverges_is_refused(monkeypatch):
    simulate = module.rollout

    def diverging(*told, **named):
        done = simulate(*told, **named)
        done.states[:, :, 30:] = np.nan
        return done

    monkeypatch.setattr(module, "rollout", diverging)
    with pytest.warns(Assumed), pytest.raises(SimulationError, match="every simulated episode"):
        module.make_shared(load_robot("servo_pendulum"), 0, TRAINING, 1)


def test_less_than_an_interrupted_plan_makes_no_more_than_its_shards(registry):
    def stop(stage: str, done: int, total: int) -> None:
        if stage == "simulators" and done >= 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fill(registry, shard_size=5, progress=stop)
    assert fill(registry, 8, shard_size=5) == 5 and registry.count(POPULATION) == 10
    assert fill(registry, shard_size=5) == ENTRIES - 10


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ({"effects": True, "like": "log", "link": False}, "--effects with --no-link"),
        ({"effects": True, "like": "log", "ranges": "wide"}, "--effects with --ranges wide"),
        ({"effects": True, "like": "log"}, "effects with training"),
        ({"dry_run": True, "executor": "ray"}, "--dry-run with --executor ray"),
    ],
)
def test_what_would_do_nothing_is_refused(registry, told, says):
    with pytest.raises(UsageError, match=says):
        populate(registry, load_robot("servo_pendulum"), 8, PopulateSettings(**told), training=TRAINING)


def test_shards_of_simulators_with_effects_have_one_size(registry):
    told = PopulateSettings(effects=True, like="log", shard_size=5)
    with pytest.raises(UsageError, match="effects with shard_size"):
        populate(registry, load_robot("servo_pendulum"), 8, told)
