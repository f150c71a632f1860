"""What the parameters of a robot are drawn up from: its model, its drives, the ground, and what a log tells of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import mujoco

from dynreg.draft.drives import OF_MODEL, QUICK, Drive, effective_inertia
from dynreg.draft.ground import Ground
from dynreg.draft.joints import groups

ALONE = 7  # joints of a robot that stands on the ground by its base, up to which each has friction of its own
KINDS = 4  # types of joints of other robots that have numbers of their own
USED = 0.6  # share of its torque that the largest of a log is of a drive: dry friction is up to 0.21 of that in an arm
WEAKEST = 0.02  # of the strongest joint's torque and inertia: no joint of one robot has less, whatever its link weighs
SPARE = 4.0  # times what holds and quickens a joint: the torque of a drive of which nothing is stated


@dataclass(frozen=True)
class Doubted:
    """What the parameters of a robot are drawn up from: its compiled model, drives and the ground it stands on.

    efforts : {joint: the largest torque of the log [N*m or N]} of those that it tells.
    """

    model: mujoco.MjModel
    drives: tuple[Drive, ...]
    floating: bool
    ground: Ground | None
    efforts: Mapping[str, float] = field(default_factory=dict)

    @property
    def grouped(self) -> dict[str, list[str]]:
        """The driven joints, in groups that have one damping and one dry friction each."""
        return groups([d.joint for d in self.drives], KINDS if self.floating else ALONE)

    @cached_property
    def loads(self) -> dict[str, tuple[float, float]]:
        """{driven joint: inertia [kg*m^2 or kg], load by its weight [N*m or N]}."""
        return {d.joint: effective_inertia(self.model, self.model.joint(d.joint).id) for d in self.drives}

    @cached_property
    def inertias(self) -> dict[str, float]:
        """{driven joint: its inertia, or that of the smallest rotor that a robot of this size has}."""
        least = WEAKEST * max(inertia for inertia, _ in self.loads.values())
        return {joint: max(inertia, least) for joint, (inertia, _) in self.loads.items()}

    @cached_property
    def strengths(self) -> dict[str, float]:
        """{driven joint: the force that its drive has [N*m or N]}: of the log, else what motion can ask of it."""
        asked = {joint: SPARE * (load + QUICK * inertia) for joint, (inertia, load) in self.loads.items()}
        least = WEAKEST * max(asked.values())
        out = {}
        for drive in self.drives:
            usual = min([*_stated(drive), max(asked[drive.joint], least)])
            out[drive.joint] = self.efforts.get(drive.joint, 0.0) / USED or usual or 1.0
        return out

    def most(self, drive: Drive) -> float:
        """The largest force of a drive [N*m or N], as stated, else its strength."""
        return min(_stated(drive), default=self.strengths[drive.joint])


def _stated(drive: Drive) -> list[float]:
    """What a drive's force is limited to [N*m or N]: by its own limit, by the largest command of the model's motor."""
    ends = abs(drive.gain) * max(abs(drive.low or 0), abs(drive.high or 0))
    motor = drive.kind == "torque" and drive.said == OF_MODEL
    return [x for x in (drive.limit, ends if motor else None) if x]
