"""Draw where a wheeled robot went, and where a diagnosis's simulators go from the same poses under the same commands.

python examples/wheel_paths.py REGISTRY RECORDING --out docs/wheels.png

Only rollouts that the diagnosis held out count. Three are shown from above, from where the robot stood: those that are
least straight. The last panel has all.
"""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import matplotlib

if __name__ == "__main__":
    matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

import dynreg
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.errors import NoMatchError
from dynreg.replay.parts import names
from dynreg.results import Diagnosis
from dynreg.session import Session
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import rollout
from dynreg.timed.wheels import pose_names
from dynreg.verbs.subjects import robot_of

MEASURED, NOMINAL, CALIBRATED, EXTENDED = "#a4a7aa", "#d9822b", "#7b3fb5", "#0b63ce"
LOOKS = {
    "measured": (MEASURED, 4.0, "-"),
    "nominal": (NOMINAL, 1.4, (0, (4, 2))),
    "calibrated": (CALIBRATED, 1.4, (0, (1, 1.5))),
    "extended": (EXTENDED, 1.6, "-"),
}
SHOWN = 3  # paths


@dataclass(frozen=True, eq=False)
class Paths:
    """Rollouts that a diagnosis held out: measured (W, T+1, 2) positions [m], NaN where there is none.

    simulated : {nominal, calibrated, extended: (W, T+1, 2)}. All begin in the origin, heading along the first axis.
    period : s between rows.
    """

    measured: np.ndarray
    simulated: Mapping[str, np.ndarray]
    period: float

    def apart(self, name: str) -> np.ndarray:
        """(W, T+1) distance [m] of a simulator from the robot."""
        return np.linalg.norm(self.simulated[name] - self.measured, axis=2)

    def ends(self, name: str) -> np.ndarray:
        """(W,) distance [m] at the last row that was measured."""
        apart = self.apart(name)
        last = np.isfinite(apart).shape[1] - 1 - np.isfinite(apart)[:, ::-1].argmax(axis=1)
        return apart[np.arange(len(apart)), last]


def held_out(registry: Session, found: Diagnosis, *, horizon: float | None = None) -> Paths:
    """The rollouts of a diagnosis's test part, in the nominal, the calibrated and the extended simulator.

    horizon : the one that it was asked for [s]. Raises NoMatchError where it held nothing out or cut the log otherwise,
    LogError for a robot without a pose.
    """
    if not found.parts["test"]:
        raise NoMatchError(
            f"the diagnosis of {found.recording_name!r} held nothing out",
            expected="rollouts that it has not seen",
            do="diagnose with --hold-out 0.5",
        )
    recording = registry.recording(found.recording)
    robot = robot_of(registry.registry, found.recording)
    settings = DiagnosisOptions(engine=found.engine or None, threads=1, horizon=horizon)
    cut = pose(robot, recording, settings)[1].windows
    known = names(recording, cut, np.ones(len(cut), dtype=bool))
    strange = sorted({*found.parts["test"]} - {*known})
    if strange:
        raise NoMatchError(
            f"no rollout {strange[0]!r} in {found.recording_name!r}, cut as the robot's folder says",
            expected="the rollouts of the diagnosis",
            do="give the horizon that it was asked for",
        )
    cut = cut.take(np.flatnonzero(np.isin(known, found.parts["test"])))
    nominal = SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal))
    stored = {"calibrated": found.calibrated_simulator, "extended": found.extended_simulator}
    configs = {"nominal": nominal} | {
        name: SimConfig.from_dict(registry.registry.simulator(i)) for name, i in stored.items() if i
    }
    columns = [robot.channels.index(name) for name in pose_names(robot, recording.names)]
    start = cut.run.initial[:, columns]
    poses = {"measured": cut.measured}
    for name, config in configs.items():
        values = robot.space.from_dict(dict(config.values))[None]
        run = rollout(
            robot, values, cut.run, engine=found.engine or None, terms=terms_of(config, robot), threads=1
        )
        poses[name] = run.states[0]
    seen = {name: _from_start(states[..., columns], start) for name, states in poses.items()}
    return Paths(seen.pop("measured"), seen, cut.period)


def _from_start(poses: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(W, T+1, 2) ahead and to the left of the start (W, 3), from poses (W, T+1, 3)."""
    away = poses[..., :2] - start[:, None, :2]
    cos, sin = np.cos(start[:, 2])[:, None], np.sin(start[:, 2])[:, None]
    return np.stack(
        [away[..., 0] * cos + away[..., 1] * sin, away[..., 1] * cos - away[..., 0] * sin], axis=2
    )


def draw_path(axes: Axes, paths: Paths, number: int, shown: tuple[str, ...]) -> None:
    """One rollout, with how far each simulator ends from the robot."""
    for name in ("measured", *shown):
        color, width, dashes = LOOKS[name]
        way = (paths.measured if name == "measured" else paths.simulated[name])[number]
        axes.plot(way[:, 0], way[:, 1], color=color, linewidth=width, linestyle=dashes, label=name)
    off = ", ".join(f"{name} {100 * paths.ends(name)[number]:.1f}" for name in shown)
    axes.set_title(f"{off} cm", fontsize=9)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def draw_apart(axes: Axes, paths: Paths) -> None:
    """How far the simulators are from the robot as time goes by: root mean square over all rollouts."""
    time = paths.period * np.arange(paths.measured.shape[1])
    for name in paths.simulated:
        color, width, dashes = LOOKS[name]
        off = 100.0 * np.sqrt(np.nanmean(paths.apart(name) ** 2, axis=0))
        axes.plot(time, off, color=color, linewidth=width, linestyle=dashes, label=name)
    axes.set_title(f"all {len(paths.measured)} rollouts", fontsize=9)
    axes.set_xlabel("time [s]", fontsize=9)
    axes.set_ylabel("off by, root mean square [cm]", fontsize=9)
    axes.set_ylim(bottom=0.0)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def bent(paths: Paths, many: int = SHOWN) -> np.ndarray:
    """The rollouts whose measured ways are least straight, in the order of the log."""
    width = []
    for way in paths.measured:
        known = way[np.isfinite(way).all(axis=1)]
        width.append(np.linalg.svd(known - known.mean(axis=0), compute_uv=False)[-1])
    return np.sort(np.argsort(-np.array(width), kind="stable")[:many])


def draw(paths: Paths, shown: tuple[str, ...] = ("nominal", "extended")) -> plt.Figure:
    """Some rollouts side by side, with the simulators `shown`, and how far off all are on all of them."""
    chosen, shown = bent(paths), tuple(name for name in shown if name in paths.simulated)
    figure, panels = plt.subplots(
        1, len(chosen) + 1, figsize=(2.75 * (len(chosen) + 1), 3.1), layout="constrained"
    )
    for axes, number in zip(panels, chosen, strict=False):
        draw_path(axes, paths, int(number), shown)
        axes.set_xlabel("ahead [m]", fontsize=9)
    panels[0].set_ylabel("to the left [m]", fontsize=9)
    draw_apart(panels[-1], paths)
    handles = {
        label: line
        for axes in (panels[0], panels[-1])
        for line, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles, loc="outside upper center", ncols=4, frameon=False)
    return figure


def main(arguments: list[str] | None = None) -> None:
    """Draw the newest diagnosis of a recording, and print how far its simulators end from the robot."""
    parser = argparse.ArgumentParser(description="Draw the held-out paths of a diagnosed wheeled robot.")
    parser.add_argument("registry", type=Path)
    parser.add_argument("recording", help="recording or diagnosis, by id or name")
    parser.add_argument("--horizon", type=float, help="of the diagnosis, where it was asked for one")
    parser.add_argument("--out", type=Path, default=Path("docs/wheels.png"))
    given = parser.parse_args(arguments)
    with dynreg.open(given.registry, create=False) as registry:
        paths = held_out(registry, registry.result(given.recording), horizon=given.horizon)
    figure = draw(paths)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(given.out, dpi=100)
    plt.close(figure)
    for name in paths.simulated:
        end = 100 * np.sqrt(np.nanmean(paths.ends(name) ** 2))
        print(f"{name}: {end:.1f} cm off at the end (root mean square of {len(paths.measured)} rollouts)")
    print(given.out)


if __name__ == "__main__":
    main()
