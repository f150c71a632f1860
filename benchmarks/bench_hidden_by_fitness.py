"""What a simulator hides that was made by scores alone, and whether one log of the robot shows it.

Two quadrupeds in MuJoCo alone (`plain_quadruped`). The pads of one's left feet are worn: half of their friction is
lost, which no parameter of the simulator states. The other hides nothing. Otherwise the nameplate is good. Back to
Reality is given 190 trials on each, and a share of its published simulations (`--scale`). Then the same robot plays
one log, standing and trotting: eight episodes of 1.7 s, and six that are held out. `diagnose` reads it twice: once it
begins with the nominal simulator, once with that of Back to Reality. It is asked for eight causes of the robot as a
whole. A cause counts where it passes the threshold of `bench-naming_quadruped`.

A parameter has moved by a share of its range. It has moved away where it is further from the robot's own than the
nameplate was. The simulators are held against each other by the replay error of the held-out episodes, and by 20 fixed
gaits that were tried on the robot: mean difference of scores, and Spearman's correlation. Each finished step is a line
of the journal.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from journal import Journal
from kept import RESULTS, keep
from measured_quadruped import measured_quadruped
from naming import TUNE
from plain_quadruped import RATE, PlainQuadruped, drawn
from quadruped_trials import EFFECTS, IN_ONE_JOINT, plan_of
from reality_runs import FIXED, Shown, scaled

import dynreg
from dynreg.adapt.differences import absolute, rank_correlation
from dynreg.data.recording import Recording
from dynreg.gait.tasks import fitness, task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.methods.by_reality import Played
from dynreg.methods.judged import replay_errors
from dynreg.replay.data import data
from dynreg.rng import stream, stream_seed
from dynreg.session import Session
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.robot import Robot

REPORT = 20261211
CAUSE, LOSS = "second_friction_material", 0.5
KINDS = ("worn", "sound")
ASKED = tuple(e for e in EFFECTS if e not in IN_ONE_JOINT)  # those of single joints take four times as long
NATS = 100.4  # that a cause needs: the kept table of bench_naming_quadruped
TRIALS = 190
HELD = 3  # held-out episodes of each kind
FAR = 0.05  # of a range


@dataclass(frozen=True)
class Bench:
    """One hidden robot, and what the library is told of it."""

    hidden: PlainQuadruped
    robot: Robot
    threads: int

    @classmethod
    def of(cls, kind: str, seed: int, threads: int) -> "Bench":
        robot = measured_quadruped()
        own = stream_seed(seed, "hidden by fitness", kind) % 2**31
        loss = LOSS if kind == "worn" else 0.0
        return cls(PlainQuadruped(robot, drawn(robot.space, own), loss, own), robot, threads)

    @property
    def truth(self) -> SimConfig:
        """The robot itself, as the library states it."""
        effects = {CAUSE: {"loss": self.hidden.loss}} if self.hidden.loss else {}
        return SimConfig.of(self.robot, self.robot.space.from_dict(self.hidden.parameters), effects)

    def log(self) -> tuple[Recording, str]:
        """One log, and the names of its held-out episodes."""
        plan = plan_of(self.robot, HELD)
        told = dict(zip(plan.names, plan.run.actions, strict=True))
        return self.hidden.log(told), ",".join(n for n in told if n.startswith("test"))

    def steps(self, session: Session, given: argparse.Namespace, done: Mapping[str, dict]) -> Iterator[dict]:
        """Every step that is not done, in turn."""
        if "btr" in done:
            made = SimConfig(self.robot.hash, self.robot.name, done["btr"]["values"], {})
        else:
            found = self.by_scores(session, given)
            yield found
            made = SimConfig(self.robot.hash, self.robot.name, found["values"], {})
        log, held = self.log()
        session.ingest(log, self.robot, name="log")
        begins = {"nominal": SimConfig.of(self.robot, self.robot.space.nominal), "btr": made}
        for name, start in begins.items():
            if f"diagnosed from {name}" not in done:
                yield self.diagnosed(session, name, start, held)

    def by_scores(self, session: Session, given: argparse.Namespace) -> dict:
        """Back to Reality, from the gaits of the robot's folder and the nominal simulator."""
        began, rules = time.process_time(), scaled(given.scale, 2)
        found = session.calibrate(
            self.robot,
            method="btr",
            robot_door=self.hidden.score,
            rules=rules,
            progress=Shown(),
            trials=TRIALS,
            seed=self.hidden.seed,
            threads=self.threads,
        )
        return {
            "step": "btr",
            "values": dict(session.registry.simulator(found.simulator)["values"]),
            "trials": found.cost.trials,
            "falls": found.cost.falls,
            "rollouts": found.cost.rollouts,
            "versions": [(v.stage, v.before, v.after) for v in found.versions],
            "best": max(s for s in found.on_robot.scores() if s is not None),
            "core seconds": time.process_time() - began,
        }

    def diagnosed(self, session: Session, name: str, start: SimConfig, held: str) -> dict:
        """What one log tells from a simulator on."""
        began, begun = time.process_time(), session.registry.put_simulator(start.as_dict())
        found = session.diagnose(
            "log",
            start=begun,
            hold_out=held,
            effects=ASKED,
            threshold_runs=0,
            max_causes=1,
            seed=self.hidden.seed,
            threads=self.threads,
        )
        causes = [
            {
                "key": c.key,
                "nats": c.evidence_nats,
                "sizes": {k: v.to_dict() for k, v in c.parameters.items()},
            }
            for c in found.causes
        ]
        passed = [c for c in causes if c["nats"] >= NATS]
        identity = found.extended_simulator if passed else found.calibrated_simulator
        made = SimConfig.from_dict(session.registry.simulator(identity))
        return {
            "step": f"diagnosed from {name}",
            "values": dict(made.values),
            "effects": {k: dict(v) for k, v in made.effects.items()},
            "verdict": found.verdict,
            "causes": causes,
            "named": [c["key"] for c in passed],
            "core seconds": time.process_time() - began,
        }

    def judged(self, done: Mapping[str, dict]) -> dict[str, dict]:
        """{simulator: figures} of all that there are."""
        made = {"nominal": SimConfig.of(self.robot, self.robot.space.nominal), "the robot itself": self.truth}
        for name, line in done.items():
            made[name] = SimConfig(self.robot.hash, self.robot.name, line["values"], line.get("effects", {}))
        log, held = self.log()
        errors = replay_errors(data(self.robot, log, held), [*made.values()], self.threads)[:, 1]
        scores = self.scores([*made.values()])
        apart, ranks = absolute(scores[:-1], scores[-1]), rank_correlation(scores[:-1], scores[-1])
        return {
            name: {"replay": float(e), "difference": float(d), "rank": float(r)}
            for name, e, d, r in zip(made, errors, apart, ranks, strict=True)
        }

    def scores(self, simulators: list[SimConfig]) -> np.ndarray:
        """(s + 1, n) of fixed gaits in simulators, and on the robot; 0 for a fall."""
        task, seed = task_of(self.robot), self.hidden.seed
        played = Played(self.robot, task, seed, self.threads)
        gaits = played.space.about_rest(FIXED, stream(seed, "fixed gaits"))
        rows = []
        for one in simulators:
            terms = terms_of(one, self.robot) if one.effects else None
            own = Simulators(self.robot.space.from_dict(dict(one.values))[None], terms)
            trials = Trials(self.robot, task, own, rate=RATE, seed=seed, threads=self.threads)
            rows.append(fitness(trials.grades(played.genes(gaits)))[:, 0])
        real = [self.hidden.score(played.commands(g), RATE, f"fixed {i}") or 0.0 for i, g in enumerate(gaits)]
        return np.array([*rows, real])


def moved(robot: Robot, values: Mapping[str, float]) -> dict[str, float]:
    """{parameter: how far it is from the nameplate, of its range}."""
    unit = robot.space.to_unit(robot.space.from_dict(dict(values))) - robot.space.to_unit(robot.space.nominal)
    return robot.space.as_dict(unit)


def show(kind: str, bench: Bench, done: Mapping[str, dict], figures: Mapping[str, dict]) -> None:
    """Print the tables of one robot."""
    print(
        f"{kind}: {f'the left feet have lost {LOSS:.0%} of their friction' if kind == 'worn' else 'hides nothing'}"
    )
    btr = done["btr"]
    print(
        f"  btr: {btr['trials']} trials, {btr['falls']} falls, {btr['rollouts']} simulations, "
        f"best {btr['best']:.2f} m, "
        + ", ".join(f"Delta {b:.3g} -> {a:.3g} m" for _, b, a in btr["versions"] if b)
    )
    shares = {name: moved(bench.robot, line["values"]) for name, line in done.items()}
    true = moved(bench.robot, bench.hidden.parameters)
    head = "".join(f"{name:>24}" for name in ("robot", *shares))
    print(f"  {'moved, of its range':16}{head}")
    for name in bench.robot.space.names:
        row = "".join(f"{s[name]:24.2f}" for s in (true, *shares.values()))
        print(f"  {name:19}{row}")
    off = {n: [p for p in true if abs(s[p] - true[p]) > abs(true[p]) + FAR] for n, s in shares.items()}
    for name, names in off.items():
        print(
            f"  {name}: {len(names)} of {len(true)} parameters moved away from the robot's by more than {FAR:.0%}"
        )
    for name, line in done.items():
        if "causes" in line:
            told = [(c["key"], round(c["nats"]), c["sizes"]) for c in line["causes"]]
            print(
                f"  {name}: {line['verdict']}, {line['core seconds']:.0f} s, {told}, passed: {line['named']}"
            )
    for name, f in figures.items():
        print(
            f"  {name:24} replay error {f['replay']:.3f}  scores of {FIXED} gaits off by {f['difference']:.2f} m, "
            f"rank correlation {f['rank']:+.2f}"
        )


def main() -> None:
    """Run what is left, and print the tables; those of the reporting robots are kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=KINDS)
    parser.add_argument("--scale", type=float, default=0.1, help="share of the published generations")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--tune", action="store_true", help="the robots of the development; keeps no table")
    parser.add_argument("--journal", type=Path, default=RESULTS / "hidden_by_fitness.jsonl")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    head = {"seed": seed, "scale": given.scale, "loss": LOSS, "nats": NATS}
    journal, cells = Journal(given.journal, head), {}
    journal.begin()
    for kind in given.kinds:
        bench = Bench.of(kind, seed, given.threads)
        done = {line["step"]: line for line in journal.lines() if line["kind"] == kind}
        with tempfile.TemporaryDirectory() as folder, dynreg.open(Path(folder) / "registry") as session:
            for line in bench.steps(session, given, done):
                done[line["step"]] = journal.add({"kind": kind, **line})
        figures = bench.judged(done)
        show(kind, bench, done, figures)
        cells[kind] = {"true": dict(bench.hidden.parameters), "steps": done, "judged": figures}
    keep(RESULTS / "hidden_by_fitness.json", head | {"cells": cells}, parser, given)


if __name__ == "__main__":
    main()
