"""The answer of `export --as robot`: a simulator as a robot folder."""

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

    name : the new robot's. mjcf : the file for MuJoCo alone, null where there is none; note : why.
    """

    schema_: Literal["dynreg/robot_folder/1"] = Field(default="dynreg/robot_folder/1", alias="schema")
    robot: str
    simulator: str
    folder: str
    name: str
    effects: tuple[CarriedEffect, ...] = ()
    mjcf: str | None = None
    note: str = ""

    def rows(self) -> list[dict[str, Any]]:
        return [effect.to_dict() for effect in self.effects]

    def __str__(self) -> str:
        return f"simulator {self.simulator[:12]} of {self.robot} as robot {self.name}, in {self.folder}"
