"""Diagnosis of some joints alone and of some windows, on the real SO-101 arm and on what it is made of."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynreg
from dynreg.diagnose.diagnose import no_candidates, offered
from dynreg.diagnose.joints import only_joints, terms_at
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem, planned
from dynreg.diagnose.threshold import USUAL, null
from dynreg.diagnose.unexplained import unexplained
from dynreg.errors import UsageError
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.lockstep import run
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.replay.parts import Parts, thinned
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot
from dynreg.verbs.diagnosis_words import not_looked_for

ARM = load_robot("so101")
MOTIONS = ("coupled_joints", "step_response", "inertia_coupling", "hold_under_gravity")


def test_a_joint_that_is_looked_at_alone_moves_as_among_the_others():
    moves = excitation(ARM, seed=3, episodes=2, steps=40)
    key = "backlash[elbow]", "command_delay[pitch]", "load_friction"
    terms = Terms(tuple(term(k) for k in key), (np.array([[0.05]]), np.array([[0.03]]), np.array([[0.2]])))
    values = ARM.space.nominal[None]
    whole = rollout(ARM, values, moves, engine="joint", threads=1, terms=terms).states
    part = replace(moves, joints=("pitch", "elbow"))
    some = rollout(ARM, values, part, engine="joint", threads=1, terms=terms).states
    looked = [i for i, c in enumerate(ARM.channels) if c.split("/")[0] in ("pitch", "elbow")]
    assert np.array_equal(some[..., looked], whole[..., looked])
    assert np.isnan(np.delete(some, looked, axis=-1)).all()


def test_the_load_is_that_of_the_pose_in_which_the_others_stand():
    moves = excitation(ARM, seed=0, episodes=2, steps=60)
    home = np.array([0.0, 0.0, 0.5, 0.0, 0.0, 1.16])
    start = np.full((2, len(ARM.channels)), np.nan)
    start[:, : len(home)] = home
    start[1, 2] = 1.4  # the forearm hangs: the upper arm carries less of it
    hold = np.repeat(start[:, None, :6], 60, axis=1)
    held = replace(moves, actions=hold, initial=start, period=0.02)
    ends = rollout(ARM, ARM.space.nominal[None], held, engine="joint", threads=1).states[0, :, -1]
    both = rollout(ARM, ARM.space.nominal[None], held, engine="mujoco", threads=1).states[0, :, -1]
    pitch = ARM.channels.index("pitch/position")
    assert abs(ends[0, pitch] - ends[1, pitch]) > 0.005
    assert np.allclose(ends[:, pitch], both[:, pitch], atol=0.003)


def test_what_is_asked_of_one_joint_is_blamed_on_it_alone():
    terms = terms_at(single_terms(ARM), ("jaw",))
    assert {t.joints for t in terms} == {("jaw",)}
    assert {t.joints for t in terms_at(single_terms(ARM), ("jaw", "elbow"))} == {
        ("jaw",),
        ("elbow",),
        ("jaw", "elbow"),
    }
    weights = {c.name: c.weight for c in only_joints(ARM, ("jaw",)).file.channels}
    assert [name for name, weight in weights.items() if weight > 0] == ["jaw/position"]


@pytest.mark.parametrize("joints", [("thumb",), ("jaw", "thumb")])
def test_an_unknown_joint_is_refused(joints: tuple[str, ...]):
    with pytest.raises(UsageError, match="thumb"):
        only_joints(ARM, joints)


def test_thinned_parts_take_from_all_episodes():
    episode = np.repeat(np.arange(6), 10)
    split = Parts(episode < 3, (episode >= 3) & (episode < 5), episode == 5)
    few = thinned(split, episode, 4, seed=1)
    assert few.fit.sum() == few.select.sum() == 4 and few.test.sum() == 10
    assert not (few.fit & few.select).any() and not ((few.fit | few.select) & split.test).any()
    five = thinned(split, episode, 5)
    assert set(episode[five.fit]) == set(episode[five.select]) == {0, 1, 2, 3, 4}
    most = thinned(split, episode, 99)
    assert most.fit.sum() == most.select.sum() == 25
    assert thinned(split, episode, 4, seed=1).fit.tolist() == few.fit.tolist()


@pytest.fixture(scope="module")
def arm(data_dir: Path, tmp_path_factory):
    logs = [data_dir / "sage_so101_arm" / f"{name}.parquet" for name in MOTIONS]
    if not logs[0].exists():
        pytest.skip("no SO-101 log in DYNREG_DATA_DIR")
    with dynreg.open(tmp_path_factory.mktemp("registry")) as registry:
        registry.ingest(logs, "so101", name="arm")
        yield registry


def test_dry_friction_of_the_real_arms_shoulder_is_found(arm):
    found = arm.diagnose(
        "arm",
        hold_out="hold_under_gravity",
        joints=["pitch"],
        windows=3,
        effects=["coulomb_friction", "backlash", "speed_limit", "torque_limit"],
        max_causes=1,
        threshold_runs=0,
        threads=1,
    )
    assert [c.key for c in found.causes] == ["coulomb_friction[pitch]"]
    assert found.causes[0].evidence_nats > 50
    assert [e.channel for e in found.errors] == ["pitch/position"]
    assert found.error.extended < 0.6 * found.error.calibrated
    assert len(found.parts["fit"]) == 3 and len(found.parts["test"]) > 3


def test_parameters_of_other_joints_stay_nominal(arm):
    recording = arm.recording("arm")
    model, data = pose(ARM, recording, DiagnosisOptions(joints=("wrist_roll",), windows=2))
    free = [ARM.space.names[i] for i in model.coordinates.free]
    assert {"wrist_roll_gain", "wrist_roll_speed"} <= set(free)
    assert not {"pitch_gain", "jaw_gain", "upper_mass"} & set(free)
    assert len(data.fit) <= 2


@pytest.mark.parametrize("engine", ["joint", "mujoco"])
def test_what_is_left_is_told_of_the_joints_asked_for_alone(engine: str):
    plan = protocol(ARM, seed=1, seconds=12.5)
    recording = log_of(ARM, hide(ARM, (term("coulomb_friction"),), "strong", 4), plan, engine="joint")
    left = {}
    for joints in (None, ("elbow",), ("jaw", "pitch")):
        settings = DiagnosisOptions(joints=joints, engine=engine, threads=1, windows=1, horizon=0.5)
        model, data = pose(ARM, recording, settings)
        found = run(unexplained(State(model, data.sample(data.fit), model.start, model.start), "unknown"))
        assert all(row.joint == each.joint for each in found for row in each.rows)
        left[joints] = {each.joint: (each.size, each.samples) for each in found}
    assert set(left[None]) == {name.split("/")[0] for name in ARM.actions}
    assert set(left[("elbow",)]) == {"elbow"} and set(left[("jaw", "pitch")]) == {"jaw", "pitch"}
    if engine == "joint":  # where joints move alone, the others make no difference to what is left of one
        assert left[("elbow",)]["elbow"] == left[None]["elbow"]


def test_windows_that_are_episodes_stay_parted():
    fit = np.arange(8) % 2 == 0
    few = thinned(Parts(fit, ~fit, np.zeros(8, dtype=bool)), np.arange(8), 3)
    assert few.fit.sum() == few.select.sum() == 3
    assert not (few.fit & ~fit).any() and not (few.select & fit).any()


def test_effects_that_have_no_place_are_told_with_the_reason():
    plan = protocol(ARM, seed=1, seconds=12.5)
    recording = log_of(ARM, hide(ARM, (), None, 4), plan, engine="joint")
    some = DiagnosisOptions(joints=("elbow",), effects=("payload", "backlash", "wheel_slip"), windows=1)
    model, data = pose(ARM, recording, some)
    terms = offered(model, data, some)
    assert [t.key for t in terms] == ["backlash[elbow]"]
    lost = no_candidates(model.robot, data, some, terms)
    assert lost == {
        "payload": "an effect of the whole robot needs all its joints; leave out the choice of joints",
        "wheel_slip": "robot 'so101' cannot have it (no engine moves the robot on wheels)",
    }
    said = " | ".join(not_looked_for(Problem(model, data, tuple(terms), None), some))
    assert "payload was not looked for: an effect of the whole robot" in said and "wheel_slip was not" in said
    with pytest.raises(
        UsageError, match="no effect is left to look for; 'payload': an effect of the whole robot"
    ):
        offered(model, data, replace(some, effects=("payload",)))
    every = replace(some, joints=ARM.driven, effects=("payload",))
    places = ["payload", "payload[wrist]", "payload[gripper]", "payload[jaw]"]
    assert [t.key for t in offered(model, data, every)] == places
    assert set(no_candidates(model.robot, data, replace(some, effects=None), ())) >= {
        "payload",
        "gravity_tilt",
    }


def test_robots_without_an_effect_are_diagnosed_at_some_joints_too():
    plan = protocol(ARM, seed=1, seconds=12.5)
    recording = log_of(ARM, hide(ARM, (), None, 4), plan, engine="joint")
    settings = DiagnosisOptions(joints=("elbow",), threads=1)
    problem = run(planned(*pose(ARM, recording, settings), [term("coulomb_friction[elbow]")]))
    assert 0.0 <= run(null(problem, ARM, 5))[0] < USUAL
