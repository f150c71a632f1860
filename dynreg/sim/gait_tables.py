"""What `robot.toml` may say about walking: the gait's roles and legs, and the tasks."""

import math
from typing import Annotated

from pydantic import Field, Strict, field_validator, model_validator

from dynreg.sim.table import Table

Range = Annotated[tuple[float, float], Strict(False)]


class RoleTable(Table):
    """[[gait.roles]]: what the joints of this name have in common in every leg."""

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", description="The role's name, such as `hip`.")
    amplitude: Range = Field(description="Least and largest amplitude of the sine [rad].")
    offset: Range = Field(description="Least and largest angle about which the joint swings [rad].")


class LegTable(Table):
    """[[gait.legs]]: a leg, with a joint for every role."""

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", description="The leg's name.")
    joints: dict[str, str] = Field(description='The joint of every role, `{hip = "fr_hip"}`.')
    mirrored: list[str] = Field(
        default_factory=list, description="Roles whose joints turn the other way in this leg."
    )


class GaitTable(Table):
    """[gait]: bounds of a sinusoidal gait."""

    frequency: Range = Field(description="Least and largest frequency [Hz].")
    ramp: float = Field(default=1.0, gt=0, le=3600, description="Time from the reset pose into the gait [s].")
    roles: list[RoleTable] = Field(min_length=1, description="Joints that every leg has.")
    legs: list[LegTable] = Field(min_length=2, description="The legs, each with a joint for every role.")
    start: list[dict[str, float]] = Field(
        default_factory=list,
        description="Gaits that searches try first, `{gene = value}`; genes that are not named stand in "
        "the middle.",
    )

    @field_validator("start", mode="before")
    @classmethod
    def _one_is_a_list(cls, given):
        if isinstance(given, dict):
            return [given] if given else []
        return given

    @model_validator(mode="after")
    def _parts(self):
        ranges = {"frequency": self.frequency}
        for role in self.roles:
            ranges |= {f"amplitude of {role.name}": role.amplitude, f"offset of {role.name}": role.offset}
        for name, (low, high) in ranges.items():
            if not low < high:
                raise ValueError(f"{name}: low {low} is not below high {high}")
        if self.frequency[0] <= 0 or any(role.amplitude[0] < 0 for role in self.roles):
            raise ValueError("a frequency must be above 0, and an amplitude not below it")
        roles = [role.name for role in self.roles]
        names = [leg.name for leg in self.legs]
        if len({*roles, *names}) < len(roles) + len(names):
            raise ValueError("two of the roles and legs have one name")
        for leg in self.legs:
            if sorted(leg.joints) != sorted(roles):
                raise ValueError(
                    f"leg {leg.name!r} has joints for {sorted(leg.joints)}, not for {sorted(roles)}"
                )
            if set(leg.mirrored) - set(roles):
                raise ValueError(f"leg {leg.name!r} mirrors {leg.mirrored}, not some of {roles}")
        joints = [joint for leg in self.legs for joint in leg.joints.values()]
        if twice := [joint for i, joint in enumerate(joints) if joint in joints[:i]]:
            raise ValueError(f"joint {twice[0]!r} is in two places of the legs")
        return self

    @model_validator(mode="after")
    def _begins(self):
        bounds = {"frequency": self.frequency}
        for role in self.roles:
            bounds |= {f"amplitude_{role.name}": role.amplitude, f"offset_{role.name}": role.offset}
        phases = [*self.roles, *self.legs[1:]]
        bounds |= {f"phase_{turning.name}": (-math.pi, math.pi) for turning in phases}
        for name, value in (item for gait in self.start for item in gait.items()):
            if name not in bounds:
                raise ValueError(f"start names {name!r}, not one of {list(bounds)}")
            if not bounds[name][0] <= value <= bounds[name][1]:
                raise ValueError(f"start: {name} = {value} lies outside {list(bounds[name])}")
        return self


class TaskTable(Table):
    """[[tasks]]: what a gait is sought for; the first is the usual one."""

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_\-]*$", description="The task's name.")
    kind: str = Field(
        default="forward",
        description="What is scored: `forward`, `slope`, `turn`, `speed`, or a kind of a plugin.",
    )
    seconds: float = Field(default=10.0, gt=0, le=3600, description="Length of a trial [s].")
    success: float = Field(default=0.3, description="Least fitness that counts as done, without a fall.")
    values: dict[str, float] = Field(
        default_factory=dict, description="Numbers of the kind, such as `{speed = 0.2}`."
    )
