"""What `robot.toml` may say about walking: the gait's roles and legs, and the tasks."""

import math
from typing import Annotated

from pydantic import Field, Strict, field_validator, model_validator

from dynreg.sim.table import Table

Range = Annotated[tuple[float, float], Strict(False)]


class RoleTable(Table):
    """[[gait.roles]]: what the joints of this name have in common in every leg; bounds [rad].

    `amplitude` of the sine and `offset`, the angle about which it swings.
    """

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")
    amplitude: Range
    offset: Range


class LegTable(Table):
    """[[gait.legs]]: the joint of every role; `mirrored` are the roles whose joints turn the other way here."""

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")
    joints: dict[str, str]
    mirrored: list[str] = Field(default_factory=list)


class GaitTable(Table):
    """[gait]: bounds of the sinusoidal gait: `frequency` [Hz]; `ramp` [s] from the reset pose into it.

    start : {gene: value} of gaits that searches try first, one or a list; genes that are not named stand in the
    middle.
    """

    frequency: Range
    ramp: float = Field(default=1.0, gt=0, le=3600)
    roles: list[RoleTable] = Field(min_length=1)
    legs: list[LegTable] = Field(min_length=2)
    start: list[dict[str, float]] = Field(default_factory=list)

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
    """[[tasks]]: what a gait is sought for; `kind` is one of dynreg's or of a plugin (`dynreg.tasks`).

    seconds : how long a trial is. success : the least fitness that counts as done, without a fall.
    values : numbers of the kind, such as {speed = 0.2}.
    """

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_\-]*$")
    kind: str = "forward"
    seconds: float = Field(default=10.0, gt=0, le=3600)
    success: float = 0.3
    values: dict[str, float] = Field(default_factory=dict)
