"""A robot simulated at its nominal values and at the ends of its ranges: what diverges, changes nothing, is coarse."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.names import joint_of
from dynreg.errors import DynregError
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import TYPICAL, bank_period, excitation, reset_pose
from dynreg.sim.finding import Said
from dynreg.sim.ports import ServoLaw, assigned, nominal_ports, servo_law, takes_positions
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, motor_noise
from dynreg.sim.stiff import StiffDrive, stiffest
from dynreg.tomlfile import Location

BUDGET = 300_000  # physics steps for one engine
EPISODES = 8
SAME = 1e-9  # of a channel's largest value: below it two rollouts are the same
HALVED = 0.25  # share of the motion that half the time step may change within SHORT
SHORT = 0.1  # [s]
STAND = 1.0  # [s]
FINER = (2, 4, 8)  # divisors of a time step that are tried where it is too long
STEP = ("robot", "timestep")


@dataclass(frozen=True)
class Coarse:
    """A time step that is too long: the channel [percent of its motion] that half of it changes, and what would do.

    would_do : a time step [s]; None where none of those that are tried does.
    """

    channel: str
    percent: float
    would_do: float | None


@dataclass(frozen=True)
class Tried:
    """What rollouts told: what keeps the robot from being used, and what will be in the way."""

    errors: tuple[Said, ...] = ()
    warnings: tuple[Said, ...] = ()


def try_out(robot: Robot, engine: str, *, whole: bool) -> Tried:
    """Roll out the nominal values, both ends of each parameter and of each setting, on one engine.

    whole : whether the robot has all that its robot.toml says; where not, what has no effect is no finding.
    """
    run = _bank(robot)
    places, labels, values = _ends(robot)
    try:
        ends = rollout(robot, values, _noisy(run, len(values)), engine=engine)
        standing = tuple(_standing(robot, engine))
    except DynregError as problem:
        return Tried(((("robot", "engines"), str(problem)),))
    stiff = stiff_drive(robot, engine)
    errors = list(_diverging(robot, places, labels, ends.states, stiff))
    if errors:
        return Tried((*errors, *standing))
    coarse = _coarse(robot, run, engine, ends.states[:1])
    warnings = [*_too_long(robot, coarse, stiff), *_sagging(robot, engine)]
    if whole:
        errors += [*_idle(robot, ends.states), *_idle_settings(robot, run, engine)]
        warnings += _still(robot, ends.states)
    return Tried((*errors, *standing), tuple(warnings))


def try_step(robot: Robot, engine: str) -> Coarse | None:
    """Whether the time step is too long for the nominal robot; None where it is not."""
    run = _bank(robot)
    states = _finer(robot, _noisy(run, 1), engine, 1)
    if np.isfinite(states).all():
        return _coarse(robot, run, engine, states)
    return Coarse(robot.channels[int((~np.isfinite(states)).any(axis=(0, 1, 2)).argmax())], np.inf, None)


def _bank(robot: Robot) -> Run:
    """The robot's own excitation, cut to the budget."""
    table, bank = robot.file.robot, robot.file.excitation
    episodes = min(bank.episodes, max(EPISODES, len(bank.kinds)))
    substeps = max(1.0, 1.0 / (table.timestep * (table.control_rate or TYPICAL)))
    rows = (2 * len(robot.space) + 1) * episodes * substeps
    steps = min(bank.steps, max(10, int(BUDGET / rows)))
    return excitation(robot, seed=0, name="check", episodes=episodes, steps=steps)


def _ends(robot: Robot) -> tuple[list[Location], list[str], np.ndarray]:
    """(places, labels, values) of the nominal robot and of each end of each parameter."""
    places: list[Location] = [STEP]
    labels, values = ["the nominal robot"], [robot.space.nominal]
    for i, p in enumerate(robot.space.parameters):
        for key, end in (("low", p.low), ("high", p.high)):
            places.append(("parameters", p.name, key))
            labels.append(f"parameter {p.name!r} at {end:g} {p.unit}")
            values.append(np.where(np.arange(len(robot.space)) == i, end, robot.space.nominal))
    return places, labels, np.array(values)


def _noisy(run: Run, simulators: int) -> Run:
    """The same motor noise for every simulator, so that they differ in their parameters alone."""
    steps, actions = run.actions.shape[-2:]
    noise = motor_noise(np.zeros(1, dtype=int), run.episodes, steps, actions)
    return replace(run, noise=np.repeat(noise, simulators, axis=0))


def _diverging(
    robot: Robot, places: list[Location], labels: list[str], states: np.ndarray, stiff: StiffDrive | None
) -> Iterator[Said]:
    for place, label, rows in zip(places, labels, states, strict=True):
        lost = ~np.isfinite(rows).all(axis=(0, 2))
        if lost.any():
            do = f"lower [robot] timestep (now {robot.file.robot.timestep:g} s), or correct masses, inertias, gains or "
            said = f"{do}the range" if stiff is None or place != STEP else str(stiff)
            yield place, f"{label} diverges at step {int(lost.argmax())}; {said}"


def _idle(robot: Robot, states: np.ndarray) -> Iterator[Said]:
    for i, parameter in enumerate(robot.space.parameters):
        if _same(states[1 + 2 * i], states[2 + 2 * i]):
            yield (
                ("parameters", parameter.name, "sets"),
                f"parameter {parameter.name!r} changes nothing between {parameter.low:g} and "
                f"{parameter.high:g} {parameter.unit}; correct its `sets`, or raise [excitation] amplitude",
            )


def _idle_settings(robot: Robot, run: Run, engine: str) -> Iterator[Said]:
    for k, setting in enumerate(robot.file.settings):
        ends = [min(setting.values, default=setting.nominal), max(setting.values, default=setting.nominal)]
        if ends[0] == ends[1]:
            continue
        states = []
        for end in ends:
            settings = np.where(np.arange(len(robot.settings)) == k, end, run.settings)
            changed = _noisy(replace(run, settings=settings), 1)
            states.append(rollout(robot, robot.space.nominal[None], changed, engine=engine).states)
        if not all(np.isfinite(s).all() for s in states):
            told = f"setting {setting.name!r} diverges within {ends}; correct its values or `sets`"
            yield ("settings", setting.name, "values"), told
        elif _same(*states):
            told = f"setting {setting.name!r} changes nothing within {ends}; correct its `sets`"
            yield ("settings", setting.name, "sets"), told


def _still(robot: Robot, states: np.ndarray) -> Iterator[Said]:
    """Channels that none of these rollouts moves by more than their sensor's noise."""
    moved = np.ptp(states, axis=2).max(axis=(0, 1))
    for channel, moves, noise in zip(robot.file.channels, moved, robot.sensor_noise, strict=True):
        if moves <= max(noise, SAME):
            yield (
                ("channels", channel.name, "name"),
                f"the excitation never moves channel {channel.name!r} (by {moves:.2g} {channel.unit} at most; its "
                f"noise is {noise:.2g}): its data tell nothing; raise [excitation] amplitude or steps, change its "
                "kinds, or leave the channel out",
            )


def _hold(robot: Robot, seconds: float) -> Run:
    steps = round(seconds * (robot.file.robot.control_rate or TYPICAL))
    return Run(np.tile(reset_pose(robot), (1, max(steps, 1), 1)), period=bank_period(robot))


def _standing(robot: Robot, engine: str) -> Iterator[Said]:
    if robot.file.fall is None:
        return
    hold = _hold(robot, STAND)
    if rollout(robot, robot.space.nominal[None], hold, engine=engine).fell[0, 0] <= hold.steps:
        yield (
            ("fall",),
            f"the nominal robot falls within {STAND:g} s of holding its reset pose; correct the keyframe, "
            "the drives or [fall]",
        )


def _sagging(robot: Robot, engine: str) -> Iterator[Said]:
    """Position servos whose largest torque does not hold the pose that episodes start from."""
    ports = nominal_ports(robot, 1)
    held = takes_positions(ports)
    if robot.planar or robot.floating or not held.any():
        return
    columns = {joint_of(name): i for i, name in enumerate(robot.channels) if name.endswith("/position")}
    hold = _hold(robot, STAND)
    states = rollout(robot, robot.space.nominal[None], hold, engine=engine).states[0, 0]
    law = _law(robot, hold)
    for a, (joint, action) in enumerate(zip(robot.joints, robot.file.actions, strict=True)):
        if not held[a] or joint not in columns or not np.isfinite(states[-1]).all():
            continue
        off = states[-1, columns[joint]] - hold.actions[0, -1, a]
        if abs(law.stiffness[0, a] * off) > law.limit[0, a]:
            yield (
                ("actions", action.name, "name"),
                f"the drive of {action.name!r} cannot hold its start: with its largest torque, "
                f"{law.limit[0, a]:.3g}, the joint is {abs(off):.2g} {action.unit} off after {STAND:g} s; raise the "
                "torque limit, lower the masses, or start elsewhere ([reset] keyframe)",
            )


def _too_long(robot: Robot, coarse: Coarse | None, stiff: StiffDrive | None) -> Iterator[Said]:
    """What half the time step changes, with the drive that may be why; a drive that swings, also where it hides it."""
    step, do = robot.file.robot.timestep, "lower it, or correct stiff gains and light links"
    if coarse is not None:
        do = f"lower it to {coarse.would_do:g}" if coarse.would_do else do if stiff is None else ""
        changes = f"half of it changes {coarse.channel!r} by {coarse.percent:.0f} % of its motion"
        why = "" if stiff is None else str(stiff)
        yield STEP, f"[robot] timestep {step:g} s is too long: {'; '.join(filter(None, (changes, do, why)))}"
    elif stiff is not None and stiff.explicit and stiff.ratio >= 1.0:
        yield STEP, f"[robot] timestep {step:g} s is too long: {stiff}"


def stiff_drive(robot: Robot, engine: str) -> StiffDrive | None:
    """The drive that the time step does not follow."""
    return (
        None
        if robot.planar or not robot.actions
        else stiffest(robot, _law(robot, _hold(robot, STAND)), engine)
    )


def _law(robot: Robot, hold: Run) -> ServoLaw:
    """(1, A) the law of the nominal robot's drives."""
    ports = nominal_ports(robot, 1)
    for assignment, values in assigned(robot, robot.space.nominal[None], hold):
        if assignment.root == "port" and not assignment.path.startswith("base"):
            ports.apply(assignment, values)
    return servo_law(ports, robot.input_defaults[None])


def _coarse(robot: Robot, run: Run, engine: str, coarse: np.ndarray) -> Coarse | None:
    """Whether half the time step gives another motion from the start (later, contacts and chaos part it)."""
    run = _begin(robot, _noisy(run, 1))
    fine = _finer(robot, run, engine, 2)
    channel, share = _changed(robot, coarse, fine)
    if channel is None:
        return None
    for finer in FINER:
        before, fine = fine, _finer(robot, run, engine, 2 * finer)
        if _changed(robot, before, fine)[0] is None:
            return Coarse(channel, share, robot.file.robot.timestep / finer)
    return Coarse(channel, share, None)


def _finer(robot: Robot, run: Run, engine: str, times: int) -> np.ndarray:
    """(1, E, T+1, S) states of the nominal robot with a time step so many times shorter."""
    return rollout(robot.stepped(times), robot.space.nominal[None], run, engine=engine).states


def _begin(robot: Robot, run: Run) -> Run:
    """What `_changed` looks at of a run: its first steps."""
    steps = _compared(robot)
    inputs = None if run.inputs is None else run.inputs[:, :steps]
    return replace(run, actions=run.actions[..., :steps, :], noise=run.noise[..., :steps, :], inputs=inputs)


def _compared(robot: Robot) -> int:
    """Steps for which two time steps are compared."""
    return max(3, round(SHORT * (robot.file.robot.control_rate or TYPICAL)))


def _changed(robot: Robot, coarse: np.ndarray, fine: np.ndarray) -> tuple[str | None, float]:
    """The channel that differs most between two time steps, None where none does by much; percent of its motion."""
    steps = _compared(robot)
    rates = np.array([c.unit.endswith("/s") for c in robot.file.channels])
    columns = np.flatnonzero(~rates) if not rates.all() else np.arange(len(rates))  # impacts shift rates
    before, after = (x[:, :, : steps + 1, columns] for x in (coarse, fine))
    motion = np.sqrt(((before - before[:, :, :1]) ** 2).mean(axis=(0, 1, 2)))
    change = np.sqrt(((after - before) ** 2).mean(axis=(0, 1, 2)))
    unseen = robot.sensor_noise[columns]  # what no log of the robot could show
    worst = int(np.argmax(change - HALVED * motion - unseen))
    share = 100 * change[worst] / max(motion[worst], 1e-12)
    small = change[worst] <= HALVED * motion[worst] + unseen[worst] + 1e-4 * np.abs(before).max()
    return (None if small else robot.channels[columns[worst]]), float(share)


def _same(first: np.ndarray, second: np.ndarray) -> bool:
    scale = np.maximum(np.abs(first), np.abs(second)).max(axis=tuple(range(first.ndim - 1)))
    return bool((np.abs(first - second) <= SAME * scale).all())
