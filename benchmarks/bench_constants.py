"""What the constants of a diagnosis decide: each is halved and doubled, and the same robots are diagnosed again.

The robots are those of the development (`TUNE`), never those of a report. Names and evidence are told by searches on
the servo bench (short lists, logs of 25 s), on a leg in the air (long ones) and on the ground; what is told of a search
that has ended, by searches that are done once. A second start goes on where the first one ended.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from constants_table import TABLE, changed
from journal import Journal
from kept import RESULTS
from leg_trials import plan_of as leg_plan
from naming import TUNE, group, seeds

from dynreg.data.recording import Recording
from dynreg.diagnose.diagnose import search
from dynreg.diagnose.examine import examine
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import planned
from dynreg.diagnose.threshold import Threshold, known
from dynreg.diagnose.trial import Trial, Trials, Tried, same_cause, size_error
from dynreg.diagnose.unexplained import unexplained
from dynreg.evidence.estimate import estimates
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.interval import posterior
from dynreg.evidence.lockstep import Search, run, together
from dynreg.evidence.truth import Hidden, hide, log_of, protocol
from dynreg.results.trials import confident
from dynreg.sim.effects import Term, term
from dynreg.sim.robot import load_robot

NEEDED = 8.0  # nats, the threshold of all
AT_ONCE = 8  # searches in lockstep: more take more memory than they save time
SECONDS = 25.0  # of a servo's log
ON_SERVO = (  # of every group of effects, those that others can pass for
    *((key, "weak") for key in ("voltage_sag", "cogging", "load_friction", "asymmetric_friction")),
    *((key, "weak") for key in ("quadratic_drag", "gravity_tilt", "clock_error", "stribeck_friction")),
    *((key, "medium") for key in ("stribeck_friction", "stribeck_load_friction", "coulomb_friction")),
    *((key, "medium") for key in ("viscous_friction", "thermal_fade", "backlash", "joint_elasticity")),
    *((key, "medium") for key in ("payload", "inertia", "encoder_scale")),
)
NOTHING = 3  # robots without an effect
TWO = (("stribeck_load_friction", "thermal_fade"), ("backlash", "voltage_sag"), ("payload", "command_lag"))
ABSENT = ("load_friction", "cogging", "quadratic_drag", "speed_limit")  # causes that the library lacks
ON_LEG = {
    "leg": (("backlash[knee]", "medium"), ("load_friction[hip_pitch]", "medium"), ("payload", "medium")),
    "ground": (
        ("torque_limit[knee]", "medium"),
        ("payload", "medium"),
        ("stribeck_friction[hip_pitch]", "medium"),
    ),
}


@dataclass(frozen=True)
class Robots:
    """The robots of one group, what they hide, and their logs."""

    trials: Trials
    todo: tuple[Trial, ...]
    hidden: tuple[Hidden, ...]
    logs: tuple[Recording, ...]

    @classmethod
    def of(cls, where: str) -> "Robots":
        """Of the servo bench, of a leg in the air or on the ground."""
        if where in ON_LEG:
            robot = load_robot("leg")
            trials = Trials(robot, leg_plan(robot, {"leg": "air"}.get(where, where)), threads=1)
            todo = [_trial(key, size, where) for key, size in ON_LEG[where]]
            todo += [Trial((), None, n) for n in seeds(TUNE, where, "none", n=1)]
        else:
            robot = load_robot("servo_pendulum")
            trials = Trials(robot, protocol(robot, seed=TUNE, seconds=SECONDS), threads=1)
            todo = [_trial(key, size) for key, size in ON_SERVO]
            todo += [Trial(tuple(map(term, two)), "medium", seeds(TUNE, *two, n=1)[0], (), 3) for two in TWO]
            todo += [Trial((), None, n) for n in seeds(TUNE, "none", n=NOTHING)]
            if where == "rest":
                less = [(_trial(key, "medium"), group(robot, key)) for key in ABSENT]
                todo += [Trial(one.terms, one.size, one.seed, without) for one, without in less]
        hidden = [hide(robot, one.terms, one.size, one.seed) for one in todo]
        logs = [log_of(robot, one, trials.plan, engine=trials.truth_engine) for one in hidden]
        return cls(trials, tuple(todo), tuple(hidden), tuple(logs))

    def diagnosed(self) -> list[Tried]:
        """All of them, some at once; the time that these took is shared out evenly."""
        out: list[Tried] = []
        for at in range(0, len(self.todo), AT_ONCE):
            some = range(at, min(at + AT_ONCE, len(self.todo)))
            busy = time.process_time()
            made = run(together([self._search(i) for i in some]))
            spent = (time.process_time() - busy) / len(made)
            out += [Tried(self.hidden[i], one, spent, spent) for i, one in zip(some, made, strict=True)]
        return out

    def _search(self, i: int) -> Search[Any]:
        one, log = self.todo[i], self.logs[i]
        options = self.trials.options(one.without, one.max_causes)
        model, data = pose(self.trials.robot, log, options)
        problem = yield from planned(model, data, single_terms(model.robot, (), one.without))
        return (yield from search(problem, log, known(Threshold(NEEDED, ())), options))


def _trial(key: str, size: str, *where: str) -> Trial:
    return Trial((term(key),), size, seeds(TUNE, *where, key, size, n=1)[0])


def names(robots: Robots) -> dict[str, Any]:
    """How many got the right name, the evidence for what is hidden [nats], false alarms, and errors of sizes."""
    right, nats, alarms, errors, told = 0, 0.0, 0, [], []
    done = robots.diagnosed()
    for one in done:
        hidden, found = one.hidden.terms, one.made.found
        stated = [t.key for t in found.current.hypothesis.terms]
        told.append("+".join(stated) + ("" if confident(one.made.verdict) else "?"))
        if not hidden:
            alarms += bool(found.accepted)
            continue
        keys = [same_cause(robots.trials.robot, t) for t in hidden]
        right += confident(one.made.verdict) and bool(stated) and all(k & {*stated} for k in keys)
        nats += max(
            (s.nats for s in found.rounds[0].ranking if _last(s).key in set().union(*keys)), default=0.0
        )
        if len(hidden) == 1 and stated[:1] == [hidden[0].key]:
            errors.append(size_error(one))
    return {
        "of": sum(bool(one.hidden.terms) for one in done),
        "right": int(right),
        "nats": round(nats, 1),
        "alarms": alarms,
        "without": sum(not one.hidden.terms for one in done),
        "error": median(errors) if errors else None,
        "told": ", ".join(told),
    }


def intervals(robots: Robots, done: Sequence[Tried]) -> dict[str, Any]:
    """How often 90 % intervals hold the size, and how wide they are, as a share of it (median)."""
    held, widths = [], []
    for one in done:
        if one.first is None or len(one.hidden.terms) != 1 or one.first.key != one.hidden.terms[0].key:
            continue
        found, size = one.made.found, one.hidden.values[0][0]
        draws = run(posterior(found.model, found.current, found.data.sample(found.data.parts.chosen)))
        told = next(iter(estimates(found.model, found.current, 0, draws).values()))
        held.append(told.low <= size <= told.high)
        widths.append((told.high - told.low) / abs(size))
    return {"of": len(held), "held": int(sum(held)), "width": round(float(np.median(widths)), 4)}


def pairs(robots: Robots, done: Sequence[Tried]) -> dict[str, Any]:
    """How many pairs the logs are said not to tell apart; the factor by which the intervals grow, of all (median)."""
    many, grown = 0, []
    for one in done:
        if one.first is None:
            continue
        found = one.made.found
        sample = found.data.sample(found.data.parts.chosen)
        draws = run(posterior(found.model, found.current, sample))
        beside = run(examine(found, draws, sample, robots.trials.options())).beside
        many += sum(each.inseparable for each in beside)
        grown += [each.growth for each in beside]
    return {"of": len(grown), "inseparable": many, "growth": round(float(np.median(grown)), 3)}


def leftovers(robots: Robots, done: Sequence[Tried]) -> dict[str, Any]:
    """What is told of what is left, as a share of it: where the library lacks the cause, and by chance."""
    told, signals, chance = 0.0, [], 0.0
    for one, asked in zip(done, robots.todo, strict=True):
        if not (asked.without or not asked.terms):
            continue
        for joint in run(unexplained(one.made.found, "unknown")) or ():
            if asked.terms:
                told += joint.explained
                signals.append([row.signal for row in joint.rows if row.share > 0])
            else:
                chance += joint.explained
    return {"told": round(told, 3), "chance": round(chance, 3), "signals": signals}


def _last(scored: Any) -> Term:
    return scored.point.hypothesis.terms[-1]


AFTER = {"interval": intervals, "rivals": pairs, "rest": leftovers}


def measuring(where: str) -> Callable[[], dict[str, Any]]:
    """What is measured with every value; what all have in common is done here."""
    robots = Robots.of(where)
    return partial(AFTER[where], robots, robots.diagnosed()) if where in AFTER else partial(names, robots)


def document(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """By logs: first what the values as they are came to, then each change."""
    out: dict[str, Any] = {}
    for line in lines:
        row = {"changed": dict(zip(line["names"], line["values"], strict=True)), **line["found"]}
        out.setdefault(line["where"], []).append(row)
    return out


def tell(line: dict[str, Any]) -> None:
    """Print a row for what was tried."""
    what = ", ".join(
        one.rsplit(".", 1)[-1] if "plans" in one else one.split(".")[-1] for one in line["names"]
    )
    found = ", ".join(f"{k} {v:.4g}" for k, v in line["found"].items() if isinstance(v, int | float))
    tried = ", ".join(map(str, line["values"]))
    print(f"{line['where']:8s} {what or 'as it is':40s} {tried:22s} {found}", flush=True)


def main() -> None:
    """Print the table and write benchmarks/results/constants.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--where", nargs="*", default=list(TABLE), choices=list(TABLE))
    parser.add_argument("--only", nargs="*", default=[""], help="parts of the names of constants")
    parser.add_argument("--journal", type=Path, default=RESULTS / "constants_tune_.jsonl")
    given = parser.parse_args()
    journal = Journal(given.journal, {"seed": TUNE, "needed": NEEDED})
    journal.begin()
    for where in given.where:
        before = [one["names"] + one["values"] for one in journal.lines() if one["where"] == where]
        asked = [((), ())]
        asked += [
            (n, v) for n, every in TABLE[where].items() for v in every if any(o in str(n) for o in given.only)
        ]
        left = [one for one in asked if json.loads(json.dumps(one[0] + one[1])) not in before]
        measure = measuring(where) if left else None
        for changes, values in left:
            with ExitStack() as held:
                for one, value in zip(changes, values, strict=True):
                    held.enter_context(changed(one, value))
                busy = time.process_time()
                found = measure()
            found["seconds"] = round(time.process_time() - busy, 1)
            tell(journal.add({"where": where, "names": changes, "values": values, "found": found}))
    for line in journal.lines():
        tell(line)
    (RESULTS / "constants.json").write_text(json.dumps(document(journal.lines()), indent=1) + "\n")


if __name__ == "__main__":
    main()
