"""How often `dynreg drift` errs on hidden robots: alarms where nothing changed, and what it says where something did.

The truth is the unicycle engine's, not the test's own reference: a diffdrive with errors of its nameplate, a time step
ten times finer, unsteady wheels, sensor noise and quantisation. Two recordings each of 12 episodes with 50 random wheel
speeds held for 0.1 to 2 s. What changes in between: one wheel, both, or what turns do, by a factor whose size is drawn
(1 to 30 %, uniform in its logarithm, up or down); a slippery floor, of which no pattern speaks; or nothing.

Without a change: verdicts `moved`, tests below the level one by one, rejections with the false-discovery rate kept, the
splits of the earlier recording, and tests that take every piece for a sample. With one: how often it is seen and
rightly named, and whether the interval holds.
"""

import argparse
import json
import time
from dataclasses import dataclass

import numpy as np
from kept import RESULTS
from scipy.stats import binomtest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.drift.compared import Held, Plan, compared
from dynreg.drift.drift import drift
from dynreg.evidence.truth import hide
from dynreg.results import Drift
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.real import disturbance, draws, drive_limits, finer, sensed
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.timed.drift import shifts
from dynreg.timed.patterns import PATTERNS
from dynreg.timed.table import DisplacementTable
from dynreg.verbs.drift import DriftSettings
from dynreg.verbs.drift_document import document

FILE = RESULTS / "drift.json"
TUNE, REPORT = 66, 20261214
PERIOD = 0.05  # s
EPISODES, EACH, TICKS = 12, 50, (2, 40)  # commands of an episode, and for how many periods they are held
SPEED = 10.5  # rad/s, 0.22 m/s
SIZES = (0.01, 0.3)  # of a change
BANDS = (0.01, 0.02, 0.05, 0.1, 0.3)
GRIP = 1.0  # m/s^2, of the slippery floor: medium in the library of effects
SLIP, NOTHING = "wheel slip", "nothing"
TOGETHER = 20  # robots simulated at once


@dataclass(frozen=True)
class Case:
    """A hidden robot that changes between its two recordings: what, by which factor, and the seed of all its draws."""

    change: str
    factor: float
    seed: int


def cases(seed: int, change: str, many: int) -> list[Case]:
    """Hidden robots with a change whose size is drawn."""
    out = []
    for number in range(many):
        own = stream_seed(seed, "hidden", change, number) % 2**31
        rng = stream(own, "change")
        size = np.exp(rng.uniform(*np.log(SIZES))) * rng.choice([-1.0, 1.0])
        out.append(Case(change, 1.0 + float(size) if change in PATTERNS else 1.0, own))
    return out


def simulators(robot: Robot, some: list[Case]) -> tuple[np.ndarray, Terms]:
    """(2 n, P) parameters before and after of n robots, one after the other, and what no parameter says.

    The engine has one radius for both wheels and a relative difference between them; a smaller track turns more.
    """
    names = list(robot.space.names)
    values, difference, grip = [], [], []
    for case in some:
        nameplate = hide(robot, (), None, case.seed).parameters
        for factor in (1.0, case.factor):
            left = factor if case.change in ("left wheel", "all speeds") else 1.0
            right = factor if case.change in ("right wheel", "all speeds") else 1.0
            own = nameplate.copy()
            own[names.index("wheel_radius")] *= 0.5 * (left + right)
            own[names.index("track")] /= factor if case.change == "turns only" else 1.0
            values.append(own)
            difference.append([2.0 * (right - left) / (left + right)])
        grip += [[np.nan], [GRIP if case.change == SLIP else np.nan]]
    return np.array(values), Terms(
        (term("wheel_gain"), term("wheel_slip")), (np.array(difference), np.array(grip))
    )


def commands(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(E, T, 2) wheel speeds [rad/s] of a recording, the last ones held to the end, and the steps (E,) that count."""
    rng = stream(seed, "commands")
    told = [
        rng.uniform(-SPEED, SPEED, (EACH, 2)).repeat(rng.integers(TICKS[0], TICKS[1] + 1, EACH), axis=0)
        for _ in range(EPISODES)
    ]
    steps = np.array([len(t) for t in told])
    most = EACH * TICKS[1]
    return np.array([np.pad(t, ((0, most - len(t)), (0, 0)), mode="edge") for t in told]), steps


def recordings(robot: Robot, some: list[Case]) -> list[tuple[Recording, Recording]]:
    """What the loggers of hidden robots write, before and after."""
    values, terms = simulators(robot, some)
    drawn = [commands(stream_seed(case.seed, "recording", i)) for case in some for i in range(2)]
    longest = max(int(steps.max()) for _, steps in drawn)
    actions = np.stack([a[:, :longest] for a, _ in drawn])
    rest = np.zeros((EPISODES, len(robot.channels)))
    truth, limits = finer(robot), drive_limits(robot)
    unsteady = draws(actions.shape[:-1], limits, stream(some[0].seed, "unsteady wheels"))
    run = Run(actions, period=PERIOD, initial=rest, draws=unsteady)
    active = terms + disturbance(truth, limits).tiled(len(values))
    states = rollout(truth, values, run, engine="unicycle", terms=active, threads=1).states
    logs = [
        _logged(robot, s, a, steps, stream(some[i // 2].seed, "sensors", i % 2))
        for i, (s, (a, steps)) in enumerate(zip(states, drawn, strict=True))
    ]
    return list(zip(logs[::2], logs[1::2], strict=True))


def _logged(
    robot: Robot, states: np.ndarray, actions: np.ndarray, steps: np.ndarray, rng: np.random.Generator
) -> Recording:
    channels = [Channel(c.name, c.unit) for c in (*robot.file.channels, *robot.file.actions)]
    measured = sensed(robot, states, rng)
    episodes = []
    for e, n in enumerate(steps):
        told = np.concatenate([actions[e, :n], actions[e, n - 1 : n]])
        values = np.concatenate([measured[e, : n + 1], told], axis=1)
        episodes.append(Episode(f"e{e}", PERIOD * np.arange(n + 1), values))
    return Recording(tuple(channels), tuple(episodes), measured=False)


def piece_by_piece(robot: Robot, recent: Held, earlier: Held, plan: Plan) -> tuple[int, int]:
    """Tests below the level, and tests, where every piece of a command is taken for a sample of its own."""
    both = compared(robot, recent, earlier, plan)
    old, new = (
        DisplacementTable.of(both.grid.cells, p.cell, off)
        for p, off in ((both.old, both.old_off), (both.new, both.new_off))
    )
    p = shifts(old, new, plan.rules).p
    return int((p < plan.rules.level).sum()), int(np.isfinite(p).sum())


def rows(robot: Robot, some: list[Case], splits: int) -> list[dict]:
    """What `drift` says of hidden robots."""
    out = []
    for at in range(0, len(some), TOGETHER):
        batch = some[at : at + TOGETHER]
        for case, pair in zip(batch, recordings(robot, batch), strict=True):
            earlier, recent = (Held(r, name) for r, name in zip(pair, ("before", "after"), strict=True))
            still = case.change == NOTHING
            settings = DriftSettings(splits=splits if still else 0)
            began = time.perf_counter()
            result = document(
                robot, recent, earlier, settings.plan, drift(robot, recent, earlier, settings.plan)
            )
            row = _row(case, result) | {"seconds": time.perf_counter() - began}
            if still:
                row["pieces"] = piece_by_piece(robot, recent, earlier, settings.plan)
            out.append(row)
        print(f"{some[0].change}: {len(out)} of {len(some)}", flush=True)
    return out


def _row(case: Case, result: Drift) -> dict:
    best = next((p for p in result.patterns if p.name == case.change), None)
    return {
        "change": case.change,
        "factor": case.factor,
        "seed": case.seed,
        "verdict": result.verdict,
        "pattern": result.pattern,
        "rivals": result.rivals,
        "low": best and best.low,
        "high": best and best.high,
        "found": best and best.factor,
        "share": result.patterns[0].share if result.patterns else None,
        "tests": result.tests,
        "below": sum(s.p < result.false_alarms.level for c in result.cells for s in c.shifts.values()),
        "rejected": result.rejected,
        "splits": [result.false_alarms.one_by_one, result.false_alarms.alarms],
    }


def unchanged(done: list[dict]) -> dict:
    """How often the test errs where nothing changed."""
    moved = sum(r["verdict"] == "moved" for r in done)
    low, high = binomtest(moved, len(done)).proportion_ci(0.95)
    splits = np.array([r["splits"] for r in done], dtype=float)
    below, tests = np.array([r["pieces"] for r in done]).sum(axis=0)
    out = {
        "pairs": len(done),
        "moved": moved,
        "moved interval": [low, high],
        "tests": sum(r["tests"] for r in done),
        "below the level": sum(r["below"] for r in done) / sum(r["tests"] for r in done),
        "pairs with a test below it": sum(r["below"] > 0 for r in done) / len(done),
        "rejected together": sum(r["rejected"] for r in done),
        "splits below the level": float(splits[:, 0].mean()),
        "splits with an alarm": float(splits[:, 1].mean()),
        "by recording": [float(splits[:, 1].min()), float(splits[:, 1].max())],
        "pieces below the level": float(below / tests),
    }
    print(
        f"\nnothing changed, {len(done)} pairs: {moved} verdicts `moved` (95 % interval {100 * low:.1f} to"
        f" {100 * high:.1f} %); {100 * out['below the level']:.1f} % of {out['tests']} tests below 5 %, in"
        f" {100 * out['pairs with a test below it']:.0f} % of the pairs some; {out['rejected together']} rejected with"
        f" the false-discovery rate kept\ntheir splits: {100 * out['splits below the level']:.1f} % of the tests below"
        f" 5 %, {100 * out['splits with an alarm']:.1f} % with an alarm"
        f" ({100 * out['by recording'][0]:.0f} to {100 * out['by recording'][1]:.0f} % by recording)\nevery piece a"
        f" sample: {100 * out['pieces below the level']:.1f} % of the tests below 5 %"
    )
    return out


def changed(done: list[dict]) -> dict:
    """How changes are seen and named: all of them, by what changed, and by the size of the change."""
    size = np.array([abs(r["factor"] - 1.0) for r in done])
    groups = {"all": np.ones(len(done), dtype=bool)}
    groups |= {name: np.array([r["change"] == name for r in done]) for name in PATTERNS}
    groups |= {
        f"{100 * a:g} to {100 * b:g} %": (size >= a) & (size < b)
        for a, b in zip(BANDS[:-1], BANDS[1:], strict=True)
    }
    print(f"\n{'change':14s} robots  moved  named  with rivals  wrong  interval holds")
    out = {}
    for name, which in groups.items():
        own = [r for r, w in zip(done, which, strict=True) if w]
        named = [r for r in own if r["pattern"] == r["change"]]
        out[name] = {
            "robots": len(own),
            "moved": sum(r["verdict"] == "moved" for r in own),
            "named": len(named),
            "with rivals": sum(r["change"] in r["rivals"] for r in own),
            "wrong": sum(r["pattern"] not in (None, r["change"]) for r in own),
            "interval holds": sum(r["low"] <= r["factor"] <= r["high"] for r in named),
        }
        print(f"{name:14s}" + "".join(f"{v:7d}" for v in out[name].values()))
    return out


def slipped(done: list[dict]) -> dict:
    """What is said of a change that no pattern speaks of."""
    out = {
        "robots": len(done),
        "moved": sum(r["verdict"] == "moved" for r in done),
        "a pattern named": sum(r["pattern"] is not None for r in done),
        "named, and said to explain less than half": sum(
            r["pattern"] is not None and r["share"] < 0.5 for r in done
        ),
        "patterns": sorted(str(r["pattern"]) for r in done),
    }
    print(
        f"\na slippery floor, {len(done)} robots: {out['moved']} `moved`, {out['a pattern named']} with a pattern,"
        f" of which {out['named, and said to explain less than half']} are said to explain less than half of the shifts"
    )
    return out


def main() -> None:
    """Print the figures, and keep them in benchmarks/results/drift.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=40, help="of a robot that stayed as it was")
    parser.add_argument("--robots", type=int, default=20, help="with each change")
    parser.add_argument("--splits", type=int, default=200)
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes nothing")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    robot, began = load_robot("diffdrive"), time.process_time()
    still = rows(robot, cases(seed, NOTHING, given.pairs), given.splits)
    moved = [r for p in PATTERNS for r in rows(robot, cases(seed, p, given.robots), 0)]
    slip = rows(robot, cases(seed, SLIP, given.robots), 0)
    out = {
        "seed": seed,
        "splits": given.splits,
        "unchanged": unchanged(still),
        "changed": changed(moved),
        "slippery floor": slipped(slip),
        "core seconds": time.process_time() - began,
        "robots": still + moved + slip,
    }
    print(f"{out['core seconds']:.0f} s of one core")
    if not given.tune:
        FILE.write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()
