"""The drives that a drafted robot gets: those of the model's actuators, as the user states them, or guessed."""

from dataclasses import replace

import mujoco
import numpy as np

from dynreg.draft.drives import (
    QUICK,
    Drive,
    effective_inertia,
    force_range,
    is_hinge,
    joint_limit,
    name_of,
    understood,
)
from dynreg.draft.entry import DraftOptions, Notes, listed
from dynreg.draft.opened import Opened
from dynreg.draft.stated import of_joint, stated_words, unknown
from dynreg.errors import RobotError, UsageError
from dynreg.sim.held import JOINT, scalar_joints, switched_on

NATURAL = 20.0  # rad/s: what a guessed servo answers with
SAG = 0.02  # rad or m by which a guessed servo gives way to the joint's own weight
DAMPED = 0.7  # share of the critical damping of a guessed servo
TWICE = 2.0  # times what holds and quickens a joint: the largest command of a guessed torque drive
STATED = "stated"
_STIFF, _DAMPED = ("position",), ("position", "velocity")  # kinds of drives with a gain, and with a rate gain


def drives_of(opened: Opened, options: DraftOptions, notes: Notes) -> tuple[Drive, ...]:
    """The drives of a model, in the order of their first actuators, or of its joints where it has none.

    Raises RobotError where no actuator is understood and no drive is stated.
    """
    model = opened.compiled()
    found: dict[int, Drive] = {}
    left_out: list[str] = []
    on = switched_on(model)
    for a in np.flatnonzero(on):
        joint = int(model.actuator_trnid[a, 0])
        known = model.actuator_trntype[a] in JOINT and joint in scalar_joints(model)
        drive = understood(model, a, joint) if known else None
        if drive is None:
            left_out.append(_called(model, a))
        elif joint not in found:
            found[joint] = drive
        else:
            found[joint] = _merged(found[joint], drive, joint_limit(model, joint), notes)
    _say_unlike(model, on, notes)
    if left_out:
        notes.add(
            f"{len(left_out)} actuators get no command ({listed(left_out)}): "
            "a drive must be a fixed or affine actuator on a hinge or slide"
        )
    if not found and (options.drive or not left_out):
        found = {j: _guessed(model, j, options) for j in scalar_joints(model) if not _follows(model, j)}
        if found:
            which = " that are understood" if left_out else " that are switched on" if model.nu else ""
            none = f"no actuators{which}"
            notes.add(f"the model has {none}: all its hinges and slides are driven")
    elif not found:
        raise RobotError(
            f"the model's actuators are not understood: {listed(left_out)}",
            expected="fixed or affine actuators on hinges and slides",
            do="state the drives with --drive position, --drive velocity or --drive torque",
        )
    else:
        found = {j: _stated(model, j, drive, options) for j, drive in found.items()}
    found = {
        j: replace(d, limit=of_joint(options.torque_limit, d.joint) or d.limit) for j, d in found.items()
    }
    return tuple(found.values())


def _say_unlike(model: mujoco.MjModel, on: np.ndarray, notes: Notes) -> None:
    """Notes about actuators that the model switches off, and about delays, which no drive has.

    on : (nu,) as `switched_on` gives it.
    """
    off = [_called(model, a) for a in np.flatnonzero(~on)]
    if off:
        notes.add(
            f"the model switches actuators off ({listed(off)}, by actuatorgroupdisable): they get no command"
        )
    late = [
        f"{_called(model, a)}: {model.actuator_delay[a]:g} s"
        for a in np.flatnonzero(on & model.actuator_history.any(axis=1))
    ]
    if late:
        notes.add(
            f"delays of actuators are left out ({listed(late)}): in a simulator a delay is the effect command_delay"
        )


def _called(model: mujoco.MjModel, a: int) -> str:
    return model.actuator(a).name or f"number {a + 1}"


def say_limits(model: mujoco.MjModel, drives: tuple[Drive, ...], notes: Notes) -> None:
    """Notes about drives that the model limits more one way than the other, and servos that nothing limits.

    model : with its own actuators.
    """
    uneven = []
    for drive in drives:
        low, high = force_range(model, model.joint(drive.joint).id)
        if drive.limit is not None and -low != high and np.isclose(drive.limit, max(-low, high)):
            uneven.append(f"{drive.joint}: {low:g} to {high:g}")
    if uneven:
        notes.add(
            f"the model limits forces by direction ({listed(uneven)}): a drive has one limit, and gets the larger one"
        )
    unlimited = [d.joint for d in drives if d.limit is None and d.kind in ("position", "velocity")]
    if unlimited:
        notes.add(f"the torque limit of {listed(unlimited)} is not known: state it with --torque-limit")


def check_gains(drives: tuple[Drive, ...], options: DraftOptions, notes: Notes) -> None:
    """A note about stated gains that some drives do not have; UsageError where none has them, or no joint the name."""
    _require_known(drives, options)
    for flag, value, kinds in (("--kp", options.kp, _STIFF), ("--kd", options.kd, _DAMPED)):
        asked = [d for d in drives if of_joint(value, d.joint) is not None]
        without = [d for d in asked if d.kind not in kinds]
        if not without:
            continue
        if len(without) == len(asked):
            raise UsageError(
                f"{flag} {stated_words(value)}: no {without[0].kind} drive has this gain",
                expected=f"{flag} with {' or '.join(kinds)} drives",
                do=f"add --drive position, or leave {flag} out",
            )
        notes.add(
            f"{flag} is not for {listed([d.joint for d in without])}: they are {without[0].kind} drives"
        )


def _require_known(drives: tuple[Drive, ...], options: DraftOptions) -> None:
    """UsageError for a name or glob in what is stated that no driven joint has."""
    joints = [d.joint for d in drives]
    stated = {"--kp": options.kp, "--kd": options.kd, "--torque-limit": options.torque_limit}
    for flag, value in stated.items():
        if names := unknown(value, joints):
            raise UsageError(
                f"{flag} {stated_words(value)}: no driven joint is called {listed([repr(n) for n in names])}",
                expected=f"some of {listed(joints, most=12)}, or a glob of them",
                do="correct the name",
            )


def _follows(model: mujoco.MjModel, joint: int) -> bool:
    """Whether an equality (a URDF's mimic) makes the joint follow another."""
    kind = int(mujoco.mjtEq.mjEQ_JOINT)
    return any(
        model.eq_type[e] == kind and model.eq_obj1id[e] == joint and model.eq_obj2id[e] >= 0
        for e in range(model.neq)
    )


def _merged(first: Drive, second: Drive, whole: list[float], notes: Notes) -> Drive:
    """Two actuators of one joint: a velocity servo beside a position servo damps it; of others the first counts.

    whole : the limit of the joint's force, which holds for both together; empty without one.
    """
    kinds = {first.kind, second.kind}
    if kinds == {"position", "velocity"}:
        position = first if first.kind == "position" else second
        other = second if position is first else first
        if not {first.limit, second.limit} <= {None, *whole}:
            notes.add(
                f"joint {first.joint} has a position and a velocity servo, and the model limits their forces one by "
                "one: they become one drive, which has the limit of the position servo"
            )
        return replace(position, rate_gain=position.rate_gain + other.rate_gain)
    notes.add(f"joint {first.joint} has several actuators: the first takes its commands")
    return first


def _guessed(model: mujoco.MjModel, joint: int, options: DraftOptions) -> Drive:
    """A drive for a joint that has no actuator, as stated, or from the joint's inertia and weight."""
    ends = joint_limit(model, joint)
    drive = Drive(
        name_of(model, joint), "torque", limit=min(ends, default=None), said="the model has no actuator"
    )
    return _stated(model, joint, drive, replace(options, drive=options.drive or "position"))


def _stated(model: mujoco.MjModel, joint: int, drive: Drive, options: DraftOptions) -> Drive:
    """The drive as the user states it; gains that are not stated are guessed where the model's drive has none."""
    kind = options.drive or drive.kind
    kp, kd = of_joint(options.kp, drive.joint), of_joint(options.kd, drive.joint)
    if kind == drive.kind and kind in _DAMPED:
        gain = drive.gain if kp is None else kp
        rate = drive.rate_gain if kd is None else kd
        changed = (gain, rate) != (drive.gain, drive.rate_gain)
        return replace(drive, gain=gain, rate_gain=rate, said=STATED if changed else drive.said)
    if options.drive is None or (kind == drive.kind and drive.high is not None):
        return drive
    limit = drive.limit
    if drive.kind == "torque" and drive.high is not None:
        # of a motor: its largest command
        most = abs(drive.gain) * max(abs(drive.low or 0.0), abs(drive.high))
        limit = most if limit is None else min(limit, most)
    inertia, load = effective_inertia(model, joint)
    if kind == "torque":
        gain = drive.gain if drive.kind == kind else 1.0
        most = (limit or TWICE * (load + QUICK * inertia)) / abs(gain)
        kept = drive
        if drive.kind != kind:
            kept = Drive(drive.joint, kind, actuator=drive.actuator, said=drive.said)
        return replace(kept, limit=limit, low=-most, high=most, usual=True)
    is_guess = (kp if kind == "position" else kd) is None
    kp = max(inertia * NATURAL**2, load / SAG) if kp is None else kp
    kd = 2.0 * DAMPED * float(np.sqrt(kp * inertia)) if kd is None else kd
    of = Drive(
        drive.joint,
        kind,
        rate_gain=kd,
        limit=limit,
        actuator=drive.actuator,
        said="guessed from inertia and weight" if is_guess else STATED,
        guessed=is_guess,
    )
    if kind == "position":
        return replace(of, gain=kp)
    speed = 2.0 * np.pi if is_hinge(model, joint) else 1.0
    return replace(of, low=-speed, high=speed, usual=True)
