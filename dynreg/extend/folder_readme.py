"""The README.md of an exported simulator: what each of its effects became."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynreg.data.units import suffix
from dynreg.extend.carry import Carrier, carries
from dynreg.extend.plain import held_for
from dynreg.sim.effects import Term, unit_of
from dynreg.sim.layout import layout_of
from dynreg.sim.ports import Ports, servo_law
from dynreg.sim.robot import Robot
from dynreg.sim.sets import is_limit

PLAIN = "mujoco.xml"
ELSE = "mujoco_corrected.xml"


def plain_name(robot: Robot) -> str:
    """The name of the file for MuJoCo alone: another where the robot's own model has the usual one."""
    return ELSE if Path(robot.file.robot.model).name == PLAIN else PLAIN


@dataclass(frozen=True)
class Written:
    """One effect of an exported simulator.

    parameters : those of robot.toml that stand for it. in_mjcf : whether the plain MJCF has it.
    """

    term: Term
    values: np.ndarray
    parameters: tuple[Carrier, ...] = ()
    in_mjcf: bool = False


def readme(robot: Robot, ports: Ports, identity: str, effects: Sequence[Written], problem: str | None) -> str:
    """The text; ports, identity : of the simulator. problem : why there is no plain MJCF."""
    lines = [f"# {robot.name}, simulator {identity[:12]}", ""]
    lines += [
        f"A simulator of `{robot.name}` as a robot folder. `robot.toml` has its parameters as nominal values:",
        "check it with `dynreg robots check FOLDER`, vary it with `dynreg populate FOLDER -n 1000`.",
        "",
        *_about_mjcf(robot, ports, problem),
        "",
    ]
    if effects:
        plain = plain_name(robot)
        lines += ["## Effects", "", f"| effect | values | robot.toml | {plain} |", "|---|---|---|---|"]
        lines += [_row(one, robot) for one in effects]
        lines += ["", "Their parameters in `robot.toml` range from none of the effect to twice as much."]
    missing = [one for one in effects if not one.parameters or not (one.in_mjcf or problem)]
    if missing:
        lines += ["", "## What is not in both files", ""]
        if any(not one.parameters and not one.in_mjcf for one in missing):
            lines += [
                "What is in neither, this robot does not have. The simulator in the registry has it.",
                "",
            ]
        for one in missing:
            where = _where(one, plain_name(robot))
            lines += [f"- **{one.term.key}** ({where}): {_means(one, plain_name(robot))}"]
    return "\n".join(lines) + "\n"


def _about_mjcf(robot: Robot, ports: Ports, problem: str | None) -> list[str]:
    plain, model = plain_name(robot), Path(robot.file.robot.model).name
    lines = [
        f"`{model}` is the uncorrected model, as it was: `robot.toml` corrects it, and dynreg reads both."
    ]
    if problem:
        return [*lines, f"There is no `{plain}`: {problem}."]
    known = [*robot.file.settings, *robot.file.inputs]
    constants = [f"{k.name} = {_number(k.nominal, k.unit)}" for k in known]
    lines = [
        f"**In plain MuJoCo open `{plain}`, not `{model}`.** It is the corrected model, drives and friction included.",
        *_about_ctrl(robot, ports),
        *lines,
    ]
    if constants:
        lines.append(f"`{plain}` holds for {', '.join(constants)}; drives are always on.")
    left_out = _unsaid(robot, ports)
    if left_out:
        lines.append(f"`{plain}` leaves out what MJCF cannot say of the drives: {', '.join(left_out)}.")
    return lines


def _about_ctrl(robot: Robot, ports: Ports) -> list[str]:
    """Which numbers of `ctrl` take the commands, for how long, and what the others keep."""
    at = [int(number) for number in layout_of(robot).action_actuator]
    held = held_for(ports)
    each = ", ".join(f"`ctrl[{number}]` takes {name}" for number, name in zip(at, robot.actions, strict=True))
    out = [f"{each}{f', held for {held:g} s each' if held else ''}."]
    if at != [*range(len(at))]:
        out.append(f"`data.ctrl[{at}] = commands` sets them in the order of `robot.toml`.")
    others = [number for number in range(robot.model.nu) if number not in at]
    if others:
        named = [robot.model.actuator(number).name for number in others]
        told = (f"`ctrl[{n}]`{f' ({name})' if name else ''}" for n, name in zip(others, named, strict=True))
        key = robot.file.reset.keyframe
        kept = "0" if key is None else f"the value of keyframe `{key}`"
        out.append(f"No command sets {', '.join(told)}: keep {kept} there.")
    return out


def _unsaid(robot: Robot, ports: Ports) -> list[str]:
    """What the simulator's drives do and no MJCF says, with the joints.

    It is torque that fades, profiles of targets, integral parts, and of commands the largest step, noise and clock.
    """
    fading = servo_law(ports, robot.input_defaults[None]).fade[0] > 0
    moving = is_limit(np.minimum(ports.drive["profile_speed"], ports.drive["profile_acceleration"])[0])
    integrating = ports.drive["integral_gain"][0] > 0
    means = (
        ("torque that falls with speed (`speed_limit`)", fading),
        ("`profile_speed`", moving),
        ("the integral part (`integral_gain`)", integrating),
    )
    out = [f"{what} of {', '.join(np.array(ports.joints)[at])}" for what, at in means if at.any()]
    step = ports.control["max_step"][0]
    if np.isfinite(step):
        out.append(f"that a command moves by {step:.6g} at most from the one before (`max_step`)")
    noise, clock = (float(ports.control[key][0]) for key in ("noise", "clock"))
    if noise:
        out.append(f"noise on each command, of standard deviation {noise:.6g} (`noise`)")
    if clock != 1.0:
        out.append(f"that a log of the robot counts 1 s in {clock:.6g} s (`clock`)")
    return out


def _row(one: Written, robot: Robot) -> str:
    values = ", ".join(
        f"{p.name} = {_number(v, unit_of(robot, one.term, p))}"
        for p, v in zip(one.term.effect.parameters, one.values, strict=True)
    )
    parameters = ", ".join(f"`{c.name}`" for c in one.parameters) or "no"
    return f"| {one.term.key} | {values} | {parameters} | {'yes' if one.in_mjcf else 'no'} |"


def _number(value: float, unit: str) -> str:
    return f"{value:.6g}{suffix(unit)}"


def _where(one: Written, plain: str) -> str:
    if one.parameters:
        return f"not in {plain}"
    return "not in robot.toml" if one.in_mjcf else "in neither"


def _means(one: Written, plain: str) -> str:
    """What the effect does, in the words of its class, and why it is missing where that can be mended."""
    said = " ".join((type(one.term.effect).__doc__ or one.term.effect.title).split())
    if carries(one.term.effect) and not one.parameters:
        said += " It changes elements of the model that have no name: name them, and robot.toml can have it."
    if one.term.effect.id == "command_lag" and not one.in_mjcf:
        said += " An actuator here smooths its commands already, and MJCF has one filter for each."
    if any(entry.startswith("port.sensor") for c in one.parameters for entry in c.sets):
        said += f" In {plain} the drives feel it, and `qpos` is the truth."
    if one.in_mjcf and one.term.effect.id == "command_delay":
        said += (
            f" In {plain} the commands before the first one are 0. To begin in a pose, tell each late actuator of it"
            " after a reset: `mujoco.mj_initCtrlHistory(model, data, ACTUATOR, None, np.full((SAMPLES, 1), POSE))`,"
            " with ACTUATOR = its number in `ctrl` and SAMPLES = `model.actuator_history[ACTUATOR, 0]`."
        )
    return said
