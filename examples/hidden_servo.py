"""A servo bench whose parameters are secret, recorded to MCAP as a robot would be.

It is `servo_pendulum` with parameters drawn by a seed, on MuJoCo's own constraint solver with a time step of
0.5 ms (the registry's simulators use the joint engine and 2 ms), seen through a noisy and quantised encoder
and a coarse supply reading. Sixteen runs as on the real XL330 bench: gains 100, 200, 400 and 800, each with
sines, a sweep, steps and a lift that ends with the torque off. With `load_friction` its gear has dry friction in
proportion to the load, which no simulator of the registry has.

    python examples/hidden_servo.py FOLDER --seed 7 --load-friction 0.15
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynreg.rng import stream
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

MAP = Path(__file__).parent / "maps" / "joint_states.toml"
GAINS = (100.0, 200.0, 400.0, 800.0)
TIMESTEP = 0.0005  # [s] of the physics
PERIOD = 0.005  # [s] of commands and readings
START = 1_700_000_000_000_000_000  # [ns] first stamp
Command = tuple[np.ndarray, np.ndarray]  # target [rad] and torque enabled, (T,) each


@dataclass(frozen=True)
class HiddenServo:
    """What was recorded: the logs, the map that reads them, and the secret (never shown to dynreg)."""

    logs: tuple[Path, ...]
    log_map: Path
    secret: dict[str, float]


def record(
    folder: Path, *, seed: int = 7, seconds: float = 6.0, load_friction: float | None = None
) -> HiddenServo:
    """Draw a servo, drive it through the sixteen runs of `seconds` [s] and write one MCAP file a run.

    load_friction : dry friction as a share of the torque that the gear transmits; None for none. Where it is given, the
    parameters are drawn from the nameplate, as far off as its tolerances say; else from their ranges.
    """
    robot = load_robot("servo_pendulum")
    rng = stream(seed, "hidden_servo", "parameters")
    if load_friction is None:
        values = robot.space.from_unit(rng.uniform(0.15, 0.85, len(robot.space)))
    else:
        values = _of_nameplate(robot, rng)
    time = np.arange(0.0, seconds, PERIOD)
    runs = [(f"{name}_kp{gain:.0f}", gain, c) for gain in GAINS for name, c in commands(time, seed).items()]
    supply = stream(seed, "hidden_servo", "supply").uniform(7.2, 7.6, len(runs))
    lacking = (
        None if load_friction is None else Terms((term("load_friction"),), (np.array([[load_friction]]),))
    )
    moved = [c for _, _, c in runs], [gain for _, gain, _ in runs]
    states = _simulate(robot, values, *moved, supply, lacking)
    folder.mkdir(parents=True, exist_ok=True)
    logs = []
    for (name, _, command), moved, volts in zip(runs, states, supply, strict=True):
        logs.append(folder / f"{name}.mcap")
        seen = _seen(robot, moved, volts, stream(seed, "hidden_servo", "noise", name))
        _write(logs[-1], time, command, *seen)
    return HiddenServo(tuple(logs), MAP, robot.space.as_dict(values))


def _of_nameplate(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """(P,) parameters as far from their nominal values as a nameplate's tolerances say."""
    drawn = rng.standard_normal(len(robot.space))
    return np.array(
        [
            np.clip(p.nominal + p.tolerance * (abs(p.nominal) or p.high - p.low) * z, p.low, p.high)
            for p, z in zip(robot.space.parameters, drawn, strict=True)
        ]
    )


def commands(time: np.ndarray, seed: int = 7) -> dict[str, Command]:
    """The bench's four trajectories at times (T,) [s]."""
    on, phase = np.ones_like(time), time / time[-1]
    levels = stream(seed, "hidden_servo", "steps").uniform(-1.5, 1.5, 1 + int(time[-1] / 0.6))
    lift = -1.57 * np.sin(0.5 * np.pi * np.clip(phase / 0.3, 0.0, 1.0)) ** 2
    return {
        "sines": (1.1 * np.sin(1.4 * time) + 0.5 * np.sin(6.1 * time), on),
        "sweep": (np.sin(1.3 * time**2), on),
        "steps": (levels[(time / 0.6).astype(int)], on),
        "drop": (lift, (phase < 0.35).astype(float)),
    }


def _simulate(
    robot: Robot,
    values: np.ndarray,
    runs: list[Command],
    gains: list[float],
    supply: np.ndarray,
    effects: Terms | None,
) -> np.ndarray:
    """(E, T, S) true states of the runs, from rest."""
    finer = robot.file.robot.model_copy(update={"timestep": TIMESTEP})
    truth = replace(robot, file=robot.file.model_copy(update={"robot": finer}))
    targets, enabled = (np.array(part) for part in zip(*runs, strict=True))
    inputs = np.empty((*targets.shape, len(robot.inputs)))
    inputs[..., robot.inputs.index("supply")] = supply[:, None]
    inputs[..., robot.inputs.index("arm/enabled")] = enabled
    run = Run(
        targets[..., None],
        inputs=inputs,
        settings=np.stack([gains, np.zeros(len(runs))], axis=1),  # kp; no mass added
        initial=np.zeros((len(runs), len(robot.channels))),
        period=PERIOD,
    )
    return rollout(truth, values[None], run, engine="mujoco", terms=effects).states[0, :, :-1]


def _seen(
    robot: Robot, states: np.ndarray, volts: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """(T, S) states through the robot's sensors, and the supply as its 0.1 V reading (T,)."""
    seen = states.copy()
    for i, channel in enumerate(robot.file.channels):
        noisy = states[:, i] + channel.noise * rng.standard_normal(len(states))
        seen[:, i] = np.round(noisy / channel.quantum) * channel.quantum if channel.quantum else noisy
    return seen, np.round(volts + 0.05 * rng.standard_normal(len(states)), 1)


def _messages(command: Command, states: np.ndarray, volts: np.ndarray) -> Iterator[tuple[int, str, dict]]:
    """(row, topic, message): what such a bench publishes."""
    for row, (target, enabled) in enumerate(zip(*command, strict=True)):
        position, velocity = states[row].tolist()
        yield row, "/joint_states", {"name": ["arm"], "position": [position], "velocity": [velocity]}
        yield row, "/arm_controller/commands", {"data": [float(target)]}
        yield row, "/arm_controller/enabled", {"data": bool(enabled)}
        yield row, "/battery", {"voltage": float(volts[row])}


def _write(path: Path, time: np.ndarray, command: Command, states: np.ndarray, volts: np.ndarray) -> None:
    from mcap.writer import Writer

    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="hidden_servo")
        schema = writer.register_schema("object", "jsonschema", b'{"type":"object"}')
        topics: dict[str, int] = {}
        for row, topic, message in _messages(command, states, volts):
            if topic not in topics:
                topics[topic] = writer.register_channel(topic, "json", schema)
            stamp = START + round(time[row] * 1e9)
            writer.add_message(topics[topic], stamp, json.dumps(message).encode(), stamp)
        writer.finish()


def main() -> None:
    """Record one servo into a folder and print its secret."""
    parser = argparse.ArgumentParser(description="Record a simulated servo bench with secret parameters.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--load-friction", type=float, help="friction as a share of the gear's torque")
    given = parser.parse_args()
    made = record(given.folder, seed=given.seed, load_friction=given.load_friction)
    print(f"{len(made.logs)} logs in {given.folder}; read them with --map {made.log_map}")
    print(json.dumps(made.secret, indent=2))


if __name__ == "__main__":
    main()
