"""`dynreg ingest`: bring a log into the registry."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import robot_names


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
    """Bring logs in as one recording.

    Reads MCAP, ROS bags, CSV, Parquet, LeRobot datasets, MATLAB .mat and bam JSON. Logs of a packaged
    robot's bench find their map by themselves; a table whose columns carry the robot's
    channel names needs none.

    Example: dynreg ingest run1.mcap run2.mcap --robot servo_pendulum --map my_map.toml --name monday
    """
    from dynreg.sim.robot import load_robot
    from dynreg.verbs.subjects import read_log

    loaded = load_robot(robot)
    recording = read_log(logs, loaded, log_map)  # before a registry is made for it
    with call.open(create=True) as session:
        result = session.ingest(recording, loaded, name=name, gait=gait)
    named = result.name or result.recording[:12]
    beside = f"dynreg export {named} --as foxglove --to run.mcap"
    call.emit(result, hint=beside if gait else f"dynreg query {named} -k 5")
