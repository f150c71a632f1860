"""One interface for every method: the same document, the lineage of what was made, and a run that goes on."""

import importlib.metadata
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tiny_registry import bench_csv, make

import dynreg
import dynreg.sim.versions as versions
import dynreg.verbs.accepted as accepted
from dynreg.adapt.plan import read_plan, resolved
from dynreg.cli.schemas import schema_files
from dynreg.data.recording import Recording
from dynreg.errors import Assumed, CorruptError, RobotError, UsageError
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.methods.calibrator import Question
from dynreg.methods.table import METHODS
from dynreg.replay.data import data
from dynreg.report.calibration import columns, made, next_steps, verdict
from dynreg.report.html import page
from dynreg.results import Calibration
from dynreg.session import Session
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import term
from dynreg.sim.excitation import excitation
from dynreg.sim.real import SimulatedRobot
from dynreg.sim.robot import load_robot
from dynreg.sim.stand import on_stand
from dynreg.verbs import calibration_start
from dynreg.verbs.calibration_start import begun_with
from dynreg.verbs.simulators import simulator
from dynreg.verbs.subjects import recorded
from dynreg.verbs.unseen import seen

PLAN = """
[[stages]]
name = "masses"
parameters = ["tip_mass", "rotor_inertia"]
recordings = ["e0", "e1", "e2"]
loss = "joint"
shift = 0.02
generations = 2
children = 6
mu = 2

[[stages]]
name = "all"
parameters = ["*"]
generations = 2
children = 6
mu = 2
"""
TOLD = {"hold_out": "e4", "threads": 1}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibrated")
    make(folder)
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def session(place: Path):
    with dynreg.open(place / "registry") as opened:
        yield opened


def budget_of(method: str) -> dict[str, int]:
    return {"budget": 30} if "budget" in METHODS[method].reads else {}


def asked(session: Session, place: Path, method: str, **told) -> Calibration:
    plan = {"plan": place / "plan.toml"} if "plan" in METHODS[method].needs else {}
    return session.calibrate("bench", method=method, **{**TOLD, **plan, **told})


@pytest.fixture(scope="module")
def found(session: Session, place: Path) -> dict[str, Calibration]:
    others = ("diagnose", "ttest")  # which takes its time, and which needs wheels
    able = [name for name, kind in METHODS.items() if name not in others and not kind.tries]
    return {name: asked(session, place, name, **budget_of(name)) for name in able}


def test_every_method_answers_by_the_same_measure(found: dict[str, Calibration]) -> None:
    assert {(one.nominal_train_error, one.nominal_test_error) for one in found.values()} == {
        (found["cma"].nominal_train_error, found["cma"].nominal_test_error)
    }
    assert all(0 < one.test_error < 10 and one.ended for one in found.values())
    assert "calibration.2.json" in schema_files()


def test_every_version_is_a_registered_simulator_that_says_what_it_came_from(
    session: Session, found: dict[str, Calibration]
) -> None:
    for one in found.values():
        assert one.versions[-1].simulator == one.simulator
        for version in one.versions:
            kept = session.registry.simulator(version.simulator)
            assert kept["lineage"]["made_by"] == f"calibrate {one.method}"
            assert kept["lineage"].get("parent") == version.parent
            assert version.recordings == (one.recording,) and "e4" not in version.episodes, (
                "what is held out shapes nothing"
            )


def test_the_stages_of_a_plan_are_versions_in_turn(found: dict[str, Calibration]) -> None:
    masses, every = found["staged"].versions
    assert (masses.stage, every.stage) == ("masses", "all") and every.parent == masses.simulator
    assert masses.episodes == ("e0", "e1", "e2") and every.episodes == ("e0", "e1", "e2", "e3")
    assert masses.after <= masses.before and every.after <= every.before
    for one in (masses, every):
        curve = [(s.simulations, s.error) for s in found["staged"].history if s.stage == one.stage]
        assert (curve[0], curve[-1][1]) == ((1, one.before), one.after), "its learning curve is its own"
    assert all(one.free for one in found["staged"].parameters.values()), "of some stage"
    assert "lowest objective of masses" in page(found["staged"]) and "of all" in page(found["staged"])


def test_a_simulator_is_made_of_the_nearest_one(session: Session, found: dict[str, Calibration]) -> None:
    nearest, made = found["synthesis"].versions
    assert made.parent == nearest.simulator and found["synthesis"].population == found["nearest"].population
    assert len(found["nearest"].versions) == 1
    entries = session.registry.resolve(nearest.parent, ("entry",))
    assert entries[1] == nearest.parent, "it is a registered one"


def test_the_document_reads_back_and_version_1_still_opens(found: dict[str, Calibration]) -> None:
    document = found["cma"].to_dict()
    assert Calibration.model_validate(document) == found["cma"]
    new = {"versions", "causes", "parts", "ended", "population", "seed"}
    old = {name: value for name, value in document.items() if name not in new}
    old |= {"schema": "dynreg/calibration/1"}
    old["cost"] = {k: v for k, v in old["cost"].items() if k not in ("simulated_seconds", "core_seconds")}
    assert Calibration.model_validate(old).train_error == found["cma"].train_error


def test_a_calibration_is_simulated_by_its_word(session: Session, found: dict[str, Calibration]) -> None:
    compared = session.compare("bench", simulators=["nominal", found["staged"].simulator], hold_out="e4")
    nominal, staged = (one["simulator"] for one in compared.rows()[:2])
    assert nominal != staged
    first = found["staged"].versions[0]
    stage = simulator(session.registry, first.simulator, load_robot("servo_pendulum"), first.recordings[0])
    assert stage.fitted_to == {*first.episodes}, "a stage says by which episodes it was shaped"


def test_an_interrupted_calibration_goes_on_and_asks_for_the_same_settings(
    session: Session, place: Path
) -> None:
    def stop(stage: str, done: int, total: int) -> None:
        if done > 15:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        asked(session, place, "es", seed=5, budget=30, progress=stop)
    with pytest.raises(UsageError, match="nothing to resume .* expected --seed 5; give"):
        asked(session, place, "es", seed=6, budget=30, resume=True)
    again = asked(session, place, "es", seed=5, budget=30, resume=True)
    whole = asked(session, place, "es", seed=5, budget=30)
    assert (again.parameters, again.history) == (whole.parameters, whole.history)
    assert again.cost.resumed > 0 and again.cost.rollouts == whole.cost.rollouts


def stopped(session: Session, place: Path, **told) -> None:
    """An evolution strategy that is interrupted after some simulations."""

    def stop(stage: str, done: int, total: int) -> None:
        if done > 15:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        asked(session, place, "es", budget=30, progress=stop, **told)


def test_simulations_by_another_version_are_run_again(
    session: Session, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped(session, place, seed=15)
    monkeypatch.setattr(
        versions, "version", lambda one: "9.9" if one == "mujoco" else importlib.metadata.version(one)
    )
    with pytest.warns(
        Assumed, match=r"simulations of 'es' were run by dynreg .*, mujoco .*: they are run again"
    ):
        again = asked(session, place, "es", seed=15, budget=30, resume=True)
    assert again.cost.resumed == 0


def test_a_result_that_cannot_be_stored_loses_no_simulation(
    session: Session, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*told) -> str:
        raise OSError("no room")

    with monkeypatch.context() as patched:
        patched.setattr(type(session.registry), "put_result", full)
        with pytest.raises(OSError, match="no room"):
            asked(session, place, "es", seed=16, budget=30)
    again = asked(session, place, "es", seed=16, budget=30, resume=True)
    assert again.cost.resumed == again.cost.rollouts > 0


def test_a_calibration_that_runs_is_not_begun_beside_itself(session: Session, place: Path) -> None:
    def beside(stage: str, done: int, total: int) -> None:
        with pytest.raises(UsageError, match="another run of the same calibration"):
            asked(session, place, "es", seed=17, budget=30)

    asked(session, place, "es", seed=17, budget=30, progress=beside)
    assert not [*(session.path / "locks").glob("*-*.lock")], "no lock stays"


def test_a_calibration_that_ended_is_given_as_it_is_stored(session: Session, place: Path) -> None:
    with pytest.warns(Assumed, match="nothing to go on with: the calibration begins"):
        first = asked(session, place, "random", seed=8, budget=4, resume=True)
    held = len(session.list("result").rows())

    def never(stage: str, done: int, total: int) -> None:
        raise AssertionError("it is computed again")

    with pytest.warns(Assumed, match="has ended: its result"):
        again = asked(session, place, "random", seed=8, budget=4, resume=True, progress=never)
    assert again.to_dict() == first.to_dict() and len(session.list("result").rows()) == held
    assert asked(session, place, "random", seed=8, budget=5).question != first.question


@pytest.mark.parametrize("name", ["dynreg", "mujoco"])
def test_a_calibration_that_another_version_ended_is_computed_again(
    session: Session, place: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    first = asked(session, place, "random", seed=9, budget=4)
    monkeypatch.setattr(
        versions, "version", lambda one: "9.9" if one == name else importlib.metadata.version(one)
    )
    with pytest.warns(Assumed, match="nothing to go on with: the calibration begins"):
        again = asked(session, place, "random", seed=9, budget=4, resume=True)
    assert again.question != first.question


def test_several_recordings_are_fitted_together_and_a_stage_may_name_one(
    session: Session, place: Path
) -> None:
    slower = bench_csv(lambda i, row: [row[0], 0.9 * row[1], 0.9 * row[2], *row[3:]])
    (place / "other.csv").write_text(slower, encoding="utf-8")
    other = session.ingest(place / "other.csv", "servo_pendulum", name="other")
    plan = PLAN.replace('"e0", "e1", "e2"', '"other"')
    (place / "both.toml").write_text(plan, encoding="utf-8")
    found = session.calibrate(
        ["bench", "other"], method="staged", plan=place / "both.toml", budget=30, threads=1
    )
    first, second = found.versions
    assert first.recordings == (other.recording,) and len(second.recordings) == 2


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ({"method": "staged"}, "without a plan"),
        ({"method": "cma", "plan": Path("x.toml")}, "has no meaning for method"),
        ({"method": "es", "population": "crowd"}, "has no meaning for method"),
        ({"method": "diagnose", "budget": 9}, "budget '9' has no meaning for method 'diagnose'"),
        ({"method": "nearest", "resume": True}, "resume has no meaning for method 'nearest'"),
        ({"method": "nearest", "budget": 3}, "a budget of 3"),
        ({"method": "staged", "plan": Path("aibo/nope")}, "aibo/air, aibo/ground"),
        ({"method": "hillary"}, "method 'hillary'"),
        ({"method": "ttest"}, r"method 'ttest' needs a robot on wheels; 'servo_pendulum'"),
    ],
)
def test_a_method_without_what_it_needs_says_so(session: Session, told: dict, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        session.calibrate("bench", **told)


def test_it_begins_with_another_simulator_and_carries_what_that_had_fitted(
    session: Session, place: Path, found: dict[str, Calibration]
) -> None:
    start = found["cma"]
    again = asked(session, place, "staged", start=start.simulator, budget=30)
    assert again.versions[0].parent == start.simulator
    assert again.versions[1].before <= start.train_error * 1.001, "the second stage is of the replay error"
    cut = data(load_robot("servo_pendulum"), session.registry.recording(start.recording), "e4")
    fitted = Question(
        cut, cut.robot.space.from_dict({n: p.value for n, p in start.parameters.items()})
    ).fitted
    same = Question(cut, cut.robot.space.from_unit(cut.robot.space.to_unit(cut.robot.space.nominal))).fitted
    assert fitted.sum() == np.isnan(cut.known).sum() and not same.any(), "a rounded nominal value is no fit"
    with pytest.raises(UsageError, match="has no meaning for method"):
        asked(session, place, "nearest", start=start.simulator)
    robot = load_robot("servo_pendulum")
    heavy = SimConfig.of(robot, 3.0 * robot.space.nominal)
    beyond = session.registry.put_simulator(heavy.as_dict() | {"lineage": {"made_by": "me"}})
    with pytest.warns(Assumed, match="tip_mass.* outside the ranges .* begins at their bounds"):
        begun_with(session.registry, beyond, robot)


def test_a_diagnosis_answers_in_the_same_form(tmp_path: Path) -> None:
    robot = load_robot("servo_pendulum")
    log = log_of(
        robot, hide(robot, (term("load_friction"),), "strong", 11), protocol(robot, seed=1, seconds=12.5)
    )
    with dynreg.open(tmp_path / "registry") as session:
        session.ingest(log, robot, name="log")
        found = session.calibrate("log", method="diagnose", threads=1, hold_out="0.25")
        kept = session.registry.simulator(found.simulator)
    assert found.causes == ("load_friction",) and set(kept["effects"]) == {"load_friction"}
    assert [one.stage for one in found.versions] == ["calibrated", "extended"]
    assert found.versions[1].parent == found.versions[0].simulator
    assert found.test_error < 0.5 * found.nominal_test_error
    fitted = [one for one in found.parameters.values() if one.low is not None]
    assert fitted and all(one.low <= one.value <= one.high for one in fitted)


def test_parameters_that_no_stage_fits_are_not_counted_as_fitted(session: Session, place: Path) -> None:
    (place / "few.toml").write_text(PLAN.partition('\n[[stages]]\nname = "all"')[0], encoding="utf-8")
    told = asked(session, place, "staged", plan=place / "few.toml")
    assert {name for name, one in told.parameters.items() if one.free} == {"tip_mass", "rotor_inertia"}
    assert verdict(told).startswith("staged fitted 2 parameters of")
    older = told.to_dict()
    for one in older["parameters"].values():
        del one["free"]
    assert "fitted 7 parameters of" in verdict(Calibration.model_validate(older)), "it does not tell"


def test_nothing_better_is_said_only_where_no_stage_found_anything(found: dict[str, Calibration]) -> None:
    first, last = found["staged"].versions
    same = {"before": 0.5, "after": 0.5}
    for begun, says in ((same, True), ({"before": 0.5, "after": 0.4}, False)):
        some = (first.model_copy(update=begun), last.model_copy(update=same))
        told = found["staged"].model_copy(update={"versions": some})
        assert any("Nothing better was found" in one for one in next_steps(told)) == says


@pytest.mark.parametrize(("name", "stand"), [("air", True), ("ground", False)])
def test_plans_that_a_robot_brings_fit_it(name: str, stand: bool) -> None:
    robot = load_robot("aibo")
    stages = read_plan(robot.folder / "plans" / f"{name}.toml")
    own = on_stand(robot) if stand else robot
    known = np.zeros(len(own.space), dtype=bool)
    found = resolved(stages, own.space.names, known, ["ground/kick", "walks/A00"], np.arange(2))
    assert [len(one.parameters) for one in found] == ([24] if stand else [24, 32])


def test_a_table_kept_by_t_tests_is_a_simulator_like_any_other(session: Session) -> None:
    robot = load_robot("diffdrive")
    hidden = (term("wheel_gain"),), (np.array([0.15]),)
    real = SimulatedRobot(robot, robot.space.nominal, *hidden, seed=3, threads=1)
    told = excitation(robot, seed=3, episodes=5, steps=100).actions
    logs = [real.run(one, robot.rate, f"e{i}").recording for i, one in enumerate(told)]
    episodes = tuple(log.episodes[0] for log in logs)
    session.ingest(Recording(logs[0].channels, episodes, measured=False), "diffdrive", name="uneven")
    found = session.calibrate("uneven", method="ttest", threads=1)
    assert found.test_error < 0.3 * found.nominal_test_error and found.causes == ("wheel_gain",)
    assert {"tests", "rejected", "removed", "explained", "difference"} == {*found.versions[-1].figures}
    kept = session.registry.simulator(found.simulator)
    assert kept["effects"]["wheel_gain"]["difference"] == found.versions[-1].figures["difference"]
    assert Calibration.model_validate(found.to_dict()) == found
    assert found.tables()["versions"][-1]["explained"] > 0.8 and "<th>figures</th>" in page(found)
    assert all(row[-1].startswith("tests ") for row in made(found)) and columns(made(found))[-1] == "figures"


def test_a_start_that_saw_what_is_held_out_is_told_and_no_other_one(session: Session, place: Path) -> None:
    start = asked(session, place, "random", budget=5, hold_out="e0").simulator
    with pytest.warns(Assumed, match="shaped by e4, which is held out"):
        asked(session, place, "random", budget=5, hold_out="e4", start=start)
    slower = bench_csv(lambda i, row: [row[0], 0.8 * row[1], 0.8 * row[2], *row[3:]])
    (place / "third.csv").write_text(slower, encoding="utf-8")
    session.ingest(place / "third.csv", "servo_pendulum", name="third")
    told = {"method": "random", "budget": 5, "start": start, "threads": 1}
    with warnings.catch_warnings():
        warnings.simplefilter("error", Assumed)
        session.calibrate("third", hold_out="e4", **told)
        asked(session, place, "random", budget=5, hold_out="e0", start=start)
        both = session.calibrate(["bench", "third"], hold_out="third/e4", **told)
    with pytest.warns(Assumed, match="shaped by bench/e4, which"):
        session.calibrate(["bench", "third"], hold_out="bench/e4", **told)
    _knows_its_parts(session, both)


def _knows_its_parts(session: Session, both: Calibration) -> None:
    """A simulator that was fitted to two recordings but for third/e4, and one that came from it, in each question."""
    robot, registry = load_robot("servo_pendulum"), session.registry
    told = {"method": "random", "budget": 5, "start": both.simulator, "threads": 1}
    with pytest.warns(Assumed, match="shaped by e4, which is held out"):
        child = session.calibrate("bench", hold_out="e4", **told).simulator
    with warnings.catch_warnings():
        warnings.simplefilter("error", Assumed)
        session.calibrate("third", hold_out="e4", **told)
    every = {"e0", "e1", "e2", "e3", "e4"}
    for name, expected in (("bench", every), ("third", every - {"e4"})):
        asked_about = registry.resolve(name, ("recording",))[1]
        assert simulator(registry, both.simulator, robot, asked_about).fitted_to == expected
        assert simulator(registry, child, robot, asked_about).inherited == expected
    joined = simulator(registry, child, robot, both.recording)
    assert "bench/e0" in joined.fitted_to and "third/e4" not in joined.fitted_to | joined.inherited


def test_what_shaped_the_parents_of_a_start_is_told(session: Session, place: Path) -> None:
    first = asked(session, place, "random", seed=20, budget=5, hold_out="e0").simulator
    with pytest.warns(Assumed, match="shaped by e4"):
        second = asked(session, place, "random", seed=21, budget=5, hold_out="e0,e4", start=first).simulator
    with pytest.warns(Assumed, match="shaped by e4, which is held out"):
        asked(session, place, "random", seed=22, budget=5, hold_out="e4", start=second)
    bench = session.registry.resolve("bench", ("recording",))[1]
    found = simulator(session.registry, second, load_robot("servo_pendulum"), bench)
    assert "e4" in found.inherited and "e4" not in found.fitted_to and "e0" not in found.inherited
    has_seen = seen(recorded(session.registry, "bench", ingest=False), found)
    assert has_seen("e4", 0.0, 0.5) and not has_seen("e0", 0.0, 0.5), "compare asks this"
    begun = session.diagnose(
        "bench", start=second, effects=("payload",), threshold_runs=0, hold_out="e0", threads=1
    )
    told = simulator(session.registry, begun.calibrated_simulator, load_robot("servo_pendulum"), bench)
    assert "e4" in told.inherited, "a diagnosis tells what it began with"


def test_a_parent_that_is_gone_or_damaged_keeps_no_simulator_from_use(
    session: Session, found: dict[str, Calibration], monkeypatch: pytest.MonkeyPatch
) -> None:
    def damaged(*told) -> dict:
        raise CorruptError("it", expected="what was written", do="verify")

    made, robot = found["staged"], load_robot("servo_pendulum")
    usual = simulator(session.registry, made.simulator, robot, made.recording)
    assert usual.inherited == {"e0", "e1", "e2"}
    own = type(session.registry).simulator
    monkeypatch.setattr(
        type(session.registry),
        "simulator",
        lambda self, ref: damaged() if ref == made.versions[0].simulator else own(self, ref),
    )
    assert simulator(session.registry, made.simulator, robot, made.recording).inherited == frozenset()


def test_a_recording_with_a_slash_in_its_name_is_found_by_a_plan(session: Session, place: Path) -> None:
    slower = bench_csv(lambda i, row: [row[0], 0.7 * row[1], 0.7 * row[2], *row[3:]])
    (place / "lab.csv").write_text(slower, encoding="utf-8")
    lab = session.ingest(place / "lab.csv", "servo_pendulum", name="lab/monday")
    (place / "lab.toml").write_text(PLAN.replace('"e0", "e1", "e2"', '"lab/monday"'), encoding="utf-8")
    found = session.calibrate(
        ["bench", "lab/monday"], method="staged", plan=place / "lab.toml", budget=30, threads=1
    )
    assert found.versions[0].recordings == (lab.recording,)


def test_an_episode_that_ends_before_what_is_skipped_shapes_no_stage(session: Session, place: Path) -> None:
    robot = load_robot("servo_pendulum")
    bench = session.registry.recording(session.registry.resolve("bench", ("recording",))[1])
    short = replace(bench.episodes[0], time=bench.episodes[0].time[:8], values=bench.episodes[0].values[:8])
    session.ingest(Recording(bench.channels, (short, *bench.episodes[1:])), robot, name="one is short")
    path = place / "skips.toml"
    path.write_text(
        '[[stages]]\nname = "one"\nparameters = ["tip_mass"]\nloss = "joint"\nskip = 0.3\ngenerations = 1\n'
    )
    found = session.calibrate("one is short", method="staged", plan=path, threads=1, hold_out="e4")
    assert found.versions[0].episodes == ("e1", "e2", "e3")


def test_a_robot_that_is_refused_is_refused_before_any_simulation(
    session: Session, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*told) -> None:
        raise RobotError("it cannot be used", expected="a sound one", do="mend it")

    def never(stage: str, done: int, total: int) -> None:
        raise AssertionError("something is simulated")

    monkeypatch.setattr(accepted, "accept", refused)
    with pytest.raises(RobotError, match="it cannot be used"):
        asked(session, place, "es", seed=30, budget=30, progress=never)


def test_a_mistake_in_a_later_stage_is_told_before_any_simulation(session: Session, place: Path) -> None:
    def never(stage: str, done: int, total: int) -> None:
        raise AssertionError("a stage is run")

    path = place / "late.toml"
    path.write_text(PLAN.replace('parameters = ["*"]', 'parameters = ["*"]\nloss = "velocity"'))
    with pytest.raises(UsageError, match="stage 'all': loss 'velocity'"):
        asked(session, place, "staged", plan=path, progress=never)


def test_a_stage_that_converges_is_not_said_to_have_run_its_plan(session: Session, place: Path) -> None:
    path = place / "long.toml"
    path.write_text(
        '[[stages]]\nname = "one"\nparameters = ["tip_mass"]\nsearch = "cma"\ngenerations = 1000\nchildren = 4\n'
    )
    found = asked(session, place, "staged", plan=path)
    assert found.ended == "converged" and found.cost.rollouts < 1000


def test_a_plan_that_was_interrupted_in_its_first_stage_goes_on_beside_another_run(
    session: Session, place: Path
) -> None:
    def stop_in(name: str):
        def stop(stage: str, done: int, total: int) -> None:
            if stage == name and done > 7:
                raise KeyboardInterrupt

        return stop

    whole = asked(session, place, "staged", seed=8, hold_out="e3")
    for seed, stage in ((9, "all"), (8, "masses")):
        with pytest.raises(KeyboardInterrupt):
            asked(session, place, "staged", seed=seed, hold_out="e3", progress=stop_in(stage))
    again = asked(session, place, "staged", seed=8, hold_out="e3", resume=True)
    assert again.parameters == whole.parameters and again.cost.resumed > 0


def test_a_result_says_what_of_the_held_out_part_it_saw(session: Session, place: Path) -> None:
    start = asked(session, place, "random", seed=30, budget=5, hold_out="e0").simulator
    with pytest.warns(Assumed, match="shaped by e4"):
        found = asked(session, place, "random", seed=31, budget=5, hold_out="e4", start=start)
    assert found.seen == ("e4",) and found.recording_name == "bench"
    row = session.list("result").items[-1].detail
    assert (row["recording"], row["held_out"], row["saw"]) == ("bench", "e4", "e4")
    steps = next_steps(found)
    assert steps[0] == "The test error is too low: e4 shaped the simulator, though it is held out."
    assert steps[-1] == f"Compare: dynreg compare bench --with nominal,{found.simulator[:12]}"
    lost = next_steps(found.model_copy(update={"train_error": 0.8, "seen": ()}))
    assert lost[0].startswith("Not even what was fitted is explained") and "diagnose bench" in lost[0]


def test_a_log_by_its_path_tells_what_the_checks_found(session: Session, place: Path, tmp_path: Path) -> None:
    def stuck(i: int, row: list[float]) -> list[float]:
        return [*row[:1], 0.0, *row[2:]]

    (tmp_path / "stuck.csv").write_text(bench_csv(stuck), encoding="utf-8")
    with pytest.warns(Assumed, match="while its velocity says that it moves"):
        session.calibrate(
            tmp_path / "stuck.csv", robot="servo_pendulum", method="random", budget=2, threads=1
        )


def test_a_plan_is_named_by_text_too(session: Session, place: Path) -> None:
    told = {"method": "staged", "threads": 1, "hold_out": "e0", "budget": 60}
    assert session.calibrate("bench", plan=str(place / "plan.toml"), **told).versions[0].unit in ("", "rad^2")
    with pytest.raises(UsageError, match="brings none"):
        session.calibrate("bench", plan="leg/air", **told)


def test_pieces_of_one_run_that_a_start_did_not_see_are_no_leak(session: Session) -> None:
    robot = load_robot("create")
    real = SimulatedRobot(robot, robot.space.nominal, seed=4, threads=1)
    told = excitation(robot, seed=4, episodes=1, steps=3000).actions[0]
    session.ingest(real.run(told, robot.rate, "run").recording, "create", name="one run")
    how = {"method": "random", "budget": 5, "threads": 1}
    first = session.calibrate("one run", **how)
    assert first.parts["test"] and all("[" in name for name in first.parts["test"])
    with warnings.catch_warnings():
        warnings.simplefilter("error", Assumed)
        again = session.calibrate("one run", start=first.simulator, **{**how, "budget": 6})
    assert again.seen == ()


def test_windows_of_another_cut_are_not_taken_for_these(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of shorter windows "run[1]" is other rows: then all of the episode counts as seen."""
    monkeypatch.setattr(calibration_start, "shaped", lambda *_: frozenset({"run"}))
    asked_about = SimpleNamespace(each=(), registry=None, recording=SimpleNamespace(id="r"))
    parts = {"fit": ("run[0]",), "select": ("run[2]",), "test": ("run[1]",)}
    begin = SimpleNamespace(parts=parts, inherited=frozenset())
    assert calibration_start.shaped_by(asked_about, begin, parts) == ()
    assert calibration_start.shaped_by(asked_about, begin, {**parts, "test": ("run[0]",)}) == ("run",)
    turned = {"fit": ("run[1]",), "select": ("run[2]",), "test": ("run[0]",)}
    assert calibration_start.shaped_by(asked_about, begin, turned) == ("run[0]",)
