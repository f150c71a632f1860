"""Paper E in small: an AIBO calibrated in stages, or all parameters at once on the walks, by as many simulators.

Ten hidden robots. Each calibration fits the walks of group A; the error is that of the mean velocities of walks of
group B, which neither saw: the root of the mean square, where 0.1 rad/s counts as 10 mm/s. All parameters at once are
fitted to what counts, the velocities, by the evolution strategy of the last stage or by CMA-ES. An air recording is
cheap to simulate, so simulated seconds stand beside the simulators. The interval is of 90 %, bootstrap over robots.
`--searches` names a folder that keeps what each search has done, so an interrupted robot goes on where it was.
"""

import argparse
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import aibo
import numpy as np
from bootstrap import interval
from journal import Journal
from kept import RESULTS, keep
from searches import kept_searches, spent
from staged_runs import calibrated, deviations, held_out

import dynreg
from dynreg.rng import stream_seed
from dynreg.session import Session
from dynreg.sim.robot import load_robot

REPORT = 20261202
ROTATION = 100.0  # mm by which a yaw rate counts, as in the plan's loss
CHILDREN = 50  # of a generation, as in the last stage
ARMS = ("es", "cma")


def at_once(
    session: Session, search: str, rollouts: int, given: argparse.Namespace, seed: int
) -> tuple[np.ndarray, int]:
    """(P,) parameters of aibo, all fitted to the session's walks; simulators that were run, no more than `rollouts`."""
    robot = load_robot("aibo")
    numbers = "mu = 9\n" if search == "es" else ""
    walks = session.recording("walks")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "once.toml"
        path.write_text(
            f'[[stages]]\nname = "once"\nparameters = ["*"]\nloss = "velocity"\nskip = 1.0\nsearch = "{search}"\n'
            f"children = {CHILDREN}\n{numbers}generations = {(rollouts - 1) // CHILDREN}\n",
            encoding="utf-8",
        )
        told = {"hold_out": ",".join(held_out(walks)), "seed": seed, "threads": given.threads}
        told["resume"] = given.resume
        found = session.calibrate("walks", method="staged", plan=path, robot=robot, **told)
    values = {name: one.value for name, one in found.parameters.items()}
    return robot.space.from_dict(values), found.cost.rollouts


def error(groups: dict, group: str) -> float:
    """mm/s of a simulator's mean velocities over a group of walks."""
    x, y, turn = (groups[group][axis][2] for axis in ("x", "y", "r"))
    return float(np.sqrt(x**2 + y**2 + (ROTATION * np.deg2rad(turn)) ** 2))


def compared(seed: int, given: argparse.Namespace, searches: Path) -> dict:
    """{arm: errors of A and B, core seconds} of a hidden robot, whose searches are kept in a folder."""
    hidden, ends, ran, took = aibo.hidden(seed), {}, {}, {}
    with tempfile.TemporaryDirectory() as folder, dynreg.open(Path(folder) / "registry") as session:

        def timed(arm: str, search: Callable[[], tuple]) -> Any:
            """What a search found; in `ran` and `took` what it cost with all its interrupted runs."""
            given.resume = any((searches / arm).glob("*.jsonl"))
            with kept_searches(session.registry.journal_path("").parent, searches / arm):
                found, ran[arm] = search()
            took[arm] = spent(searches / arm)["core seconds"]
            return found

        stages = timed("staged", lambda: calibrated(session, given, hidden))
        ends |= {"initial": stages["initial"], "staged": stages["walks"]}
        for arm in given.arms:
            ends[arm] = timed(arm, partial(at_once, session, arm, ran["staged"], given, seed))
        table = deviations(hidden, session, ends, given.threads)
    return {
        "rollouts": ran,
        "errors": {arm: {g: error(table[arm], g) for g in ("A", "B")} for arm in ends},
        "core seconds": took,
    }


def show(lines: list[dict]) -> None:
    """Print each robot, and how much less staged errs than the others."""
    for line in lines:
        errors = ", ".join(f"{arm} {e['A']:.0f} / {e['B']:.0f}" for arm, e in line["errors"].items())
        took = ", ".join(f"{arm} {s:.0f}" for arm, s in line["core seconds"].items())
        ran = ", ".join(f"{arm} {n}" for arm, n in line["rollouts"].items())
        print(f"robot {line['number']}: mm/s A / B: {errors}; simulators: {ran}; core s: {took}")
    for arm in ("initial", *ARMS):
        own = [line["errors"] for line in lines if arm in line["errors"]]
        if len(own) > 1:
            ratio = np.log([e["staged"]["B"] / e[arm]["B"] for e in own])
            mean, low, high = np.exp(interval(ratio))
            better = int((ratio < 0).sum())
            print(
                f"staged over {arm}, B: {mean:.2f} [{low:.2f}, {high:.2f}], better on {better} of {len(own)}"
            )


def main() -> None:
    """Print the table; that of the reporting seed is kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--arms", nargs="*", default=["es"], choices=ARMS)
    parser.add_argument("--scale", type=float, default=0.1, help="share of each stage's generations")
    parser.add_argument("--fit", type=int, default=4, help="walks of group A")
    parser.add_argument("--held", type=int, default=8, help="walks of group B")
    parser.add_argument("--air", type=float, default=20.0, help="seconds in the air")
    parser.add_argument("--seed", type=int, default=REPORT)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--journal", type=Path, default=RESULTS / "at_once.jsonl")
    parser.add_argument("--searches", type=Path, help="folder of interrupted searches, to go on from")
    parser.set_defaults(walk=aibo.WALK)
    given = parser.parse_args()
    told = {name: getattr(given, name) for name in ("seed", "arms", "scale", "fit", "held", "air")}
    journal = Journal(given.journal, told)
    journal.begin()
    done = {line["number"] for line in journal.lines()}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.robots):
            if number not in done:
                own = stream_seed(given.seed, "at once", number) % 2**31
                name = f"robot_{own}_{given.scale:g}_{given.fit}_{given.held}_{given.air:g}"
                searches = (given.searches or Path(folder)) / name
                show([journal.add({"number": number, **compared(own, given, searches)})])
    show(journal.lines())
    keep(RESULTS / "at_once.json", {**told, "robots": journal.lines()}, parser, given, ("searches",))


if __name__ == "__main__":
    main()
