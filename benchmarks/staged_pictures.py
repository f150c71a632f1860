"""Draw what a staged calibration of an AIBO came to: joints that were told, measured and simulated, and its searches.

    python benchmarks/bench_staged.py --registry R
    python benchmarks/staged_pictures.py R --out docs

Reads the recordings and the two calibrations that the bench leaves in a registry; writes joints.png (paper E, figures
1 and 4 to 7) and stages.png (its learning curves). Shown are the first seconds behind the first one of the air, of the
square wave and of the first walk of group B, which no stage has seen.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import matplotlib

if __name__ == "__main__":
    matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import dynreg
from dynreg.replay.data import data
from dynreg.replay.windows import Replayer
from dynreg.results import Calibration
from dynreg.session import Session
from dynreg.sim.robot import load_robot
from dynreg.sim.stand import on_stand

JOINTS = ("fr_rotor", "fr_elevator", "fr_knee")
SECONDS, SKIPPED = 3.0, 1.0
TOLD, MEASURED, NOMINAL, FITTED = "#a4a7aa", "#333333", "#d9822b", "#0b63ce"


@dataclass(frozen=True, eq=False)
class Shown:
    """A piece of an episode: its title, time (T,) [s], and of each joint of JOINTS (T, 3) [rad]."""

    title: str
    time: np.ndarray
    told: np.ndarray
    measured: np.ndarray
    nominal: np.ndarray
    fitted: np.ndarray


def calibrations(session: Session) -> tuple[Calibration, Calibration]:
    """Of the stage in the air, and of those on the ground: the newest of each."""
    rows = session.list("result").rows()
    found = [session.result(row["id"]) for row in rows if row["kind"] == "result"]
    own = [one for one in found if isinstance(one, Calibration) and one.method == "staged"]
    pick = lambda robot: [one for one in own if one.robot == robot][-1]  # noqa: E731
    return pick("aibo_on_stand"), pick("aibo")


def piece(session: Session, found: Calibration, name: str, episode: str, begin: float, title: str) -> Shown:
    """Some seconds of an episode from `begin` [s] on, in the nominal simulator and in the fitted one."""
    robot = load_robot("aibo") if found.robot == "aibo" else on_stand(load_robot("aibo"))
    cut = data(robot, session.recording(name), "0")
    window = next(w for w, e in enumerate(cut.windows.episode) if cut.recording.episodes[e].name == episode)
    values = session.registry.simulator(found.simulator)["values"]
    fitted = robot.space.from_dict(robot.space.as_dict(robot.space.nominal) | values)
    first, last = (round(t / cut.windows.period) for t in (begin, begin + SECONDS))
    replayed = Replayer(robot, cut.windows, 0).states(np.stack([cut.start, fitted]), np.array([window]))[:, 0]
    positions = [robot.channels.index(f"{joint}/position") for joint in JOINTS]
    commands = [i for joint in JOINTS for i, a in enumerate(robot.actions) if a.split("/")[0] == joint]
    rows = slice(first, min(last, cut.windows.run.actions.shape[1]))
    return Shown(
        title,
        np.arange(rows.start, rows.stop) * cut.windows.period,
        cut.windows.run.actions[window, rows][:, commands],
        cut.windows.measured[window, rows][:, positions],
        *replayed[:, rows][:, :, positions],
    )


def joints(shown: list[Shown]) -> plt.Figure:
    """A row for each joint, a column for each piece."""
    size = (3.6 * len(shown), 1.7 * len(JOINTS))
    figure, panels = plt.subplots(len(JOINTS), len(shown), figsize=size, layout="constrained", squeeze=False)
    for column, one in enumerate(shown):
        for row, joint in enumerate(JOINTS):
            axes = panels[row, column]
            for table, color, width, dashes, label in (
                (one.told, TOLD, 1.0, "-", "told"),
                (one.measured, MEASURED, 2.2, "-", "measured"),
                (one.nominal, NOMINAL, 1.1, (0, (4, 2)), "nominal simulator"),
                (one.fitted, FITTED, 1.3, "-", "after the last stage"),
            ):
                axes.plot(one.time, np.rad2deg(table[:, row]), color=color, lw=width, ls=dashes, label=label)
            axes.tick_params(labelsize=7)
            axes.spines[["top", "right"]].set_visible(False)
            if row == 0:
                axes.set_title(one.title, fontsize=9)
            if column == 0:
                axes.set_ylabel(f"{joint} [deg]", fontsize=8)
        panels[-1, column].set_xlabel("time [s]", fontsize=8)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, frameon=False, fontsize=9)
    return figure


def stages(found: tuple[Calibration, ...]) -> plt.Figure:
    """A learning curve for each stage."""
    every = [(one, v.stage) for one in found for v in one.versions]
    figure, panels = plt.subplots(
        1, len(every), figsize=(3.4 * len(every), 2.2), layout="constrained", squeeze=False
    )
    for axes, (one, stage) in zip(panels[0], every, strict=True):
        curve = [(s.simulations, s.error) for s in one.history if s.stage == stage]
        axes.step(*zip(*curve, strict=True), where="post", color=FITTED)
        axes.set_yscale("log")
        axes.set_title(f"lowest loss of stage {stage!r}", fontsize=9)
        axes.set_xlabel("simulators", fontsize=8)
        axes.tick_params(labelsize=7, which="both")
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def main(arguments: list[str] | None = None) -> None:
    """Draw both."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("registry", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs"))
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    with dynreg.open(given.registry) as session:
        air, ground = found = calibrations(session)
        end = float(np.ptp(session.recording("air").episodes[0].time))
        walks = session.recording("walks")
        unseen = next(e.name for e in walks.episodes if e.name.startswith("B"))
        shown = [
            piece(session, air, "air", "air", 0.4 * end, "in the air, a rising sine"),
            piece(session, air, "air", "air", 0.5 * end + SKIPPED, "in the air, a square wave"),
            piece(session, ground, "walks", unseen, SKIPPED, "a walk that no stage has seen"),
        ]
    for name, figure in (("joints.png", joints(shown)), ("stages.png", stages(found))):
        figure.savefig(given.out / name, dpi=100)
        plt.close(figure)
        print(given.out / name)


if __name__ == "__main__":
    main()
