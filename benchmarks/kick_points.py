"""What came of the points of paper B's kick: which are solved, after up to three runs, and how they are counted."""

from collections.abc import Iterator

import kicking
import numpy as np
from kicking import goal_of

from dynreg.adapt.goals import Goals
from dynreg.adapt.tried import Reached

SOLVED = 0.1  # m, in a trial's score: the ball rolls for more than its diameter where it was aimed
LEVELS = (0.1, 0.2, 0.3)  # m, at which points are counted
RUNS = {"point": "first run", "second": "second run", "third": "third run"}  # by the step of the journal
COSTS = ("trials", "falls", "rollouts", "core seconds")


def told(found: Reached, spent: list[float | None]) -> dict:
    """What is kept of a point."""
    best = found.best
    return {
        "unit": None if best is None else best.gait.tolist(),
        "score": None if best is None else best.score,
        "simulated": None if best is None else best.simulated,
        "trials": len(spent),
        "falls": spent.count(None),
        "tried": [(one.iteration, one.simulated, one.scores) for one in found.tried],
        "ended": found.ended,
        "versions": [(v.made, v.before, v.after) for v in found.versions],
        "simulator": found.versions[-1].simulator.tolist(),
    }


def reached(line: dict, least: float = SOLVED) -> bool:
    """Whether the new trials of a point's kick all stood and reach so much in the mean."""
    again = line["again"]
    return bool(again) and min(again) > 0.0 and float(np.mean(again)) >= least


def mean(line: dict) -> float:
    """Of the new trials of a point's kick; 0 where there are none."""
    return float(np.mean(line["again"])) if line["again"] else 0.0


def both(before: dict, again: dict) -> dict:
    """A point after another run: the better answer, and what all runs have cost."""
    better = max((before, again), key=lambda line: (reached(line), mean(line)))
    return better | {key: before[key] + again[key] for key in COSTS}


def points_of(lines: list[dict], seed: int) -> dict[tuple[int, ...], dict]:
    """The points of a robot, after all runs."""
    done: dict[tuple[int, ...], dict] = {}
    for line in lines:
        if line["robot"] == seed and line["step"] in RUNS:
            at = tuple(line["at"])
            done[at] = both(done[at], line) if at in done else line
    return done


def goals_of(done: dict[tuple[int, ...], dict]) -> Goals:
    """The grid with the kicks of the points that are solved."""
    gaits = np.full((*kicking.SHAPE, 25), np.nan)
    for at, line in done.items():
        if reached(line):
            gaits[at] = line["unit"]
    return Goals(kicking.AXES, gaits)


def found_again(lines: list[dict]) -> Iterator[str]:
    """How many of the simulators' kicks scored half of what these said, by run, and what adaptations left."""
    kicks, left = [], []
    for line in lines:
        for number, simulated, scores in line["tried"]:
            if simulated is None:  # a kick that the point had before, or of the small steps on the robot
                continue
            real = 0.0 if None in scores else float(np.mean(scores))
            kicks.append((f"{RUNS[line['step']]}, iteration {number}", real >= 0.5 * simulated))
        left += [after / before for made, before, after in line["versions"] if made == "adapted"]
    for name in ["all", *dict.fromkeys(name for name, _ in kicks)]:
        half = [again for one, again in kicks if name in ("all", one)]
        if half:
            yield f"{name}: {len(half)} kicks tried, {np.mean(half):.0%} score half of what the simulator said"
    if left:
        yield f"{len(left)} adaptations: {np.median(left):.0%} of the difference is left in the median"


def show(lines: list[dict]) -> None:
    """Print the points of every robot and their count, and how much of the simulator is found on the robot."""
    for seed in dict.fromkeys(line["robot"] for line in lines):
        own = [*points_of(lines, seed).values()]
        total = lambda key: sum(line[key] for line in own)  # noqa: E731, B023
        print(f"robot {seed}: {len(own)} points, {total('trials')} trials, {total('falls')} of them falls")
        for line in sorted(own, key=lambda line: line["at"]):
            distance, *angles = goal_of(tuple(line["at"]))
            bearing, direction = np.rad2deg(angles)
            again = mean(line)
            mark = "solved" if reached(line) else "not solved"
            print(
                f"  {distance:.2f} m {bearing:3.0f} deg -> {direction:3.0f} deg: {again:.3f} m {mark}"
                f" {line['trials']:3} trials {line['falls']:2} falls"
            )
        counts = ", ".join(f"{sum(reached(line, least) for line in own)} by {least} m" for least in LEVELS)
        print(f"  solved: {counts}; {total('rollouts')} simulated kicks, {total('core seconds'):.0f} core s")
        for said in found_again([one for one in lines if one["robot"] == seed and one["step"] in RUNS]):
            print(f"  {said}")
        for line in lines:
            if line["robot"] == seed and line["step"] == "between":
                for kind in ("interpolated", "nearest"):
                    scores = np.array([one[kind] for one in line["goals"]])
                    print(
                        f"  between, {kind}: median {np.median(scores):.3f} m,"
                        f" {(scores >= SOLVED).sum()} of {len(scores)} reach {SOLVED} m"
                    )
