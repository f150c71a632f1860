"""Per-simulation MjModel fields of a mujoco.batch.Batch, written through the `sets` grammar."""

from types import MappingProxyType

import mujoco
import numpy as np

from dynreg.errors import RobotError, quoted
from dynreg.sim.masses import grow, moving_sites, weight_at
from dynreg.sim.sets import Assignment, combine, matching

_OBJECTS = MappingProxyType(
    {
        "body": mujoco.mjtObj.mjOBJ_BODY,
        "geom": mujoco.mjtObj.mjOBJ_GEOM,
        "jnt": mujoco.mjtObj.mjOBJ_JOINT,
        "dof": mujoco.mjtObj.mjOBJ_JOINT,
        "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
        "site": mujoco.mjtObj.mjOBJ_SITE,
        "tendon": mujoco.mjtObj.mjOBJ_TENDON,
        "sensor": mujoco.mjtObj.mjOBJ_SENSOR,
        "pair": mujoco.mjtObj.mjOBJ_PAIR,
    }
)


def names_of(model: mujoco.MjModel, prefix: str) -> list[str]:
    """Names of the rows of the fields with this prefix; dofs and positions carry their joint's name."""
    if prefix == "dof":
        return [model.joint(int(j)).name for j in model.dof_jntid]
    if prefix == "qpos":
        owner = np.searchsorted(model.jnt_qposadr, np.arange(model.nq), side="right") - 1
        return [model.joint(int(j)).name for j in owner]
    kind = _OBJECTS[prefix]
    count = getattr(model, "nu" if prefix == "actuator" else f"n{prefix}")
    return [mujoco.mj_id2name(model, kind, i) or "" for i in range(count)]


def own_field(batch, model: mujoco.MjModel, field: str) -> np.ndarray:
    """(n or 1, rows, ...) a field of the model, each simulation's own where they differ."""
    own = batch.expanded(field)
    return getattr(model, field)[None] if own is None else own


def set_field(batch, model: mujoco.MjModel, assignment: Assignment, values: np.ndarray) -> None:
    """Write `mj.<field>[elements][index]` of every simulation from (B,) values; RobotError on a wrong name."""
    field = assignment.path
    try:
        array = batch.expand(field)
    except (AttributeError, KeyError, ValueError, TypeError) as problem:
        raise RobotError(
            f"sets entry {assignment.text!r}: {problem}",
            expected="a field of MjModel that can differ between simulations, such as mj.body_mass",
            do="correct the field",
        ) from None
    if field.startswith("opt."):
        where: tuple = (slice(None), *(int(e) if e.isdigit() else e for e in assignment.elements))
    else:
        prefix = "qpos" if field in ("qpos0", "qpos_spring") else field.split("_")[0]
        if prefix not in _OBJECTS and prefix != "qpos":
            raise RobotError(
                f"sets entry {assignment.text!r}: rows of {field!r} have no names",
                expected=f"a field that starts with one of {quoted(sorted(_OBJECTS))}",
                do="correct the field",
            )
        rows = matching(names_of(model, prefix), assignment.elements, assignment.text)
        where = (slice(None), rows) if assignment.index is None else (slice(None), rows, assignment.index)
    try:
        old = array[where]
    except IndexError:
        raise RobotError(
            f"sets entry {assignment.text!r}: {field} has no such index",
            expected=f"indexes below {list(array.shape[1:] if field.startswith('opt.') else array.shape[2:])}",
            do="correct the index",
        ) from None
    array[where] = combine(assignment.op, old, values)


def modify(batch, model: mujoco.MjModel, assignment: Assignment, values: np.ndarray) -> None:
    """Apply a named modifier from (B,) values; RobotError where it cannot be applied.

    gravity [m/s^2, downwards], mass [kg or factor; inertia in proportion; a factor leaves bodies without mass as they
    are], added_mass [kg; at a site with the site's shape, on a body spread as that is], link_length [m or factor; the
    link's children, geometry, mass (as length) and inertia (as length cubed, a slender rod)]. The world is no body.
    """
    if assignment.path == "gravity":
        gravity = batch.expand("opt.gravity")
        gravity[:, 2] = -combine(assignment.op, -gravity[:, 2], values)
        return
    if assignment.path == "added_mass":
        _add_masses(batch, model, assignment, values)
        return
    bodies = 1 + matching(names_of(model, "body")[1:], assignment.elements, assignment.text)
    change = _set_mass if assignment.path == "mass" else _scale_link
    for body in bodies:
        change(batch, model, int(body), assignment, values)


def _set_mass(batch, model: mujoco.MjModel, body: int, assignment: Assignment, values: np.ndarray) -> None:
    old = batch.expand("body_mass")[:, body].copy()
    massless = old == 0.0
    if assignment.op != "*=" and massless.any():
        name = model.body(body).name
        raise RobotError(
            f"sets entry {assignment.text!r}: body {name or body!r} has no mass that its inertia could grow with",
            expected="bodies with a mass, or OP '*=', which leaves the others as they are",
            do=f"name the bodies, or give it mass with 'modifier.added_mass[{name or 'SITE'}] +='",
        )
    new = combine(assignment.op, old, values)
    factor = np.where(massless, 1.0, new / np.where(massless, 1.0, old))
    batch.expand("body_inertia")[:, body] *= factor[:, None]
    batch.expand("body_mass")[:, body] = new


def _add_masses(batch, model: mujoco.MjModel, assignment: Assignment, values: np.ndarray) -> None:
    sites, bodies = moving_sites(model), names_of(model, "body")
    for name in assignment.elements or ("",):
        if assignment.op != "+=" or not name or name not in (*sites, *bodies[1:]):
            raise RobotError(
                f"sets entry {assignment.text!r}",
                expected=f"'modifier.added_mass[NAME] +=' with a site out of {sites} or a body out of "
                f"{quoted(one for one in bodies[1:] if one)}",
                do="correct the entry",
            )
        if name in sites:
            weight_at(model, name).add(batch.expand, slice(None), values)
        else:
            grow(batch.expand, model, slice(None), bodies.index(name), values[:, None])


def _scale_link(batch, model: mujoco.MjModel, body: int, assignment: Assignment, values: np.ndarray) -> None:
    length = link_length(model, body)
    ratio = combine(assignment.op, np.full(len(values), length), values) / length
    for child in np.flatnonzero(model.body_parentid == body):
        if child != body:
            batch.expand("body_pos")[:, child] *= ratio[:, None]
    geoms = np.flatnonzero(model.geom_bodyid == body)
    batch.expand("geom_pos")[:, geoms] *= ratio[:, None, None]
    # numpy's numbers equal MuJoCo's enums, but are in no tuple of them
    kinds = [int(kind) for kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER)]
    long = [g for g in geoms if model.geom_type[g] in kinds]
    if long:
        size = batch.expand("geom_size")
        size[:, long, 1] *= ratio[:, None]
        batch.expand("geom_rbound")[:, long] = size[:, long, 0] + size[:, long, 1]
    batch.expand("body_ipos")[:, body] *= ratio[:, None]
    batch.expand("body_mass")[:, body] *= ratio
    batch.expand("body_inertia")[:, body] *= ratio[:, None] ** 3


def link_length(model: mujoco.MjModel, body: int) -> float:
    """Metres from a link's origin to its first child, or to its farthest geom where it is the last."""
    children = [c for c in np.flatnonzero(model.body_parentid == body) if c != body]
    if children:
        return float(np.linalg.norm(model.body_pos[children[0]]))
    geoms = np.flatnonzero(model.geom_bodyid == body)
    lengths = np.linalg.norm(model.geom_pos[geoms], axis=1) if len(geoms) else np.zeros(1)
    if not lengths.max() > 0:
        raise RobotError(
            f"link {model.body(body).name!r} has no length",
            expected="a child body or a geom away from the link's origin",
            do="set its fields one by one with mj.* instead of modifier.link_length",
        )
    return float(lengths.max())
