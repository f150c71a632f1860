"""Thresholds: paid once for commands that are alike, never beside them; their robots lack nothing of the start."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from edited_log import edited

from dynreg.data.recording import Recording
from dynreg.diagnose.diagnose import offered
from dynreg.diagnose.noise import TWICE, noisier, own_noise
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans import Short
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.tail import exceeded
from dynreg.diagnose.threshold import (
    FEW,
    LEAST,
    USUAL,
    Threshold,
    commands,
    known,
    level,
    null,
    null_data,
    null_robot,
    same,
    threshold,
)
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.lockstep import counted, run
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.rng import stream
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot

OFFERED = ("cogging", "payload")


@dataclass
class Shelf:
    """A cache of plain JSON in memory."""

    kept: dict[str, str] = field(default_factory=dict)

    def cached(self, kind: str, key: Any) -> Any:
        found = self.kept.get(json.dumps([kind, key], sort_keys=True))
        return None if found is None else json.loads(found)

    def cache(self, kind: str, key: Any, document: Any) -> None:
        self.kept[json.dumps([kind, key], sort_keys=True)] = json.dumps(document)


@dataclass(frozen=True)
class Case:
    """What a threshold is found for."""

    problem: Problem
    recording: Recording
    options: DiagnosisOptions

    def paid(self, shelf: Shelf) -> bool:
        """Whether anything has to be simulated to tell the threshold."""
        search = threshold(self.problem, self.recording, self.options, shelf)
        try:
            search.send(None)
        except StopIteration:
            return False
        return True


def logged(seed: int = 3, moves: int = 1) -> Recording:
    """The log of a robot without an effect."""
    robot = load_robot("servo_pendulum")
    plan = protocol(robot, seed=moves, seconds=7.5, episode=1.5)
    return log_of(robot, hide(robot, (), None, seed), plan, engine="mujoco")


def posed(robot: Robot, recording: Recording, start: SimConfig | None = None, **asked: Any) -> Case:
    options = DiagnosisOptions(**{"hold_out": "test_0", "threads": 1, "threshold_runs": 1} | asked)
    model, data = pose(robot, recording, options, start)
    return Case(Problem(model, data, tuple(single_terms(robot, OFFERED)), Short()), recording, options)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


@pytest.fixture(scope="module")
def recording() -> Recording:
    return logged()


@pytest.fixture(scope="module")
def case(robot: Robot, recording: Recording) -> Case:
    return posed(robot, recording)


@pytest.fixture(scope="module")
def shelf(case: Case) -> Shelf:
    """The cache after the case's threshold was found."""
    shelf = Shelf()
    found, many = run(counted(threshold(case.problem, case.recording, case.options, shelf)))
    assert many > 0 and not found.cached and found.nats == max(USUAL, *found.scores)
    return shelf


def started(robot: Robot, size: float = 0.05, **values: float) -> SimConfig:
    """The nominal robot with cogging and these parameters."""
    nominal = robot.space.as_dict(robot.space.nominal)
    (first, *others) = term("cogging").effect.parameters
    sizes = {first.name: size} | {p.name: p.medium for p in others}
    return SimConfig(robot.hash, robot.name, nominal | values, {"cogging": sizes})


# ---- what pays nothing, and what does ----


def column(recording: Recording, name: str) -> int:
    return recording.names.index(name)


def noised(recording: Recording, name: str, sigma: float) -> Recording:
    rng = stream(0, "test noise", name)

    def edit(_: int, values: np.ndarray) -> None:
        values[:, column(recording, name)] += sigma * rng.standard_normal(len(values))

    return edited(recording, edit)


def a_row_late(recording: Recording) -> Recording:
    """The commands of every other episode come a row later."""

    def edit(number: int, values: np.ndarray) -> None:
        target = values[:, column(recording, "arm/target")]
        target[1:] = target[:-1].copy() if number % 2 else target[1:]

    return edited(recording, edit)


def later(recording: Recording) -> Recording:
    episodes = [replace(e, time=e.time + 100.0) for e in recording.episodes]
    return replace(recording, episodes=tuple(episodes))


ALIKE: dict[str, Callable[[Recording], Recording]] = {
    "the same log": lambda log: log,
    "another robot's, with other noise, starts and spread": lambda log: logged(seed=4),
    "another supply": lambda log: noised(log, "supply", 0.05),
    "a logger's clock": a_row_late,
    "another time of day": later,
    "noise as stated": lambda log: noised(
        log, "arm/position", 0.5 * load_robot("servo_pendulum").sensor_noise[0]
    ),
}


@pytest.mark.parametrize("other", ALIKE.values(), ids=ALIKE)
def test_a_second_recording_of_the_same_commands_pays_nothing(other, robot, recording, shelf):
    again = posed(robot, other(recording))
    assert not again.paid(shelf)
    found, many = run(counted(threshold(again.problem, again.recording, again.options, shelf)))
    assert many == 0 and found.cached and len(found.scores) == 1


def noisy(recording: Recording) -> Recording:
    return noised(recording, "arm/position", 3.0 * load_robot("servo_pendulum").sensor_noise[0])


def switched_off(recording: Recording) -> Recording:
    """The drive is off for the first half of an episode that moves."""

    def edit(number: int, values: np.ndarray) -> None:
        if number in (0, 2):
            values[: len(values) // 2, column(recording, "arm/enabled")] = 0.0

    return edited(recording, edit)


def stated(robot: Robot, folder: Path) -> Robot:
    """The robot with another stated noise of its first channel, in a folder of its own."""
    shutil.copytree(robot.folder, folder)
    table = folder / "robot.toml"
    text = table.read_text(encoding="utf-8")
    noise = f"noise = {robot.file.channels[0].noise:g}"
    assert noise in text
    table.write_text(text.replace(noise, "noise = 0.0006", 1), encoding="utf-8")
    return load_robot(folder)


def with_gaps(recording: Recording) -> Recording:
    """Every third position is missing."""

    def edit(_: int, values: np.ndarray) -> None:
        values[1::3, column(recording, "arm/position")] = np.nan

    return edited(recording, edit)


def slower(case: Case) -> Case:
    """The same commands, each half as long again."""
    data = case.problem.data
    period = 1.5 * data.windows.period
    windows = replace(data.windows, period=period, run=replace(data.windows.run, period=period))
    return replace(case, problem=replace(case.problem, data=replace(data, windows=windows)))


def planned_otherwise(case: Case) -> Case:
    return replace(case, problem=replace(case.problem, plan=Short(iterations=1)))


def with_less(case: Case) -> Case:
    return replace(case, problem=replace(case.problem, terms=case.problem.terms[:-1]))


def other_engine(robot: Robot, case: Case) -> str:
    return next(name for name in robot.engines if name != case.problem.model.running)


OTHERS: dict[str, Callable[[Case, Robot, Recording], Case]] = {
    "commands": lambda c, robot, log: posed(robot, logged(moves=2)),
    "windows": lambda c, robot, log: posed(robot, log, horizon=1.0),
    "another rate of the same commands": lambda c, robot, log: slower(c),
    "rows that were measured": lambda c, robot, log: posed(robot, with_gaps(log)),
    "parts": lambda c, robot, log: posed(robot, log, hold_out="fit_0"),
    "settings": lambda c, robot, log: posed(robot, log, tolerance=2.0),
    "a drive that was off": lambda c, robot, log: posed(robot, switched_off(log)),
    "seed": lambda c, robot, log: posed(robot, log, seed=1),
    "runs": lambda c, robot, log: posed(robot, log, threshold_runs=2),
    "joints": lambda c, robot, log: posed(robot, log, joints=("arm",)),
    "engine": lambda c, robot, log: posed(robot, log, engine=other_engine(robot, c)),
    "effects offered": lambda c, robot, log: with_less(c),
    "effects of the start": lambda c, robot, log: posed(robot, log, started(robot)),
    "plan": lambda c, robot, log: planned_otherwise(c),
    "noise more than twice as stated": lambda c, robot, log: posed(robot, noisy(log)),
}


@pytest.mark.parametrize("what", OTHERS)
def test_what_scores_depend_on_is_paid_for(what: str, case: Case, robot: Robot, recording: Recording, shelf):
    assert not case.paid(shelf) and OTHERS[what](case, robot, recording).paid(shelf)


def test_another_stated_noise_is_paid_for(robot: Robot, recording: Recording, shelf, tmp_path: Path):
    assert posed(stated(robot, tmp_path / "noisier"), recording).paid(shelf)


def test_other_sizes_or_parameters_of_the_start_are_paid_for(robot: Robot, recording: Recording, shelf):
    parameter = next(p for p in robot.space.parameters if np.isfinite(p.tolerance) and not p.known)
    starts = [
        started(robot),
        started(robot, size=0.06),
        started(robot, **{parameter.name: 1.1 * parameter.nominal}),
    ]
    for start in starts:
        one = posed(robot, recording, start)
        assert one.paid(shelf)
        key = Keys()
        one.paid(key)
        row = {"commands": commands(one.problem.data).tolist(), "ratios": [1.0], "scores": [7.0]}
        shelf.cache("threshold", key.asked, {"found": [row]})
        assert not one.paid(shelf)


class Keys(Shelf):
    """A cache that remembers what it was asked for."""

    asked: Any = None

    def cached(self, kind: str, key: Any) -> None:
        self.asked = key


def test_a_log_with_its_own_noise_has_a_threshold_of_its_own_beside_the_other(robot, recording, case, shelf):
    """Kept in its turn, for all logs of such a sensor; its robots are measured as noisily."""
    loud = posed(robot, noisy(recording))
    noise = own_noise(robot, loud.recording)
    assert list(noise) == ["arm/position"] and noise["arm/position"] > TWICE * robot.sensor_noise[0]
    assert own_noise(robot, recording) == {} and noisier(robot, {}) is robot
    found = run(threshold(loud.problem, loud.recording, loud.options, shelf))
    assert not found.cached and not loud.paid(shelf) and not case.paid(shelf)
    louder = posed(robot, noised(logged(seed=5), "arm/position", 3.1 * robot.sensor_noise[0]))
    assert not louder.paid(shelf)
    measured = [
        run(null_data(loud.problem, one, 7)).windows.measured[..., 0]
        for one in (robot, noisier(robot, noise))
    ]
    quiet, heard = (np.median(np.abs(np.diff(m, n=3, axis=1))) for m in measured)
    assert heard > TWICE * quiet


def test_what_the_log_moved_is_no_unit_of_its_robots_errors(robot, case):
    problem = case.problem
    windows = problem.data.windows
    wider = replace(
        problem, data=replace(problem.data, windows=replace(windows, spread=3.0 * windows.spread))
    )
    one, other = (run(null_data(p, robot, 7)).windows for p in (problem, wider))
    assert np.array_equal(one.spread, other.spread) and np.array_equal(one.measured, other.measured)


def test_two_sets_of_commands_are_kept_under_one_key(robot, recording, case):
    shelf, other = Shelf(), posed(robot, logged(moves=2))
    for one in (case, other):
        search = threshold(one.problem, one.recording, one.options, shelf)
        run(search)
    assert len(shelf.kept) == 1 and not case.paid(shelf) and not other.paid(shelf)


def test_commands_of_other_shapes_are_others(case):
    told = commands(case.problem.data)
    assert same(told, told) and not same(told, told[:-1]) and not same(told, told + 0.1)


def test_what_only_the_test_part_shows_is_not_looked_at_before_it_is_judged(robot, recording):
    """Its noise set the threshold, and a supply that sags there alone left an effect out."""
    held = [e.name for e in recording.episodes[2:]]
    rng, position, supply = stream(0, "noise"), column(recording, "arm/position"), column(recording, "supply")

    def edit(number: int, values: np.ndarray) -> None:
        if number >= 2:
            values[:, position] += 4.0 * robot.sensor_noise[0] * rng.standard_normal(len(values))
            values[5:, supply] -= 0.3

    odd = edited(recording, edit)
    one = posed(robot, odd, hold_out=",".join(held))
    assert own_noise(robot, odd) and not own_noise(robot, one.problem.train_part(odd))
    key = Keys()
    one.paid(key)
    assert key.asked["noise"] == {}
    asked = DiagnosisOptions(effects=("voltage_sag",), hold_out=",".join(held), threads=1)
    model, data = pose(robot, odd, asked)
    assert [t.key for t in offered(model, data, asked)] == ["voltage_sag"]


# ---- the level ----


def test_the_level_is_what_one_robot_in_a_hundred_exceeds():
    scores = np.random.default_rng(0).exponential(5.0, 4000)
    assert exceeded(scores[:200], 0.01) == pytest.approx(5.0 * np.log(100.0), rel=0.25)
    assert exceeded(scores, 0.01) == pytest.approx(5.0 * np.log(100.0), rel=0.05)
    assert level(FEW * [0.1]) == LEAST and exceeded([3.0], 0.01) == 3.0 and exceeded([1.0, 9.0], 0.01) > 9.0


def test_few_robots_set_a_level_that_is_seldom_too_low():
    rng = np.random.default_rng(0)
    levels = [level(rng.exponential(5.0, 20)) for _ in range(400)]
    assert 0.75 < np.mean(np.array(levels) > 5.0 * np.log(100.0)) < 0.9


@pytest.mark.parametrize("runs", range(1, FEW))
def test_a_few_robots_make_the_threshold_no_looser_than_none_do(runs: int):
    """One or two that scored nothing took it from 20 nats to 5."""
    assert level(runs * [0.0]) == USUAL and level(runs * [30.0]) >= 30.0


def test_where_nothing_was_simulated_the_usual_threshold_holds(case):
    asked = replace(case.options, threshold_runs=0)
    assert run(counted(threshold(case.problem, case.recording, asked)))[0].nats == USUAL
    assert run(known(Threshold(7.0, ()))).nats == 7.0


# ---- robots that lack nothing ----


def test_robots_that_lack_nothing_are_drawn_about_the_start_and_have_its_effects(robot, recording):
    parameter = next(p for p in robot.space.parameters if np.isfinite(p.tolerance) and not p.known)
    index = robot.space.parameters.index(parameter)
    off = parameter.nominal * (1.0 + 3.0 * parameter.tolerance)
    start = started(robot, size=0.05, **{parameter.name: off})
    model = posed(robot, recording, start).problem.model
    drawn = [null_robot(model, seed) for seed in range(30)]
    assert all([t.key for t in one.terms] == ["cogging"] for one in drawn)
    assert all(one.values[0] == pytest.approx([*start.effects["cogging"].values()]) for one in drawn)
    values = [one.parameters[index] for one in drawn]
    assert np.median(values) == pytest.approx(off, abs=1.5 * parameter.tolerance * parameter.nominal)


def test_without_a_start_they_are_drawn_about_the_nameplate_and_have_no_effects(case, robot):
    one, same = null_robot(case.problem.model, 7), hide(robot, (), None, 7)
    assert one.terms == () and one.values == ()
    assert np.array_equal(one.parameters, same.parameters)


def test_effects_beyond_what_a_fit_reaches_are_simulated_as_far_as_it_does(robot, recording):
    model = posed(robot, recording, started(robot, size=1e4)).problem.model
    most = model.coordinates.effect_values(model.start.hypothesis, model.start.effect[None])[0][0]
    assert null_robot(model, 0).values[0] == pytest.approx(most) and most[0] < 1e4


def test_an_effect_of_the_start_is_no_cause_that_a_simulated_robot_lacks(robot, recording):
    """Where nothing else is offered no cause is scored; where there is, the simulated robots lack little of it."""
    problem = posed(robot, recording, started(robot, size=0.07)).problem
    nats, left = run(null(replace(problem, terms=(term("cogging"),)), robot, 3))
    assert nats == 0.0 and 0.5 < left < 3.0
    assert run(null(problem, robot, 3))[0] < USUAL
