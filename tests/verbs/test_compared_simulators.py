"""Simulators that `compare` is told of: found by the words of every verb, each once and by a name of its own."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from driven_robot import commands, config, logged

import dynreg
from dynreg.errors import NoMatchError
from dynreg.session import Session
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.compare import named
from dynreg.verbs.subjects import recorded

DELAYED = {"command_delay": {"delay": 0.06}}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("diffdrive")


@pytest.fixture(scope="module")
def registry(tmp_path_factory: pytest.TempPathFactory, robot: Robot) -> Session:
    session = dynreg.open(tmp_path_factory.mktemp("compared") / "registry")
    session.ingest(logged(robot, config(robot), [commands(robot, 80, 1)]), "diffdrive", name="monday")
    yield session
    session.close()


def test_simulators_are_found_by_their_ids_and_by_results_that_recommend_one(
    registry: Session, robot: Robot
) -> None:
    store, log = registry.registry, registry.recording("monday").id
    truth = config(robot, {"yaw_lag": 0.15}, DELAYED)
    identity = store.put_simulator(truth.as_dict() | {"lineage": {"made_by": "diagnose", "kind": "extended"}})
    store.put_result("diagnosis", log, {"extended_simulator": None, "calibrated_simulator": identity})
    told_by = store.latest("diagnosis", log).id
    refs = [identity, identity[:10], told_by, "diagnosed", "nominal", "nominal"]
    found = registry.compare("monday", models=["kinematic"], simulators=refs)
    extended, nominal, model = found.contenders
    assert found.commands.names == (f"diagnosed (extended {identity[:8]})", "nominal", "kinematic")
    note = f"the newest diagnosis, {told_by[:12]}, named no cause: diagnosed is its calibrated simulator"
    assert note in found.notes
    assert (extended.simulator, extended.kind) == (identity, "extended simulator")
    assert (extended.parameters, extended.effects) == (truth.values, DELAYED)
    assert (nominal.simulator, nominal.kind) == (None, "nominal simulator")
    assert (model.simulator, model.kind) == (None, "closed form")


def test_an_earlier_diagnosis_that_named_a_cause_is_told(registry: Session, robot: Robot) -> None:
    store, log = registry.registry, registry.recording("monday").id
    kept = [
        store.put_simulator(
            config(robot, {"yaw_lag": lag}, DELAYED).as_dict() | {"lineage": {"kind": "extended"}}
        )
        for lag in (0.1, 0.2)
    ]
    cause = {"effect": "command_delay"}
    store.put_result("diagnosis", log, {"extended_simulator": kept[0], "causes": [cause]})
    earlier = store.latest("diagnosis", log).id[:12]
    store.put_result("diagnosis", log, {"extended_simulator": None, "calibrated_simulator": kept[1]})
    found = registry.compare("monday", models=["kinematic"], simulators=["nominal", "diagnosed"])
    assert any(f"An earlier one, {earlier}, named command_delay: --with {earlier}" in n for n in found.notes)
    alone = registry.compare("monday", models=["kinematic"], simulators=["nominal", earlier])
    assert not any("named no cause" in note for note in alone.notes)


def test_what_tells_no_simulator_is_refused(registry: Session) -> None:
    store, log = registry.registry, registry.recording("monday").id
    store.put_result("gait", log, {"robot": "diffdrive"})
    for ref, says in (
        (store.latest("gait", log).id, "of kind 'gait' tells no simulator"),
        ("monday", "monday"),
        ("nearest", "no 'nearest' simulator"),
    ):
        with pytest.raises(NoMatchError, match=says):
            registry.compare("monday", models=["kinematic"], simulators=[ref])


def test_entries_with_the_same_name_keep_apart(registry_folder: Path, tmp_path: Path, monkeypatch) -> None:
    shutil.copytree(registry_folder, tmp_path / "registry")
    with dynreg.open(tmp_path / "registry") as session:
        store = session.registry
        (population,) = store.populations()
        first, second = store.load(population.id, ()).ids[:2]
        asked = recorded(store, "bench", ingest=False)
        alone = named(asked, (first, first))
        assert [*alone] == ["servo_pendulum-0"]
        assert alone["servo_pendulum-0"].config.values == store.load_entry(first).values
        entry = store.load_entry
        monkeypatch.setattr(store, "load_entry", lambda ref: replace(entry(ref), number=7))
        names = [*named(asked, (first, second))]
        assert len({*names}) == 2 and all(name.startswith("servo_pendulum-7 ") for name in names)
