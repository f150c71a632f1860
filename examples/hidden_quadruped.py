"""A quadruped whose parameters are secret, recorded to MCAP as a robot would be, and the trial of a gait on it.

It is `quadruped` with parameters drawn by a seed from the population's ranges, until it can walk, behind the door of
`dynreg.sim.real.SimulatedRobot`: a physics step ten times finer than the registry's simulators have, disturbed
torques, noisy and quantised sensors. Every log in its folder is a trial that it has had.

    python examples/hidden_quadruped.py FOLDER --seed 7
    python examples/hidden_quadruped.py FOLDER --seed 7 --play gait.csv
    python examples/hidden_quadruped.py FOLDER --seed 7 --play trials/trial_1.csv --log trials/trial_1_log.mcap
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from dynreg.data.readers import ReadOptions, read_log
from dynreg.data.recording import Recording
from dynreg.errors import DynregError, UsageError
from dynreg.gait.tasks import fitness, progress, task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.rng import stream
from dynreg.sim.excitation import excitation
from dynreg.sim.real import RealTrial, SimulatedRobot, Spent
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.export_gait import write_new

MAP = Path(__file__).parent / "maps" / "quadruped.toml"
DRAWS = 200  # of a robot, until one can walk; a third can
START = 1_700_000_000_000_000_000  # [ns] first stamp of the first trial
APART = 60_000_000_000  # [ns] from the begin of one trial to that of the next
ON_TIME = 1e-3  # [s] by which a command may be early or late
SLACK = 1e-6  # [rad] that a table's rounding may add


@dataclass(frozen=True)
class HiddenQuadruped:
    """What was recorded: the logs, the map that reads them, and the secret (never shown to dynreg)."""

    logs: tuple[Path, ...]
    log_map: Path
    secret: dict[str, float]


def record(folder: Path, *, seed: int = 7, episodes: int = 0) -> HiddenQuadruped:
    """Excite a drawn robot, each episode a trial from rest, and write one MCAP file a trial.

    episodes : their number, 0 for that of robot.toml.
    """
    robot = load_robot("quadruped")
    told = excitation(robot, seed=seed, name="hidden_quadruped", episodes=episodes).actions
    logs = tuple(folder / f"run_{i:02}.mcap" for i in range(len(told)))
    _require_room(folder, logs)
    real = hidden_robot(seed, past(folder))
    for path, actions in zip(logs, told, strict=True):
        write_new(path, _mcap(real.run(actions, robot.rate, path.stem).recording, real.spent.trials))
    return HiddenQuadruped(logs, MAP, robot.space.as_dict(real.parameters))


def play(folder: Path, gait: Path, *, seed: int = 7, log: Path | None = None) -> tuple[RealTrial, Spent]:
    """Play a gait's table once on the robot of the seed and write its log; what all trials cost, besides.

    log : FOLDER/trial.mcap where none is named.
    """
    robot = load_robot("quadruped")
    actions = read_commands(gait, robot)  # before anything moves
    log = log or folder / "trial.mcap"
    _require_room(log.parent, (log,))
    real = hidden_robot(seed, past(*sorted({folder.resolve(), log.parent.resolve()})))
    trial = real.run(actions, robot.rate, log.stem)
    write_new(log, _mcap(trial.recording, real.spent.trials))
    return trial, real.spent


def hidden_robot(seed: int, spent: Spent | None = None) -> SimulatedRobot:
    """The robot of a seed, which has had the trials `spent`: they tell which disturbances are the next."""
    robot = load_robot("quadruped")
    return SimulatedRobot(robot, _able(robot, seed), seed=seed, spent=spent or Spent())


def past(*folders: Path) -> Spent:
    """The trials and seconds that the logs in folders tell of; whether a robot fell, they do not."""
    options = ReadOptions(sources=("/joint_states.position[0]",))
    found = [read_log(path, options).sources for folder in folders for path in sorted(folder.glob("*.mcap"))]
    seconds = [max(series.time[-1] for series in sources.values()) for sources in found if sources]
    return Spent(len(seconds), float(sum(seconds)))


def read_commands(path: Path, robot: Robot) -> np.ndarray:
    """(T, A) commands [rad] of a table with the columns `time` [s] and the robot's action names, in any order.

    Raises LogError for what is no table, UsageError for one that is not this robot's.
    """
    log = read_log(path)
    missing = [name for name in robot.actions if name not in log.sources]
    unknown = sorted({*log.sources, *log.labels} - set(robot.actions))
    if missing or unknown:
        fault = f"has no column of numbers {missing[0]!r}" if missing else f"has a column {unknown[0]!r}"
        raise UsageError(
            f"{path.name!r} {fault}",
            expected=f"time and the actions of robot {robot.name!r}: {', '.join(robot.actions)}",
            do="export a gait of this robot with `dynreg export GAIT --as csv`",
        )
    series = [log.sources[name] for name in robot.actions]
    _require_on_time(path, series[0].time, robot.rate)
    told = np.stack([s.values for s in series], axis=1)
    _require_reachable(path, told, robot)
    return told


def _require_on_time(path: Path, time: np.ndarray, rate: float) -> None:
    """UsageError where times (T,) [s] are not `rate` a second."""
    even = np.arange(len(time)) / rate
    late = np.flatnonzero(~(np.abs(time - even) <= ON_TIME))  # a time that is no number is late
    if len(late):
        row = late[0]
        raise UsageError(
            f"row {row + 1} of {path.name!r} is at {time[row]:.6g} s",
            expected=f"{even[row]:.6g} s: {rate:g} commands a second, evenly",
            do="seek the gait on a log of this robot, which tells its rate",
        )


def _require_reachable(path: Path, told: np.ndarray, robot: Robot) -> None:
    """UsageError where commands (T, A) [rad] pass the limits of robot.toml or are no numbers."""
    low, high = np.array([(a.low, a.high) for a in robot.file.actions]).T
    past = np.argwhere(~((told >= low - SLACK) & (told <= high + SLACK)))
    if len(past):
        row, action = past[0]
        raise UsageError(
            f"row {row + 1} of {path.name!r} tells {robot.actions[action]} {told[row, action]:.4g} rad",
            expected=f"{low[action]:g} to {high[action]:g} rad",
            do="use the gait as `dynreg export` wrote it",
        )


def _require_room(folder: Path, logs: tuple[Path, ...]) -> None:
    """Make the folder; UsageError where that fails, or one of the logs is there: no trial is written over."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"cannot make folder {str(folder)!r}: {error.strerror}",
            expected="a folder that may be written",
            do="name another one",
        ) from error
    there = [path for path in logs if path.exists()]
    if there:
        raise UsageError(
            f"{str(there[0])!r} is there already",
            expected="a folder without it, as every log is a trial that the robot has had",
            do="rename it, or name another folder",
        )


def _able(robot: Robot, seed: int) -> np.ndarray:
    """(P,) the first draw that walks by the hand-written trot in its own simulator."""
    rng, task = stream(seed, "hidden_quadruped", "parameters"), task_of(robot)
    for _ in range(DRAWS):
        values = robot.space.from_unit(rng.uniform(size=len(robot.space)))
        values[robot.space.names.index("action_rate")] = robot.rate
        trials = Trials(robot, task, Simulators(values[None]), rate=robot.rate, seed=seed, threads=1)
        trot = trials.space.feasible(trials.space.from_unit(trials.space.starts[:1]))
        if fitness(trials.grades(trot)).min() >= task.success:
            return values
    raise RuntimeError(f"none of {DRAWS} draws of seed {seed} can walk")


def _messages(recording: Recording) -> Iterator[tuple[float, str, dict]]:
    """(time [s], topic, message): what such a robot publishes. Its joints come in the order of the alphabet."""
    (episode,) = recording.episodes
    joints = sorted(name.split("/")[0] for name in recording.names if name.endswith("/target"))
    for time, row in zip(episode.time.tolist(), episode.values.tolist(), strict=True):
        now = dict(zip(recording.names, row, strict=True))
        position, velocity, target = (
            [now[f"{joint}/{what}"] for joint in joints] for what in ("position", "velocity", "target")
        )
        attitude = [now[f"base/{angle}"] for angle in ("roll", "pitch", "yaw")]
        turning = [now[f"base/w{axis}"] for axis in "xyz"]
        moving = {axis: now[f"base/v{axis}"] for axis in "xyz"}
        yield time, "/joint_states", {"name": joints, "position": position, "velocity": velocity}
        yield time, "/imu", {"rpy": attitude, "gyroscope": turning}
        yield time, "/odom", {"twist": {"twist": {"linear": moving}}}
        yield time, "/joint_commands", {"name": joints, "position": target}


def _mcap(recording: Recording, number: int) -> bytes:
    """The log of trial `number` of the robot, from 1 on."""
    from mcap.writer import Writer

    file = BytesIO()
    writer = Writer(file)
    writer.start(profile="", library="hidden_quadruped")
    schema = writer.register_schema("object", "jsonschema", b'{"type":"object"}')
    topics: dict[str, int] = {}
    for time, topic, message in _messages(recording):
        if topic not in topics:
            topics[topic] = writer.register_channel(topic, "json", schema)
        stamp = START + (number - 1) * APART + round(time * 1e9)
        writer.add_message(topics[topic], stamp, json.dumps(message).encode(), stamp)
    writer.finish()
    return file.getvalue()


def main(arguments: list[str] | None = None) -> int:
    """Record a robot into a folder, or play a gait on it; the exit status."""
    parser = argparse.ArgumentParser(description="Record a simulated quadruped with secret parameters.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--play", type=Path, metavar="CSV", help="a gait, played once on the same robot")
    parser.add_argument("--log", type=Path, metavar="MCAP", help="the new log of --play  [FOLDER/trial.mcap]")
    parser.add_argument("--secret", action="store_true", help="also print the robot's true parameters")
    given = parser.parse_args(arguments)
    try:
        if given.play is None:
            made = record(given.folder, seed=given.seed)
            _tell_recorded(given.folder, made)
            if given.secret:
                print(json.dumps(made.secret, indent=2))
        else:
            log = given.log or given.folder / "trial.mcap"
            _tell_played(log, *play(given.folder, given.play, seed=given.seed, log=log))
    except DynregError as problem:
        print(problem, file=sys.stderr)
        return problem.exit_status
    return 0


def _tell_recorded(folder: Path, made: HiddenQuadruped) -> None:
    print(f"{len(made.logs)} logs in {folder}; read them with")
    print(f"  dynreg ingest {folder}/run_*.mcap --robot quadruped --map {made.log_map} --name walker")


def _tell_played(log: Path, trial: RealTrial, cost: Spent) -> None:
    ahead, left = (float(way[0, 0]) for way in progress(trial.walk.base))
    (episode,) = trial.recording.episodes
    print(f"{'fell' if trial.fell else 'stood'} after {episode.duration:.1f} s")
    print(f"{ahead:.2f} m ahead, {left:.2f} m left")
    print(f"{cost.trials} trials and {cost.seconds:.1f} s that the robot has had; log: {log}")


if __name__ == "__main__":
    sys.exit(main())
