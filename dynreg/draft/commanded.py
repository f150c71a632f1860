"""What the commands of a log are: positions to go to, or torques, or none that are recognised; and in which scale."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from dynreg.data.drafting import Draft, draft_map
from dynreg.data.names import joint_of
from dynreg.data.schema import RecordingSpec
from dynreg.data.series import RawLog
from dynreg.draft.drives import Drive, is_hinge
from dynreg.draft.entry import DriveKind, Notes, listed
from dynreg.draft.heard import Heard, Named, heard, spec_of
from dynreg.draft.tables import action_unit

HALF = 0.5  # share of the joints for which a log must tell the same
CLEARLY = (
    0.5  # of the error of scaled commands, below which that of plain ones tells that they are not scaled
)
BEYOND = 0.1  # of the range between a joint's stops, by which targets may lie beyond them


def commanded(model: mujoco.MjModel, drives: Sequence[Drive], log: RawLog) -> DriveKind | None:
    """The kind of drive that the log's commands are for, where that is not the kind of most drives; else None."""
    own = {d.kind for d in drives}
    joints, also = [d.joint for d in drives], called(drives)
    hinges = [is_hinge(model, model.joint(j).id) for j in joints]

    def named(quantity: str, turn: str, slide: str) -> list[Named]:
        return [(f"{j}/{quantity}", turn if h else slide) for j, h in zip(joints, hinges, strict=True)]

    positions, targets = named("position", "rad", "m"), named("target", "rad", "m")
    torques = named("torque", "N*m", "N")
    if own == {"torque"}:
        told = heard(draft_map(log, spec_of(model, positions, targets), also))
        follow = [told.follows(f"{j}/target", f"{j}/position") for j in joints]
        if _only_measured(draft_map(log, spec_of(model, positions, torques), also), torques) and all(
            _within_stops(model, j, told) for j in joints
        ):
            return "position"
        return "position" if sum(follow) > HALF * len(joints) else None
    if own == {"position"} and all(d.guessed for d in drives):
        told = heard(draft_map(log, spec_of(model, positions, targets), also))
        if any(name in told.series for name, _ in targets):
            return None
        forces = heard(draft_map(log, spec_of(model, positions, torques), also))
        return "torque" if sum(name in forces.series for name, _ in torques) > HALF * len(joints) else None
    return None


def as_told(model: mujoco.MjModel, drives: Sequence[Drive], log: RawLog, notes: Notes) -> tuple[Drive, ...]:
    """The drives, with a scale of 1 where the joint follows the log's commands as they are.

    A log may hold what the joint is told, though the model's actuator takes other numbers, as one with a gear does.
    """
    scaled = [d for d in drives if d.scale != 1.0 or d.offset != 0.0]
    if not scaled:
        return tuple(drives)
    measured = [(f"{d.joint}/{what}", unit) for d in drives for what, unit in _motion(model, d).items()]
    spec = spec_of(model, measured, [(d.action, action_unit(model, d)) for d in drives])
    plain, control = heard(draft_map(log, spec, called(drives))), heard(map_of(log, spec, drives))
    kept = set()
    for drive in scaled:
        names = drive.action, f"{drive.joint}/{drive.kind}"
        errors = plain.missed(*names), control.missed(*names)
        if None not in errors and errors[0] < CLEARLY * errors[1]:
            kept.add(drive.joint)
    if kept:
        cases = listed([f"{d.joint}: {d.scale:g}" for d in scaled if d.joint in kept])
        notes.add(
            "joints follow the log's commands as they are, not scaled as controls of the model's actuators would be "
            f"({cases}): the map does not scale them"
        )
    return tuple(replace(d, scale=1.0, offset=0.0) if d.joint in kept else d for d in drives)


def called(drives: Sequence[Drive]) -> dict[str, str]:
    """{joint: the name of its actuator in the model}, of those that have one: a log may call its command so."""
    return {d.joint: d.actuator for d in drives if d.actuator}


def _motion(model: mujoco.MjModel, drive: Drive) -> dict[str, str]:
    """{quantity: unit} of what a drive moves."""
    way = "rad" if is_hinge(model, model.joint(drive.joint).id) else "m"
    return {"position": way, "velocity": f"{way}/s"}


def map_of(log: RawLog, spec: RecordingSpec, drives: Sequence[Drive]) -> Draft:
    """The map of a log whose commands are the controls of the model's actuators, whatever their numbers look like."""
    drafted = draft_map(log, spec, called(drives))
    units = {channel.name: channel.unit for channel in spec.channels}
    for drive in drives:
        if drive.scale != 1.0 or drive.offset != 0.0:
            keys = {"scale": drive.scale, "offset": drive.offset} if drive.offset else {"scale": drive.scale}
            note = "scale: the log holds the control of the model's actuator"
            drafted = drafted.changed(drive.action, note, unit=units[drive.action], **keys)
    return drafted


def say_no_command(draft: Draft, missing: Sequence[str], measured: Sequence[str], notes: Notes) -> None:
    """A note about a log in which these commands were not recognised: what else it holds, and what to do."""
    if not missing:
        return
    log = draft.log
    used = {str(source.keys.get("source")) for source in draft.sources.values()}
    first = sorted(log.sources, key=lambda name: name in used)  # what nothing took may be it
    held = listed([" ".join(name.split()) for name in first], most=12)
    looks = f" One looks like a measured torque ({listed(measured)})." if measured else ""
    left = [n for n in log.names if n not in (*log.sources, *log.labels, log.metadata.get("time_column"))]
    if left:
        names = listed([" ".join(name.split()) for name in left], most=12)
        looks += f" {names} could not be read as signals: `dynreg doctor LOG` says why."
    notes.add(
        f"no column of commands was recognised in the log (for {listed(missing)}). It holds {held}."
        f"{looks} Rename that of the commands, such as {joint_of(missing[0])}_cmd, and draft again with another --to, "
        f'or write source = "COLUMN" under {missing[0]} in the map'
    )


def _only_measured(draft: Draft, torques: Sequence[Named]) -> bool:
    """Whether the log has torques that were measured, and none that were commanded."""
    sources = [draft.sources[name] for name, _ in torques if name in draft.sources]
    return bool(sources) and all(source.measured for source in sources)


def _within_stops(model: mujoco.MjModel, joint: str, told: Heard) -> bool:
    """Whether the commands of a joint could be targets: within its stops, or up to 10 % of the range beyond."""
    if f"{joint}/target" not in told.series:
        return False
    number = model.joint(joint).id
    low, high = model.jnt_range[number] if model.jnt_limited[number] else (-2 * np.pi, 2 * np.pi)
    values = told.series[f"{joint}/target"].values
    beyond = BEYOND * (high - low)
    return bool(np.nanmin(values) >= low - beyond and np.nanmax(values) <= high + beyond)
