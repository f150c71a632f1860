"""The whole diagnosis of a recorded hidden servo: result, simulators, storage; frozen, and the same in any company."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

import dynreg
from dynreg.data.recording import Episode, Recording
from dynreg.diagnose.account import Account, with_account
from dynreg.diagnose.diagnose import Diagnosed, diagnose, search
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import planned
from dynreg.diagnose.threshold import Threshold, known
from dynreg.errors import LogError
from dynreg.evidence.estimate import estimates
from dynreg.evidence.hypothesis import Coordinates
from dynreg.evidence.interval import posterior
from dynreg.evidence.lockstep import Search, run, together
from dynreg.evidence.truth import Hidden, hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    robot = load_robot("servo_pendulum")
    hidden = hide(robot, (term("cogging"),), "strong", 11)
    recording = log_of(robot, hidden, protocol(robot, seed=1), engine="mujoco")
    with dynreg.open(tmp_path_factory.mktemp("registry")) as registry:
        name = registry.ingest(recording, robot, name="hidden").recording
        found = registry.diagnose(
            name, hold_out="test_0,test_1,test_2,test_3", effects=["cogging", "payload"], threshold_runs=0
        )
        yield registry, robot, recording, found


def test_it_names_the_hidden_effect_and_says_what_it_gains(made):
    _, _, _, found = made
    assert found.verdict == "named" and found.causes[0].effect == "cogging"
    assert found.causes[0].gain.low > 0
    assert found.error.extended < 0.5 * found.error.calibrated
    assert set(found.parts["test"]).isdisjoint(found.parts["fit"] + found.parts["select"])


def test_the_extended_simulator_is_registered_with_its_lineage(made):
    registry, robot, _, found = made
    config = registry.registry.simulator(found.extended_simulator)
    assert set(config["effects"]) == {"cogging"} and config["robot"] == robot.hash
    assert config["lineage"]["made_by"] == "diagnose"
    assert config["values"] == {name: p.value for name, p in found.parameters.items()}


def test_a_recording_in_which_nothing_moves_is_refused(made):
    registry, robot, recording, _ = made
    still = tuple(
        Episode(e.name, e.time, np.tile(e.values[:1], (len(e.time), 1)), e.settings)
        for e in recording.episodes
    )
    registry.registry.put_recording(Recording(recording.channels, still, measured=False), robot.hash, "still")
    with pytest.raises(LogError, match="never change"):
        registry.diagnose("still", threshold_runs=0)


ASKED = DiagnosisOptions(
    hold_out="test_0",
    effects=("cogging", "payload"),
    max_causes=1,
    threshold_runs=1,
    threads=1,
)


def logged(*keys: str, seed: int = 11) -> tuple[Hidden, Recording]:
    """A servo with these strong effects, and its log."""
    robot = load_robot("servo_pendulum")
    hidden = hide(robot, tuple(term(key) for key in keys), "strong", seed)
    return hidden, log_of(robot, hidden, protocol(robot, seed=1, seconds=12.5), engine="mujoco")


def whole(*keys: str) -> Search[tuple[Diagnosed, Account]]:
    return with_account(diagnose(load_robot("servo_pendulum"), logged(*keys)[1], ASKED), ASKED)


def bits(value: Any) -> Any:
    """A diagnosis down to its last bit: what of it is a number, by name."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, Robot | Coordinates):
        return None
    if is_dataclass(value):
        return {f.name: bits(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {key: bits(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [bits(one) for one in value]
    return value.hex() if isinstance(value, float) else repr(value)


def test_diagnoses_in_lockstep_and_on_two_threads_are_those_made_alone():
    """Thresholds of their own, causes, intervals and what is left: the same to the last bit."""
    alone = [bits(run(whole(*keys))) for keys in (("cogging",), ())]
    beside = run(together([whole("cogging"), whole()]), threads=2)
    assert [bits(one) for one in beside] == alone
    assert [made.verdict for made, _ in beside] == ["named", "none"]


def test_the_share_of_a_parameter_says_what_it_alone_did_to_the_prediction():
    """Of a servo of the nameplate but for one parameter, calibration gains by that one."""
    robot = load_robot("servo_pendulum")
    number = robot.space.names.index("resistance")
    truth = robot.space.nominal.copy()
    truth[number] = 7.0
    log = log_of(robot, Hidden((), (), truth, 5), protocol(robot, seed=1, seconds=12.5), engine="mujoco")
    made, seen = run(with_account(diagnose(robot, log, replace(ASKED, threshold_runs=0)), ASKED))
    shares = dict(zip(made.problem.model.coordinates.free, seen.shares, strict=True))
    assert shares[number] > 0.8 and max(shares, key=shares.get) == number
    assert made.judged.gained(made.judged.START, made.judged.CALIBRATED).value > 0.9


def test_a_diagnosis_leaves_its_problem_as_it_was():
    _, recording = logged("cogging", "load_friction")
    model, data = pose(load_robot("servo_pendulum"), recording, ASKED)
    problem = run(planned(model, data, (term("cogging"), term("load_friction"))))
    before = bits(problem)
    made = run(search(problem, recording, known(Threshold(5.0, ())), replace(ASKED, max_causes=2)))
    assert made.found.accepted == 2 and made.problem is problem
    assert bits(problem) == before and not problem.model.corrections
    assert made.found.model.corrections, "what was corrected on the way is in a model of its own"


def test_what_takes_times_is_found_beyond_the_models_time_step():
    """The model's steps of 2.5 ms would put these off by more than their intervals are wide."""

    def sized(hidden: Hidden, recording: Recording) -> Search[tuple]:
        asked = replace(ASKED, effects=(hidden.key,), max_causes=1)
        model, data = pose(load_robot("servo_pendulum"), recording, asked)
        problem = yield from planned(model, data, hidden.terms)
        found = (yield from search(problem, recording, known(Threshold(1.0, ())), asked)).found
        draws = yield from posterior(found.model, found.current, found.data.sample(found.data.parts.chosen))
        return next(iter(estimates(found.model, found.current, 0, draws).values()))

    logs = [logged("speed_limit"), logged("command_delay")]
    for (hidden, _), size in zip(logs, run(together([sized(*log) for log in logs])), strict=True):
        assert size.low <= hidden.values[0][0] <= size.high
        assert size.high - size.low < 0.1 * size.value
