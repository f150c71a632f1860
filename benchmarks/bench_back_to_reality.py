"""Paper B: a gait and a simulator of an AIBO make each other better, by scores of trials alone.

A hidden AIBO (`aibo.hidden`) differs from the nameplate in 38 parameters, and its elbows are of a second material that
no simulator of the family has. The robot begins with a gait of about 40 % of the best speed, which is that of the
middle one of three searches in the hidden robot itself; each has as many rollouts as Back to Reality runs gaits in its
simulators. The robot is given 190 trials in all, those that fall included. Searches on the robot alone (two genetic
algorithms, a hill climber, a policy gradient, CMA-ES) begin with the same gait and have as many. Of these they try the
best of single trials again, as Back to Reality does. `btr_cma` is Back to Reality whose gaits are sought in the
simulator by CMA-ES, not by the paper's genetic algorithm. Speeds are means over new trials, which no choice has seen;
those of `btr` and `btr_cma` have the same disturbances.

LP is the paper's learning performance d IF / e: d genes of the gait, IF = 100 (f_end - f_0) / f_end in percent, e
trials. The paper prints its column IF as a fraction, a hundredth of what its LP is made of; `TABLE` has what it prints,
and `learning` recomputes it. `--scale` runs a share of the published generations. The truth has a time step four times
finer than the model's. Every finished step is a line of the journal; a second start goes on.
"""

import argparse
import tempfile
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import aibo
import numpy as np
from journal import Journal
from kept import RESULTS, keep
from reality_runs import FIXED, Shown, Tape, scaled, walking_for

import dynreg
from dynreg.adapt.differences import rank_correlation
from dynreg.adapt.tried import ROULETTE, Rules
from dynreg.gait.tasks import fitness, task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.methods.by_reality import Played
from dynreg.rng import stream
from dynreg.search.drive import Limits, drive
from dynreg.search.start import Start
from dynreg.search.table import SEARCHES
from dynreg.sim.effects import Terms

REPORT, TUNE = 20270119, 71
FILE = RESULTS / "back_to_reality.json"
TRIALS = 190
SHARE, NEAR = 0.4, 0.05  # of the best, from which all begin, and how far off is near enough
AGAIN = 10  # new trials of a gait
# searches on the robot alone; the first keeps no elite
REAL_ONLY = ("roulette", "ga", "hill", "policy", "cma")
REALITY = {"btr": ROULETTE, "btr_cma": "cma"}  # Back to Reality, and its search in the simulator
DRAWS = 600  # gaits among which the start is chosen: of 60 the best had 21 % of the best speed
ORACLES = 3  # searches for the best
# name: (genes d, trials e, f_0, f_end [cm/s], IF and LP as printed, LP to the third digit)
TABLE = {
    "Hornby trot": (20, 30 * 3 * 21, 4.5, 10.0, 0.55, 0.582, 0.582),
    "Hornby pace": (20, 30 * 3 * 11, 8.7, 12.0, 0.275, 0.556, 0.556),
    "Golubovic-Hu": (13, 20 * 50, 4.0, 11.7, 0.658, 0.855, 0.856),
    "Kohl-Stone": (12, 15 * 3 * 23, 24.5, 29.0, 0.155, 0.180, 0.180),
    "Quinlan EHCLS": (11, 80, 24.9, 29.0, 0.141, 1.939, 1.944),
    "Rofer ERS-210": (26, 15 * 3 * 48, 23.0, 31.0, 0.258, 0.310, 0.311),
    "Rofer ERS-7": (26, 15 * 3 * 48, 30.0, 40.0, 0.25, 0.301, 0.301),
    "Kim-Uther Powell": (24, 24 * 24, 22.7, 27.0, 0.159, 0.663, 0.664),
    "Back to Reality": (20, 190, 10.0, 24.7, 0.595, 6.263, 6.265),
}


def improvement(first: float, last: float) -> float:
    """IF in percent, as paper B's equation 2 has it."""
    return 100.0 * (last - first) / last


def learning(genes: int, trials: int, first: float, last: float) -> float:
    """LP, of IF in percent."""
    return genes * improvement(first, last) / trials


def apart(start: dict) -> float:
    """How far the real speed of a start is from its share of the best."""
    return abs(float(np.mean(start["speeds"])) / start["best"] - SHARE)


@dataclass(frozen=True)
class Bench:
    """One hidden robot and what it is asked for."""

    tape: Tape
    played: Played

    @classmethod
    def of(cls, seed: int, seconds: float, threads: int) -> "Bench":
        robot = walking_for(seconds)
        task = task_of(robot)
        tape = Tape(aibo.hidden(seed), robot, task, threads)
        return cls(tape, Played(robot, task, seed, threads))

    def score(self, unit: np.ndarray, name: str) -> float:
        """One trial of a gait (G,) in the unit cube; 0 for a fall."""
        return self.tape(self.played.commands(unit), self.tape.robot.rate, name) or 0.0

    def again(self, unit: np.ndarray, name: str) -> list[float]:
        """New trials of a gait."""
        return [self.score(unit, f"{name} again {i}") for i in range(AGAIN)]

    def start(self, rules: Rules) -> dict:
        """The best speed, of the middle one of searches in the hidden robot's own simulator, a gait of a `SHARE`.

        Each search has another motor noise, and as many rollouts as `rules` give to those for gaits.
        """
        tape, space = self.tape, self.played.space
        terms, values = tape.hidden.effects(tape.robot)
        own = Simulators(
            tape.hidden.values(tape.robot.space)[None], Terms(terms, tuple(v[None] for v in values))
        )
        trials = Trials(tape.robot, tape.task, own, rate=tape.robot.rate, threads=tape.threads)
        fit = lambda unit, draw=0: fitness(trials.grades(self.played.genes(unit), draw))  # noqa: E731
        rng = stream(tape.hidden.seed, "start")
        draws = space.about_rest(DRAWS, rng)
        scores = fit(draws)[:, 0]
        begin = Start(len(space), rng, 10, draws[scores.argmax()], space.periodic)
        most, found = Limits(rules.gaits * (rules.first + (rules.iterations - 1) * rules.later)), []
        for draw in range(ORACLES):
            one = drive(
                SEARCHES["cma"].begin(begin), partial(fit, draw=draw), lambda g: (g[:, 0], -g[:, 0]), most
            )
            found.append(float(np.mean(self.again(one.best, f"oracle {draw}"))))
        top = float(np.median(found))
        stood = []
        for one in np.argsort(
            np.abs(scores - SHARE * top)
        ):  # what scores so in the simulator may do otherwise
            speeds = self.again(draws[one], "start")
            if min(speeds) > 0.0:
                stood.append({"unit": draws[one].tolist(), "speeds": speeds, "best": top, "oracles": found})
            if stood and apart(stood[-1]) <= NEAR:
                break
        if not stood:
            raise SystemExit("no gait to begin with stands")
        return min(stood, key=apart)

    def btr(self, start: np.ndarray, rules: Rules) -> dict:
        """Back to Reality, through a session."""
        robot, space, seed = self.tape.robot, self.played.space, self.tape.hidden.seed
        genes = space.as_dict(self.played.genes(start[None])[0])
        began, told = time.process_time(), {"trials": TRIALS, "seed": seed, "threads": self.tape.threads}
        with tempfile.TemporaryDirectory() as folder, dynreg.open(Path(folder) / "registry") as session:
            found = session.calibrate(
                robot, method="btr", robot_door=self.tape, gait=genes, rules=rules, progress=Shown(), **told
            )
            made = [session.registry.simulator(v.simulator)["values"] for v in found.versions]
        simulators = [robot.space.from_dict(values) for values in made]
        best = space.to_unit(space.from_dict(found.on_robot.gait))
        return {
            "unit": best.tolist(),
            "speeds": self.again(best, "btr"),
            "trials": found.cost.trials,
            "falls": found.cost.falls,
            "discarded": found.cost.discarded,
            "rollouts": found.cost.rollouts,
            "core seconds": time.process_time() - began,
            "ended": found.ended,
            "versions": [(v.stage, v.before, v.after) for v in found.versions],
            "scores": found.on_robot.scores(),
            "tried": [one.to_dict() for one in found.on_robot.tried],
            "rank": self.ranks(np.array(simulators)),
        }

    def ranks(self, simulators: np.ndarray) -> list[float]:
        """Spearman's correlation of real and simulated fitness over the fixed gaits, of each simulator (s, P)."""
        fixed = self.played.space.about_rest(FIXED, stream(self.tape.hidden.seed, "fixed gaits"))
        real = np.array([self.score(one, f"fixed {i}") for i, one in enumerate(fixed)])
        unit = self.tape.robot.space.to_unit(simulators)
        return rank_correlation(self.played(fixed, unit), real).tolist()

    def real_only(self, start: np.ndarray, method: str, rules: Rules) -> dict:
        """The same trials, all on the robot, by a search that begins with the same gait.

        As `btr` does once an iteration, it tries a gait that was the best of single trials again, and these count.
        """
        space, tried = self.played.space, []
        rng = stream(self.tape.hidden.seed, "real only", method)
        kind = SEARCHES[method]
        begin = Start(len(space), rng, 15 if method == "roulette" else kind.batch, start, space.periodic)

        def grades(some: np.ndarray) -> np.ndarray:
            for one in some:
                tried.append((self.score(one, f"{method} {len(tried)}"), one))
            return np.array([[score] for score, _ in tried[-len(some) :]])

        confirmed = rules.iterations * rules.repeats
        most = Limits(TRIALS - confirmed, cut=True)
        found = drive(kind.begin(begin), grades, lambda g: (g[:, 0], -g[:, 0]), most)
        hopes = [one for _, one in sorted(tried, key=lambda told: -told[0])[: rules.iterations]]
        again = [
            [self.score(one, f"{method} confirmed {i} {trial}") for trial in range(rules.repeats)]
            for i, one in enumerate(hopes)
        ]
        best = hopes[int(np.argmax([np.mean(some) if min(some) else 0.0 for some in again]))]
        return {
            "unit": best.tolist(),
            "speeds": self.again(best, method),
            "trials": found.evaluations + sum(map(len, again)),
            "history": found.history,
            "confirmed": again,
        }


def show(lines: list[dict], seconds: float) -> None:
    """Print the table of every robot."""
    for seed in dict.fromkeys(line["robot"] for line in lines):
        own = {line["step"]: line for line in lines if line["robot"] == seed}
        if "start" not in own:
            continue
        speed = lambda step: 100.0 * float(np.mean(own[step]["speeds"])) / seconds  # noqa: E731, B023
        first, best = speed("start"), 100.0 * own["start"]["best"] / seconds
        genes, *_, printed, _ = TABLE["Back to Reality"]
        print(f"robot {seed}: start {first:.2f} cm/s, best known {best:.2f} cm/s ({first / best:.0%})")
        for step in (*REALITY, *REAL_ONLY):
            if step not in own:
                continue
            last, trials = speed(step), own[step]["trials"]
            lp = learning(genes, trials, first, last) if last > first else 0.0
            print(
                f"  {step:9} {last:6.2f} cm/s  x {last / first:.2f}  {trials} trials  LP {lp:6.3f} (paper {printed})"
                f"  {(last - first) / trials:.4f} cm/s a trial"
            )
        for step in [step for step in REALITY if step in own]:
            b = own[step]
            spent = f"falls {b['falls']}, discarded {b['discarded']}, {b['rollouts']} rollouts"
            print(f"  {step}: {spent}, {b['ended']}")
            for (stage, before, after), rank in zip(b["versions"], b["rank"], strict=True):
                delta = f"  Delta {before:.4g} -> {after:.4g} ({after / before:.0%})" if before else ""
                print(f"  {stage:12} rank correlation over {FIXED} fixed gaits {rank:+.3f}{delta}")


def main() -> None:
    """Run what is left, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=3)
    parser.add_argument("--scale", type=float, default=1.0, help="share of the published generations")
    parser.add_argument("--iterations", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=20.0, help="of a trial; the paper's last 20 s")
    parser.add_argument("--steps", nargs="*", default=[*REALITY, *REAL_ONLY], choices=[*REALITY, *REAL_ONLY])
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--tune", action="store_true", help="the robots of the development; keeps no table")
    parser.add_argument("--journal", type=Path, default=RESULTS / "back_to_reality.jsonl")
    given = parser.parse_args()
    first = TUNE if given.tune else REPORT
    head = {name: getattr(given, name) for name in ("scale", "iterations", "seconds")}
    head |= {"seed": first, "oracles": ORACLES}
    rules = scaled(given.scale, given.iterations)
    journal = Journal(given.journal, head)
    journal.begin()
    for seed in range(first, first + given.robots):
        bench = Bench.of(seed, given.seconds, given.threads)
        done = {line["step"]: line for line in journal.lines() if line["robot"] == seed}
        for step in ("start", *given.steps):
            if step in done:
                continue
            if step == "start":
                made = bench.start(rules)
            elif step in REALITY:
                made = bench.btr(np.array(done["start"]["unit"]), replace(rules, search=REALITY[step]))
            else:
                made = bench.real_only(np.array(done["start"]["unit"]), step, rules)
            done[step] = journal.add({"robot": seed, "step": step, **made})
            show([*done.values()], given.seconds)
    show(journal.lines(), given.seconds)
    keep(FILE, head | {"cells": journal.lines()}, parser, given)


if __name__ == "__main__":
    main()
