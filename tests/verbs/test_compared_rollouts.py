"""Held-out errors of simulators of robots without wheels: the truth wins, a copy ties, what was fitted is left out."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import dynreg
from dynreg.compare.rollouts import score
from dynreg.errors import UsageError
from dynreg.evidence.truth import Hidden, hide, log_of, protocol
from dynreg.report import comparison as words
from dynreg.results import Comparison
from dynreg.session import Session
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.compare import _too_long
from dynreg.verbs.simulator import Simulator
from dynreg.verbs.unseen import seen


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


@pytest.fixture(scope="module")
def hidden(robot: Robot) -> Hidden:
    return hide(robot, (term("load_friction"),), "strong", 11)


@pytest.fixture(scope="module")
def registry(robot: Robot, hidden: Hidden, tmp_path_factory: pytest.TempPathFactory) -> Session:
    recording = log_of(robot, hidden, protocol(robot, seed=1, seconds=12.5), engine="mujoco")
    with dynreg.open(tmp_path_factory.mktemp("rollouts") / "registry") as session:
        session.ingest(recording, robot, name="bench")
        yield session


def put(registry: Session, robot: Robot, values: np.ndarray, effects: dict | None = None, **lineage) -> str:
    config = SimConfig.of(robot, values, effects)
    return registry.registry.put_simulator(config.as_dict() | {"lineage": lineage})


@pytest.fixture(scope="module")
def found(registry: Session, robot: Robot, hidden: Hidden) -> Comparison:
    sizes = zip(hidden.terms[0].effect.parameters, hidden.values[0], strict=True)
    effects = {hidden.terms[0].key: {p.name: float(v) for p, v in sizes}}
    truth = put(registry, robot, hidden.parameters, effects, kind="true")
    copy = put(registry, robot, robot.space.nominal * (1 + 1e-12), kind="copied")
    return registry.compare("bench", simulators=["nominal", truth, copy], threads=1)


def test_the_truth_errs_less_than_the_nominal_simulator_and_a_copy_ties(found: Comparison) -> None:
    rollouts = found.rollouts
    nominal, true, copied = rollouts.names
    assert found.commands is None and rollouts.best == true and rollouts.alike == ()
    assert [h.seconds for h in rollouts.horizons] == pytest.approx([0.1, 0.5, 1.0, 2.5], abs=0.02)
    assert rollouts.channels == ("arm/position", "arm/velocity") and rollouts.unscored == ("arm/velocity",)
    gains = [
        [rollouts.score(true, channel, h.seconds).gain.value for h in rollouts.horizons]
        for channel in (None, "arm/position", "arm/velocity")
    ]
    assert gains[0] == pytest.approx(gains[1]) and gains[0] != pytest.approx(gains[2])
    assert len(rollouts.episodes) == 5
    for channel in (None, *rollouts.channels):
        for horizon in rollouts.horizons:
            better = rollouts.score(true, channel, horizon.seconds)
            assert better.low <= better.error <= better.high and better.unit != ""
            same = rollouts.score(copied, channel, horizon.seconds)
            assert same.tie and same.error == pytest.approx(
                rollouts.score(nominal, channel, horizon.seconds).error
            )
        longest = rollouts.score(true, channel, rollouts.horizons[-1].seconds)
        assert not longest.tie and longest.gain.low > 0.5
    assert f"{true} errs least" in str(found) and f"less than {nominal}" in str(found)
    assert {*rollouts.traces[0].simulators} == {*rollouts.names}


def test_what_only_differs_by_less_than_the_sensor_tells_is_a_tie(registry: Session, robot: Robot) -> None:
    """A servo with 0.05 % more dry friction is better in each episode, by a tenth of the encoder's noise."""
    values = robot.space.as_dict(robot.space.nominal)
    rougher = robot.space.from_dict(values | {"coulomb_friction": 1.0005 * values["coulomb_friction"]})
    rollouts = registry.compare(
        "bench", simulators=["nominal", put(registry, robot, rougher, kind="near")], threads=1
    ).rollouts
    near = rollouts.score(rollouts.names[1], "arm/position", rollouts.horizons[-1].seconds)
    assert near.gain.low > 0 and near.tie and len(rollouts.alike) == 1
    assert "tie" in str(rollouts)


def test_nothing_named_compares_nominal_with_what_results_found(registry: Session, robot: Robot) -> None:
    with pytest.raises(UsageError, match="1 to compare; expected two simulators"):
        registry.compare("bench")
    recording = registry.show("bench").id
    made = put(registry, robot, robot.space.nominal * 1.01, kind="calibrated", made_by="diagnose")
    parts = {"fit": ["fit_0"], "select": ["select_0"], "test": ["test_0"]}
    registry.registry.put_result(
        "diagnosis",
        recording,
        {"extended_simulator": None, "calibrated_simulator": made, "parts": parts},
    )
    rollouts = registry.compare("bench", threads=1).rollouts
    assert rollouts.names == ("nominal", f"diagnosed (calibrated {made[:8]})")
    assert {*rollouts.left_out} == {"fit_0", "select_0"} and "fit_0" not in rollouts.episodes
    (only,) = registry.compare("bench", hold_out="test_0", threads=1).rollouts.episodes
    assert only == "test_0"
    with pytest.raises(UsageError, match="every part of hold-out 'fit_0' was seen by one of the simulators"):
        registry.compare("bench", hold_out="fit_0", threads=1)


@pytest.fixture(scope="module")
def long(robot: Robot, hidden: Hidden) -> dynreg.Recording:
    """One run of 32 s."""
    recording = log_of(robot, hidden, protocol(robot, seed=2, seconds=160.0, episode=32.0), engine="mujoco")
    return dynreg.Recording(recording.channels, recording.episodes[-1:], False)


@pytest.mark.parametrize("horizon, held_out", [(None, 10), (5.0, 5)])
def test_windows_that_a_diagnosis_of_few_windows_held_out_are_unseen(
    robot: Robot, long: dynreg.Recording, horizon: float | None, held_out: int
) -> None:
    """Windows that were neither fitted nor held out count as seen: nothing says what the diagnosis did with them."""
    name = long.episodes[0].name
    nominal = SimConfig.of(robot, robot.space.nominal)
    parts = {"fit": [f"{name}[0]"], "select": [], "test": [f"{name}[1]"]}
    told = Simulator(
        None,
        "diagnosed",
        {},
        nominal,
        robot,
        None,
        frozenset({name}),
        parts,
        {"horizon": horizon, "windows": 1},
    )
    known = seen(SimpleNamespace(robot=robot, recording=long), told)
    begin = float(long.episodes[0].time[0]) + (horizon or 10.0)
    assert not known(name, begin + 0.2, begin + held_out - 0.2)
    assert known(name, begin - 0.5, begin + 1.0) and known(
        name, begin + held_out - 0.5, begin + held_out + 0.5
    )


def test_where_only_short_windows_were_held_out_the_longest_that_fit_are_compared(
    robot: Robot, long: dynreg.Recording
) -> None:
    """As of a diagnosis with a horizon of 1 s: no rollout of 10 s lies in what it held out."""
    begin = float(long.episodes[0].time[0]) + 12.0

    def known(episode: str, first: float, last: float) -> bool:
        return not (begin - 1e-6 <= first and last <= begin + 1.0 + 1e-6)

    rng = np.random.default_rng(0)
    values = (robot.space.nominal, robot.space.from_unit(rng.uniform(0.3, 0.7, len(robot.space))))
    simulators = {str(i): (robot, SimConfig.of(robot, one)) for i, one in enumerate(values)}
    found = score(robot, long, simulators, [known, known])
    assert [e.seconds for e in found.errors] == [0.1, 0.5, 1.0] and found.too_long == (10.0,)
    assert [e.rollouts for e in found.errors] == [10, 2, 1] and found.errors[-1].whole
    assert "rollouts of 10 s are left out: nothing so long was held out" in _too_long(found)[0]
    assert found.traces, "of the longest that are left"
    with pytest.raises(UsageError, match="every part of the recording was seen"):
        score(robot, long, simulators, [known, lambda *_: True])


def test_windows_of_one_episode_that_a_result_held_out_are_tested(
    robot: Robot, long: dynreg.Recording, tmp_path: Path
) -> None:
    """One run of 32 s is cut into windows of 10 s at most: what a diagnosis held out of it counts as unseen."""
    with dynreg.open(tmp_path / "registry") as session:
        identity = session.ingest(long, robot, name="long").recording
        made = put(session, robot, robot.space.nominal * 1.01, kind="calibrated")
        name = long.episodes[0].name
        parts = {"fit": [f"{name}[0]"], "select": [f"{name}[2]"], "test": [f"{name}[1]"]}
        document = {"extended_simulator": None, "calibrated_simulator": made, "parts": parts}
        session.registry.put_result("diagnosis", identity, document)
        rollouts = session.compare("long", threads=1).rollouts
    assert rollouts.horizons[-1].rollouts == 1 and rollouts.left_out == (f"{name}[0]", f"{name}[2]")
    assert [h.rollouts for h in rollouts.horizons[1:]] == [20, 10, 1], "all of them within the part held out"
    assert rollouts.within == 1
    assert "within that one run, and hold for it alone" in words.tested_words(rollouts)
    assert rollouts.score(rollouts.names[1], None, rollouts.horizons[-1].seconds).low is None, (
        "one rollout alone"
    )


def test_a_stored_comparison_of_the_first_version_reads(registry: Session) -> None:
    import made_up_comparison

    document = made_up_comparison.comparison().to_dict()
    commands = document.pop("commands")
    names = commands.pop("names")
    old = {k: v for k, v in document.items() if k != "rollouts"} | commands
    identity = registry.registry.put_result("comparison", None, old | {"schema": "dynreg/comparison/1"})
    read = registry.result(identity)
    assert read.commands.names == tuple(names) and read.rollouts is None
    assert read.commands == made_up_comparison.comparison().commands
