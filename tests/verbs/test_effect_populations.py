"""Populations of effects in a registry: grown, asked, used by diagnoses; and nobody takes them for models."""

from dataclasses import replace
from functools import partial

import pytest

from dynreg.diagnose.guided import keep, kept
from dynreg.errors import NoMatchError, UsageError
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.executor import Local
from dynreg.neighbours.entries import Stopwatch
from dynreg.session import Session, open
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot
from dynreg.verbs.datasets import dataset, population_frame
from dynreg.verbs.effect_populations import begin, fill_span, hold, posed
from dynreg.verbs.export_dataset import export_dataset
from dynreg.verbs.models import dynamics_model, entry_distance, near_entries
from dynreg.verbs.populations import fill
from dynreg.verbs.simulators import stored
from dynreg.verbs.subjects import population_for, recorded

SATURATES = {"torque_limit", "duty_limit"}  # one limit by two names, which no log of a duty servo tells apart

ROBOT = "servo_pendulum"
FEW, MORE = 260, 400


def recording_of(seed: int, cause: str | None):
    robot = load_robot(ROBOT)
    plan = protocol(robot, seed=seed, seconds=20.0)
    hidden = hide(robot, (term(cause),) if cause else (), "strong", 77)
    return log_of(robot, hidden, plan, engine="joint")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    opened = open(tmp_path_factory.mktemp("effects") / "registry")
    opened.ingest(recording_of(5, "torque_limit"), ROBOT, name="monday")
    opened.ingest(recording_of(6, None), ROBOT, name="tuesday")
    return opened


@pytest.fixture(scope="module")
def grown(session: Session) -> tuple[str, tuple[str, ...]]:
    """Id of the population like monday's log, and the ids of its first entries before it grew."""
    few = session.populate(ROBOT, FEW, effects=True, like="monday")
    assert few.entries == few.added == FEW
    before = session.registry.load(few.population, ()).ids
    more = session.populate(ROBOT, MORE, effects=True, like="monday")
    assert more.population == few.population and more.added == MORE - FEW
    return few.population, before


def test_a_population_grows_and_its_first_entries_stay(session, grown) -> None:
    identity, before = grown
    after = session.registry.load(identity, ()).ids
    assert len(after) == MORE and after[:FEW] == before
    assert session.verify().clean


def test_a_worker_poses_the_recording_anew_and_makes_the_same_entries(grown, tmp_path) -> None:
    with open(tmp_path / "other") as other:
        registry = other.registry
        for seed, cause, name in ((5, "torque_limit", "monday"), (6, None, "tuesday")):
            other.ingest(recording_of(seed, cause), ROBOT, name=name)
        monday, tuesday = (
            posed(recorded(registry, name, None, None, ingest=False), 0, 1) for name in ("monday", "tuesday")
        )
        identity = begin(registry, load_robot(ROBOT), monday, FEW)
        hold(tuesday, 1)  # as a worker that has made entries of another population
        assert fill(registry, identity, Local(1), Stopwatch(), lambda _: None, fill_span) == FEW
        assert (identity, registry.load(identity, ()).ids) == grown


def test_a_query_shows_what_the_recording_looks_like(session, grown) -> None:
    found = session.query("monday", k=5)
    assert found.schema_name() == "causes" and found.population == grown[0]
    assert found.causes[0].effect in SATURATES and not found.outside
    alike = [
        one for one in found.causes if one.effect in SATURATES
    ]  # the nearest are shared between the two names
    assert sum(one.near for one in alike) == pytest.approx(1.0) and found.causes[0].cosine > 0.95
    assert sum(one.belief for one in found.causes) == pytest.approx(1.0)


def test_the_nearest_entry_is_a_simulator_with_its_effect(session, grown) -> None:
    entry = session.query("monday").causes[0].entry
    simulator = stored(session.registry, "entry", entry)
    assert {*simulator.config.effects} <= SATURATES
    ((loss,),) = (values.values() for values in simulator.config.effects.values())
    assert loss == pytest.approx(0.40, abs=0.1)  # strong was hidden


def test_entries_do_not_carry_over_to_other_commands(session, grown) -> None:
    with pytest.raises(UsageError, match="other commands than 'tuesday'"):
        session.query("tuesday", population=grown[0])


def test_settings_that_mean_nothing_to_it_are_refused(session, grown) -> None:
    with pytest.raises(UsageError, match="--no-replay --hold-out 0.25 with population"):
        session.query("monday", hold_out="0.25", replay=False)
    assert session.query("monday", k=3, distance="one_sided").k == 3


def test_it_is_not_counted_as_simulators_to_ask(session, grown) -> None:
    assert session.ingest(recording_of(5, "torque_limit"), ROBOT, name="monday").simulators == 0


def test_it_is_no_population_of_models(session, grown) -> None:
    asked = recorded(session.registry, "monday", None, None, ingest=False)
    with pytest.raises(UsageError, match="no models"):
        population_for(asked, grown[0])
    with pytest.raises(NoMatchError):
        population_for(asked, None)


def test_what_would_lose_the_effects_is_refused(session, grown, tmp_path) -> None:
    registry, (entry, *_) = session.registry, session.registry.load(grown[0], ()).ids
    asked = [partial(export_dataset, registry, [ref], tmp_path / "out", "csv") for ref in (grown[0], entry)]
    asked += [partial(dataset, registry, [grown[0], "monday"]), partial(dynamics_model, registry, entry)]
    asked += [partial(near_entries, registry, entry, 3), partial(entry_distance, registry, entry, entry)]
    for ask in (*asked, partial(population_frame, registry, grown[0])):
        with pytest.raises(UsageError, match="has effects .* no models; .*export ENTRY --as robot"):
            ask()
    assert not (tmp_path / "out").exists()


def test_an_entry_shows_its_effect_and_no_loss_of_a_model(session, grown) -> None:
    shown = [session.show(one).detail for one in session.registry.load(grown[0], ()).ids[:30]]
    assert not any({"own_loss", "train_loss"} & set(detail) for detail in shown)
    bare = [detail for detail in shown if detail["effects"] == "none"]
    assert 0 < len(bare) < len(shown)
    for (values,) in (detail["effects"].values() for detail in shown if detail not in bare):
        assert values and all(isinstance(size, float) for size in values.values())


def test_a_diagnosis_finds_it_under_the_same_commands_alone(session, grown) -> None:
    for name, there in (("monday", True), ("tuesday", False)):
        given = posed(recorded(session.registry, name, None, None, ingest=False), 0, 1)
        assert (kept(given.problem, given.noise, session.registry) is not None) == there


def test_a_smaller_population_takes_no_larger_ones_place(session, grown) -> None:
    given = posed(recorded(session.registry, "monday", None, None, ingest=False), 0, 1)
    whole = kept(given.problem, given.noise, session.registry)
    fewer = replace(whole, carried=whole.carried[:50])
    keep(fewer, given.problem, given.noise, session.registry)
    assert len(fewer) == 50 and len(kept(given.problem, given.noise, session.registry)) == len(whole) == MORE


def test_a_diagnosis_tells_what_the_recording_looks_like(session, grown) -> None:
    how = {"threshold_runs": 0, "max_causes": 1}
    made = session.diagnose("monday", **how)
    assert made.resembles.causes[0] in SATURATES and made.resembles.entries == MORE
    assert made.causes[0].effect in SATURATES and not made.resembles.outside
    assert session.diagnose("monday", ranker="off", **how).resembles is None


@pytest.mark.parametrize("how", [{"effects": True}, {"like": "monday"}])
def test_effects_and_like_belong_together(session, how) -> None:
    with pytest.raises(UsageError, match="without --"):
        session.populate(ROBOT, 300, **how)


def test_too_few_entries_leave_effects_out(session) -> None:
    with pytest.raises(UsageError, match="20 simulators for"):
        session.populate(ROBOT, 20, effects=True, like="monday")
