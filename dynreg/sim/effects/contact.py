"""Effects of contact: what the robot stands on is not what the model has."""

import mujoco
import numpy as np

from dynreg.errors import quoted
from dynreg.sim.beside import own_geoms
from dynreg.sim.effects.body import at_reset
from dynreg.sim.effects.effect import Effect, EffectParameter, Site, Values
from dynreg.sim.robot import Robot

SLIDING = (0, 1)  # columns of `pair_friction`: along the ground in both directions


class _OnGround(Effect):
    """Needs a ground: a geom of the world, and one of the robot that can touch it."""

    acts_on = "contact"
    scope = "robot"

    def why_not(self, robot: Robot) -> str | None:
        if len(touching_geoms(robot)) < 2:
            return "nothing in the model can touch anything"
        return None if has_ground(robot) else "the model has no ground: no geom of the world can be touched"


class GroundFriction(_OnGround):
    """The ground's friction differs from the model's by a factor 1 + change."""

    id, title = "ground_friction", "the ground is more or less slippery"
    parameters = (
        EffectParameter("change", "1", "relative change of friction", 0.15, 0.30, 0.50, 0.9, signed=True),
    )
    near = ("second_friction_material",)
    separate_by = "pull the standing robot sideways with a spring scale, on each ground"

    def configure(self, site: Site, p: Values) -> None:
        factor = 1.0 + p["change"]
        _scale(site, "geom_friction", factor, touching_geoms(site.robot))
        _scale(site, "pair_friction", factor, pairs_on_ground(site.robot), SLIDING)


class SecondFrictionMaterial(_OnGround):
    """A group of geoms is more slippery on the ground than all others.

    Without a place it is the feet of the left side: another floor, or worn pads. Else it is a material of robot.toml.
    """

    id, title = "second_friction_material", "one side stands on a more slippery material"
    parameters = (EffectParameter("loss", "1", "friction lost on the left", 0.3, 0.5, 0.8, 0.97),)
    near = ("ground_friction",)
    separate_by = "turn the robot by 180 degrees on the spot"
    scope = "material"

    def why_not(self, robot: Robot) -> str | None:
        reason = super().why_not(robot) or (None if self.places(robot) else "no feet on a left side")
        if reason is None and _ground_decides(robot):
            return "the ground's `priority` is above that of what stands on it: its friction alone counts"
        return reason

    def places(self, robot: Robot) -> tuple[tuple[str, ...], ...]:
        sides = ((),) if len(left_feet(robot)) else ()
        return (*sides, *((name,) for name in unlike_materials(robot)))

    def misplaced(self, robot: Robot, at: tuple[str, ...]) -> tuple[str, str] | None:
        places = self.places(robot)
        expected = f"one of the materials {quoted(place[0] for place in places if place)}"
        wrong = f"no material {','.join(at)!r} beside another touches anything" if at else "no left side"
        return None if at in places else (wrong, expected)

    def title_at(self, at: tuple[str, ...]) -> str:
        return f"the material {at[0]!r} is more slippery than the others" if at else self.title

    def meaning_at(self, parameter: EffectParameter, at: tuple[str, ...]) -> str:
        return f"friction lost at the material {at[0]!r}" if at else parameter.meaning

    def separate_by_at(self, at: tuple[str, ...]) -> str:
        if not at:
            return self.separate_by
        return f"drag the robot over the ground on {at[0]!r} alone, then on another material alone, with a spring scale"

    def configure(self, site: Site, p: Values) -> None:
        # contact takes the friction of the geom of higher priority, and of equals the larger one: the ground steps back
        # for all others, a ball's too
        ground, priority = grounds(site.robot), site.robot.model.geom_priority
        feet = np.setdiff1d(touching_geoms(site.robot), ground)
        group = unlike_materials(site.robot)[site.at[0]] if site.at else left_feet(site.robot)
        friction, left = site.expand("geom_friction"), 1.0 - p["loss"]
        rows = np.arange(len(friction))[site.rows]
        above = priority[feet][:, None] > priority[ground]
        common = np.maximum(
            friction[np.ix_(rows, feet)][..., 0],
            np.where(above, 0.0, friction[rows][:, None, ground, 0]).max(axis=2),
        )
        friction[np.ix_(rows, feet, [0])] = (common * np.where(np.isin(feet, group), left, 1.0))[..., None]
        friction[np.ix_(rows, ground, [0])] = 1e-3
        _scale(site, "pair_friction", left, pairs_on_ground(site.robot, group), SLIDING)


class ContactCompliance(_OnGround):
    """Softer ground: the time constant of contacts grows by a factor 1 + softening.

    Of geoms whose solref is direct (minus stiffness, minus damping) both fall so that it does.
    """

    id, title = "contact_compliance", "the ground or the feet are softer"
    parameters = (EffectParameter("softening", "1", "of the contact's time constant", 0.5, 1.5, 3.0, 10.0),)
    near = ("joint_elasticity",)
    separate_by = "press the standing robot down with a known mass and log its height"

    def configure(self, site: Site, p: Values) -> None:
        factor = 1.0 + p["softening"]
        _soften(site, "geom_solref", factor, touching_geoms(site.robot))
        _soften(site, "pair_solref", factor, pairs_on_ground(site.robot))


def touching_geoms(robot: Robot) -> np.ndarray:
    """Numbers of the geoms that can touch others."""
    model = robot.model
    return np.flatnonzero((model.geom_contype > 0) | (model.geom_conaffinity > 0))


def can_touch(robot: Robot) -> bool:
    """Whether any two geoms can touch: where none can, contacts never come and go."""
    return len(touching_geoms(robot)) > 1 or robot.model.npair > 0


def grounds(robot: Robot) -> np.ndarray:
    """Touching geoms that belong to the world."""
    touching = touching_geoms(robot)
    return touching[robot.model.geom_bodyid[touching] == 0]


def own_touching(robot: Robot) -> np.ndarray:
    """Touching geoms of the robot itself: neither of the world nor of a body beside the robot, such as a ball."""
    return own_geoms(robot, np.setdiff1d(touching_geoms(robot), grounds(robot)))


def has_ground(robot: Robot) -> bool:
    """Whether a geom of the world can touch one of the robot."""
    model, ground, others = robot.model, grounds(robot), own_touching(robot)
    meets = model.geom_contype[ground][:, None] & model.geom_conaffinity[others]
    met = model.geom_contype[others] & model.geom_conaffinity[ground][:, None]
    return bool((meets | met).any())


def pairs_on_ground(robot: Robot, geoms: np.ndarray | None = None) -> np.ndarray:
    """Numbers of the model's <pair>s of the world with another body, or with one of these geoms.

    Their contacts have friction and softness of their own, whatever those of the geoms are.
    """
    model = robot.model
    both = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
    world = model.geom_bodyid[both] == 0
    meant = ~world if geoms is None else ~world & np.isin(both, geoms)
    return np.flatnonzero(world.any(axis=1) & meant.any(axis=1))


def left_feet(robot: Robot) -> np.ndarray:
    """Touching spheres and capsules on the side of positive y at the reset pose, where both sides have some."""
    touching = own_touching(robot)
    round_ones = [int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)]
    feet = touching[np.isin(robot.model.geom_type[touching], round_ones)]
    if len(feet) < 2:
        return np.zeros(0, dtype=int)
    y = at_reset(robot).geom_xpos[feet, 1]
    return feet[y > 1e-3] if (y < -1e-3).any() else np.zeros(0, dtype=int)


def unlike_materials(robot: Robot) -> dict[str, np.ndarray]:
    """{material: numbers of its geoms that can touch the ground}, of those beside which another one can.

    Where all that touches is of one material, its friction is that of the ground.
    """
    if not robot.file.materials:
        return {}
    own = own_touching(robot)
    touching = {name: np.intersect1d(own, geoms) for name, geoms in robot.materials.items()}
    return {name: geoms for name, geoms in touching.items() if 0 < len(geoms) < len(own)}


def _ground_decides(robot: Robot) -> bool:
    """Whether a geom of the world has a priority above another that touches."""
    priority, ground = robot.model.geom_priority, grounds(robot)
    return priority[ground].max() > priority[np.setdiff1d(touching_geoms(robot), ground)].min()


def _soften(site: Site, field: str, factor: np.ndarray, which: np.ndarray) -> None:
    """Multiply the time constant of the solref of some geoms or pairs by (rows, 1) factors."""
    direct = getattr(site.robot.model, field)[which, 0] < 0.0
    _scale(site, field, factor, which[~direct])
    if direct.any():
        # of the constant stiffness is the inverse square, damping the inverse: MuJoCo's "Solver parameters"
        _scale(site, field, factor**-2.0, which[direct])
        _scale(site, field, factor**-1.0, which[direct], (1,))


def _scale(
    site: Site, field: str, factor: np.ndarray, which: np.ndarray, columns: tuple[int, ...] = (0,)
) -> None:
    """Multiply numbers (their columns) of a field of some geoms or pairs by (rows, 1) factors."""
    if not len(which):
        return
    array = site.expand(field)
    where = np.ix_(np.arange(len(array))[site.rows], which, columns)
    array[where] = array[where] * factor[:, :, None]
