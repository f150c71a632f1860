"""`dynreg excite`: commands that separate two causes, or with which legs hang free in turn."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynreg.cli.call import Call, can_write
from dynreg.cli.options import RobotFolder
from dynreg.errors import UsageError, command
from dynreg.verbs.excite import ExciteSettings

if TYPE_CHECKING:
    from dynreg.data.recording import Recording

FORMATS = (".csv", ".mcap")


def excite(
    call: Call,
    robot: RobotFolder,
    settings: ExciteSettings,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="File to write, in place of one that is there: .csv or .mcap; with --legs, a new folder.",
        ),
    ],
) -> None:
    """Write commands that separate effects, or let legs hang free.

    The commands keep to the limits of the robot's actions. Play them on the robot, and diagnose the log. Targets end
    each episode in the reset pose, in which the next begins after a pause. The last row holds them and sets torques,
    voltages and speeds to 0. Without torque a joint may fall or coast. The note tells what no limit bounds.

    With --legs, each leg in turn hangs free and reverses, slowly and fast, while the base is held on a stand: backlash
    and elasticity show there, not where a leg carries the robot. The folder holds a file of commands for each leg, the
    robot on its stand, by which the logs are diagnosed, and a note for the operator.

    Example: dynreg excite servo_pendulum --for payload,coulomb_friction -o next.csv
    """
    from dynreg.session import Session

    if settings.legs:
        told = {name: value for name, value in vars(settings).items() if name != "between"}
        with call.progress() as progress:
            protocol = Session.excite_legs(call.robot(robot), **told, folder=out, progress=progress)
        call.emit(protocol, hint=f"read {out}/README.md, and play {protocol.legs[0].file}")
        return
    _check_file(out)
    with call.progress() as progress:
        commands, experiment = Session.excite(
            call.robot(robot),
            between=settings.between,
            seconds=settings.seconds,
            seed=settings.seed,
            progress=progress,
        )
    _write(commands, out)
    written = experiment.model_copy(update={"file": str(out)})
    call.emit(written, hint=f"play {out}, then {command('diagnose', 'LOG', '--robot', robot)}")


def _check_file(out: Path) -> None:
    """UsageError for a file that could not be written, before time is spent on it."""
    if out.suffix not in FORMATS:
        raise UsageError(
            f"-o {str(out)!r}", expected=f"a file name that ends in {' or '.join(FORMATS)}", do="rename it"
        )
    can_write(out)


def _write(commands: "Recording", out: Path) -> None:
    from dynreg.data.table import to_csv, to_mcap
    from dynreg.verbs.written import write_out

    write_out(out, (to_csv if out.suffix == ".csv" else to_mcap)(commands))
