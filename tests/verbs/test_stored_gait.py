"""From a recording to a stored gait: which simulators it is sought in, what is kept, and what is refused."""

import json
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import made_up_results
import numpy as np
import pytest

from dynreg import session
from dynreg.errors import Assumed, NoMatchError, PictureError, UsageError
from dynreg.gait import play
from dynreg.gait.play import commands
from dynreg.gait.space import gait_space
from dynreg.results import Gait, Neighbour
from dynreg.search.table import SEARCHES
from dynreg.session import Session
from dynreg.sim import versions
from dynreg.sim.config import SimConfig
from dynreg.sim.excitation import excitation
from dynreg.sim.real import SimulatedRobot
from dynreg.sim.robot import load_robot
from dynreg.verbs.gait import MANY, MEETS, SOURCES, GaitSettings
from dynreg.verbs.gait import ROLLOUTS as ROLLOUTS_IN_DRAWS
from dynreg.verbs.simulator import NAMES

ROLLOUTS = 22  # two batches of CMA-ES in one simulator


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory, brief, short_log) -> Iterator[Session]:
    """A registry with a short log of a quadruped, "log", and two simulators."""
    with session.open(tmp_path_factory.mktemp("gaits") / "registry") as made:
        made.ingest(short_log, brief, name="log")
        for torque in (1.3, 1.5):
            values = brief.space.as_dict(brief.space.nominal) | {"torque": torque}
            made.registry.put_simulator(SimConfig(brief.hash, brief.name, values).as_dict())
        yield made


@pytest.fixture(scope="module")
def found(opened: Session) -> Gait:
    return opened.gait("log", on="nominal", rollouts=ROLLOUTS, threads=1)


def simulators(opened: Session) -> list[str]:
    """Ids of those of the gait's robot, whatever other tests have stored."""
    ids = opened.registry.ids("simulator")
    return [i for i in ids if opened.registry.simulator(i)["robot_name"] == "quadruped"]


def neighbours(opened: Session, fits: bool = True):
    """What a query would answer: the stored simulators."""
    ids = simulators(opened)[:2]
    configs = [opened.registry.simulator(i) for i in ids]
    listed = tuple(
        Neighbour(entry=i, name="n", index=0, distance=1.0, parameters=c["values"])
        for i, c in zip(ids, configs, strict=True)
    )
    made = made_up_results.neighbours(fits=fits)
    told = made.synthesised.model_copy(update={"simulator": ids[1]})
    return made.model_copy(update={"robot": "quadruped", "neighbours": listed, "synthesised": told})


def answering(opened: Session, monkeypatch: pytest.MonkeyPatch, fits: bool = True) -> None:
    answer = neighbours(opened, fits)
    monkeypatch.setattr("dynreg.verbs.gait_simulators.query", lambda asked, settings, progress: answer)


def test_rollouts_grow_with_the_simulators_where_none_are_named() -> None:
    nearest = GaitSettings(on="nearest")
    for many in (1, 5):
        assert nearest.search(many).rollouts == 750 * many
        assert GaitSettings(on="nearest", rollouts=90).search(many).rollouts == 90
    one, five = (nearest.search(many).evaluations(many) for many in (1, 5))
    assert one == pytest.approx(five, rel=0.05) == pytest.approx(600, rel=0.05)


def test_draws_of_the_posterior_take_turns() -> None:
    usual, few = GaitSettings().search(16), GaitSettings(rollouts=500).search(16)
    assert (usual.rollouts, few.rollouts) == (ROLLOUTS_IN_DRAWS, 500)
    assert usual.met(16) == MEETS and usual.met(1) == 1 and usual.doubt == 0.05
    many = {rollouts: GaitSettings(rollouts=rollouts).most_chosen() for rollouts in (60, 400, 959, 960, 7500)}
    assert many == {60: 1, 400: 6, 959: 15, 960: 16, 7500: MANY}  # finalists are tried in all
    for rollouts, draws in many.items():
        assert GaitSettings(rollouts=rollouts).search(draws).met(draws) == min(MEETS, draws)
    assert usual.evaluations(16) == pytest.approx(0.8 * ROLLOUTS_IN_DRAWS / MEETS, rel=0.05)
    assert GaitSettings(on="nearest").search(16).met(16) == 16


def test_once_a_gait_walked_the_search_near_it_shares_the_rollouts_with_one_of_the_whole_range() -> None:
    for settings, rollouts in ((GaitSettings(), ROLLOUTS_IN_DRAWS), (GaitSettings(rollouts=500), 500)):
        near, whole = settings.searches(16, walked=True)
        assert near.near and not whole.near and (near.doubt, whole.doubt) == (0.1, 0.05)
        assert (near.rollouts, whole.rollouts) == (rollouts // 4, rollouts - rollouts // 4)
        assert near.seed == whole.seed
        assert settings.searches(16, walked=False) == (settings.search(16),)
    # whose simulators take no turns: one search is dear enough
    (alone,) = GaitSettings(on="nearest").searches(5, walked=True)
    assert alone.near and alone.rollouts == GaitSettings(on="nearest").search(5).rollouts
    (anew,) = GaitSettings(method="hill").searches(5, walked=True)  # which cannot stay near a gait
    assert not anew.near and anew.rollouts == ROLLOUTS_IN_DRAWS


@pytest.mark.parametrize("method", ["cma", "es"])
def test_so_few_rollouts_as_serve_for_one_gait_serve_for_the_next(method: str) -> None:
    batch = SEARCHES[method].batch
    for rollouts in range(batch, 1000):
        settings = GaitSettings(method=method, rollouts=rollouts)
        searches = settings.searches(settings.most_chosen(), walked=True)
        assert sum(one.rollouts for one in searches) == rollouts and searches[0].near
        assert len(searches) == 1 + (rollouts >= 4 * batch)
        most = settings.most_in_all(searches)
        assert all(one.rollouts >= batch for one in searches)
        # all points of the way are tried in all of them
        assert 5 <= 5 * most <= max(0.35 * searches[0].rollouts, 5)
        for one in searches[1:]:
            assert one.evaluations(most) >= batch and one.met(most) == min(MEETS, most)
    assert GaitSettings().most_in_all(GaitSettings().searches(16, walked=True)) == MANY
    assert GaitSettings(on="nearest").most_in_all(GaitSettings(on="nearest").searches(5, walked=True)) is None


def test_a_gait_is_stored_and_comes_back(found: Gait, opened: Session) -> None:
    assert opened.result("@last") == found
    assert found.k == 1 and found.seconds == 1.0 and found.ended == "budget"
    assert "in 1 simulator" in str(found) and found.brief().endswith(" in 1 simulator")
    assert found.rate == pytest.approx(36.0) and found.recording_name == "log"
    assert found.fitness.min == found.trials[0].fitness == found.value
    assert found.succeeded == (not found.trials[0].fell and found.value >= found.success)
    assert opened.registry.simulator(found.trials[0].simulator)["lineage"] == {
        "made_by": "gait",
        "kind": "nominal",
    }
    feet = found.trials[0].contacts
    assert sorted(feet) == ["fl_foot", "fr_foot", "rl_foot", "rr_foot"]
    assert any(feet.values()) and all(0 <= a < b <= 1.1 for spans in feet.values() for a, b in spans)
    assert not list((opened.path / "searches").glob("*"))
    assert opened.verify().clean


def test_the_joints_of_the_document_are_the_targets_of_the_genes(found: Gait, brief) -> None:
    space = gait_space(brief)
    genes = space.from_dict({name: g.value for name, g in found.genes.items()})
    times, told = commands(found)
    assert np.abs(told - space.targets(genes[None], times)[0]).max() < 2e-4  # chords of a sine
    assert found.kind == "sines" and found.frequency == pytest.approx(found.genes["frequency"].value)


def test_a_document_of_the_first_version_is_played_as_before(found: Gait, opened: Session, brief) -> None:
    """It stated the sine of each joint, and no table."""
    space = gait_space(brief)
    genes = {name: g.value for name, g in found.genes.items()}
    old = found.to_dict() | {"schema": "dynreg/gait/1", "frequency": genes["frequency"]}
    del old["table"], old["kind"]
    for leg, role in np.ndindex(*space.columns.shape):
        sign, name = space.signs[leg, role], space.roles[role]
        old["joints"][space.columns[leg, role]] |= {
            "offset": sign * genes[f"offset_{name}"],
            "amplitude": sign * genes[f"amplitude_{name}"],
            "phase": genes[f"phase_{name}"] + genes.get(f"phase_{space.legs[leg]}", 0.0),
        }
    read = Gait.model_validate(old)
    assert read.schema_ == "dynreg/gait/2" and read.joints == found.joints
    assert np.allclose(read.table.targets, found.table.targets) and np.allclose(
        read.table.times, found.table.times
    )
    times = np.arange(30) / found.rate
    exact = space.targets(space.from_dict(genes)[None], times)[0]
    assert np.array_equal(play.told(space, genes, read, times), exact)
    identity = opened.registry.put_result("gait", found.recording, old)
    assert opened.result(identity) == read


def test_in_the_neighbours_and_in_the_synthesised_one(opened: Session, monkeypatch) -> None:
    answering(opened, monkeypatch)
    both = opened.gait("log", on="nearest", k=2, rollouts=44, threads=1)
    assert [t.kind for t in both.trials] == ["neighbour"] * 2
    assert {t.simulator for t in both.trials} == set(simulators(opened)[:2])
    assert both.source == opened.registry.latest("neighbours").id
    one = opened.gait("log", on="synthesised", rollouts=ROLLOUTS, threads=1)
    assert one.on == "synthesised" and [t.kind for t in one.trials] == ["synthesised"]


def test_where_no_simulator_is_close_the_diagnosis_is_advised(opened: Session, monkeypatch) -> None:
    answering(opened, monkeypatch, fits=False)
    with pytest.raises(NoMatchError, match="close enough.*dynreg diagnose log.*--on diagnosed") as caught:
        opened.gait("log", on="synthesised")
    assert caught.value.exit_status == 4


def test_in_what_a_diagnosis_left(opened: Session) -> None:
    with pytest.raises(NoMatchError, match="no 'diagnosed' simulator"):
        opened.gait("log", on="diagnosed")
    (recording,) = opened.registry.recordings()
    robot = opened.registry.simulator(simulators(opened)[0])["robot"]
    rubbing = SimConfig(robot, "quadruped", {}, {"coulomb_friction": {"torque": 0.1}})
    simulator = opened.registry.put_simulator(rubbing.as_dict())
    opened.registry.put_result("diagnosis", recording.id, {"extended_simulator": simulator})
    found = opened.gait("log", on="diagnosed", rollouts=ROLLOUTS, threads=1)
    assert [(t.simulator, t.kind) for t in found.trials] == [(simulator, "diagnosed")]
    plain = opened.gait("log", on="nominal", rollouts=ROLLOUTS, threads=1)
    assert found.history != plain.history  # the effect is at work


def test_in_draws_of_the_ranges_and_in_named_simulators(opened: Session) -> None:
    drawn = opened.gait("log", on="population", k=2, rollouts=44, threads=1)
    assert len({t.parameters["torque"] for t in drawn.trials}) == 2
    assert {t.parameters["action_rate"] for t in drawn.trials} == {drawn.rate}  # known from the log
    refs = ",".join(t.simulator[:16] for t in drawn.trials)
    named = opened.gait("log", on=refs, rollouts=44, threads=1)
    assert named.genes == drawn.genes


def test_over_a_population_the_mean_counts_and_simulators_that_only_fall_are_told(
    opened: Session, brief
) -> None:
    weak = brief.space.as_dict(brief.space.nominal) | {"torque": 0.6, "torso_mass": 3.5, "gravity": 11.0}
    weak = SimConfig(brief.hash, brief.name, weak, {"torque_limit": {"loss": 0.8}})
    fine = SimConfig(brief.hash, brief.name, {})
    ids = [opened.registry.put_simulator(c.as_dict()) for c in (fine, weak)]
    found = opened.gait("log", on=",".join(ids), rollouts=44, threads=1)
    assert found.accept == "min" and found.value == 0.0
    assert (
        found.notes[-1]
        == "every gait that was tried there fell in 1 of 2 simulators: a fall counts as 0 in the min"
    )
    assert found.packaged == 1 and found.notes[0].startswith("this gait is number 1 of the gaits")
    drawn = opened.gait("log", on="population", k=2, rollouts=44, threads=1)
    assert drawn.accept == "mean" and drawn.value == drawn.fitness.mean
    least = opened.gait("log", on="population", k=2, accept="min", rollouts=44, threads=1)
    assert least.accept == "min" and least.value == least.fitness.min


def test_a_gait_says_what_a_trial_may_bring(found: Gait) -> None:
    """Of runs with noise and parameters that the search never saw."""
    e = found.expected
    assert e.runs == 40 and 0 <= e.falls <= 40 and e.p5 <= e.median <= e.p95
    assert e.low <= e.falls / 40 <= e.high and (e.falls < 39 or e.p5 == 0.0)
    assert found.prediction in str(found) and f"{e.p5:.3g} to {e.p95:.3g}; 0 for a fall" in found.prediction
    older = found.model_copy(update={"expected": None})
    assert older.prediction == "" and "A trial on the robot" not in str(older)


def test_where_the_mean_counts_one_run_in_ten_may_fall(opened: Session, monkeypatch) -> None:
    from dynreg.gait import seek

    falls = {}

    def finished(trials, settings, finalists, rounds):
        return finalists[0], seek.Finals(38, falls["now"], 0.4)

    monkeypatch.setattr(seek, "best_again", finished)
    seen = {}
    for accept, count in (("mean", 3), ("mean", 4), ("min", 0), ("min", 1)):
        falls["now"] = count
        found = opened.gait("log", on="nominal", rollouts=150, accept=accept, threads=1)
        seen[accept, count] = found.succeeded, found.value >= found.success and not found.trials[0].fell
    assert all(fine for _, fine in seen.values())
    assert {how: done for how, (done, _) in seen.items()} == {
        ("mean", 3): True,
        ("mean", 4): False,
        ("min", 0): True,
        ("min", 1): False,
    }


def test_a_gait_that_mostly_falls_is_no_success(found: Gait) -> None:
    falls = found.expected.model_copy(update={"runs": 40, "falls": 30})
    stands = found.expected.model_copy(update={"runs": 40, "falls": 4})
    won = found.model_copy(update={"succeeded": True})
    assert "stood here, but fell in 30 of 40" in str(won.model_copy(update={"expected": falls}))
    assert "the gait succeeded" in str(won.model_copy(update={"expected": stands}))


def test_too_few_rollouts_are_refused_before_a_query(opened: Session, monkeypatch) -> None:
    monkeypatch.setattr("dynreg.verbs.gait_simulators.query", lambda *a: pytest.fail("it asked"))
    with pytest.raises(UsageError, match="3 rollouts in 5 simulators"):
        opened.gait("log", on="nearest", rollouts=3, threads=1)
    with pytest.raises(UsageError, match="3 rollouts in 1 simulator;"):
        opened.gait("log", on="synthesised", rollouts=3, threads=1)
    with pytest.raises(UsageError, match="3 rollouts in 1 simulator;.*raise --rollouts$"):
        opened.gait("log", rollouts=3, threads=1)


def test_the_prediction_is_that_of_unseen_runs(opened: Session, monkeypatch) -> None:
    monkeypatch.setattr("dynreg.gait.seek.expected", lambda *_: np.array([[-1000.0, 1.0, 2.0, 3.0]]))
    e = opened.gait("log", on="nominal", rollouts=ROLLOUTS, threads=1).expected
    assert (e.runs, e.falls, e.median) == (4, 1, 1.5)


def test_the_gaits_of_the_folder_can_be_left_out(opened: Session) -> None:
    alone = opened.gait("log", on="nominal", rollouts=60, packaged=False, threads=1)
    assert alone.packaged is None and not any("the robot's folder" in note for note in alone.notes)


def test_simulators_are_named_by_the_words_of_all_verbs() -> None:
    assert {*SOURCES} == {*NAMES, "posterior", "random", "population"}


def test_simulators_of_other_robots_and_unknown_ones_are_refused(opened: Session) -> None:
    other = load_robot("leg")
    opened.registry.put_robot(other.files, other.hash, other.name)
    stranger = opened.registry.put_simulator(SimConfig(other.hash, other.name, {}).as_dict())
    with pytest.raises(UsageError, match="is of robot 'leg'"):
        opened.gait("log", on=stranger)
    with pytest.raises(NoMatchError, match="nowhere"):
        opened.gait("log", on="nowhere")
    with pytest.raises(NoMatchError, match="no simulators of robot"):
        opened.gait("log", on="random")
    with pytest.raises(UsageError, match="k 0"):
        opened.gait("log", on="nominal", k=0)


@pytest.mark.parametrize(
    ("on", "told", "says"),
    [
        ("nominal", {"k": 7}, "-k 7 has no meaning with --on nominal"),
        ("diagnosed", {"population": "p"}, "--population p has no meaning with --on diagnosed"),
        ("1a2b3c,nominal", {"k": 7}, "-k 7 has no meaning with --on 1a2b3c,nominal"),
        ("population", {"population": "p"}, "--population p has no meaning with --on population"),
    ],
)
def test_settings_of_a_query_are_refused_in_other_simulators(on: str, told: dict, says: str, opened) -> None:
    with pytest.raises(UsageError, match=says):
        opened.gait("log", on=on, **told)


def interrupted(opened: Session, **settings: object) -> Path:
    """The journal of a search that was interrupted after its first batch."""

    def interrupt(*told: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        opened.gait("log", **settings, progress=interrupt)
    (path,) = (opened.path / "searches").glob("*.jsonl")
    return path


def test_an_interrupted_gait_goes_on(opened: Session) -> None:
    settings = {"on": "nominal", "rollouts": ROLLOUTS, "seed": 9, "threads": 1}
    interrupted(opened, **settings)
    assert opened.verify().clean
    resumed = opened.gait("log", **settings, resume=True)
    assert resumed.resumed == 10
    assert resumed.genes == opened.gait("log", **settings).genes


def test_the_nominal_simulator_may_stand_in_a_list_and_none_may_stand_there_twice(opened: Session) -> None:
    one = simulators(opened)[0]
    settings = {"rollouts": 2 * ROLLOUTS, "threads": 1}
    both = opened.gait("log", on=f"nominal, {one}", **settings)
    assert [trial.kind for trial in both.trials][0] == "nominal" and both.k == 2
    assert both.trials[0].simulator != both.trials[1].simulator == one
    for listed in (f"{one},{one}", f"{one},nominal,{one[:10]}", f"nominal,{both.trials[0].simulator}"):
        with pytest.raises(UsageError, match="on .* names simulator .* twice"):
            opened.gait("log", on=listed, **settings)


def test_a_search_that_runs_is_not_begun_beside_itself(opened: Session) -> None:
    settings = {"on": "nominal", "rollouts": ROLLOUTS, "seed": 10, "threads": 1}
    ran = []

    def beside(stage: str, done: int, total: int) -> None:
        ran.append(done)
        for resume in (False, True):
            with pytest.raises(UsageError, match="another run of the same search for a gait has not ended"):
                opened.gait("log", **settings, resume=resume)

    opened.gait("log", **settings, progress=beside)
    assert ran and not [*(opened.path / "searches").glob("*")]
    assert not [*(opened.path / "locks").glob("*.lock")], "no lock stays"


def test_what_other_versions_searched_is_run_again(opened: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {"on": "nominal", "rollouts": ROLLOUTS, "seed": 11, "threads": 1}
    interrupted(opened, **settings)
    monkeypatch.setattr(versions, "version", lambda name: "9.9")
    with pytest.warns(Assumed, match="gaits of an interrupted search were run by .*: they are run again"):
        assert opened.gait("log", **settings, resume=True).resumed == 0


@pytest.fixture
def written(found: Gait, opened: Session, tmp_path: Path) -> Path:
    for form in ("csv", "mcap", "python"):
        opened.export_gait("log", tmp_path / f"gait.{form}", form)
    return tmp_path


def test_a_table_holds_the_commands_and_can_be_read_as_a_log(written: Path, opened: Session) -> None:
    gait = opened.result("@last")
    table = np.genfromtxt(written / "gait.csv", delimiter=",", names=True, deletechars="")
    times, told = commands(gait)
    assert table.dtype.names == ("time", *(j.action for j in gait.joints))
    assert np.allclose(np.array(table.tolist())[:, 1:], told, atol=1e-6)
    with pytest.raises(UsageError, match="exists already"):
        opened.export_gait("log", written / "gait.csv", "csv")
    with pytest.raises(UsageError, match="form 'svg'.*'csv'.*'gif'"):
        opened.export_gait("log", written / "gait.svg", "svg")


def test_an_mcap_holds_joint_states(written: Path, opened: Session) -> None:
    from mcap.reader import make_reader

    times, told = commands(opened.result("@last"))
    with open(written / "gait.mcap", "rb") as file:
        messages = [json.loads(m.data) for _, _, m in make_reader(file).iter_messages()]
    assert np.allclose([m["position"] for m in messages], told)
    assert messages[0]["name"][:3] == ["fl_hip", "fl_shoulder", "fl_elbow"]
    again = written / "again.mcap"
    opened.export_gait("log", again, "mcap")
    assert again.read_bytes() == (written / "gait.mcap").read_bytes()


def test_the_python_module_needs_nothing_and_says_the_same(written: Path, opened: Session) -> None:
    """Isolated from every installed package; play goes back to rest at its end."""
    gait = opened.result("@last")
    script = (
        "import runpy, json, sys; m = runpy.run_path(sys.argv[1]); told = []; now = [0.0]\n"
        "m['play'](lambda j, a: told.append(a), clock=lambda: now[0], sleep=lambda s: now.__setitem__(0, now[0] + s))\n"
        "print(json.dumps([told, now[0], sorted(sys.modules)]))"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", script, str(written / "gait.python")],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    angles, lasted, modules = json.loads(done.stdout)
    angles = np.array(angles).reshape(-1, len(gait.joints))
    times, told = commands(gait)
    assert np.allclose(angles[: len(times)], told)
    assert np.allclose(angles[-1], [j.rest for j in gait.joints])
    assert lasted == pytest.approx(gait.seconds + gait.ramp, abs=0.1)
    assert "numpy" not in modules


def test_names_in_a_document_do_not_become_program(found: Gait, opened: Session, tmp_path: Path) -> None:
    evil = '"""\nraise SystemExit("taken over")\n"""'
    opened.export_gait(
        found.model_copy(update={"robot": evil, "task": evil, "unit": evil}), tmp_path / "g.py", "python"
    )
    made = runpy.run_path(str(tmp_path / "g.py"))
    assert made["ROBOT"] == evil and set(made["targets"](0.0)) == {
        j.action.split("/")[0] for j in found.joints
    }


def test_a_gait_is_drawn_as_it_walked(found: Gait, opened: Session, tmp_path: Path, monkeypatch) -> None:
    """In the simulation of its document, to the last bit."""
    seen = {}

    def draw(model, poses, rate, times, form):
        seen.update(poses=poses, rate=rate, times=times, form=form)
        return b"drawn"

    monkeypatch.setattr("dynreg.verbs.export_gait.draw", draw)
    opened.export_gait(found, tmp_path / "walk.gif", "gif")
    assert (tmp_path / "walk.gif").read_bytes() == b"drawn"
    trial = found.trials[0]
    steps = np.round(np.array(trial.time) * found.rate).astype(int)
    assert np.array_equal(seen["poses"][steps, :2], np.stack([trial.x, trial.y], axis=1))
    assert (seen["rate"], seen["form"], seen["times"][-1]) == (found.rate, "gif", pytest.approx(0.96))
    rest = np.array([j.rest for j in found.joints])
    smaller = rest + 0.5 * (np.array(found.table.targets) - rest)
    slower = found.table.model_copy(update={"targets": tuple(map(tuple, smaller.tolist()))})
    opened.export_gait(found.model_copy(update={"table": slower}), tmp_path / "slower.gif", "gif")
    assert abs(seen["poses"][steps[-1], 0] - trial.x[-1]) > 1e-4  # what was changed by hand is what is drawn
    with pytest.raises(UsageError, match="exists already"):
        opened.export_gait(found, tmp_path / "walk.gif", "gif")


def test_a_gait_is_drawn_where_it_walks_least_with_the_effects_there(
    opened: Session, brief, tmp_path: Path, monkeypatch
) -> None:
    seen = []
    monkeypatch.setattr(
        "dynreg.verbs.export_gait.draw", lambda model, poses, *rest: seen.append(poses) or b"drawn"
    )
    configs = [
        SimConfig(brief.hash, brief.name, {}, {"coulomb_friction": {"torque": t}}) for t in (0.05, 0.2)
    ]
    ids = [opened.registry.put_simulator(c.as_dict()) for c in configs]
    gait = opened.gait("log", on=",".join(ids), rollouts=44, threads=1)
    for order in (gait.trials, gait.trials[::-1]):
        fitness = [1.0, 0.5]  # as if the second one were the worse one, each in turn
        trials = tuple(t.model_copy(update={"fitness": f}) for t, f in zip(order, fitness, strict=True))
        listed = sorted(trials, key=lambda t: ids.index(t.simulator))
        opened.export_gait(
            gait.model_copy(update={"trials": tuple(listed)}), tmp_path / f"{len(seen)}.gif", "gif"
        )
        assert (seen[-1][-1, 0], seen[-1][-1, 1]) == (order[1].x[-1], order[1].y[-1])
    assert not np.array_equal(seen[0], seen[1])


def test_without_opengl_a_gait_is_not_drawn(
    found: Gait, opened: Session, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(PictureError, match="no picture was drawn"):
        opened.export_gait(found, tmp_path / "walk.png", "png")
    assert not list(tmp_path.iterdir())


def test_a_gait_changed_by_hand_past_its_limits_is_not_written(
    found: Gait, opened: Session, tmp_path: Path
) -> None:
    gait = found
    path = tmp_path / "wild.json"
    rows = np.array(gait.table.targets)

    def write(**changes: object) -> None:
        table = type(gait.table).model_validate(gait.table.to_dict() | changes)
        path.write_text(gait.model_copy(update={"table": table}).to_json())

    write(targets=(3.0 * rows).tolist())
    with pytest.raises(UsageError, match="fl_shoulder/target would go from"):
        opened.export_gait(path, tmp_path / "wild.csv")
    middle = rows.copy()
    middle[5, 1] += 0.3
    for change, says in (
        ({"targets": middle.tolist()}, "fl_shoulder/target would turn at"),
        ({"targets": rows[:, :3].tolist()}, "does not hold an angle of each joint"),
        ({"targets": rows[1:].tolist()}, "does not hold an angle of each joint"),
        ({"times": gait.table.times[::-1]}, "times do not rise"),
        ({"period": 7.0}, "its period does not end as it begins"),
    ):
        write(**change)
        with pytest.raises(UsageError, match=f"cannot be run.*{says}"):
            opened.export_gait(path, tmp_path / "wild.csv")
    text = gait.to_json()
    for old, new, says in (
        ('"ramp": 1.0', '"ramp": -1.0', "ramp = -1.0"),
        ('"ramp": 1.0', '"ramp": 0.0', "would begin away from rest"),
        (f"[[{rows[0, 0]}", "[[NaN", "targets of fl_hip"),
    ):
        assert old in text
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(UsageError, match=f"cannot be run.*{says}"):
            opened.export_gait(path, tmp_path / "wild.csv")
    first = gait.genes["frequency"].model_copy(update={"value": 9.0})
    for change, says in (
        ({"genes": {**gait.genes, "frequency": first}}, "frequency = 9 Hz lies outside"),
        ({"genes": {"frequency": first}}, "does not fit"),
        (
            {"joints": (gait.joints[0].model_copy(update={"high": 9.0}), *gait.joints[1:])},
            "fl_hip/target is not",
        ),
        ({"joints": gait.joints[:3]}, "number of joints is not stated"),
    ):
        path.write_text(gait.model_copy(update=change).to_json())
        with pytest.raises(UsageError, match=says):
            opened.export_gait(path, tmp_path / "wild.csv")
    for version in (1, 2):
        path.write_text(f'{{"schema": "dynreg/gait/{version}"}}')
        with pytest.raises(UsageError, match="is not a gait"):
            opened.export_gait(path, tmp_path / "wild.csv")
    joint = {"action": "fl_hip/target", "rest": 0.0, "low": None, "high": None, "speed": None}
    sine = joint | {"offset": 0.0, "amplitude": 0.1, "phase": 0.0}
    for frequency, stated, says in (
        (1.0, [{}], "joints.0.action: Field required"),
        ("x", [sine], "frequency: .*number"),
        (0.0, [sine], "frequency: .*greater than 0"),
        (1.0, 3, "joints: .*array"),
        (1.0, [joint], "joints.0.offset: Field required"),
        (1.0, [sine | {"phase": float("inf")}], "joints.0.phase: .*finite"),
        (1.0, [3], "joints.0: "),
    ):
        first = {"schema": "dynreg/gait/1", "frequency": frequency, "joints": stated}
        path.write_text(json.dumps(json.loads(text) | first))
        with pytest.raises(UsageError, match=f"is not a gait: {says}"):
            opened.export_gait(path, tmp_path / "wild.csv")
    assert not (tmp_path / "wild.csv").exists()


def test_the_log_of_a_trial_is_linked_to_its_gait(opened: Session, brief, tmp_path: Path) -> None:
    gait = opened.registry.latest("gait")
    _, told = commands(opened.result("@last"))
    real = SimulatedRobot(brief, brief.space.nominal, seed=2)
    log = real.run(told, brief.rate).recording
    kept = opened.ingest(log, brief, name="trial", gait="@last")
    assert kept.gait == gait.id
    assert opened.recording("trial").provenance["gait"] == gait.id
    assert opened.recording("trial").id == log.id  # the link does not change the data
    with pytest.raises(UsageError, match="is of robot 'quadruped'"):
        opened.ingest(log, "leg", gait=gait.id)
    query = opened.registry.put_result("neighbours", None, {})
    with pytest.raises(UsageError, match="of kind 'neighbours'"):
        opened.ingest(log, brief, gait=query)


def test_the_training_script(opened: Session, brief_folder: Path, tmp_path: Path, capsys) -> None:
    """From a table of a log to a Python module."""
    import importlib.util

    opened.recording("log").to_frame().drop(columns="episode").to_csv(tmp_path / "run.csv", index=False)
    source = Path(__file__).parents[2] / "examples" / "train_gait.py"
    spec = importlib.util.spec_from_file_location("train_gait", source)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    options = f"--robot {brief_folder} --registry {tmp_path / 'reg'} --on nominal --rollouts {ROLLOUTS}"
    script.main([str(tmp_path / "run.csv"), *options.split(), "--to", str(tmp_path / "gait.py")])
    assert "forward" in capsys.readouterr().out
    assert "def targets(t)" in (tmp_path / "gait.py").read_text()


def test_in_registered_simulators_at_random_and_more_than_there_are(brief, tmp_path: Path) -> None:
    """On a real population of three."""
    from tiny_registry import QUICK

    with session.open(tmp_path / "registry") as opened:
        real = SimulatedRobot(brief, brief.space.nominal, seed=1)
        commands = excitation(brief, seed=1, episodes=4, steps=40).actions
        logs = [real.run(c, brief.rate, f"e{i}").recording for i, c in enumerate(commands)]
        log = type(logs[0])(logs[0].channels, tuple(r.episodes[0] for r in logs), measured=False)
        opened.ingest(log, brief, name="log")
        opened.populate(brief, 3, training=QUICK, link=False, threads=1)
        found = opened.gait("log", on="random", k=2, rollouts=44, threads=1)
        assert [t.kind for t in found.trials] == ["random"] * 2
        assert len({opened.registry.resolve(t.simulator, ("entry",)) for t in found.trials}) == 2
        assert found != opened.gait("log", on="random", k=2, rollouts=44, seed=5, threads=1)
        for on in ("random", "nearest"):
            with pytest.raises(UsageError, match="k = 4.*1 to 3") as caught:
                opened.gait("log", on=on, k=4, threads=1)
            assert caught.value.exit_status == 2
