"""Robots: those that come with dynreg, what is wrong with a folder, a simulator as a folder of its own."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Result


class CarriedEffect(Result):
    """One effect of the simulator: its values in their units, and where the folder has it.

    parameters : those of robot.toml that stand for it; empty where it cannot say it. mjcf : whether the MJCF has it.
    """

    effect: str
    values: dict[str, float]
    units: dict[str, str]
    parameters: tuple[str, ...]
    mjcf: bool


class RobotFolder(Result):
    """A robot folder made of a stored simulator.

    name : the new robot's. mjcf : the file for MuJoCo alone, null where there is none; note : why. model : the
    uncorrected model, which robot.toml corrects. warning : the effects that robot.toml lacks, and what has them; the
    held-out error in MuJoCo of a simulator that was fitted in the joint engine; empty where there is nothing to say.
    """

    schema_: Literal["dynreg/robot_folder/1"] = Field(default="dynreg/robot_folder/1", alias="schema")
    robot: str
    simulator: str
    folder: str
    name: str
    effects: tuple[CarriedEffect, ...] = ()
    mjcf: str | None = None
    note: str = ""
    model: str = ""
    warning: str = ""

    def rows(self) -> list[dict[str, Any]]:
        return [effect.to_dict() for effect in self.effects]

    def __str__(self) -> str:
        return f"simulator {self.simulator[:12]} of {self.robot} as robot {self.name}, in {self.folder}"


class RobotDraft(Result):
    """A robot folder drafted from a model file.

    model : the name of the file. joints : that move. base : the free joint, null where the robot has none. map : the
    drafted log map, null without a log; missing : channels for which the log holds nothing. notes : what was guessed,
    left out or not understood, one line each.
    """

    schema_: Literal["dynreg/robot_draft/1"] = Field(default="dynreg/robot_draft/1", alias="schema")
    name: str
    folder: str
    model: str
    log: str | None = None
    engines: tuple[str, ...]
    control_rate: float
    timestep: float
    base: str | None = None
    joints: tuple[str, ...]
    actions: tuple[str, ...]
    channels: tuple[str, ...]
    parameters: tuple[str, ...]
    bytes: int
    map: str | None = None
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"robot {self.name} of {self.model}, in {self.folder}"


class RobotLine(Result):
    """A packaged robot."""

    name: str
    title: str
    engines: tuple[str, ...]
    control_rate: float | None
    channels: tuple[str, ...]
    actions: tuple[str, ...]
    settings: tuple[str, ...]
    parameters: tuple[str, ...]


class RobotList(Result):
    """The robots that come with dynreg."""

    schema_: Literal["dynreg/robots/1"] = Field(default="dynreg/robots/1", alias="schema")
    robots: tuple[RobotLine, ...]


class RobotCheck(Result):
    """What is wrong with a robot folder, each with its line in robot.toml.

    problems : errors; the folder is sound, and can be used, where there are none. warnings : faults that do not keep
    the folder from being used.
    """

    schema_: Literal["dynreg/robot_check/1"] = Field(default="dynreg/robot_check/1", alias="schema")
    robot: str
    sound: bool
    problems: tuple[str, ...]
    warnings: tuple[str, ...] = ()
