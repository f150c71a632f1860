"""Draft a robot folder from a model file and logs."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dynreg.errors import UsageError
from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, option

if TYPE_CHECKING:
    from dynreg.draft.entry import Drafted
    from dynreg.draft.stated import Stated
    from dynreg.results.robots import RobotDraft

EACH = "NUMBER|JOINT=NUMBER,..."  # one number of all drives, or one of each
EACH_JOINT = ("kp", "kd", "torque_limit")


@dataclass(frozen=True)
class RobotDraftSettings(Settings):
    """What a user states about a robot."""

    to: Path | None = option(None, "Folder to write.", usual="the robot's name, here")
    name: str | None = option(None, "Name of the robot.", usual="the file's, or its folder's")
    drive: str | None = option(
        None,
        "What drives are told.",
        usual="as the model's actuators",
        choices=("position", "torque", "velocity"),
    )
    kp: str | None = option(
        None, "Gain of position drives [N*m/rad or N/m]: of all, or joint1=1500,wrist*=300.", metavar=EACH
    )
    kd: str | None = option(None, "Their damping, or the gain of velocity drives [N*m*s/rad].", metavar=EACH)
    torque_limit: str | None = option(
        None,
        "Largest torque of a drive [N*m or N].",
        usual="the model's, or where the log's torques stop",
        metavar=EACH,
    )
    free_base: bool | None = option(
        None,
        "The first body of a URDF moves freely, or is fixed.",
        flag="--free-base/--fixed-base",
        usual="free where the log's base moves",
    )
    root: Path | None = option(
        None,
        "Folder that holds every file which the model names.",
        usual="the model's own, or its ROS package",
    )
    visuals: bool = option(False, "Keep the geoms and meshes that touch nothing.")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in EACH_JOINT:
            self.stated(name)

    def stated(self, name: str) -> "Stated | None":
        """What is stated of drives under one of `EACH_JOINT`; UsageError where that is no number above 0."""
        from dynreg.draft.stated import stated_of

        value = getattr(self, name)
        return None if value is None else stated_of(str(value), name)


def robot_draft(
    model: Path, log: Path | None, settings: RobotDraftSettings, progress: Progress | None = None
) -> "RobotDraft":
    """Write a robot folder made of the model, with a map where there is a log.

    progress : is called with (stage, done, total).
    Raises UsageError where the folder exists or its name is none, RobotError for a model that cannot be read or driven,
    LogError for a log that cannot be read or whose clock tells no rate. Nothing is left where it fails.
    """
    from dynreg.data.ingest import read_log
    from dynreg.draft.apart import draft_apart
    from dynreg.draft.entry import DraftOptions, write_draft
    from dynreg.verbs.written import new_folder, require_new

    name = settings.name or _name_of(model)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_\-]{0,99}", name):
        raise UsageError(
            f"robot name {name!r}",
            expected="a letter, then letters, digits, - and _",
            do="choose another --name",
        )
    folder = settings.to or _folder_of(name, model)
    require_new(folder)
    stated = DraftOptions(
        settings.drive,
        *map(settings.stated, EACH_JOINT),
        settings.free_base,
        settings.visuals,
    )
    heard = None
    report = progress or (lambda *_: None)
    if log:
        report(f"read {log.name}", 0, 1)
        heard = read_log(log).stamped()
        report(f"read {log.name}", 1, 1)
    report(f"draft and try {name}", 0, 1)
    made = draft_apart(model, name, stated, heard, settings.root)
    report(f"draft and try {name}", 1, 1)
    with new_folder(folder) as hidden:
        write_draft(made, hidden)
    return _told(made, folder, model, log)


def _name_of(model: Path) -> str:
    """The name of a robot by its file; by the file's folder where that says no more than that it is a robot.

    A name that a robot has which comes with dynreg gets a word more.
    """
    from dynreg.sim.robot import packaged_robots

    stem = model.absolute().parent.name if model.stem in ("robot", "model", "scene") else model.stem
    plain = re.sub(r"[^A-Za-z0-9_\-]+", "_", stem).strip("_") or "robot"
    named = plain if plain[0].isalpha() else f"robot_{plain}"
    return f"{named}_robot" if named in packaged_robots() else named


def _folder_of(name: str, model: Path) -> Path:
    """The folder to write: the robot's name, with a word more where that is the folder that the model lies in."""
    folder = Path(name)
    return Path(f"{name}_robot") if folder.resolve() in model.resolve().parents else folder


def _told(made: "Drafted", folder: Path, model: Path, log: Path | None) -> "RobotDraft":
    from dynreg.results.robots import RobotDraft

    robot = made.robot
    head = robot.file.robot
    return RobotDraft(
        name=robot.name,
        folder=str(folder),
        model=model.name,
        log=log.name if log else None,
        engines=tuple(head.engines),
        control_rate=head.control_rate,
        timestep=head.timestep,
        base=made.base,
        joints=made.joints,
        actions=robot.actions,
        channels=robot.channels,
        parameters=robot.space.names,
        bytes=sum(map(len, made.files.values())),
        map=str(folder / made.map) if made.map else None,
        missing=made.missing,
        notes=made.notes,
    )
