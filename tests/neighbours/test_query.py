"""From a recording of a secret servo to the simulator that predicts it best."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import secret_servo
from secret_servo import ENTRIES, TRAINING

from dynreg import session
from dynreg.data.names import episode_of
from dynreg.data.recording import Episode, Recording
from dynreg.errors import LogError, UsageError
from dynreg.neighbours.spending import usual_budget
from dynreg.replay.windows import Replayer
from dynreg.results import Neighbours
from dynreg.sim.robot import load_robot
from dynreg.verbs.populations import load_population
from dynreg.verbs.query import QuerySettings, query
from dynreg.verbs.subjects import Recorded


@pytest.fixture(scope="module")
def short(servos):
    """A recording that is quickly replayed."""
    return servos.ingest(secret_servo.record(secret_servo.values_of(50), 50, steps=50), "servo_pendulum")


@pytest.fixture
def watched(monkeypatch):
    """Every call of the replayer: (simulators, windows)."""
    calls = []
    states = Replayer.states

    def watch(self, values, chosen, initial=None):
        calls.append((len(values), tuple(int(w) for w in chosen)))
        return states(self, values, chosen, initial)

    residuals_from = Replayer.residuals_from

    def watch_starts(self, values, chosen, initial):
        calls.append((len(initial), tuple(int(w) for w in chosen)))
        return residuals_from(self, values, chosen, initial)

    monkeypatch.setattr(Replayer, "states", watch)
    monkeypatch.setattr(Replayer, "residuals_from", watch_starts)
    return calls


def without_time(answer: Neighbours) -> dict:
    document = answer.to_dict()
    document["cost"].pop("seconds")
    return document


def test_the_answer_predicts_the_test_part_far_better_than_the_nominal_simulator(asked):
    for one in asked:
        stages = {stage.stage: stage.test for stage in one.answer.stages}
        assert stages["answer"] < 0.25 * stages["nominal"]
        assert one.answer.gain.value == pytest.approx(1 - stages["answer"] / stages["nominal"])


@pytest.mark.parametrize(
    "planted", [{"zero_offset": 0.055}, {"zero_offset": -0.06, "coulomb_friction": 0.06}]
)
def test_a_planted_parameter_is_recovered_within_its_interval(servos, planted):
    values = secret_servo.values_of(60, **planted)
    made = servos.query(servos.ingest(secret_servo.record(values, 60), "servo_pendulum")).synthesised
    for name, value in planted.items():
        found = made.parameters[name]
        low, high = found.limits
        assert found.low <= value <= found.high
        assert found.high - found.low < 0.7 * (high - low), "an interval that says something"
        assert abs(found.value - value) < abs(found.nominal - value) / 2


def test_most_intervals_hold_the_truth(asked):
    """90 % intervals of 7 parameters of 6 servos; 42 draws at 90 % give fewer than 31 once in 1000."""
    held = [
        [
            e.low <= value <= e.high
            for e, value in zip(a.answer.synthesised.parameters.values(), a.values, strict=True)
        ]
        for a in asked
    ]
    assert np.sum(held) >= 31


def test_the_answer_has_the_lowest_error_of_all_that_was_replayed(asked):
    for one in asked:
        answer = one.answer
        errors = {"nominal": answer.nominal.replay_error, "synthesised": answer.synthesised.replay_error}
        errors["neighbour"] = min(n.replay_error for n in answer.neighbours)
        assert min(errors, key=errors.get) == answer.answer_kind
        ranked = [n.replay_error for n in answer.neighbours]
        assert ranked == sorted(ranked)
        if answer.answer_kind == "synthesised":
            assert answer.answer == answer.synthesised.simulator


def test_the_answer_can_be_simulated_again_from_the_registry(servos, asked):
    answer = asked[0].answer
    stored = servos.registry.simulator(answer.answer)
    assert stored["values"] == answer.answer_parameters
    assert servos.registry.load_entry(answer.neighbours[0].entry).values == answer.neighbours[0].parameters


def test_the_test_part_is_replayed_once_and_last(servos, short, watched):
    answer = servos.query(short, hold_out="0.3")
    windows = [f"run{e}" for e in range(10)]
    test = {windows.index(name) for name in answer.parts["test"]}
    chosen = {windows.index(name) for part in ("fit", "select") for name in answer.parts[part]}
    assert len(test) == 3 and not test & chosen and test | chosen == set(range(10))
    last = [bool(set(used) & test) for _, used in watched]
    assert last == sorted(last), "nothing is chosen after the test part was seen"
    *before, (_, judged) = watched
    assert set(judged) == test | chosen, "the alarm looks at all of the log"
    for _, used in before:
        assert set(used) in (test, chosen)


@pytest.mark.parametrize("budget", [7, 8, 15, usual_budget(load_robot("servo_pendulum"), 5)])
@pytest.mark.parametrize("synthesise", [True, False])
def test_the_budget_is_kept_and_counted(servos, short, watched, budget, synthesise):
    answer = servos.query(short, budget=budget, synthesise=synthesise, hold_out="0.3")
    test = len(answer.parts["test"])
    watched.pop()  # the alarm chooses nothing
    spent = sum(count for count, used in watched if len(used) != test)
    assert answer.cost.rollouts == spent <= budget
    if budget <= 25:
        assert spent == budget, "what is allowed is used, until the last steps save nothing"
    assert answer.cost.test_rollouts == next(count for count, used in watched if len(used) == test)


def test_what_the_test_part_says_changes_nothing_but_its_own_figures(servos):
    """Another robot's motion in the held-out episodes: the same answer."""
    recording = secret_servo.record(secret_servo.values_of(51), 51, episodes=6, steps=50)
    other = secret_servo.record(secret_servo.values_of(52), 51, episodes=6, steps=50)
    mixed = Recording(recording.channels, (*recording.episodes[:5], other.episodes[5]))
    one, two = (
        servos.query(servos.ingest(r, "servo_pendulum"), hold_out="run5", budget=12)
        for r in (recording, mixed)
    )
    assert one.stages[-1].test != two.stages[-1].test
    assert [n.entry for n in one.neighbours] == [n.entry for n in two.neighbours]
    assert [n.distance for n in one.neighbours] == [n.distance for n in two.neighbours]


@pytest.mark.parametrize("threads", [1, 2])
def test_the_same_question_has_the_same_answer_on_any_number_of_threads(servos, asked, threads):
    again = servos.query("secret 0", threads=threads)
    first, second = without_time(asked[0].answer), without_time(again)
    # other recordings may have been asked about meanwhile, which are entries now; never its own
    near = first.pop("measured") + second.pop("measured")
    assert servos.recording("secret 0").id not in {one["recording"] for one in near}
    assert second == first


def test_an_answer_comes_back_from_json_and_from_the_registry(servos, asked):
    answer = asked[1].answer
    assert Neighbours.model_validate(json.loads(answer.to_json())).to_dict() == answer.to_dict()
    assert servos.result("secret 1").to_dict() == answer.to_dict()


@pytest.mark.parametrize("hold_out, test", [("kp=200", None), ("run2,run3", 2), ("0", 0), ("0.4", 4)])
def test_what_is_held_out_is_what_was_asked_for(servos, short, hold_out, test):
    answer = servos.query(short, hold_out=hold_out, budget=10, synthesise=False)
    if test is None:
        episodes = servos.registry.recording(short.recording).episodes
        assert answer.parts["test"] == tuple(e.name for e in episodes if e.settings["kp"] == 200)
        assert answer.parts["test"]
    else:
        assert len(answer.parts["test"]) == test
    assert (answer.gain is None) == (test == 0)
    assert (answer.stages[-1].test is None) == (test == 0)


def test_neighbours_alone_cost_no_simulation(servos, short, watched):
    answer = servos.query(short, replay=False, synthesise=False, k=3)
    assert watched == [] and answer.cost.rollouts == 0 and len(answer.neighbours) == 3
    distances = [n.distance for n in answer.neighbours]
    assert distances == sorted(distances) and answer.nominal.replay_error is None


def test_more_neighbours_contain_fewer(servos, short):
    few, many = (servos.query(short, k=k, replay=False, synthesise=False).neighbours for k in (2, 10))
    assert [n.entry for n in many][:2] == [n.entry for n in few]
    assert len({n.entry for n in many}) == 10


def test_a_single_run_is_enough_for_an_answer(servos):
    recording = secret_servo.record(secret_servo.values_of(53), 53, episodes=1, steps=200)
    answer = servos.query(servos.ingest(recording, "servo_pendulum"))
    assert answer.gain is None and answer.parts["test"] == ()
    assert answer.synthesised.replay_error < 0.5 * answer.nominal.replay_error


def test_rows_that_were_not_measured_are_left_out(servos, asked):
    """A tenth of the rows lost, here and there and at the start of a run: nearly the same servo is found."""
    recording = asked[2].recording
    rng = np.random.default_rng(0)
    episodes = []
    for e in recording.episodes:
        values = e.values.copy()
        values[rng.uniform(size=len(values)) < 0.1, :2] = np.nan
        values[:5, 0] = np.nan
        episodes.append(Episode(e.name, e.time, values, e.settings))
    holed = Recording(recording.channels, tuple(episodes))
    answer = servos.query(servos.ingest(holed, "servo_pendulum"))
    assert answer.gain.value > 0.75
    assert all(np.isfinite([s.fit, s.select, s.test]).all() for s in answer.stages)


def test_optional_inputs_that_were_not_logged_take_their_defaults(servos, asked):
    recording = asked[3].recording
    keep = recording.columns(["arm/position", "arm/velocity", "arm/target"])
    enabled = recording.columns(["arm/enabled"])[0]
    bare = Recording(
        tuple(recording.channels[i] for i in keep),
        tuple(
            Episode(e.name, e.time, e.values[:, keep], e.settings)
            for e in recording.episodes
            if e.values[:, enabled].min() > 0  # a drive that was switched off cannot be guessed
        ),
    )
    answer = servos.query(servos.ingest(bare, "servo_pendulum"), budget=20)
    assert answer.stages[-1].test < answer.stages[0].test


def test_too_few_rows_are_refused(servos):
    tiny = secret_servo.record(secret_servo.values_of(54), 54, episodes=1, steps=10)
    with pytest.raises(LogError, match="10 usable rows|usable rows"):
        servos.query(servos.ingest(tiny, "servo_pendulum"))


@pytest.mark.parametrize(
    "asked_for, words",
    [
        ({"k": 25}, "k = 25"),
        ({"k": 0}, "k 0"),
        ({"budget": 6}, "a budget of 6 replays"),
        ({"distance": "cosine"}, "distance 'cosine'"),
        ({"hold_out": "kp=1"}, "hold-out 'kp=1' fits no episode"),
        ({"hold_out": ",".join(f"run{i}" for i in range(10))}, "leaves nothing to choose by"),
    ],
)
def test_what_cannot_be_asked_is_refused(servos, short, asked_for, words):
    with pytest.raises(UsageError, match=words):
        servos.query(short, **asked_for)


def test_of_a_long_run_only_the_chosen_windows_are_seen(servos):
    """One run cut into windows: what lies in the held-out ones does not reach the choice."""
    (record,) = servos.registry.populations()
    population = load_population(servos.registry, record.id)
    robot = population.shared.robot
    horizon = robot.file.replay.model_copy(update={"horizon": 0.2})
    robot = replace(robot, file=robot.file.model_copy(update={"replay": horizon}))
    population = replace(population, shared=replace(population.shared, robot=robot))
    recording = secret_servo.record(secret_servo.values_of(55), 55, episodes=1, steps=200)
    settings = QuerySettings(budget=10, synthesise=False)
    ask = lambda log: query(Recorded(servos.registry, robot, log, "long"), settings, population=population)  # noqa: E731
    first = ask(recording)
    (run,) = recording.episodes
    values = run.values.copy()
    for name in first.parts["test"]:
        window = int(name.removeprefix("run0[").removesuffix("]"))
        values[20 * window + 1 : 20 * window + 20, :2] *= -1
    changed = Recording(recording.channels, (Episode(run.name, run.time, values, run.settings),))
    second = ask(changed)
    assert len(first.parts["test"]) == 2 and second.parts == first.parts
    assert [n.distance for n in second.neighbours] == [n.distance for n in first.neighbours]
    assert second.stages[-1].test > first.stages[-1].test


@pytest.mark.parametrize("rate", [80.0, 50.0])
def test_what_the_log_tells_of_the_robot_is_not_searched(tmp_path, rate):
    """A robot whose command rate is a parameter marked known: the answer has the recording's rate.

    So it has where that lies outside the range, which ends at 60 Hz.
    """
    folder = shutil.copytree(load_robot("servo_pendulum").folder, tmp_path / "rated")
    with (folder / "robot.toml").open("a") as table:
        table.write(
            '\n[[parameters]]\nname = "command_rate"\nunit = "Hz"\nnominal = 100.0\nlow = 60.0\nhigh = 140.0\n'
            'known = true\nsets = ["control.rate ="]\n'
        )
    with session.open(tmp_path / "registry") as rated:
        rated.populate(folder, ENTRIES, training=TRAINING, link=False)
        recording = secret_servo.record(secret_servo.values_of(56), 56, episodes=5, steps=60)
        slower = tuple(
            Episode(e.name, e.time * 100.0 / rate, e.values, e.settings) for e in recording.episodes
        )
        known = rated.ingest(Recording(recording.channels, slower), folder)
        answer = rated.query(known, budget=24)
    found = answer.synthesised.parameters["command_rate"]
    assert answer.answer_parameters["command_rate"] == pytest.approx(rate)
    assert found.low == found.value == found.high == pytest.approx(rate) and not found.at_bound
    rates = [n.parameters["command_rate"] for n in answer.neighbours]
    assert len(set(rates)) == 5, "the entries themselves are as they were registered"


def test_a_synthesised_simulator_tells_which_episodes_shaped_it_wherever_it_is_taken(servos, asked, tmp_path):
    """Its result alone told them, so in another registry they counted as held out."""
    one = next(a for a in asked if a.answer.synthesised)
    parts, made = one.answer.parts, one.answer.synthesised.simulator
    fitted = {episode_of(name) for name in (*parts["fit"], *parts["select"])}
    with session.open(tmp_path / "elsewhere") as elsewhere:
        recording = elsewhere.ingest(one.recording, "servo_pendulum", name="log")
        taken = elsewhere.registry.put_simulator(servos.registry.simulator(made))
        rollouts = elsewhere.compare(recording, simulators=["nominal", taken]).rollouts
    assert {*rollouts.left_out} == fitted and not fitted & {*rollouts.episodes}
