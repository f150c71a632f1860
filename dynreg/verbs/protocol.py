"""The document and the folder of commands for legs that hang free in turn."""

from collections.abc import Mapping
from pathlib import Path

from dynreg.data.table import to_csv
from dynreg.errors import command
from dynreg.excite.legs import Hanging, HangingLegs
from dynreg.results.protocol import ExpectedEvidence, LegCommands, LegProtocol
from dynreg.verbs.cautions import beginning, cautions, ending
from dynreg.verbs.experiment import commanded
from dynreg.verbs.written import new_folder, write_out

ROBOT, README = "robot", "README.md"  # in the folder: the robot on its stand, and the operator's note


def protocol(made: HangingLegs, name: str) -> LegProtocol:
    """What is played and what the operator does, for the robot called `name`."""
    limits = {}
    for one in made.legs:
        for limit in commanded(made.robot, made.limits, one.run):
            known = limits.get(limit.name, limit)
            span = {"least": min(limit.least, known.least), "most": max(limit.most, known.most)}
            limits[limit.name] = known.model_copy(update=span)
    return LegProtocol(
        robot=name, legs=tuple(_leg(made, one) for one in made.legs), limits=tuple(limits.values())
    )


def write_protocol(made: HangingLegs, told: LegProtocol, folder: Path) -> LegProtocol:
    """Write the commands, the robot on its stand and the operator's note; the document with their places.

    Raises UsageError where the folder exists or cannot be written.
    """
    with new_folder(folder) as hidden:
        for one, leg in zip(made.legs, told.legs, strict=True):
            _put(hidden, {leg.file: to_csv(made.recording(one))})
        _put(hidden / ROBOT, made.robot.files.files)
        written = told.model_copy(update={"folder": str(folder), "stand": str(folder / ROBOT)})
        _put(hidden, {README: _readme(written).encode()})
    return written


def diagnosing(told: LegProtocol, leg: LegCommands) -> str:
    """The command that diagnoses the log of a leg."""
    how = ("--joints", ",".join(leg.joints), "--hold-out", ",".join(leg.held_out))
    return command("diagnose", "LOG", "--robot", told.stand or "ROBOT_ON_ITS_STAND", *how)


def _leg(made: HangingLegs, one: Hanging) -> LegCommands:
    run = one.run
    expected = tuple(
        ExpectedEvidence(effect=name, joint=joint, nats=float(nats))
        for name, row in zip(made.aims, one.nats, strict=True)
        for joint, nats in zip(one.joints, row, strict=True)
    )
    operator = (
        f"Fix the base on a stand so that leg {one.leg} hangs free and touches nothing, whatever it does. Begin each"
        f" episode {beginning(made.robot)}; play {one.leg}.csv, and log the joints. The other legs hold still;"
        f" {ending(made.robot)}."
    )
    for sentence in cautions(made.robot, made.limits, run, one.reached):
        operator += f" {sentence[0].upper()}{sentence[1:]}."
    return LegCommands(
        leg=one.leg,
        joints=one.joints,
        file=f"{one.leg}.csv",
        seconds=run.episodes * run.steps * run.period,
        episodes=one.names,
        held_out=one.held_out,
        operator=operator,
        expected=expected,
    )


def _readme(told: LegProtocol) -> str:
    """The operator's note: leg after leg what to do, and how its log is diagnosed."""
    out = [f"# {told.robot}: each leg hangs free in its turn", ""]
    out += [f"`{ROBOT}/` is the robot with its base held: logs of these commands are diagnosed by it.", ""]
    for leg in told.legs:
        out += [f"## {leg.leg}", leg.operator, "", "```sh", diagnosing(told, leg), "```", ""]
    return "\n".join(out)


def _put(folder: Path, files: Mapping[str, bytes]) -> None:
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_out(folder / name, data)
