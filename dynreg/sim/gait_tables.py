"""What `robot.toml` may say about walking: the gait's roles and legs, and the tasks."""

import math
from typing import Annotated

from pydantic import BeforeValidator, Field, Strict, field_validator, model_validator

from dynreg.errors import quoted
from dynreg.sim.table import Table

Range = Annotated[tuple[float, float], Strict(False)]


def _listed(given: object) -> object:
    """One table stands for a list of it, an empty one for none."""
    if isinstance(given, dict):
        return [given] if given else []
    return given


def _require_order(name: str, bounds: tuple[float, float]) -> None:
    """ValueError where the low bound is not below the high one."""
    if not bounds[0] < bounds[1]:
        raise ValueError(f"{name}: low {bounds[0]} is not below high {bounds[1]}")


class RoleTable(Table):
    """[[gait.roles]]: what the joints of this name have in common in every leg.

    Sines need both ranges; other kinds of gaits have none of them.
    """

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", description="The role's name, such as `hip`.")
    amplitude: Range | None = Field(
        default=None, description="Of sines: least and largest amplitude of the sine [rad]."
    )
    offset: Range | None = Field(
        default=None, description="Of sines: least and largest angle about which the joint swings [rad]."
    )


class LegTable(Table):
    """[[gait.legs]]: a leg, with a joint for every role."""

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", description="The leg's name.")
    joints: dict[str, str] = Field(description='The joint of every role, `{hip = "fr_hip"}`.')
    mirrored: list[str] = Field(
        default_factory=list, description="Roles whose joints turn the other way in this leg."
    )


Starts = Annotated[list[dict[str, float]], BeforeValidator(_listed)]


class MotionTable(Table):
    """What the tables of all gaits and motions have in common."""

    kind: str
    ranges: dict[str, Range] = Field(
        default_factory=dict,
        description="Other bounds of genes, `{gene = [low, high]}`; genes that are not named keep theirs. Those of "
        "sines are told by `frequency` and the roles.",
    )
    start: Starts = Field(
        default_factory=list,
        description="Gaits that searches try first, `{gene = value}`; genes that are not named stand in "
        "the middle.",
    )

    @field_validator("ranges")
    @classmethod
    def _order(cls, ranges: dict[str, tuple[float, float]]):
        for name, bounds in ranges.items():
            _require_order(name, bounds)
        return ranges


class GaitTable(MotionTable):
    """[gait]: how a legged robot walks, and the bounds of its gaits."""

    kind: str = Field(
        default="sines",
        description="What a gait is: `sines` of the joint angles, a `locus` on which each foot goes round, or a "
        "kind of a plugin. A locus needs four legs with the roles `rotor` (about the lateral axis), `elevator` (about "
        "the fore-aft axis) and `knee`.",
    )
    frequency: Range | None = Field(default=None, description="Of sines: least and largest frequency [Hz].")
    ramp: float = Field(default=1.0, gt=0, le=3600, description="Time from the reset pose into the gait [s].")
    roles: list[RoleTable] = Field(min_length=1, description="Joints that every leg has.")
    legs: list[LegTable] = Field(min_length=2, description="The legs, each with a joint for every role.")

    @model_validator(mode="after")
    def _legs(self):
        roles = [role.name for role in self.roles]
        names = [leg.name for leg in self.legs]
        if len({*roles, *names}) < len(roles) + len(names):
            raise ValueError("two of the roles and legs have one name")
        for leg in self.legs:
            if sorted(leg.joints) != sorted(roles):
                raise ValueError(
                    f"leg {leg.name!r} has joints for {quoted(sorted(leg.joints))}, not for {quoted(sorted(roles))}"
                )
            if set(leg.mirrored) - set(roles):
                raise ValueError(f"leg {leg.name!r} mirrors {leg.mirrored}, not some of {roles}")
        joints = [joint for leg in self.legs for joint in leg.joints.values()]
        if twice := [joint for i, joint in enumerate(joints) if joint in joints[:i]]:
            raise ValueError(f"joint {twice[0]!r} is in two places of the legs")
        return self

    @model_validator(mode="after")
    def _sines(self):
        ranges = {"frequency": self.frequency}
        for role in self.roles:
            ranges |= {f"amplitude_{role.name}": role.amplitude, f"offset_{role.name}": role.offset}
        for name, bounds in ranges.items():
            if (bounds is None) is (self.kind == "sines"):
                raise ValueError(f"{name.replace('_', ' of ', 1)}: sines have one, and other kinds have none")
            if bounds is not None:
                _require_order(name.replace("_", " of ", 1), bounds)
        if self.kind != "sines":
            return self
        if self.ranges:
            raise ValueError(
                "ranges: those of sines are `frequency`, and `amplitude` and `offset` of each role"
            )
        if self.frequency[0] <= 0 or any(role.amplitude[0] < 0 for role in self.roles):
            raise ValueError("a frequency must be above 0, and an amplitude not below it")
        phases = [*self.roles, *self.legs[1:]]
        ranges |= {f"phase_{turning.name}": (-math.pi, math.pi) for turning in phases}
        for name, value in (item for gait in self.start for item in gait.items()):
            if name not in ranges:
                raise ValueError(f"start names {name!r}, not one of {list(ranges)}")
            if not ranges[name][0] <= value <= ranges[name][1]:
                raise ValueError(f"start: {name} = {value} lies outside {list(ranges[name])}")
        return self


class PosesTable(MotionTable):
    """[[motions]]: what a robot does once, such as a kick: through poses, and back to rest."""

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_\-]*$", description="The motion's name, for tasks.")
    kind: str = Field(default="poses", description="What a motion is: `poses`, or a kind of a plugin.")
    poses: int = Field(default=2, ge=1, le=100, description="How many poses lie between rest and rest.")
    joints: list[str] = Field(
        default_factory=list,
        description="Joints that move, each with an angle of its own in every pose; by default all that follow none.",
    )
    mirrored: dict[str, str] = Field(
        default_factory=dict,
        description='Joints that turn the other way as another one, `{fr_hip = "fl_hip"}`.',
    )
    together: dict[str, str] = Field(
        default_factory=dict, description='Joints that turn as another one, `{fr_knee = "fl_knee"}`.'
    )


class TaskTable(Table):
    """[[tasks]]: what a gait is sought for; the first is the usual one."""

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_\-]*$", description="The task's name.")
    kind: str = Field(
        default="forward",
        description="What is scored: `forward`, `slope`, `turn`, `speed`, `kick`, or a kind of a plugin.",
    )
    motion: str | None = Field(
        default=None, description="The one of [[motions]] that is sought; without it, the gait."
    )
    seconds: float = Field(default=10.0, gt=0, le=3600, description="Length of a trial [s].")
    success: float = Field(default=0.3, description="Least fitness that counts as done, without a fall.")
    values: dict[str, float] = Field(
        default_factory=dict, description="Numbers of the kind, such as `{speed = 0.2}`."
    )
