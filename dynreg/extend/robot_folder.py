"""An extended simulator as a robot folder: robot.toml with its parameters and effects, one plain MJCF, a README."""

import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path

import numpy as np

from dynreg.errors import DynregError, RobotError, UsageError
from dynreg.extend.carry import SPREAD, Carrier, Fields, carriers, carries
from dynreg.extend.folder_readme import Written, plain_name, readme
from dynreg.extend.plain import says, write_mjcf
from dynreg.folder import TOML
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.effects import Terms
from dynreg.sim.engines import rollout
from dynreg.sim.engines.acting import acting
from dynreg.sim.excitation import excitation
from dynreg.sim.lint import FAR
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.space import Parameter
from dynreg.tomlfile import line_of, literal, toml_text

TRIED = 4  # episodes in which a parameter must change something,
IDLE = 1e-9  # of what a channel reaches


@dataclass(frozen=True)
class Exported:
    """A robot folder that was written, and where each effect is in it. problem : why there is no plain MJCF."""

    robot: Robot
    effects: tuple[Written, ...]
    problem: str | None = None


def export_robot(robot: Robot, config: SimConfig, destination: Path, identity: str | None = None) -> Exported:
    """Write a simulator of `robot` as a new robot folder.

    identity : the id by which a registry knows the simulator, for its name and its README; by default the hash of what
    it is, where no registry holds it.
    Its robot.toml has the simulator's parameters as nominal values, and for each effect that acts before anything
    moves a parameter that does the same; `mujoco.xml` is the whole for MuJoCo alone (see `plain_name`); README.md tells
    what each effect became. Everything else is copied, the uncorrected model too.
    Raises UsageError where `destination` exists or an effect cannot act on the robot, RobotError where the parameters
    of robot.toml cannot be replaced.
    """
    destination = Path(destination)
    if destination.exists() or not destination.absolute().parent.is_dir():
        raise UsageError(
            f"cannot write a robot folder to {str(destination)!r}",
            expected="a name that is not taken, in a folder that is there",
            do="name another one",
        )
    terms, values = terms_of(config, robot), robot.space.from_dict(dict(config.values))
    acting(robot, terms)  # refuses what cannot act on this robot
    destination.mkdir()
    try:
        written = _write(robot, identity or config.id, values, terms, destination)
    except BaseException:
        shutil.rmtree(destination, ignore_errors=True)
        raise
    return Exported(load_robot(destination), *written)


def _write(
    robot: Robot, identity: str, values: np.ndarray, terms: Terms, folder: Path
) -> tuple[tuple[Written, ...], str | None]:
    robot.files.write(folder)
    problem = None
    try:
        write_mjcf(robot, values, terms, (folder / robot.file.robot.model).with_name(plain_name(robot)))
    except DynregError as error:
        problem = error.problem
    effects = _carried(robot, values, terms, problem is None)
    effects = _without_idle(_with_toml(robot, identity, values, effects, folder), effects)
    _with_toml(robot, identity, values, effects, folder)
    text = readme(robot, Fields.of(robot, values).ports, identity, effects, problem)
    (folder / "README.md").write_text(text, encoding="utf-8")
    return effects, problem


def _carried(robot: Robot, values: np.ndarray, terms: Terms, in_mjcf: bool) -> tuple[Written, ...]:
    """Where each effect goes."""
    fields, out = Fields.of(robot, values), []
    taken = {*robot.space.names, *robot.settings}
    for term, rows in zip(terms.terms, terms.values, strict=True):
        made = []
        for one in (carriers(fields, term, rows[0]) if carries(term.effect) else None) or ():
            numbered = (f"{one.name}_{number}" for number in count(2))
            name = next(n for n in chain([one.name], numbered) if n not in taken)
            made.append(replace(one, name=name))
            taken.add(name)
        told = in_mjcf and term.effect.acts_on != "sensor" and (carries(term.effect) or says(robot, term))
        out.append(Written(term, rows[0], tuple(made), told))
    return tuple(out)


def _without_idle(made: Robot, effects: tuple[Written, ...]) -> tuple[Written, ...]:
    """Parameters that change nothing beside others of the same effect left out (inertia about an axis that stands)."""
    several = [one for effect in effects if len(effect.parameters) > 1 for one in effect.parameters]
    if not several or made.file.robot.control_rate is None:
        return effects
    values = np.tile(made.space.nominal, (1 + len(several), 1))
    for row, one in enumerate(several, start=1):
        values[row, made.space.names.index(one.name)] = one.neutral
    states = rollout(made, values, excitation(made, seed=0, episodes=TRIED)).states
    moved = np.abs(states[1:] - states[:1]).max(axis=(1, 2)) > IDLE * np.abs(states[:1]).max(axis=(1, 2))
    idle = {one.name for one, yes in zip(several, moved.any(axis=1), strict=True) if not yes}
    return tuple(
        replace(e, parameters=tuple(one for one in e.parameters if one.name not in idle)) for e in effects
    )


def _with_toml(
    robot: Robot, identity: str, values: np.ndarray, effects: tuple[Written, ...], folder: Path
) -> Robot:
    """Write robot.toml and read it again; RobotError where it is not what was to be written."""
    added = [one for effect in effects for one in effect.parameters]
    (folder / TOML).write_text(_toml(robot, identity, values, added), encoding="utf-8")
    made = load_robot(folder)
    if not np.array_equal(made.space.nominal, [*values, *(one.value for one in added)]):
        raise RobotError(
            f"{robot.folder / TOML}: the nominal values could not be replaced",
            expected="a [[parameters]] table for each parameter, with `nominal = NUMBER` on a line of its own",
            do="write them so",
        )
    return made


def _toml(robot: Robot, identity: str, values: np.ndarray, added: Sequence[Carrier]) -> str:
    """robot.toml with other nominal values, the simulator's name, and a parameter for each carrier at its end."""
    text = toml_text(robot.files.files[TOML], TOML, RobotError)
    lines = text.splitlines()
    for i, (p, value) in enumerate(zip(robot.space.parameters, values, strict=True)):
        _replace(lines, line_of(text, ("parameters", i, "nominal")), "nominal", repr(float(value)))
        sure = _tolerance(p, float(value))
        if sure is not None:
            _replace(lines, line_of(text, ("parameters", i, "tolerance")), "tolerance", f"{sure:.3g}")
    name = f"{robot.name}_{identity[:8]}"
    _replace(lines, line_of(text, ("robot", "name")), "name", literal(name))
    for one in added:
        lines += ["", "[[parameters]]", f"name = {literal(one.name)}", f"unit = {literal(one.unit)}"]
        lines += [f"nominal = {one.value!r}", f"low = {one.low!r}", f"high = {one.high!r}"]
        reach = max(one.high - one.value, one.value - one.low) / (abs(one.value) or one.high - one.low)
        lines += [f"tolerance = {max(SPREAD, 1.01 * reach / FAR):.3g}", f"sets = {literal(one.sets)}"]
    return "\n".join(lines) + "\n"


def _tolerance(p: Parameter, value: float) -> float | None:
    """The tolerance of a parameter about another nominal value; None where it may stay.

    It is relative to the nominal value. In the parameter's unit it becomes what it was and how far the value has moved:
    a value beyond its tolerance shows that this was too narrow, and a range about the old value must stay in reach.
    """
    if p.known or value == p.nominal or not np.isfinite(p.tolerance):
        return None
    if p.scale == "log":
        return p.tolerance + abs(np.log(value / p.nominal))
    unit = abs(p.nominal) or p.high - p.low
    return (p.tolerance * unit + abs(value - p.nominal)) / (abs(value) or p.high - p.low)


def _replace(lines: list[str], number: int, key: str, value: str) -> None:
    """Put `key = value` in line `number` (from 1); what stands behind stays."""
    pattern = rf"(\b{key}\s*=\s*)(\"[^\"]*\"|'[^']*'|[^\s,#}}]+)"
    lines[number - 1] = re.sub(pattern, lambda m: m[1] + value, lines[number - 1], count=1)
