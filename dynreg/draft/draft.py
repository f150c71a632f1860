"""A robot folder drafted from a model that others wrote, and from a log where there is one."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from dynreg.data.checks.clock import coarse
from dynreg.data.checks.commands import step_within
from dynreg.data.checks.counts import ASKED
from dynreg.data.drafting import Draft, draft_map
from dynreg.data.names import joint_of
from dynreg.data.series import RawLog
from dynreg.draft.actuators import put_drives
from dynreg.draft.base import with_base
from dynreg.draft.commanded import as_told, called, commanded, map_of, say_no_command
from dynreg.draft.contacts import without_self_contacts
from dynreg.draft.doubted import Doubted
from dynreg.draft.driven import check_gains, drives_of, say_limits
from dynreg.draft.drives import Drive, name_of
from dynreg.draft.entry import Drafted, DraftOptions, Entry, Notes, listed
from dynreg.draft.ground import add_ground, ground_of, standing_height
from dynreg.draft.heard import (
    MOST_CONTROL,
    Heard,
    heard,
    require_clocks,
    rounded_rate,
    sensed,
    spec_of,
    thinned,
)
from dynreg.draft.measured import (
    EFFORT,
    with_measured_gains,
    with_measured_limits,
    without_passed_ranges,
)
from dynreg.draft.opened import Opened, open_model, tools_among
from dynreg.draft.parameters import parameters, reasons
from dynreg.draft.passive import REASON, of_passive
from dynreg.draft.source import Source
from dynreg.draft.start import add_start
from dynreg.draft.tables import (
    Tables,
    action_tables,
    action_unit,
    channel_names,
    channel_tables,
    drive_tables,
    effort_unit,
    keyframe_of,
)
from dynreg.draft.text import toml_of
from dynreg.draft.trial import Make, with_engines, with_finer_step, with_sound_ranges, with_time_step
from dynreg.errors import RobotError
from dynreg.folder import TOML, Folder
from dynreg.sim.base import base_joint
from dynreg.sim.held import pose_of, scalar_joints
from dynreg.sim.masses import moving_sites
from dynreg.sim.mjcf import model_files, trust_model
from dynreg.sim.robot import Robot, robot_of

MODEL, MAP = "model.xml", "maps/log.toml"
ELSEWHERE = 0.1  # m by which a base may begin higher or lower than simulations do
RATES = (50.0, 100.0)  # Hz: of commands where no log tells, for arms and for robots that stand
LEGGED = 4  # drives, other than of wheels, from which on a robot with a free base is taken for one on legs
FALLEN = 0.4  # share of the height in which the base stands below which it has fallen
TILT = 1.0  # rad


def draft_robot(
    source: Source, name: str, options: DraftOptions, log: RawLog | None, notes: Notes
) -> Drafted:
    """A robot folder from a model, and what a log of the robot tells, in this process: see `apart.draft_apart`.

    Raises RobotError where the model cannot be read, or nothing in it can be driven; LogError for a log whose clock
    tells no rate.
    """
    options = with_base(source, options, log, notes)
    opened = open_model(source, options, notes)
    drives = _drives(opened, options, log, notes)
    if not drives:
        raise RobotError(
            f"{source.name} has no joint that can be driven",
            expected="a hinge or slide, with an actuator or without",
            do="give the whole robot's model",
        )
    base = base_joint(opened.compiled(), tuple(d.joint for d in drives))
    told = _heard(opened.compiled(), drives, base, log, notes)
    drives = with_measured_limits(with_measured_gains(drives, told, notes), told, options, notes)
    drives = without_passed_ranges(drives, told, notes)
    say_limits(opened.compiled(), drives, notes)
    if any(d.guessed for d in drives):
        notes.add("gains are guessed from inertia and weight; --kp and --kd state them, with another --to")
    put_drives(opened, drives)
    add_ground(opened, base, notes)
    without_self_contacts(opened, base, notes)
    add_start(opened, base, told)
    model = opened.compiled()
    head = _head(model, (name, source.name), base, drives, told, notes)
    longest = float(head.values["timestep"])
    head = with_time_step(opened, drives, head, notes)
    made = _settled(opened, _tables(opened.compiled(), drives, head, told, notes), longest, notes)
    return made if log is None else _with_map(made, drives, log)


def _drives(opened: Opened, options: DraftOptions, log: RawLog | None, notes: Notes) -> tuple[Drive, ...]:
    """The drives of the model, of another kind or scale where the log's commands are of another.

    Raises UsageError for a gain that no drive has.
    """
    quiet = Notes()
    drives = drives_of(opened, options, quiet)
    if log is not None and drives and options.drive is None:
        kind = commanded(opened.compiled(), drives, log)
        if kind is not None:
            notes.add(f"the log holds commands of {kind} drives: the robot gets such drives")
            quiet, options = Notes(), replace(options, drive=kind)
            drives = drives_of(opened, options, quiet)
    check_gains(drives, options, quiet)
    for line in quiet.lines:
        notes.add(line)
    return drives if log is None else as_told(opened.compiled(), drives, log, notes)


def _heard(
    model: mujoco.MjModel, drives: Sequence[Drive], base: int, log: RawLog | None, notes: Notes
) -> Heard | None:
    """What the log tells of the robot's channels and commands, and of torques that it measures besides.

    Raises LogError for a clock that tells no rate.
    """
    if log is None:
        return None
    channels = [(name, unit) for name, unit, _ in channel_names(model, base, logged=True)]
    actions = [(d.action, action_unit(model, d)) for d in drives]
    drafted = map_of(log, spec_of(model, channels, actions), drives)
    _say_ambiguous(drafted, notes)
    told, said = heard(drafted), dict(actions)
    efforts = [(f"{d.joint}/{EFFORT}", effort_unit(model, d)) for d in drives]
    beside = spec_of(model, [(name, unit) for name, unit in efforts if name not in said], ())
    measured = heard(draft_map(log, beside, called(drives))).series
    every = replace(told, series={**told.series, **measured})
    require_clocks(every, log)
    if rounded := coarse(every.series.values()):
        notes.add(
            f"{rounded.said}; {rounded.do}, and draft again with another --to: control_rate and noise are those of the "
            "stamps as they are"
        )
    missing = [name for name in said if name not in told.series]
    say_no_command(drafted, missing, [*measured], notes)
    if measured and len(missing) < len(said):
        joints = f"{len(measured)} {'joint' if len(measured) == 1 else 'joints'}"
        notes.add(f"the log measures the torque of {joints}: used to tell gains and limits, not as evidence")
    return every


def _say_ambiguous(drafted: Draft, notes: Notes) -> None:
    """Lines about channels and commands for which the log holds several signals, as where two robots are in it, and
    about a command that was guessed.
    """
    doubted = [name for name, source in drafted.sources.items() if source.ambiguous]
    if doubted:
        taken = " ".join(str(drafted.sources[doubted[0]].keys["source"]).split())
        notes.add(
            f"several signals of the log fit {listed(doubted)}: {taken} is taken for {doubted[0]}. The map lists the "
            "others as ambiguous"
        )
    if counts := [n for n, source in drafted.sources.items() if any(ASKED in note for note in source.notes)]:
        notes.add(
            f"{listed(counts)} go too far for radians: {ASKED} Set scale = ... (radians per count) in the map, and "
            "draft again from a log with columns in rad, for what is drafted here is of the numbers as they are"
        )
    for name, source in drafted.sources.items():
        if source.guessed:
            taken = " ".join(str(source.keys["source"]).split())
            notes.add(
                f"{taken} is taken for {name}, for nothing else in the log could be it: check that in the map"
            )


def _tables(
    model: mujoco.MjModel, drives: tuple[Drive, ...], head: Entry, told: Heard | None, notes: Notes
) -> Tables:
    """The tables of robot.toml below its `head`."""
    base = base_joint(model, tuple(d.joint for d in drives))
    key = keyframe_of(model)
    pose = pose_of(model, key)
    ground = ground_of(model, base, pose) if base >= 0 else None
    _say_what_is_left(model, base, notes)
    reset: dict[str, object] = {"keyframe": model.key(key).name} if key >= 0 else {}
    if base >= 0 and all(d.kind == "position" for d in drives):
        reset["settle"] = 0.3
    measured = base >= 0 and _places_base(model, base, told)
    if measured:
        reset["base"] = "measured"
    doubted = Doubted(model, drives, base >= 0, ground, _efforts(drives, told))
    passive = of_passive(doubted, notes)
    if base >= 0 and sum(d.kind != "velocity" for d in drives) >= LEGGED:
        notes.add(
            "how the robot walks is not drafted: write [gait] and [[tasks]] for dynreg gait. docs/gait.md explains "
            "them, with examples"
        )
    fall = None
    if base >= 0:
        values = {
            "tilt": TILT,
            "height": float(f"{max(FALLEN * standing_height(model, base, pose), 0.0):.2g}"),
        }
        fall = Entry(values, "rad and m; a guess")
    return Tables(
        robot=head,
        drives=drive_tables(model, drives),
        actions=tuple(
            _reached(entry, d, told) for entry, d in zip(action_tables(model, drives), drives, strict=True)
        ),
        channels=_channels(model, drives, base, pose, told, notes),
        parameters=(*parameters(doubted), *passive),
        reasons=(*reasons(doubted), *([REASON] if passive else [])),
        reset=Entry(reset) if reset else None,
        fall=fall,
        replay=_replay(base, drives, measured),
        excitation=_excitation(base, drives),
    )


def _efforts(drives: Sequence[Drive], told: Heard | None) -> dict[str, float]:
    """{joint: the largest torque of the log [N*m or N]}, of those whose torques it tells."""
    if told is None:
        return {}
    return {d.joint: most for d in drives if (most := told.largest(f"{d.joint}/{EFFORT}")) > 0}


def _reached(entry: Entry, drive: Drive, told: Heard | None) -> Entry:
    """An action with the range of the log, where it has none or a guessed one that the log goes beyond.

    Not a range that the model states: MuJoCo cuts commands there. Nor targets: those of populations keep to the joint.
    """
    if drive.kind == "position" or (not drive.usual and "high" in entry.values):
        return entry
    most = told.largest(entry.values["name"]) if told else 0.0
    if most <= max(entry.values.get("high", 0.0), -entry.values.get("low", 0.0)):
        return entry
    end = float(f"{1.2 * most:.2g}")
    return Entry({**entry.values, "low": -end, "high": end}, "1.2 times the largest of the log")


def _channels(
    model: mujoco.MjModel,
    drives: Sequence[Drive],
    base: int,
    pose: np.ndarray,
    told: Heard | None,
    notes: Notes,
) -> tuple[Entry, ...]:
    """The channels that the log holds, besides those of driven joints, which a robot must have."""
    names = channel_names(model, base, logged=told is not None)
    if told is None:
        return channel_tables(names, {})
    driven = {d.joint for d in drives}
    kept = [c for c in names if joint_of(c[0]) in driven or c[0] in told.series]
    usual = {name for name, _, _ in channel_names(model, base, logged=False)}
    gone = [name for name, _, _ in names if name in usual - {k for k, _, _ in kept}]
    if gone:
        notes.add(f"{len(gone)} channels are not in the log and left out ({listed(gone)})")
    high = f"{name_of(model, base)}/z" if base >= 0 else ""
    if high in told.series and _elsewhere(told.first(high), model, base, pose):
        if _places_base(model, base, told):
            notes.add(
                f"{high} is left out: its log begins at {told.first(high):.2g} m, where no foot is on the ground"
            )
            kept = [c for c in kept if c[0] != high]
        else:
            kept = [(name, unit, 0.0 if name == high else weight) for name, unit, weight in kept]
    seen = {n: sensed(told.series[n], u) for n, u, _ in kept if n in told.series}
    return channel_tables(kept, {n: s for n, s in seen.items() if s is not None})


def _places_base(model: mujoco.MjModel, base: int, told: Heard | None) -> bool:
    """Whether a log tells the attitude of a free base, with which replays can then begin anywhere."""
    joint = name_of(model, base)
    return told is not None and all(told.first(f"{joint}/{angle}") is not None for angle in ("roll", "pitch"))


def _elsewhere(height: float | None, model: mujoco.MjModel, base: int, pose: np.ndarray) -> bool:
    """Whether a base begins at another height [m] in the log than in simulations, which stand on the ground."""
    return height is not None and abs(height - standing_height(model, base, pose)) > ELSEWHERE


def _with_map(made: Drafted, drives: Sequence[Drive], log: RawLog) -> Drafted:
    """The draft with the map of its log."""
    spec = made.robot.recording_spec
    # ranges of commands do not say how far a joint turns, only stops do: units are then those that were heard
    spec = replace(spec, channels=tuple(replace(c, low=None, high=None) for c in spec.channels))
    drafted = map_of(log, spec, drives)
    return replace(made, files=made.files | {MAP: drafted.text.encode()}, map=MAP, missing=drafted.missing)


def _head(
    model: mujoco.MjModel,
    names: tuple[str, str],
    base: int,
    drives: Sequence[Drive],
    told: Heard | None,
    notes: Notes,
) -> Entry:
    name, source = names
    actions = [d.action for d in drives]
    heard_rate = told.rate(actions) if told else None
    rate = heard_rate or RATES[base >= 0]
    said = "control_rate: of the log's stamps" if heard_rate else "control_rate: a guess"
    logged = told.often(actions) if told else None
    if logged and (every := thinned(logged)) > 1:
        said += f", of which it takes one in {every}"
        whole = rounded_rate(logged)
        notes.add(
            f"the log has {whole:g} rows a second, and control_rate is {rate:g} Hz, which takes one in {every}: above "
            f"{MOST_CONTROL:g} Hz every answer is slow. To take all, set control_rate = {whole:g} in robot.toml, with "
            f"a timestep of at most {step_within(whole):g} s"
        )
    tools = tools_among(moving_sites(model))
    return Entry(
        {
            "name": name,
            "title": f"{name}, {len(drives)} drives" if len(drives) > 1 else f"{name}, one drive",
            "source": source,
            "model": MODEL,
            "engines": ["mujoco"],
            "control_rate": rate,
            "timestep": min(float(model.opt.timestep), 1.0 / rate, 0.05),
            **({"tools": tools} if tools else {}),
        },
        said,
    )


def _replay(base: int, drives: Sequence[Drive], measured: bool) -> Entry | None:
    if measured:
        return Entry({"horizon": 1.0}, "s; contacts make longer rollouts drift apart")
    if base >= 0:  # every window begins in the first pose: a log is one
        return None
    if any(d.kind in ("torque", "dcmotor") for d in drives):
        return Entry({"horizon": 0.5}, "s; without a servo longer rollouts drift apart")
    return Entry({"horizon": 2.0}, "s")


def _excitation(base: int, drives: Sequence[Drive]) -> Entry:
    kinds = ["walk", "levels", "gait", "chirp"] if base >= 0 else ["levels", "chirp", "walk", "triangle"]
    return Entry({"kinds": kinds, "amplitude": 0.1 if base >= 0 else 0.3})


def _say_what_is_left(model: mujoco.MjModel, base: int, notes: Notes) -> None:
    """Lines about parts of the model that channels and parameters do not cover."""
    kinds = mujoco.mjtJoint
    balls = [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] == kinds.mjJNT_BALL]
    if balls:
        notes.add(f"{len(balls)} ball joints ({', '.join(balls[:4])}) move, but have no channel and no drive")
    free = [
        model.body(model.jnt_bodyid[j]).name
        for j in range(model.njnt)
        if model.jnt_type[j] == kinds.mjJNT_FREE and j != base
    ]
    if free:
        notes.add(
            f"bodies that move freely and carry no drive are not the robot's base, and have no channel: {listed(free)}"
        )
    if model.ntendon:
        notes.add(f"{model.ntendon} tendons act as in the model; no parameter changes them")
    if model.neq:
        notes.add(f"{model.neq} equality constraints act as in the model; no parameter changes them")


def _settled(opened: Opened, tables: Tables, longest: float, notes: Notes) -> Drafted:
    """The draft with a time step, ranges and parameters with which it can be simulated, and its engines.

    longest : the time step that the model has [s].
    """
    xml, model = opened.xml(), opened.compiled()
    make: Make = lambda changed: _robot(xml, opened, changed, notes)[0]  # noqa: E731
    tables = with_sound_ranges(make, with_finer_step(make, tables, longest, notes), notes)
    tables = with_engines(make, tables, notes)
    robot, files = _robot(xml, opened, tables, notes)
    base = robot.base
    joints = tuple(name_of(model, j) for j in scalar_joints(model))
    return Drafted(robot, files, joints, name_of(model, base) if base >= 0 else None, tuple(notes.lines))


def _robot(xml: str, opened: Opened, tables: Tables, notes: Notes) -> tuple[Robot, dict[str, bytes]]:
    text = toml_of(replace(tables, notes=tuple(notes.lines)))
    files = {TOML: text.encode(), MODEL: xml.encode(), **opened.assets}
    folder = Folder(files)
    robot = robot_of(folder, Path())
    trust_model(model_files(robot.files), MODEL)
    return robot, files
