"""Comparisons on robots whose truth is known: the model that is true wins, and numbers do not depend on the run."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driven_robot import commands, config, logged

import dynreg
from dynreg.compare.compare import parts
from dynreg.data.recording import Recording
from dynreg.errors import LogError, NoMatchError, UsageError
from dynreg.results import Comparison
from dynreg.session import Session
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.compare import CompareSettings

QUICK = {"starts": 1, "generations": 4, "threads": 1}
CLOCK = {"commands": {"paces"}, "cost": True}  # what differs from run to run
# of all models together: what an analysis of variance says of an axis, and of a pair
POOLED, POOLED_OF_PAIR = {"f", "p"}, {"low", "high", "tukey", "paired"}
LAGS = {"speed_lag": 0.15, "yaw_lag": 0.18, "yaw_drag": 1.04}  # of the hidden robot


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("diffdrive")


@pytest.fixture(scope="module")
def log(robot: Robot) -> Recording:
    """240 commands in two runs, with a tenth of the sensors' noise."""
    told = [commands(robot, many, seed) for many, seed in ((150, 1), (90, 2))]
    return logged(robot, config(robot, LAGS), told, engine="unicycle", noise=0.1)


@pytest.fixture(scope="module")
def registry(tmp_path_factory: pytest.TempPathFactory, log: Recording) -> Session:
    session = dynreg.open(tmp_path_factory.mktemp("compare") / "registry")
    session.ingest(log, "diffdrive", name="monday")
    yield session
    session.close()


@pytest.fixture(scope="module")
def found(registry: Session) -> Comparison:
    return registry.compare("monday", simulators=["nominal"], **QUICK)


def test_the_model_that_the_robot_is_wins_on_every_axis(found: Comparison) -> None:
    """Two of six parameters are far from nominal: neither the closed form nor the nominal simulator knows them."""
    assert (
        found.commands.names == ("nominal", "kinematic", "dynamic", "table", "network", "mlp")
        and found.commands.best == "dynamic"
    )
    assert (
        found.commands.parts == {"fit": 164, "validation": 38, "test": 38}
        and found.commands.errors.commands == 38
    )
    for axis in found.commands.axes:
        (pair,) = (
            p
            for p in found.commands.errors.pairs
            if {p.first, p.second} == {"kinematic", "dynamic"} and p.axis == axis
        )
        assert pair.first == "kinematic" and pair.difference > 0 and pair.tukey < 0.05 and pair.paired < 0.05
        mean = {name: found.commands.errors.models[name][axis].mean for name in found.commands.names}
        assert mean["dynamic"] < mean["nominal"] < mean["kinematic"] and mean["mlp"] < mean["kinematic"]
    ends = found.commands.paths.models
    assert found.commands.paths.runs == 3 and ends["dynamic"].mean < 0.5 * ends["kinematic"].mean
    assert "kinematic" not in found.commands.alike() and str(found).startswith(
        "monday: On the last 38 commands, dynamic"
    )


def _leaves(part: object, place: str = "") -> dict[str, object]:
    """What a document holds, by its place."""
    if not isinstance(part, dict | list | tuple):
        return {place: part}
    items = part.items() if isinstance(part, dict) else enumerate(part)
    return {at: leaf for key, value in items for at, leaf in _leaves(value, f"{place}.{key}").items()}


def _of_networks(place: str, first: dict[str, object]) -> bool:
    """Whether a number is of the networks, of a pair with them, or pools all models: MINPACK's rounding reaches it."""
    parts = place.split(".")
    if "pairs" in parts:
        pair = ".".join(parts[: parts.index("pairs") + 2])
        return "network" in (first[f"{pair}.first"], first[f"{pair}.second"]) or parts[-1] in POOLED_OF_PAIR
    return "network" in parts or ("variance" in parts and parts[-1] in POOLED)


def test_the_same_seed_gives_the_same_numbers_on_any_threads(registry: Session, found: Comparison) -> None:
    """The same bytes but for the networks, whose MINPACK rounds differently from run to run."""
    again = registry.compare("monday", simulators=["nominal"], **QUICK | {"threads": 2})
    first, second = (
        _leaves(result.model_dump(exclude={"commands": {"paces"}, "cost": True})) for result in (found, again)
    )
    assert first.keys() == second.keys()
    rounded = {place for place in first if isinstance(first[place], float) and _of_networks(place, first)}
    assert len(rounded) < sum(isinstance(value, float) for value in first.values()) / 2
    for place, value in first.items():
        assert second[place] == (pytest.approx(value, rel=1e-3, abs=1e-6) if place in rounded else value), (
            place
        )
    other = registry.compare("monday", models=["kinematic", "network"], seed=1, starts=1)
    assert other.commands.errors.models["network"] != found.commands.errors.models["network"]
    assert other.commands.errors.models["kinematic"] == found.commands.errors.models["kinematic"]


def test_a_comparison_is_stored_and_comes_back(registry: Session, robot: Robot, tmp_path: Path) -> None:
    made = registry.compare("monday", models=["kinematic"], simulators=["nominal"])
    assert registry.result("@last") == made == registry.result("monday")
    with dynreg.open(tmp_path / "copy") as other:  # a log by its path is registered once it was compared
        path = tmp_path / "run.csv"
        registry.recording("monday").to_frame().query("episode == 'run_0'").drop(columns="episode").to_csv(
            path, index=False
        )
        other.compare(path, models=["kinematic"], simulators=["nominal"], robot="diffdrive")
        assert [i.kind for i in other.list().items] == ["recording", "result", "robot"]


def test_predictions_take_time_and_the_closed_form_is_the_measure(found: Comparison) -> None:
    paces = {pace.model: pace for pace in found.commands.paces}
    assert paces["nominal"].one_by_one is None and paces["nominal"].at_once > 0
    assert paces["dynamic"].one_by_one_ratio > 5 and paces["dynamic"].fit > 0
    assert paces["kinematic"].at_once < paces["kinematic"].one_by_one


def test_parts_follow_each_other_in_the_published_shares() -> None:
    assert parts(1460) == (slice(0, 1000), slice(1000, 1230), slice(1230, 1460))
    assert parts(64) == (slice(0, 44), slice(44, 54), slice(54, 64))
    with pytest.raises(
        LogError, match="the recording holds 60 commands, 9 of them to test on; expected at least 64"
    ):
        parts(60)


def test_a_simulator_is_told_of_where_it_may_have_seen_commands_to_test(
    registry: Session, robot: Robot, log: Recording
) -> None:
    """The test part lies in the second episode."""
    store, identity = registry.registry, registry.recording("monday").id
    lineage = {"made_by": "diagnose", "kind": "calibrated", "recording": identity}
    parts = {"fit": ["run_0[0]", "run_0[3]"], "select": ["run_0[1]"], "test": ["run_1"]}

    def notes(simulator: str) -> str:
        return " ".join(registry.compare("monday", models=["kinematic"], simulators=[simulator]).notes)

    assert "fitted" not in notes("nominal")
    made = config(robot, {"yaw_lag": 0.17}).as_dict() | {"lineage": lineage}
    simulator = store.put_simulator(made)
    assert "was fitted to this recording, and it is not known to which part" in notes(simulator)
    other = store.put_simulator(
        config(robot, {"yaw_lag": 0.16}).as_dict() | {"lineage": lineage | {"recording": "ab" * 32}}
    )
    assert "fitted" not in notes(other)
    document = {"extended_simulator": None, "calibrated_simulator": simulator, "parts": parts}
    store.put_result("diagnosis", identity, document)
    assert "fitted" not in notes("diagnosed") and "fitted" not in notes(simulator)
    store.put_result("diagnosis", identity, document | {"parts": parts | {"select": ["run_1[2]"]}})
    for ref in ("diagnosed", simulator):
        assert "was fitted to episodes that hold 38 of the 38 test commands" in notes(ref)
    found = registry.compare("monday", models=["kinematic", "table"], simulators=["nominal", simulator])
    seen = found.commands.names[1]
    assert found.commands.errors.seen == (seen,) and seen in found.commands.errors.models
    assert found.commands.best != seen and seen not in found.commands.alike()
    assert len(found.commands.errors.pairs) == 3 * 3
    assert not [p for p in found.commands.errors.pairs if seen in (p.first, p.second)]
    assert f"{seen} may have seen them, and does not count" in str(found.commands)


def test_what_cannot_be_compared_is_refused(registry: Session, robot: Robot, log: Recording) -> None:
    for asked, says in (
        ({"models": ["magic"]}, "models 'magic'"),
        ({"longest": 0.0}, "longest 0; expected a number above 0"),
        ({"starts": 0}, "starts 0"),
    ):
        with pytest.raises(UsageError, match=says):
            CompareSettings(**asked)
    for asked in ({"models": ["kinematic"] * 2, "simulators": []}, {"models": [], "simulators": ["nominal"]}):
        with pytest.raises(UsageError, match="1 to compare; expected two simulators"):
            registry.compare("monday", **asked)
    with pytest.raises(NoMatchError, match="is called 'nowhere'"):
        registry.compare("monday", simulators=["nowhere"])
    short = Recording(log.channels, log.episodes[1:])
    registry.ingest(short, "diffdrive", name="short")
    with pytest.raises(
        LogError, match="62 of 90 commands are there to fit model 'network'.*206 in all"
    ) as told:
        registry.compare("short")
    assert str(told.value).endswith("--models kinematic,dynamic,table,mlp")
    for models, simulators, advice in (
        (["kinematic", "network"], [], "--models kinematic --with nominal"),
        (["network"], ["nominal"], "--models kinematic"),
    ):
        with pytest.raises(LogError) as told:
            registry.compare("short", models=models, simulators=simulators)
        assert str(told.value).endswith(f"leave it out: {advice}")
    before = len(registry.registry.ids("result"))
    straight = [np.tile(commands(robot, 100, 3)[:, :1], 2)]
    registry.ingest(logged(robot, config(robot), straight), "diffdrive", name="straight")
    with pytest.raises(LogError, match="no two of the 68 commands to fit differ in dx") as told:
        registry.compare("straight", models=["kinematic", "dynamic"])
    assert str(told.value).endswith("--models kinematic")
    assert len(registry.registry.ids("result")) == before


def test_models_without_wheels_and_logs_without_a_pose_are_refused(registry: Session, log: Recording) -> None:
    columns = [i for i, name in enumerate(log.names) if not name.startswith("base/")]
    blind = Recording(
        tuple(log.channels[i] for i in columns),
        tuple(replace(e, values=e.values[:, columns]) for e in log.episodes),
    )
    registry.ingest(blind, "diffdrive", name="blind")
    with pytest.raises(LogError, match="no channel 'base/x'"):
        registry.compare("blind")
    bench = load_robot("servo_pendulum")
    registry.ingest(logged(bench, config(bench), [commands(bench, 5, 1)]), "servo_pendulum", name="bench")
    for name, value, said in (
        ("models", ["kinematic"], "--models kinematic"),
        ("starts", 3, "--starts 3"),
        ("generations", 9, "--generations 9"),
        ("longest", 0.5, "--longest 0.5"),
    ):
        with pytest.raises(
            UsageError, match=f"{said} has no meaning for robot 'servo_pendulum', which has no wh"
        ):
            registry.compare("bench", **{name: value})


def test_commands_that_are_short_or_have_no_pose_are_told_of(registry: Session, robot: Robot) -> None:
    quick = logged(robot, config(robot), [commands(robot, 120, 4, (0.02, 0.06))])
    (episode,) = quick.episodes
    values = episode.values.copy()
    values[-60::4, quick.names.index("base/x")] = np.nan
    holed = Recording(quick.channels, (replace(episode, values=values),))
    registry.ingest(holed, "diffdrive", name="quick")
    found = registry.compare("quick", models=["kinematic"], simulators=["nominal"])
    text = " ".join(found.notes)
    assert (
        "half of the commands last 0.04 s or less" in text
        and "no pose was measured at their begin or end: " in text
    )
    assert found.commands.paths is None and not found.commands.driven and "no ten commands in a row" in text
    assert sum(found.commands.parts.values()) < 120
