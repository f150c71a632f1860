"""`dynreg ingest`: bring a log into the registry."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import robot_names
from dynreg.errors import command


def ingest(
    call: Call,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs of one recording.")],
    robot: Annotated[str, typer.Option(help="Robot that was recorded.", autocompletion=robot_names)],
    log_map: Annotated[
        Path | None, typer.Option("--map", help="TOML map from the log to the robot's channels.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name for the recording.")] = None,
    gait: Annotated[
        str | None, typer.Option(help="Stored gait that was played: its id, or @last (the last gait).")
    ] = None,
) -> None:
    """Read logs and store them as one recording.

    It reads MCAP, ROS bags, CSV, Parquet, NumPy .npz, LeRobot datasets, MATLAB .mat and bam JSON. A map says which
    column of the log is which channel. `robots init --log` drafts one in the robot's folder, and it is found by itself.
    A table with the robot's channel names needs none.

    Example: dynreg ingest run1.mcap run2.mcap --robot servo_pendulum --map my_map.toml --name monday
    """
    from dynreg.verbs.diagnose import first_command
    from dynreg.verbs.ingest import require_name
    from dynreg.verbs.subjects import read_log

    require_name(name)
    loaded = call.robot(robot)
    with call.progress() as progress:
        recording = read_log(logs, loaded, log_map, progress)  # before a registry is made for it
        with call.open(create=True) as session:
            result = session.ingest(recording, loaded, name=name, gait=gait, progress=progress)
    named = result.name or result.recording[:12]
    if gait or not set(loaded.actions) <= set(result.channels):
        ask = [command("export", named, "--as", "foxglove", "--to", "run.mcap")]
    elif result.simulators != 0:
        ask = [command("query", named, "-k", 5), first_command(named, loaded)]
    else:
        ask = [first_command(named, loaded), command("populate", robot, "-n", 1000)]
    call.emit(result, hint=ask)
