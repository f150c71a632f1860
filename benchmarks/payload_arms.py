"""Six-joint arms that carry something: the robot folder of one, and truths by MuJoCo's plain steps.

A truth shares with dynreg the text of the arm's links alone. Its drives, friction and rotors are written here: a
position servo whose torque is computed every 0.5 ms, Coulomb friction by a smooth law, RK4; the payload is a body
welded to the flange before the model is compiled.
"""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.rng import stream
from dynreg.sim.robot import Robot, load_robot

JOINTS = ("base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3")
# link by link: where it hangs [m], axis, mass [kg], centre [m], inertia of a rod or a can [kg m^2]; an arm of 18 kg
# that lifts 5 kg, of the usual build, with a vertical axis, two parallel ones and a wrist of three
LINKS = (
    ((0, 0, 0.16), (0, 0, 1), 3.8, (0, -0.02, 0.0), (0.011, 0.011, 0.009)),
    ((0, -0.13, 0), (0, 1, 0), 8.1, (0, 0, 0.21), (0.13, 0.13, 0.015)),
    ((0, 0.12, 0.425), (0, 1, 0), 2.9, (0, 0, 0.19), (0.032, 0.032, 0.004)),
    ((0, 0, 0.392), (0, 1, 0), 1.4, (0, -0.11, 0), (0.0028, 0.0021, 0.0026)),
    ((0, -0.13, 0), (0, 0, 1), 1.3, (0, 0, 0.09), (0.0024, 0.0024, 0.0018)),
    ((0, 0, 0.1), (0, 1, 0), 0.37, (0, -0.07, 0), (0.0003, 0.0003, 0.0002)),
)
FLANGE = (0, -0.1, 0)
REST = (0.0, 0.6, 1.1, -0.5, 0.4, 0.0)
GAIN = (2500.0, 2500.0, 1200.0, 350.0, 300.0, 250.0)  # N m/rad on the nameplate
RATE_GAIN = (250.0, 250.0, 110.0, 25.0, 20.0, 14.0)  # N m s/rad
LIMIT = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)  # N m
COULOMB = (6.0, 6.0, 4.0, 1.2, 1.2, 1.0)  # N m
VISCOUS = (6.0, 6.0, 4.0, 1.0, 1.0, 0.8)  # N m s/rad
ROTOR = (0.9, 0.9, 0.5, 0.12, 0.12, 0.1)  # kg m^2 at the joint
SPREAD = 2.0  # factor either way within which frictions and rotors of an arm lie, log-uniform: unknown to the diagnosis
GAINS = 1.25  # likewise of its gains
RATE, STEP, FINE = 50.0, 0.002, 0.0005  # Hz of commands; s of the model's time step; s of the truth's
NOISE, SPEED_NOISE = 0.0002, 0.005  # rad of the encoders, rad/s of what the controller says of speeds
SLOPE = 0.01  # rad/s at which the smooth Coulomb friction reaches 76 % of its level
EPISODE, EPISODES = 4.0, 9  # s and number of episodes of a log
TESTS = ("test_7", "test_8")


@dataclass(frozen=True)
class Arm:
    """A hidden arm: kilograms at its flange, and factors (6,) on what the nameplate says of each joint."""

    seed: int
    payload: float
    coulomb: np.ndarray
    viscous: np.ndarray
    rotor: np.ndarray
    gain: np.ndarray


def drawn(seed: int, least: float, most: float) -> Arm:
    """The arm of a seed, with a payload between `least` and `most` kg."""
    rng = stream(seed, "arm with a payload")
    factor = lambda spread: spread ** rng.uniform(-1.0, 1.0, len(JOINTS))  # noqa: E731
    load = float(rng.uniform(least, most))
    return Arm(seed, load, factor(SPREAD), factor(SPREAD), factor(SPREAD), factor(GAINS))


def mjcf(payload: float = 0.0, rotor: np.ndarray | None = None, actuators: bool = True) -> str:
    """The arm's model; a payload is a ball of that mass about the flange."""
    rotor = np.array(ROTOR) if rotor is None else rotor
    text, close = [], ""
    for name, armature, (at, axis, mass, centre, inertia) in zip(JOINTS, rotor, LINKS, strict=True):
        text.append(
            f'<body name="{name}_link" pos="{_row(at)}"><joint name="{name}" axis="{_row(axis)}" '
            f'armature="{float(armature)!r}"/><inertial mass="{mass}" pos="{_row(centre)}" '
            f'diaginertia="{_row(inertia)}"/>'
        )
        close += "</body>"
    if payload:
        text.append(
            f'<body pos="{_row(FLANGE)}"><geom type="sphere" size="0.005" mass="{payload!r}"/></body>'
        )
    site = f'<site name="flange" pos="{_row(FLANGE)}"/>'
    motors = "".join(f'<position name="{j}" joint="{j}"/>' for j in JOINTS) if actuators else ""
    held = f' ctrl="{_row(REST)}"' if actuators else ""
    key = f'<keyframe><key name="rest" qpos="{_row(REST)}"{held}/></keyframe>'
    return (
        f'<mujoco model="six_joint_arm"><option timestep="{STEP}"/>'
        f'<default><geom contype="0" conaffinity="0"/></default>'
        f"<worldbody>{''.join(text)}{site}{close}</worldbody><actuator>{motors}</actuator>{key}</mujoco>"
    )


def folder(path: Path) -> Robot:
    """The robot folder of the arm, written to `path`: frictions, gains and rotors are not told by the nameplate."""
    path.mkdir(parents=True, exist_ok=True)
    (path / "model.xml").write_text(mjcf(), encoding="utf-8")
    lines = [
        "[robot]",
        'name = "payload_arm"',
        'engines = ["mujoco"]',
        f"control_rate = {RATE}",
        f"timestep = {STEP}",
        'tools = ["flange"]',
        "[reset]",
        'keyframe = "rest"',
        "[excitation]",
        "amplitude = 0.5",
    ]
    for i, joint in enumerate(JOINTS):
        lines += [
            "[[drives]]",
            f'joint = "{joint}"',
            'type = "position"',
            f"gain = {GAIN[i]}",
            f"rate_gain = {RATE_GAIN[i]}",
            f"torque_limit = {LIMIT[i]}",
        ]
    for i, joint in enumerate(JOINTS):
        lines += [
            "[[actions]]",
            f'name = "{joint}/target"',
            'unit = "rad"',
            f"low = {REST[i] - 1.2}",
            f"high = {REST[i] + 1.2}",
        ]
    for kind, unit, noise, weight in (
        ("position", "rad", NOISE, 1.0),
        ("velocity", "rad/s", SPEED_NOISE, 0.0),
    ):
        for joint in JOINTS:
            lines += ["[[channels]]", f'name = "{joint}/{kind}"', f'unit = "{unit}"']
            lines += [f"noise = {noise}", f"weight = {weight}"]
    for i, joint in enumerate(JOINTS):
        for name, unit, value, factor, sets in (
            ("coulomb", "N*m", COULOMB[i], 1.6 * SPREAD, f"port.friction.coulomb[{joint}] ="),
            ("viscous", "N*m*s/rad", VISCOUS[i], 1.6 * SPREAD, f"port.friction.viscous[{joint}] ="),
            ("rotor", "kg*m^2", ROTOR[i], 1.6 * SPREAD, f"mj.dof_armature[{joint}] ="),
            ("gain", "1", 1.0, 1.3 * GAINS, f"port.drive.gain[{joint}] *="),
        ):
            lines += [
                "[[parameters]]",
                f'name = "{joint}_{name}"',
                f'unit = "{unit}"',
                f"nominal = {value}",
                f"low = {value / factor:.6g}",
                f"high = {value * factor:.6g}",
                'scale = "log"',
                f'sets = ["{sets}"]',
            ]
    (path / "robot.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return load_robot(path)


def log_of(arm: Arm) -> Recording:
    """What an arm logs: slow and fast motions of all joints together, each twice, then others to test."""
    model = mujoco.MjModel.from_xml_string(mjcf(arm.payload, np.array(ROTOR) * arm.rotor, actuators=False))
    model.opt.timestep, model.opt.integrator = FINE, mujoco.mjtIntegrator.mjINT_RK4
    rng = stream(arm.seed, "arm's log")
    episodes = []
    for number in range(EPISODES):
        told = _commands(number)
        moved = _moved(model, arm, told)
        moved = moved + np.repeat([NOISE, SPEED_NOISE], len(JOINTS)) * rng.standard_normal(moved.shape)
        name = f"test_{number}" if number >= EPISODES - len(TESTS) else f"run_{number}"
        episodes.append(Episode(name, np.arange(len(told)) / RATE, np.concatenate([moved, told], axis=1), {}))
    kinds = (("position", "rad"), ("velocity", "rad/s"), ("target", "rad"))
    channels = [Channel(f"{joint}/{kind}", unit) for kind, unit in kinds for joint in JOINTS]
    return Recording(tuple(channels), tuple(episodes), measured=False)


def _commands(number: int) -> np.ndarray:
    """(T, 6) targets of an episode: sums of sines from rest, the same for all arms."""
    rng = stream(number, "arm's commands")
    time = np.arange(round(EPISODE * RATE)) / RATE
    out = np.tile(np.array(REST), (len(time), 1))
    for j in range(len(JOINTS)):
        for _ in range(3):
            rate, phase = rng.uniform(0.15, 1.2), rng.uniform(0, 2 * np.pi)
            size = rng.uniform(0.15, 0.45) * min(1.0, 0.4 / rate)
            out[:, j] += size * (np.sin(2 * np.pi * rate * time + phase) - np.sin(phase))
    return out


def _moved(model: mujoco.MjModel, arm: Arm, told: np.ndarray) -> np.ndarray:
    """(T, 12) positions and speeds at the times of the commands; each is held until the next."""
    data = mujoco.MjData(model)
    gain, rate_gain = np.array(GAIN) * arm.gain, np.array(RATE_GAIN)
    coulomb, viscous, limit = (
        np.array(COULOMB) * arm.coulomb,
        np.array(VISCOUS) * arm.viscous,
        np.array(LIMIT),
    )
    out, substeps = np.empty((len(told), 2 * len(JOINTS))), round(1 / (RATE * FINE))

    def hold(target: np.ndarray, steps: int) -> None:
        for _ in range(steps):
            q, v = data.qpos, data.qvel
            drive = np.clip(gain * (target - q) - rate_gain * v, -limit, limit)
            data.qfrc_applied[:] = drive - coulomb * np.tanh(v / SLOPE) - viscous * v
            mujoco.mj_step(model, data)

    data.qpos[:] = REST
    hold(told[0], round(1.5 / FINE))
    for i, target in enumerate(told):
        out[i] = np.concatenate([data.qpos, data.qvel])
        hold(target, substeps)
    return out


def _row(numbers) -> str:
    return " ".join(repr(float(n)) for n in numbers)
