"""Back to Reality over a toy: a gait scores by how near it is to what the robot hides, and some gaits fall."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from dynreg.adapt.differences import DIFFERENCES, rank_correlation
from dynreg.adapt.journalled import Journalled, Outcome, outcome_of
from dynreg.adapt.reality import back_to_reality
from dynreg.adapt.tried import ADAPTED, BACK, REFINE, TRANSFER, Reached, Rules
from dynreg.adapt.world import World
from dynreg.errors import BudgetError, CorruptError, UsageError
from dynreg.rng import stream
from dynreg.search.journal import Journal

HIDDEN = np.array([0.75, 0.3, 0.6])
BEGIN = np.array([0.45, 0.5, 0.4])  # the simulator's
GAIT = np.array([0.1, 0.8, 0.3, 0.2])  # stands, and is poor
TALL = 0.7  # a gait whose last gene is higher falls on the robot; no simulator knows
FREE = np.arange(3)
SMALL = Rules(first=20, later=8, turns=30, simulators=20, steps=2, variations=6)


def scores(gaits: np.ndarray, simulators: np.ndarray) -> np.ndarray:
    """(s, n) highest, 1, where the first genes are the simulator's numbers."""
    apart = np.abs(gaits[None, :, :3] - simulators[:, None]).mean(axis=-1)
    return np.clip(1.0 - 2.0 * apart, 0.0, None)


class Robot:
    """What is behind the door: trials at most, and which gaits were played."""

    def __init__(
        self, most: int = 1000, breaks: int | None = None, slips: float = np.inf, tall: float = TALL
    ):
        self.most, self.breaks, self.slips, self.tall = most, breaks, slips, tall
        self.played, self.counted = [], []

    def begin(self) -> Outcome:
        if len(self.played) == self.most:
            raise BudgetError("the budget is spent", expected="more", do="grant it", what="trials")
        number = len(self.played) + len(self.counted) + 1
        return Outcome(None, 2.0, number, number, lost=True)

    def __call__(self, gait: np.ndarray) -> Outcome:
        begun = self.begin()
        if len(self.played) == self.breaks:
            raise KeyboardInterrupt
        self.played.append(gait)
        off = np.abs(gait[:3] - HIDDEN).mean()
        fell = gait[3] > self.tall or off > self.slips
        score = None if fell else float(scores(gait[None], HIDDEN[None])[0, 0])
        return replace(begun, score=score, lost=False)


def run(
    robot,
    rules: Rules = SMALL,
    seed: int = 4,
    journal=lambda _: None,
    gaits: np.ndarray = GAIT[None],
    play=scores,
) -> Reached:
    world = World(play, robot, lambda step: stream(seed, "toy", step), journal)
    return back_to_reality(world, rules, gaits, BEGIN, FREE)


@pytest.fixture(scope="module")
def usual() -> Reached:
    """What a run with all defaults reaches."""
    return run(Robot())


def apart(simulator: np.ndarray) -> float:
    """Mean difference over gaits that no choice has seen."""
    unseen = stream(9, "unseen").uniform(size=(200, 4))
    return float(np.abs(scores(unseen, simulator[None]) - scores(unseen, HIDDEN[None])).mean())


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5, 6])
def test_the_absolute_difference_brings_the_simulator_near_and_the_signed_one_leads_it_away(
    seed: int,
) -> None:
    one = replace(SMALL, iterations=1, steps=0, first=4, lost=0.9, enough=0.05)
    found = {
        name: run(Robot(), replace(one, difference=name), seed).versions[-1]
        for name in ("absolute", "signed", "rank")
    }
    assert found["absolute"].after < 0.3 * found["absolute"].before
    assert apart(found["absolute"].simulator) < 0.85 * apart(BEGIN)
    assert found["rank"].after < 0.3 * found["rank"].before
    assert apart(found["signed"].simulator) > apart(BEGIN), "the slowest simulator has its lowest value"


def test_a_gait_and_a_simulator_make_each_other_better(usual: Reached) -> None:
    first = scores(GAIT[None], HIDDEN[None])[0, 0]
    assert usual.best.score > 1.5 * first and usual.ended == "iterations"
    assert [v.iteration for v in usual.versions] == [0, 1, 2] and usual.versions[2].parent == 1
    assert all(v.after < 0.6 * v.before for v in usual.versions[1:])
    second = [t.simulated for t in usual.tried if t.iteration == 2 and t.step == TRANSFER]
    assert min(second) > 1.5 * first, "the second search begins with what stood on the robot"


def test_gaits_that_fall_are_discarded_and_counted_and_shape_nothing() -> None:
    robot = Robot()
    found = run(robot, replace(SMALL, lost=0.9, first=4), seed=2)
    fell = [one for one in found.tried if one.fell]
    assert fell and all(one.scores[-1] is None and one.score == 0.0 for one in fell)
    assert all(None not in one.scores[:-1] for one in fell), "a fall ends the trials of a gait"
    lost = {n for one in fell for n in one.trials}
    assert not lost & {n for v in found.versions for n in v.trials}
    numbers = [n for one in found.tried for n in one.trials]
    assert numbers == [*range(1, len(robot.played) + 1)], "every trial counts, those with a fall too"
    for number in (1, 2):
        stood = [t for t in found.tried if (t.iteration, t.step, t.fell) == (number, TRANSFER, False)]
        assert len(stood) == SMALL.stand and all(len(t.trials) == SMALL.repeats for t in stood)


@pytest.mark.parametrize("most", [1, 5, 17, 33, 60])
def test_the_budget_ends_it_with_the_best_version_and_no_error(most: int, usual: Reached) -> None:
    part = run(Robot(most))
    assert part.ended == "trials"
    assert sum(len(one.trials) for one in part.tried) == most
    counted = [one.score for one in part.tried if len(one.trials) == SMALL.repeats]
    assert part.best.score == max(counted or [one.score for one in part.tried])
    played = [s for one in usual.tried for s in one.scores][:most]
    assert [s for one in part.tried for s in one.scores] == played, "a budget changes nothing before its end"
    assert (len(part.versions) > 1) == (most >= 5), "what was tried is used, even where no trial is left"


def test_the_goal_ends_it(usual: Reached) -> None:
    goal = 0.95 * usual.best.score  # above all that the first turn tried
    assert goal > max(one.score for one in usual.tried if one.iteration == 1)
    found = run(Robot(), replace(SMALL, goal=goal))
    assert found.ended == "goal" and found.best.score >= goal
    small = [one for one in found.tried if one.step == REFINE]
    assert small[-1] is found.best and len(found.best.trials) == SMALL.repeats
    assert sum(one.score >= goal for one in small) <= SMALL.variations + 1


@pytest.mark.parametrize("goal", [None, 2.0])
def test_one_lucky_trial_is_neither_the_best_nor_the_goal(goal: float | None) -> None:
    class Lucky(Robot):
        """Scores 5 in its 35th trial: one of step 4."""

        def __call__(self, gait: np.ndarray) -> Outcome:
            made = super().__call__(gait)
            return replace(made, score=5.0) if made.number == 35 else made

    found = run(Lucky(), replace(SMALL, iterations=1, goal=goal))
    (lucky,) = (one for one in found.tried if one.score == 5.0)
    again = [one for one in found.tried if one.gait.tobytes() == lucky.gait.tobytes() and one is not lucky]
    assert lucky.step == REFINE and [len(one.trials) for one in again] == [SMALL.repeats]
    assert found.best.score < 1.0 and found.ended == "iterations"


def test_the_best_small_step_counts_by_trials_of_its_own() -> None:
    found = run(Robot(), replace(SMALL, iterations=1))
    single = [one for one in found.tried if one.step == REFINE and len(one.trials) == 1]
    assert found.best is found.tried[-1] and len(found.best.trials) == SMALL.repeats
    assert found.best.gait.tobytes() == max(single, key=lambda one: one.score).gait.tobytes()


def test_the_goal_ends_the_trials_of_gaits_from_the_simulator_too(usual: Reached) -> None:
    there = [one for one in usual.tried if one.step == TRANSFER and one.iteration == 1]
    first = next(i for i, one in enumerate(there) if one.score >= 0.5)
    assert first < len(there) - 1
    found = run(Robot(), replace(SMALL, goal=0.5))
    assert found.ended == "goal" and len(found.tried) == first + 1 and found.best is found.tried[-1]
    assert len(found.versions) == 1


def test_a_gait_and_its_code_are_tried_as_one() -> None:
    found = run(Robot(tall=1.0), replace(SMALL, iterations=1, first=1, steps=0, lost=0.9))
    tried = np.array([one.gait for one in found.tried])
    apart = np.abs(tried[:, None] - tried).max(axis=2) + np.eye(len(tried))
    assert (tried[0] == GAIT).all() and len(tried) == SMALL.stand and apart.min() > 0.99 / 255


def test_gaits_that_the_robot_plays_alike_are_tried_as_one() -> None:
    robot = Robot(tall=1.0)
    still = lambda gaits: np.where([True, True, True, False], 0.5, gaits)  # noqa: E731
    told = {"periodic": np.array([False, False, False, True]), "played": still}
    world = World(scores, robot, lambda step: stream(4, "toy", step), **told)
    back_to_reality(world, replace(SMALL, iterations=1, first=1, steps=0), GAIT[None], BEGIN, FREE)
    last = np.array(robot.played)[:: SMALL.repeats, 3]
    apart = np.abs(last[:, None] - last) + np.eye(len(last))
    assert np.minimum(apart, 1.0 - apart + np.eye(len(last))).min() > 0.99 / 255
    assert world.apart(np.array([0.1, 0.8, 0.3, 0.999]), GAIT[None] * [1, 1, 1, 0])[0] == pytest.approx(0.001)


def test_seeds_are_in_the_first_generation_and_no_gait_is_tried_before_the_simulator_has_run_it() -> None:
    """The best for the simulator is handed over; random ones would not be near it after one generation."""
    best = np.append(BEGIN, 0.2)
    rules = replace(SMALL, iterations=1, first=1, stand=1, steps=0)
    world = World(scores, Robot(), lambda step: stream(4, "toy", step))
    found = back_to_reality(world, rules, np.empty((0, 4)), BEGIN, FREE, seeds=best[None])
    first = found.tried[0]
    assert np.abs(first.gait - best).max() < 1 / 255 and first.simulated > 0.99
    without = back_to_reality(world, rules, np.empty((0, 4)), BEGIN, FREE)
    assert without.tried[0].simulated < 0.95


def test_the_second_search_begins_with_gaits_that_stood_in_all_trials_and_with_others_at_random() -> None:
    """Not with the single small steps about the best of the first turn: they are nearly one gait."""
    begun: list[str] = []
    first: list[np.ndarray] = []

    def named(step: str) -> np.random.Generator:
        begun.append(step)
        return stream(4, "toy", step)

    def seen(gaits: np.ndarray, simulators: np.ndarray) -> np.ndarray:
        if begun[-1] == "gaits 2" and not first:
            first.append(gaits)
        return scores(gaits, simulators)

    rules = replace(SMALL, stand=6, steps=4)
    found = back_to_reality(World(seen, Robot(), named), rules, GAIT[None], BEGIN, FREE)
    (generation,) = first
    before = [one for one in found.tried if one.iteration == 1 and not one.fell]
    whole = np.array([one.gait for one in before if len(one.trials) >= rules.repeats])
    single = [one for one in before if len(one.trials) < rules.repeats]
    assert len(single) >= rules.gaits > len(whole) >= rules.stand
    near = np.abs(generation[:, None] - whole).max(axis=-1) <= 1 / 255
    assert near.any(axis=0).all()
    assert (~near.any(axis=1)).sum() == rules.gaits - len(whole)
    assert generation.std(axis=0).min() > 0.1


def test_a_bit_turns_by_the_chance_that_the_rules_say() -> None:
    asked: dict[float, list[np.ndarray]] = {}
    for mutation in (0.001, 0.2):
        seen = asked.setdefault(mutation, [])

        def play(gaits: np.ndarray, simulators: np.ndarray, seen: list = seen) -> np.ndarray:
            seen.append(gaits)
            return np.ones((len(simulators), len(gaits)))

        rules = replace(SMALL, iterations=1, first=2, gaits=40, mutation=mutation, steps=0)
        world = World(play, Robot(), lambda step: stream(4, "toy", step))
        back_to_reality(world, rules, np.empty((0, 4)), BEGIN, FREE, seeds=np.tile(GAIT, (40, 1)))
    new = {m: float((np.abs(seen[1] - seen[0][0]).max(axis=1) > 0).mean()) for m, seen in asked.items()}
    assert new[0.001] < 0.2 < 0.95 < new[0.2], "32 bits a gait"


def test_the_search_for_gaits_ends_once_one_scores_enough_in_the_simulator() -> None:
    asked = []

    def play(gaits: np.ndarray, simulators: np.ndarray) -> np.ndarray:
        asked.append(scores(gaits, simulators).max())
        return scores(gaits, simulators)

    rules = replace(SMALL, iterations=1, steps=0, hope=0.8)
    run(Robot(1), rules, play=play)
    assert len(asked) < rules.first and asked[-1] >= 0.8 > max(asked[:-1])


def test_a_generation_that_falls_in_the_simulator_does_not_end_the_search_for_gaits() -> None:
    asked = []

    def play(gaits: np.ndarray, simulators: np.ndarray) -> np.ndarray:
        asked.append(len(gaits))
        return np.zeros((len(simulators), len(gaits)))

    rules = replace(SMALL, iterations=1, first=8, search="cma", steps=0)
    run(Robot(), rules, play=play, gaits=np.empty((0, 4)))
    assert asked == [rules.gaits] * rules.first


def test_with_more_simulators_a_gait_counts_by_the_worst_and_one_that_is_good_in_one_alone_is_not_taken() -> (
    None
):
    """A gait with a high last gene scores 1 in the simulator itself, and nothing a hair beside it."""

    def play(gaits: np.ndarray, simulators: np.ndarray) -> np.ndarray:
        exact = np.abs(simulators - BEGIN).max(axis=1) < 1e-9
        fluke = (gaits[:, 3] > 0.5)[None] & exact[:, None]
        return np.where(fluke, 1.0, np.where(gaits[:, 3] > 0.5, 0.0, 0.5 * scores(gaits, simulators)))

    found = {}
    for near in (1, 3):
        rules = replace(SMALL, iterations=1, steps=0, near=near, stand=3)
        found[near] = run(Robot(tall=1.0), rules, play=play, gaits=np.empty((0, 4))).tried[0]
    assert found[1].gait[3] > 0.5 and found[1].simulated == 1.0
    assert found[3].gait[3] <= 0.5 and 0.2 < found[3].simulated < 0.5


def spoilt(robot: Robot) -> Reached:
    """The signed difference leads the simulator away: its gaits fall on a robot that slips far from the best."""
    rules = replace(SMALL, iterations=3, later=20, difference="signed", enough=0.01, steps=0)
    return run(robot, rules)


def test_a_simulator_that_was_spoilt_is_rolled_back_and_the_search_in_it_is_shortened() -> None:
    found = spoilt(Robot(slips=0.25, tall=1.0))
    here = [t for t in found.tried if t.iteration == 2]
    assert sum(t.fell for t in here) >= SMALL.lost * len(here)
    before, away, back = found.versions[:3]
    assert back.made == BACK and back.iteration == 2 and back.trials == ()
    assert (back.simulator == before.simulator).all() and not (away.simulator == before.simulator).all()
    healthy = run(Robot(tall=1.0), replace(SMALL, iterations=3, steps=0))
    assert BACK not in {v.made for v in healthy.versions}


def test_a_simulator_that_is_used_again_says_which_trials_shaped_it() -> None:
    class Breaking(Robot):
        def __call__(self, gait: np.ndarray) -> Outcome:
            self.tall = 1.0 if len(self.played) < 60 else 0.0
            return super().__call__(gait)

    rules = replace(SMALL, iterations=4, stand=10, steps=0)
    versions = run(Breaking(), rules).versions
    back = next(v for v in versions if v.made == BACK)
    shaped = [v for v in versions if v.made == ADAPTED and (v.simulator == back.simulator).all()]
    assert len(shaped) == 1 and back.trials == shaped[0].trials != ()


def test_a_budget_that_ends_with_a_fall_says_nothing_of_the_simulator() -> None:
    whole = spoilt(Robot(slips=0.25, tall=1.0))
    first = next(t for t in whole.tried if t.iteration == 2 and t.fell)
    cut = spoilt(Robot(slips=0.25, tall=1.0, most=first.trials[-1]))
    assert cut.tried[-1].fell and cut.ended == "trials"
    assert BACK not in {v.made for v in cut.versions}, "one gait that fell is no half of ten"


def asked_by(rules: Rules, robot: Robot) -> dict[str, int]:
    """How many gaits each search asked for, by its name."""
    counts: dict[str, int] = {}

    def seen(stage: str, done: int, total: int) -> None:
        counts[stage] = max(counts.get(stage, 0), done)

    world = World(scores, robot, lambda step: stream(4, "toy", step), progress=seen)
    back_to_reality(world, rules, GAIT[None], BEGIN, FREE)
    return counts


def test_disengagement_halves_the_generations_of_step_1() -> None:
    rules = replace(SMALL, iterations=3, first=16, later=8, steps=0)
    free, falls = asked_by(rules, Robot(tall=1.0)), asked_by(rules, Robot(slips=0.01))
    sizes = [[counts[f"gaits {i}"] // rules.gaits for i in (1, 2, 3)] for counts in (free, falls)]
    assert sizes == [[16, 8, 8], [16, 4, 2]]


def kept(path: Path, robot: Robot, resume: bool, keeps: bool = False, **told) -> Reached:
    journal = lambda name: Journal(path / f"{name}.jsonl", {"toy": name}, resume=resume)  # noqa: E731
    trial = Journalled(robot.begin, robot, robot.counted.append, journal("trials"), keeps)
    return run(trial, journal=journal, **told)


def simulated(found: Reached) -> list[tuple]:
    return [(v.simulator.tobytes(), v.before, v.after) for v in found.versions]


@pytest.mark.parametrize("keeps", [True, False])
@pytest.mark.parametrize("breaks", [1, 14, 32, 40])
def test_what_was_interrupted_goes_on_to_the_same_end_and_counts_every_trial_once(
    tmp_path: Path, breaks: int, keeps: bool, usual: Reached
) -> None:
    first, second = Robot(breaks=breaks), Robot()
    with pytest.raises(KeyboardInterrupt):
        kept(tmp_path, first, resume=False, keeps=keeps)
    found = kept(tmp_path, second, resume=True, keeps=keeps)
    told = lambda r: [(t.gait.tobytes(), t.scores, t.simulated) for t in r.tried]  # noqa: E731
    assert told(found) == told(usual) and simulated(found) == simulated(usual)
    assert len(first.played) + len(second.played) == sum(len(t.trials) for t in usual.tried)
    numbers = [n for one in found.tried for n in one.trials]
    assert numbers == [n for n in range(1, numbers[-1] + 1) if keeps or n != breaks + 1]
    assert [one.number for one in second.counted] == [*range(1, breaks + (1 if keeps else 2))]
    assert sum(one.seconds for one in second.counted) == 2.0 * len(second.counted)
    assert [one.lost for one in second.counted] == [False] * breaks + [True] * (not keeps)


def test_resumed_runs_and_new_ones_are_those_of_a_run_that_was_not_interrupted(tmp_path: Path) -> None:
    """With two simulators in step 1, of which each run counts."""
    rules, counts = replace(SMALL, near=2), []

    def counting(gaits: np.ndarray, simulators: np.ndarray) -> np.ndarray:
        counts[-1] += len(gaits) * len(simulators)
        return scores(gaits, simulators)

    def journal(resume: bool):
        return lambda step: Journal(tmp_path / f"{step}.jsonl", {"of": step}, resume=resume)

    found = []
    for breaks, told in ((None, {}), (40, {"journal": journal(False)}), (None, {"journal": journal(True)})):
        counts.append(0)
        try:
            found.append(run(Robot(breaks=breaks), rules, play=counting, **told))
        except KeyboardInterrupt:
            assert breaks
    assert found[1].resumed > 0 and counts[2] + found[1].resumed == counts[0]


def test_every_trial_that_was_lost_is_counted_in_every_later_run(tmp_path: Path) -> None:
    for resume in (False, True, True):
        with pytest.raises(KeyboardInterrupt):
            kept(tmp_path, Robot(breaks=2), resume=resume)
    last = Robot(most=1)
    found = kept(tmp_path, last, resume=True)
    assert [one.lost for one in last.counted] == [False, False, True, False, False, True, False, False, True]
    assert [n for one in found.tried for n in one.trials] == [1, 2, 4, 5, 7, 8, 10]


@pytest.mark.parametrize("score", [None, 0.0, -0.25])
@pytest.mark.parametrize("lost", [True, False])
def test_an_outcome_comes_back_as_it_was_kept_and_another_row_is_refused(
    score: float | None, lost: bool
) -> None:
    outcome = Outcome(None if lost else score, 1.5, 3, 7, lost)
    assert outcome_of(outcome.row) == outcome
    with pytest.raises(CorruptError, match="another seed"):
        outcome_of(outcome.row[:, :4])


def test_grades_of_other_gaits_are_forgotten_where_a_larger_budget_tries_more_of_them(
    tmp_path: Path,
) -> None:
    asked, rules = [], replace(SMALL, enough=0.01)

    def breaks(gaits: np.ndarray, simulators: np.ndarray) -> np.ndarray:
        asked.append(len(simulators))
        if len([many for many in asked if many > 1]) == 3:
            raise KeyboardInterrupt
        return scores(gaits, simulators)

    with pytest.raises(KeyboardInterrupt):
        kept(tmp_path, Robot(8, tall=1.0), resume=False, rules=rules, play=breaks)
    found = kept(tmp_path, Robot(22, tall=1.0), resume=True, rules=rules)
    whole = run(Robot(30, tall=1.0), rules)
    assert simulated(found) == simulated(whole) and len(found.versions) > 1


def test_a_door_that_falls_every_time_leaves_no_gait() -> None:
    found = run(Robot(slips=0.0), replace(SMALL, iterations=2))
    assert found.best is None and len(found.versions) == 1
    known = [one for one in found.tried if one.simulated is None]
    assert all(one.fell for one in found.tried) and len(found.tried) - len(known) <= 2 * SMALL.stand
    assert len(known) == 1


def ten_known(last: float) -> np.ndarray:
    """(10, 4) gaits to begin with; those whose last gene is above `TALL` fall."""
    return np.column_stack([np.tile(GAIT[:2], (10, 1)), np.linspace(0.0, 0.9, 10), np.full(10, last)])


def test_known_gaits_that_stand_leave_half_of_the_places_to_gaits_of_the_simulator() -> None:
    found = run(Robot(tall=1.0), replace(SMALL, iterations=1, steps=0), gaits=ten_known(0.2))
    first = [one.simulated is None for one in found.tried]
    assert first == [True] * 5 + [False] * 5 and len(found.versions) == 2
    assert sum(len(one.trials) for one in found.tried) == SMALL.stand * SMALL.repeats


def test_known_gaits_that_fall_end_no_turn_and_say_nothing_of_the_simulator() -> None:
    robot = Robot()
    found = run(robot, replace(SMALL, iterations=1, steps=0, lost=0.9), gaits=ten_known(0.9))
    known = [one for one in found.tried if one.simulated is None]
    assert len(known) == 10 and all(one.fell for one in known)
    assert sum(not one.fell for one in found.tried) == SMALL.stand
    assert found.versions[-1].made == ADAPTED and len(robot.played) == found.tried[-1].trials[-1]

    class Slippery(Robot):
        """Every gait that the simulator proposes stands, and none of the others."""

        def __call__(self, gait: np.ndarray) -> Outcome:
            self.tall = 0.0 if gait[3] == 0.9 else 1.0
            return super().__call__(gait)

    usual = run(Slippery(), replace(SMALL, iterations=1, steps=0), gaits=ten_known(0.9))
    assert [v.made for v in usual.versions] == ["start", ADAPTED], "ten of twenty fell, but no gait of it"


def test_differences_are_what_the_paper_says() -> None:
    simulated, real = np.array([[5.0, 0.0], [3.0, 1.0]]), np.array([0.0, 5.0])
    assert DIFFERENCES["absolute"](simulated, real).tolist() == [5.0, 3.5]
    assert DIFFERENCES["signed"](simulated, real).tolist() == [0.0, -0.5], "+5 and -5 cancel"
    assert DIFFERENCES["rank"](simulated, real).tolist() == [2.0, 2.0]
    assert rank_correlation(np.array([[1.0, 1.0, 1.0], [1.0, 2.0, 9.0]]), np.arange(3.0)).tolist() == [
        0.0,
        pytest.approx(1.0),
    ]


def test_a_budget_of_simulations_is_shared_by_the_steps() -> None:
    usual = Rules()
    assert usual.rollouts == 15 * 700 + 2 * (2 + 45 * 20) * 10
    assert usual.within(None) == usual.within(10**6) == usual
    half = usual.within(usual.rollouts // 2)
    assert half.rollouts <= usual.rollouts // 2 and abs(half.first - 300) < 9 and abs(half.turns - 22) < 3
    with pytest.raises(UsageError, match="at least 470"):
        usual.within(100)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_no_more_simulations_are_run_than_the_budget_allows(share: float) -> None:
    usual, played = replace(SMALL, enough=0.001, lost=0.9), []

    def counting(gaits: np.ndarray, simulators: np.ndarray) -> np.ndarray:
        played.append(len(gaits) * len(simulators))
        return scores(gaits, simulators)

    most = int(share * usual.rollouts)
    rules = usual.within(most)
    run(Robot(tall=1.0), rules, play=counting)
    assert sum(played) == rules.rollouts <= most


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"stand": 0}, "stand = 0; expected 1 or more"),
        ({"steps": -1}, "steps = -1; expected 0 or more"),
        ({"variations": 1}, "variations = 1; expected 2 or more"),
        ({"first": 0.1 * 600}, "first = 60.0; expected a whole number, 1 or more"),
        ({"stand": 2.5}, "stand = 2.5; expected a whole number, 1 or more"),
        ({"steps": "3"}, "steps = 3; expected a whole number, 0 or more"),
        ({"lost": 1.0}, "lost = 1.0; expected a share"),
        ({"mutation": 0.0}, "mutation = 0.0; expected a share"),
        ({"enough": float("nan")}, "enough = nan; expected a share"),
        ({"difference": "none"}, "difference = 'none'; expected one of"),
        ({"goal": float("nan")}, "goal = nan; expected a score"),
        ({"goal": float("inf")}, "goal = inf; expected a score"),
        ({"hope": float("nan")}, "hope = nan; expected a score"),
        ({"search": "ga"}, "search = 'ga' with gaits = 15: .* expected an even population"),
    ],
)
def test_sizes_that_make_no_sense_are_refused(wrong: dict, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Rules(**wrong)


def test_whole_numbers_of_numpy_are_sizes_that_a_journal_can_keep() -> None:
    rules = Rules(first=np.int64(7), stand=np.int32(3))
    assert rules == Rules(first=7, stand=3) and json.loads(json.dumps(asdict(rules))) == asdict(rules)


def test_a_difference_that_is_negative_at_first_does_not_end_the_search_for_a_simulator() -> None:
    """The robot is better than every simulator."""
    asked = []

    def low(gaits: np.ndarray, simulators: np.ndarray) -> np.ndarray:
        asked.append(len(simulators))
        return scores(gaits, simulators) / 10.0

    rules = replace(SMALL, iterations=1, steps=0, difference="signed")
    found = run(Robot(), rules, play=low)
    assert found.versions[1].before < 0.0 and sum(many > 1 for many in asked) == rules.turns


def test_the_same_seed_gives_the_same_bytes_and_another_another(usual: Reached) -> None:
    ends = lambda found: [v.simulator.tobytes() for v in found.versions]  # noqa: E731
    assert ends(usual) == ends(run(Robot(), seed=4)) != ends(run(Robot(), seed=5))


def test_the_page_names_the_least_budget() -> None:
    least = replace(Rules(), first=1, later=1, turns=1).rollouts
    assert Rules().within(least).rollouts == least
    with pytest.raises(UsageError, match=f"at least {least}"):
        Rules().within(least - 1)
    page = (Path(__file__).parents[2] / "docs" / "methods.md").read_text(encoding="utf-8")
    assert f"`--budget {least}`, the least" in page
