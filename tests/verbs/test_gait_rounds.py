"""Gaits tried on a robot in turn: the loop through a robot, a function and a folder, its budget, and going on."""

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import made_up_results
import numpy as np
import pytest
import toy_dog

from dynreg import session
from dynreg.data.recording import Recording
from dynreg.errors import Assumed, LogError, MapError, NoMatchError, UsageError
from dynreg.gait import forecast
from dynreg.gait.had import Had
from dynreg.gait.logged import LoggedRobot
from dynreg.gait.near import DOUBT as NEAR
from dynreg.gait.play import commands
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import fitness, task_of
from dynreg.gait.trials import Trials
from dynreg.report.tables import render
from dynreg.results import Gait, GaitRounds, Neighbour
from dynreg.session import Session
from dynreg.sim.config import SimConfig
from dynreg.sim.real import Budget, SimulatedRobot, Spent
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs import gait_simulators
from dynreg.verbs.gait import GaitSettings
from dynreg.verbs.gait import gait as seek
from dynreg.verbs.gait_simulators import Chosen, with_earlier
from dynreg.verbs.gaits import genes_of
from dynreg.verbs.next_gait import Tried, had_by
from dynreg.verbs.simulator import Simulator
from dynreg.verbs.simulators import simulator
from dynreg.verbs.subjects import Recorded, recorded
from dynreg.verbs.trial_folder import EVERY, MCAP_END, PATIENCE, QUIET, TrialFolder, state

ROLLOUTS = 22  # two batches of CMA-ES in one simulator
ASKED = {"on": "synthesised", "rollouts": ROLLOUTS, "threads": 1, "progress": None}


@pytest.fixture(autouse=True)
def quick_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials on a robot are many here, and none needs the usual ten steps for one of the simulators."""
    monkeypatch.setattr("dynreg.sim.real.FINER", 2)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory, brief, short_log) -> tuple[Path, list[str]]:
    """The folder of a registry with "log" and two simulators, and their ids."""
    folder = tmp_path_factory.mktemp("kept") / "registry"
    values = brief.space.as_dict(brief.space.nominal)
    with session.open(folder) as made:
        made.ingest(short_log, brief, name="log")
        configs = [SimConfig(brief.hash, brief.name, values | {"torque": torque}) for torque in (1.3, 1.5)]
        return folder, [made.registry.put_simulator(config.as_dict()) for config in configs]


@pytest.fixture
def opened(tmp_path: Path, kept, brief, monkeypatch: pytest.MonkeyPatch) -> Iterator[Session]:
    """A copy of that registry; `queried` has the recordings that a query was asked about."""
    folder, ids = kept
    shutil.copytree(folder, tmp_path / "registry")
    with session.open(tmp_path / "registry") as made:
        made.queried, made.fits, made.ids = [], {}, ids
        nominal = brief.space.as_dict(brief.space.nominal)

        def query(asked, settings, progress):
            made.queried.append(asked.name)
            fits = made.fits.get(asked.name, True)
            if isinstance(fits, LogError):
                raise fits
            answer = made_up_results.neighbours(fits=fits)
            told = answer.synthesised.model_copy(update={"simulator": ids[asked.name == "log"]})
            near = Neighbour(
                entry=ids[0], name="n", index=0, distance=1.0, parameters=nominal | {"torque": 1.3}
            )
            return answer.model_copy(update={"robot": brief.name, "neighbours": (near,), "synthesised": told})

        monkeypatch.setattr("dynreg.verbs.gait_simulators.query", query)
        yield made


@pytest.fixture
def one_gait(opened: Session, monkeypatch: pytest.MonkeyPatch) -> Gait:
    """The gait that every search finds from now on: none runs."""
    found = opened.gait("log", **ASKED)

    def same(asked: Recorded, settings: GaitSettings, *_, had: Had) -> Gait:
        return found.model_copy(update={"seed": settings.seed, "recording": asked.recording.id})

    monkeypatch.setattr("dynreg.verbs.next_gait.gait", same)
    return found


def robot_of(brief: Robot, **budget: int) -> SimulatedRobot:
    return SimulatedRobot(brief, brief.space.nominal, seed=9, budget=Budget(**budget), threads=1)


def test_each_trials_log_tells_where_the_next_gait_is_sought(
    opened: Session, brief: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, told = robot_of(brief), []

    def gait(asked, settings, progress, *, had):
        told.append(had)
        assert settings.resume  # an interrupted search goes on
        return seek(asked, settings, progress, had=had)

    monkeypatch.setattr("dynreg.verbs.next_gait.gait", gait)
    found = opened.gait_rounds("log", real, trials=3, **ASKED)
    assert isinstance(found, GaitRounds) and opened.result("@last") == found
    assert opened.queried == ["log", "log trial 1", "log trial 2"]
    assert real.spent.trials == 3 and found.seconds == real.spent.seconds
    gaits = [Gait.model_validate(opened.registry.result(one.gait).document) for one in found.rounds]
    assert [g.recording_name for g in gaits] == opened.queried
    assert gaits[0] == opened.gait("log", **ASKED).model_copy(update={"cost": gaits[0].cost})
    for number, (one, gait) in enumerate(zip(found.rounds, gaits, strict=True), start=1):
        assert one.name == f"log trial {number}" and one.fits
        assert opened.registry.recording(one.recording).provenance["gait"] == one.gait
        assert one.simulators == tuple(t.simulator for t in gait.trials)
        assert (one.median, one.p5, one.p95) == (gait.expected.median, gait.expected.p5, gait.expected.p95)
        again = robot_of(brief)
        again.spent = type(again.spent)(trials=number - 1)
        trial = again.run(commands(gait)[1], gait.rate, f"trial_{number}")
        assert one.fell == trial.fell and opened.registry.holds(trial.recording.id)
        assert one.fitness == pytest.approx(float(fitness(task_of(brief).grade(trial.walk))[0, 0]))
    stood = [one.again for one in found.rounds if not one.fell]
    assert found.falls == 3 - len(stood)
    assert found.best is None if not stood else found.rounds[found.best - 1].again == max(stood)
    assert gaits[0].seed == 0 and len({g.seed for g in gaits}) == 3
    # what the robot has had is told to the next search
    genes = [tuple(gait_space(brief).from_dict(genes_of(g))) for g in gaits]
    reached = [one.fitness for one in found.rounds]
    assert [one.genes for one in told] == [(), (genes[0],), (*genes[:2],)]
    assert [one.reached for one in told] == [(), (reached[0],), (*reached[:2],)]


def test_once_a_gait_walked_the_next_is_sought_near_it_in_the_simulators_of_all_logs(
    opened, brief, monkeypatch
) -> None:
    again, own = [], Trials.again
    monkeypatch.setattr(Trials, "again", lambda self, *a, **how: again.append(how) or own(self, *a, **how))
    asked = recorded(opened.registry, "log", ingest=True)
    settings = GaitSettings(on="synthesised", rollouts=150, threads=1, packaged=False)
    space = gait_space(brief)
    best, other = (tuple(space.feasible(space.from_unit(u[None]))[0]) for u in space.starts[:2])
    newest, earlier = opened.ids[1], opened.ids[0]  # as the fixture's query tells of "log" and of a trial
    told = lambda walked: Had(  # noqa: E731
        (other, best), (0.1, 0.9), (False, walked), (newest, earlier, earlier)
    )
    near = seek(asked, settings, had=told(walked=True))
    foretold = [how for how in again if how.get("moved")]  # what the two will do on the robot
    assert {how["doubt"] for how in foretold} == {forecast.DOUBT} and len(foretold) == 2
    moved = [how["doubt"] for how in again if how.get("doubt") and how not in foretold]
    assert set(moved) == {NEAR}  # in the search, on the way and in what a trial may bring
    assert [t.simulator for t in near.trials] == [newest, earlier] and near.seed == settings.seed
    # a gait costs a run, and 40 in all tell what it may bring; what the two will do on the robot, twice as many each
    assert near.cost.rollouts <= 150 + 2 + 40 + 2 * 2 * 40
    assert [t.simulator for t in seek(asked, settings, had=told(walked=False)).trials] == [newest]


def test_after_the_trials_gaits_are_forecast_in_the_simulators_of_the_last(
    opened, brief, monkeypatch
) -> None:
    asked, own = [], forecast.forecast

    def told(trials: Trials, had: Had, *new: np.ndarray) -> forecast.Forecast:
        asked.append((trials, had, new, own(trials, had, *new)))
        return asked[-1][-1]

    monkeypatch.setattr(forecast, "forecast", told)
    found = opened.gait_rounds("log", robot_of(brief), trials=2, **ASKED)
    trials, tried, new, made = asked[-1]
    last = opened.registry.result(found.rounds[-1].gait).document
    assert [brief.space.as_dict(v) for v in trials.simulators.values] == [
        one["parameters"] for one in last["trials"]
    ]
    assert tried.reached == tuple(one.fitness for one in found.rounds) and not new
    assert tuple(one.again for one in found.rounds) == (*made.values,) and trials.rate == last["rate"]


@pytest.mark.parametrize("fell", [(False, False, False), (False, True, False), (True, False, False)])
def test_of_those_that_stood_the_highest_forecast_is_the_best(
    fell, opened, one_gait, brief, monkeypatch
) -> None:
    real, order = robot_of(brief), [1.0, 3.0, 2.0]

    def trial(actions: np.ndarray, rate: float, name: str) -> Recording:
        log = real.run(actions, rate, name).recording
        return _cut(log) if fell[int(name[-1]) - 1] else log

    monkeypatch.setattr("dynreg.verbs.gait_rounds.forecasts", lambda *_: order)
    found = opened.gait_rounds("log", trial, trials=3, **ASKED)
    assert [one.again for one in found.rounds] == order and [one.fell for one in found.rounds] == [*fell]
    assert found.best == (3 if fell[1] else 2) and "another trial should reach" in found.headline


def test_without_the_simulators_the_best_is_the_one_that_did_most(opened, brief, monkeypatch) -> None:
    real, own = robot_of(brief), gait_simulators.simulators_named

    def lost(asked: Recorded, refs: list[str]) -> tuple[Simulator, ...]:
        if real.spent.trials == 2:  # after the trials
            raise NoMatchError("no simulator 'ab'", expected="one of this registry", do="x")
        return own(asked, refs)

    monkeypatch.setattr(gait_simulators, "simulators_named", lost)
    found = opened.gait_rounds("log", real, trials=2, **ASKED)
    assert [one.again for one in found.rounds] == [None, None]
    did = [one.fitness for one in found.rounds]
    assert found.best == 1 + did.index(max(did)) and "another" not in found.headline
    assert "did most in its one trial, which may be luck" in " ".join(rendered(found).split())


def test_simulators_of_earlier_logs_are_no_answers_of_this_one(opened, brief) -> None:
    asked = recorded(opened.registry, "log", ingest=True)
    one, two = (simulator(opened.registry, i, brief) for i in opened.ids)
    chosen = Chosen("posterior", ("answer", "posterior"), (one, one))
    more = with_earlier(asked, chosen, (one.id, two.id))
    assert more.kinds == ("answer", "posterior", "earlier") and more.simulators[2].id == two.id


def test_of_too_many_simulators_half_are_of_earlier_logs(opened, brief) -> None:
    asked = recorded(opened.registry, "log", ingest=True)
    values = brief.space.as_dict(brief.space.nominal)
    configs = [SimConfig(brief.hash, brief.name, values | {"torque": 1.2 + i / 100}) for i in range(8)]
    ids = [opened.registry.put_simulator(config.as_dict()) for config in configs]
    newest, earlier = ids[:4], ids[4:]
    chosen = Chosen(
        "posterior",
        ("answer", *["posterior"] * 3),
        tuple(simulator(opened.registry, i, brief) for i in newest),
    )
    for most, told in (
        (2, [newest[0], earlier[0]]),
        (4, [*newest[:2], *earlier[:2]]),
        (5, [*newest[:3], *earlier[:2]]),
        (7, [*newest, *earlier[:3]]),
        (8, ids),
        (None, ids),
    ):
        more = with_earlier(asked, chosen, (newest[1], *earlier, earlier[0]), most)
        assert [one.id for one in more.simulators] == told
        # what they were to an earlier log, they are not to this one
        new = [identity in newest for identity in told]
        assert more.kinds == ("answer", *("posterior" if one else "earlier" for one in new[1:]))
    assert [one.id for one in with_earlier(asked, chosen, (), 4).simulators] == newest


def test_a_gait_walked_where_it_stood_and_reached_what_counts_as_success(opened, brief) -> None:
    task, first = task_of(brief), opened.gait("log", **ASKED)
    doubled = {
        name: gene.model_copy(update={"value": 2.0 * gene.value}) for name, gene in first.genes.items()
    }
    at = tuple(one.model_copy(update={"simulator": opened.ids[0]}) for one in first.trials)
    gaits = [first, first.model_copy(update={"genes": doubled, "trials": at})]
    genes = [tuple(gait_space(brief).from_dict(genes_of(g))) for g in gaits]
    for reached, walked in ((0.9, True), (task.success, True), (0.9 * task.success, False)):
        told = had_by(brief, task, [Tried(gaits[0], 0.0, True), Tried(gaits[1], reached, False)])
        assert told.genes == (*genes,) and told.walked == (False, walked)
        assert told.simulators == (opened.ids[1], opened.ids[0])  # the query tells of the second one
        assert told.reached == (0.0, reached)
    for fitness_there in (0.0, 0.9):  # a fall behind the goal is a fall
        assert had_by(brief, task, [Tried(gaits[0], fitness_there, True)]).walked == (False,)
    assert had_by(brief, task, []) == Had()


def test_the_budget_ends_the_trials_and_all_that_was_found_is_kept(opened, brief) -> None:
    found = opened.gait_rounds("log", robot_of(brief, trials=1), trials=3, **ASKED)
    assert len(found.rounds) == 1 and "budget of 1 trials" in found.ended
    assert opened.queried == ["log"]  # no time is spent on a gait that cannot be tried
    fallen = lambda actions, rate, name: _cut(robot_of(brief).run(actions, rate).recording)  # noqa: E731
    found = opened.gait_rounds("log", fallen, trials=3, falls=2, **ASKED)
    assert [one.fell for one in found.rounds] == [True, True] and found.best is None
    assert "No gait stood" in str(found) and found.ended == "2 falls" and found.falls == 2
    had = LoggedRobot(brief, fallen, spent=Spent(trials=7, seconds=50.0, falls=5))
    found = opened.gait_rounds("log", had, trials=3, falls=1, **ASKED)  # those before are not of these trials
    assert len(found.rounds) == found.falls == 1 and found.seconds == pytest.approx(0.5, abs=0.1)


def test_a_budget_that_a_gait_would_exceed_ends_the_trials_too(
    opened, brief, one_gait, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = robot_of(brief, seconds=50)
    run = real.run
    monkeypatch.setattr(real, "run", lambda *told: real.afford(99.0) if real.spent.trials else run(*told))
    found = opened.gait_rounds("log", real, trials=3, **ASKED)
    assert len(found.rounds) == 1 and found.ended.startswith("the budget of 50 seconds")


def test_where_an_error_ends_the_trials_what_they_brought_is_kept(opened, brief, one_gait) -> None:
    real = robot_of(brief)

    def played(actions: np.ndarray, rate: float, name: str) -> Recording:
        if name == "trial_3":
            raise KeyboardInterrupt
        return real.run(actions, rate, name).recording

    with pytest.raises(KeyboardInterrupt):
        opened.gait_rounds("log", played, trials=3, **ASKED)
    kept = opened.result("@last")
    assert isinstance(kept, GaitRounds) and kept.ended == "interrupted after trial 2"
    assert [one.fitness for one in kept.rounds] == [pytest.approx(one.worth) for one in kept.rounds]
    assert len(kept.rounds) == 2 and kept.seconds == pytest.approx(3.0)  # in the third it may have moved


def test_a_search_that_cannot_be_gone_on_with_begins_anew(opened, brief) -> None:
    def interrupt(*told: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        opened.gait_rounds("log", robot_of(brief), trials=1, **(ASKED | {"progress": interrupt}))
    (journal,) = (opened.path / "searches").glob("*.jsonl")
    journal.write_text(journal.read_text(encoding="utf-8").replace("asked", "told"), encoding="utf-8")
    with pytest.warns(Assumed, match=r"line 2 of .* is damaged: the search begins anew"):
        found = opened.gait_rounds("log", robot_of(brief), trials=1, **ASKED)
    assert len(found.rounds) == 1 and not [*(opened.path / "searches").glob("*")]


@pytest.mark.parametrize("name", ["_fitness", "forecasts"])
def test_no_log_is_lost_where_what_it_tells_cannot_be_judged(
    name: str, opened, brief, one_gait, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def judged(*told: object) -> float:
        calls.append(told)
        if len(calls) == 2 or name == "forecasts":
            raise LogError("it does not tell", expected="a fitness", do="x")
        return 0.2

    monkeypatch.setattr(f"dynreg.verbs.gait_rounds.{name}", judged)
    with pytest.raises(LogError, match="does not tell"):
        opened.gait_rounds("log", robot_of(brief), trials=2, **ASKED)
    kept = opened.result("@last")
    assert isinstance(kept, GaitRounds) and kept.best is not None
    assert len(kept.rounds) == (2 if name == "forecasts" else 1)
    assert opened.registry.recording("log trial 2").provenance["gait"]


def _cut(log: Recording) -> Recording:
    """The log of a robot that was stopped half way."""
    from dataclasses import replace

    (e,) = log.episodes
    half = len(e.time) // 2
    return replace(log, episodes=(replace(e, time=e.time[:half], values=e.values[:half]),))


def test_a_log_that_no_simulator_is_close_to_leaves_those_before(opened, brief) -> None:
    opened.fits["log trial 1"] = False
    found = opened.gait_rounds("log", robot_of(brief), trials=3, **ASKED)
    assert opened.queried == ["log", "log trial 1", "log", "log trial 2"]
    assert [one.fits for one in found.rounds] == [True, False, True]
    first = opened.registry.recording_info("log").id
    assert [one.told_by == first for one in found.rounds] == [True, True, False]
    opened.fits["log trial 1"] = LogError("12 usable rows", expected="20", do="x")  # so of a fall at once
    found = opened.gait_rounds("log", robot_of(brief), trials=2, **ASKED)
    assert [one.fits for one in found.rounds] == [True, False]
    assert "did not tell where to seek" in str(rendered(found))
    opened.fits["log"] = False
    with pytest.raises(NoMatchError, match="no simulator is close enough"):
        opened.gait_rounds("log", robot_of(brief), **ASKED)


def test_simulators_that_no_query_names_are_refused_before_anything_moves(opened, brief) -> None:
    real = robot_of(brief)
    for on in ("nominal", "diagnosed", "random"):
        with pytest.raises(UsageError, match=f"--on {on}; expected one of posterior, nearest, synthesised"):
            opened.gait_rounds("log", real, **(ASKED | {"on": on}))
    assert real.spent.trials == 0 and opened.queried == []


def rendered(found: GaitRounds) -> str:
    """What the command line shows."""
    from io import StringIO

    from rich.console import Console

    out = StringIO()
    Console(file=out, width=100).print(render(found))
    return out.getvalue()


def test_what_no_robot_is_or_no_map_is_refused_before_anything_is_sought(
    opened, brief, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match="a robot of type 'int'"):
        opened.gait_rounds("log", 3, **ASKED)
    with pytest.raises(MapError):
        opened.gait_rounds("log", tmp_path / "trials", log_map=tmp_path / "none.toml", **ASKED)
    with pytest.raises(UsageError, match="--on nominal"):
        opened.gait_rounds("log", tmp_path / "trials", **(ASKED | {"on": "nominal"}))
    assert opened.queried == [] and not (tmp_path / "trials").exists()


def test_a_kick_that_no_log_scores_is_refused_before_anything_moves(tmp_path: Path) -> None:
    kick = '[[motions]]\nname = "kick"\n[[tasks]]\nname = "kick"\nkind = "kick"\nmotion = "kick"\nseconds = 1.0\n'
    dog = load_robot(toy_dog.folder(tmp_path / "dog", toy_dog.walking(), kick, ball=True))
    still = np.tile(gait_space(dog).pose, (30, 1))
    log = SimulatedRobot(dog, dog.space.nominal, seed=1).run(still, dog.rate).recording
    played = []
    with session.open(tmp_path / "registry") as made:
        made.ingest(log, dog, name="log")
        for real in (lambda *told: played.append(told), tmp_path / "trials"):
            with pytest.raises(UsageError, match="task 'kick' scores where a body beside the robot goes"):
                made.gait_rounds("log", real, **ASKED, task="kick")
    assert played == [] and not [*tmp_path.glob("trials/*")]


class Clock:
    """Stands in for `time` in `trial_folder`: to sleep moves it, and whoever writes into the folder is next.

    steps : (seconds after the one before, what is done then), in turn.
    """

    def __init__(self, steps: Sequence[tuple[float, Callable[[], object]]] = ()):
        self.now, self._steps, at = 0.0, [], 0.0
        for after, step in steps:
            at += after
            self._steps.append((at, step))

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        assert self.now < 3600.0, "it waits for ever"
        while self._steps and self._steps[0][0] <= self.now:
            self._steps.pop(0)[1]()


class Operator(Clock):
    """Plays what appears in a folder on a hidden robot, and puts the logs there."""

    def __init__(self, folder: Path, real: SimulatedRobot):
        super().__init__()
        self.folder, self.real = folder, real

    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        path = self.folder / f"trial_{self.real.spent.trials + 1}.csv"
        if path.exists():
            told = np.loadtxt(path, delimiter=",", skiprows=1)
            log = self.real.run(told[:, 1:], 1.0 / (told[1, 0] - told[0, 0])).recording
            write_log(path.with_name(f"{path.stem}_log.csv"), log)


def write_log(path: Path, log: Recording) -> None:
    """A table of the log, whole at once, with names of its own."""
    (e,) = log.episodes
    rows = np.concatenate([e.time[:, None], e.values], axis=1)
    part = path.with_name(f".{path.name}")
    np.savetxt(
        part,
        rows,
        delimiter=",",
        header=",".join(["time", *(f"my {name}" for name in log.names)]),
        comments="",
        fmt="%.17g",
    )
    part.rename(path)


def test_trials_through_a_folder_are_those_of_the_robot_and_a_second_start_goes_on(
    opened: Session, brief: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, said, names = tmp_path / "trials", [], opened.registry.recording("log").names
    asked = ASKED | {"log_map": tmp_path / "map.toml"}
    units = {c.name: c.unit for c in opened.registry.recording("log").channels}
    lines = [f'"{name}" = {{ source = "my {name}", unit = "{units[name]}" }}' for name in names]
    asked["log_map"].write_text("\n".join(['[map]\nrobot = "quadruped"\n\n[channels]', *lines]))
    operator = Operator(folder, robot_of(brief))
    monkeypatch.setattr("dynreg.verbs.trial_folder.time", operator)
    found = opened.gait_rounds("log", folder, trials=2, say=said.append, **asked)
    assert operator.real.spent.trials == 2
    alone = opened.gait_rounds("log", robot_of(brief), trials=2, **ASKED)
    assert [one.fell for one in found.rounds] == [one.fell for one in alone.rounds]
    assert found.rounds[0].fitness == pytest.approx(alone.rounds[0].fitness, abs=0.05)
    assert [line.split()[0] for line in said] == ["trial", "play", "trial"] * 2
    assert "A trial on the robot may bring" in said[0] and "trial_1.csv on the robot (1 s)" in said[1]
    one = found.rounds[0]
    assert f"predicted {one.median:.3g}" in said[2] and "its log is 'log trial 1'" in said[2]
    there = {path.name for path in folder.iterdir()}
    assert there == {f"{kind}_{i}{end}" for i in (1, 2) for kind, end in KINDS}

    # nothing is sought or waited for again
    monkeypatch.setattr("dynreg.verbs.next_gait.gait", None)
    again = opened.gait_rounds("log", folder, trials=2, say=said.append, **asked)
    assert again == found and [line.split()[0] for line in said[6:]] == ["trial", "trial"] * 2

    # nor is another question answered by what was found for this one
    for other in ({"task": "turn"}, {"seed": 4}, {"on": "nearest", "k": 1}, {"accept": "mean"}):
        with pytest.raises(UsageError, match=f"was sought with {next(iter(other))} .*the first start"):
            opened.gait_rounds("log", folder, trials=2, **(asked | other))

    kept = (folder / "gait_1.json").read_text()
    (folder / "gait_1.json").write_text(json.dumps(json.loads(kept) | {"robot_hash": "0123456789abcdef" * 4}))
    with pytest.raises(
        UsageError, match="sought for another version of the robot, 0123456789ab; expected quadruped"
    ):
        opened.gait_rounds("log", folder, trials=2, **asked)
    (folder / "gait_1.json").write_text(kept)

    # a folder that an older version began has the method's former name
    older = json.loads((folder / "gait_1.json").read_text()) | {"method": "cmaes"}
    (folder / "gait_1.json").write_text(json.dumps(older))
    assert opened.gait_rounds("log", folder, trials=2, **asked) == found

    kept = json.loads((folder / "gait_2.json").read_text())
    row = kept["table"]["targets"][5]
    told, row[0] = row[0], 9.0  # changed by hand
    (folder / "gait_2.json").write_text(json.dumps(kept))
    with pytest.raises(UsageError, match="fl_hip/target would go from"):
        opened.gait_rounds("log", folder, trials=2, **asked)
    row[0] = told
    (folder / "gait_2.json").write_text(json.dumps(kept))

    (folder / "trial_2.csv").write_text("time\n")
    with pytest.raises(UsageError, match="holds other commands than the gait"):
        opened.gait_rounds("log", folder, trials=2, **asked)
    (folder / "trial_1_log.csv").write_text("time,my fl_hip/position\n0,0\n1,0\n")
    with pytest.raises(MapError, match="my fl_shoulder/position"):
        opened.gait_rounds("log", folder, trials=2, **asked)
    opened.ingest(_cut(opened.registry.recording("log")), brief, name="other")
    with pytest.raises(UsageError, match="trial 1 was sought for recording"):
        opened.gait_rounds("other", folder, trials=1, **asked)


KINDS = (("gait", ".json"), ("trial", ".csv"), ("trial", "_log.csv"))


def append(path: Path, data: bytes) -> None:
    with open(path, "ab") as file:
        file.write(data)


def test_a_log_is_read_when_it_is_whole(
    brief: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    csv, mcap, bag = (tmp_path / f"trial_{name}" for name in ("1_log.csv", "2_log.mcap", "3_log"))
    steps = [
        # of no format that can be read
        (1.0, lambda: (tmp_path / "trial_1_log.csv.part").write_text("time")),
        (9.0, lambda: csv.write_bytes(b"")),
        (2.0 * QUIET, lambda: append(csv, b"time\n")),  # an empty one is none yet
        *[(0.8 * QUIET, lambda: append(csv, b"0\n"))] * 3,  # pauses shorter than the quiet
        (2.0 * QUIET, lambda: append(mcap, b"some")),
        (1.5 * PATIENCE, lambda: append(mcap, MCAP_END)),  # but a file of this format has an end
        (2.0 * QUIET, bag.mkdir),  # as a recorder makes it, before the robot moves
        (0.0, lambda: (bag / "one.db3").write_text("")),
        (5.0 * QUIET, lambda: (bag / "metadata.yaml").write_text("")),
    ]
    at = np.cumsum([after for after, _ in steps])
    clock, said = Clock(steps), []
    monkeypatch.setattr("dynreg.verbs.trial_folder.time", clock)
    folder = TrialFolder(tmp_path, None, brief, say=said.append)
    for name, log, whole in (("trial_1", csv, at[5]), ("trial_2", mcap, at[7]), ("trial_3", bag, at[-1])):
        assert folder._arrived(name) == log
        assert QUIET <= clock.now - whole <= QUIET + 2 * EVERY  # when it is seen, and when it was quiet
    slow = [line for line in said if "is there, but its end is not written" in line]
    assert len(slow) == 2 and str(mcap) in slow[0] and str(bag) in slow[1]


def test_while_there_are_two_logs_neither_is_taken_nor_called_unread(
    brief: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    download, log = tmp_path / "trial_1_log (1).csv", tmp_path / "trial_1_log.csv"
    steps = [
        (1.0, lambda: download.write_text("time\n")),
        (0.0, lambda: log.write_text("time\n")),
        (60.0, download.unlink),
    ]
    clock, said = Clock(steps), []
    monkeypatch.setattr("dynreg.verbs.trial_folder.time", clock)
    assert TrialFolder(tmp_path, None, brief, say=said.append)._arrived("trial_1") == log
    assert clock.now >= 61.0
    assert said == ["trial_1_log (1).csv, trial_1_log.csv would all be the log of trial_1: leave one of them"]


def test_a_log_that_goes_away_is_waited_for_again(
    brief: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, seen = tmp_path / "trial_1_log.mcap", []

    def looked(path: Path) -> object:
        found = state(path)
        seen.append(found)
        if len(seen) == 5:  # once it was looked at
            path.unlink()
        return found

    steps = [(1.0, lambda: log.write_bytes(MCAP_END)), (60.0, lambda: log.write_bytes(MCAP_END))]
    clock = Clock(steps)
    monkeypatch.setattr("dynreg.verbs.trial_folder.time", clock)
    monkeypatch.setattr("dynreg.verbs.trial_folder.state", looked)
    assert TrialFolder(tmp_path, None, brief, say=print)._arrived("trial_1") == log
    assert 61.0 + QUIET <= clock.now <= 61.0 + QUIET + 2 * EVERY


def test_a_folder_that_goes_away_while_its_log_is_waited_for_is_named(
    brief: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "trials"
    place.mkdir()
    clock = Clock([(5.0, lambda: place.rename(tmp_path / "moved"))])
    monkeypatch.setattr("dynreg.verbs.trial_folder.time", clock)
    folder = TrialFolder(place, None, brief, say=lambda _: None)
    with pytest.raises(
        UsageError, match="trials' cannot be read any more: No such file.*the same command goes on"
    ):
        folder.played(np.zeros((5, len(brief.actions))), brief.rate, "trial_1")


def test_a_file_with_another_name_than_the_log_is_told_once(
    brief: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "notes.md").write_text("there before")
    named = [
        (0.0, lambda name=name: (tmp_path / name).write_text("time\n0\n"))
        for name in ("log_1.csv", ".trial_1_log.csv", "trial_1_log.csv.part")
    ]
    rename = lambda: (tmp_path / "log_1.csv").rename(tmp_path / "trial_1_log.csv")  # noqa: E731
    monkeypatch.setattr("dynreg.verbs.trial_folder.time", Clock([*named, (10.0, rename)]))
    said = []
    folder = TrialFolder(tmp_path, None, brief, say=said.append)
    assert folder._arrived("trial_1").name == "trial_1_log.csv"
    assert said == ["log_1.csv is not read: trial_1_log.mcap (or .csv, .bag, ...) is waited for"]


def test_a_log_from_before_its_commands_is_refused(brief: Robot, tmp_path: Path) -> None:
    (tmp_path / "trial_1_log.csv").write_text("time\n0\n1\n")
    folder = TrialFolder(tmp_path, None, brief, say=lambda _: None)
    with pytest.raises(UsageError, match=r"trial_1_log.csv' answers trial_1.csv, which.* remove it"):
        folder.played(np.zeros((5, len(brief.actions))), brief.rate, "trial_1")
    assert not (tmp_path / "trial_1.csv").exists()


def test_a_folder_that_cannot_be_is_refused_before_a_search(opened: Session, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file", tmp_path / "nowhere" / "trials", Path("/proc/self")):
        with pytest.raises(UsageError, match="no folder for trials at"):
            opened.gait_rounds("log", path, **ASKED)
    assert opened.queried == []
