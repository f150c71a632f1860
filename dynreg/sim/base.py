"""Which free joint is the base of a robot: a model may hold other things that move freely, such as a cube."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

FREE = 0  # mujoco.mjtJoint.mjJNT_FREE, without the import


def base_joint(model: "mujoco.MjModel", driven: Sequence[str]) -> int:
    """Number of the free joint that carries the joints `driven` (their names); -1 where none does.

    Of a model in which nothing is driven it is the first free joint.
    """
    free = [j for j in range(model.njnt) if model.jnt_type[j] == FREE]
    if not driven:
        return free[0] if free else -1
    names = set(driven)
    moved = [j for j in range(model.njnt) if model.joint(j).name in names]
    roots = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in moved}
    mine = (j for j in free if int(model.body_rootid[model.jnt_bodyid[j]]) in roots)
    return next(mine, -1)
