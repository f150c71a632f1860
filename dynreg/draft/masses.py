"""The masses that a lab doubts: of the base, of what an arm carries, and of all other links."""

from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np

from dynreg.draft.doubted import KINDS, Doubted
from dynreg.draft.drives import Drive
from dynreg.draft.entry import Entry, ranged, rounded
from dynreg.draft.joints import groups, identifier
from dynreg.rng import stream
from dynreg.sim.held import tied
from dynreg.sim.lint import FACTOR

PAYLOAD = 4.0  # times the last link's mass, where its drives hold no more: a gripper beside a flange
OWN = 1.0  # of the arm's own mass: few arms carry more than they weigh, whatever torques their models state
POSES = 128  # of an arm that are looked at
EASY = 0.9  # share of them in which its drives hold a payload
FRAME = 1e-4  # of the mass that moves: what weighs less marks a place, and no multiple of it is a payload
# Ranges, as factors on the nominal.
MASSES = (0.5, 2.0)  # of what may carry something
LINKS = (0.7, 1.4)  # of all else: 3.5 times the tolerance of a mass, to each side
MOST = MASSES[0] * FACTOR  # times the last link's mass: the check takes a wider range for a slip
MASS = 0.1  # 1 sigma of a mass that is stated, relative to it
REACHED = 14.0  # such sigmas, in which a range of a payload ends: a wide one is as open to a log as one to `PAYLOAD`
LOADED = 1e-3  # N: less of a kilogram's weight on a drive is none, as that of a slide that lies level


def masses(doubted: Doubted) -> Iterator[Entry]:
    """The masses of the robot's links, that which may carry something first."""
    model = doubted.model
    moved = _moved(doubted)
    if not moved:
        return
    first = next(iter(moved))
    if doubted.floating:
        yield _mass(model, "base_mass", moved.pop(first), MASSES, "the base and what it carries")
        if moved:
            every = [b for bodies in moved.values() for b in bodies]
            yield _mass(model, "limb_mass", every, LINKS, "all else that moves")
        return
    tip = _tip(model, doubted.drives, moved)
    if tip is None:
        yield from _limbs(doubted, moved)
        return
    last, links_of = len(tip) == 1, moved
    bodies = [b for w in tip for b in links_of.pop(w)]
    said = "the last link" if last else f"the {len(tip)} links behind the arm's last joint"
    if not moved:
        said = "the only link" if last else f"all {len(tip)} links"
    name = ("tip_mass" if last else "hand_mass") if moved else "moving_mass"
    mass = float(sum(model.body_mass[b] for b in bodies))
    whole = mass + float(sum(model.body_mass[b] for rest in moved.values() for b in rest))
    most, why = _payload(doubted, tip[0], mass, whole)
    said = f"{said}: a payload shows here{why}"
    yield _mass(
        model, name, bodies, (MASSES[0], most), said, max(MASS, rounded(float(np.log(most)) / REACHED))
    )
    if moved:
        every = [b for bodies in moved.values() for b in bodies]
        yield _mass(model, "link_mass", every, LINKS, "all links before that")


def _limbs(doubted: Doubted, moved: Mapping[int, list[int]]) -> Iterator[Entry]:
    """Of a robot held by its base, with several limbs: the masses of the links behind joints of one type."""
    model = doubted.model
    split = groups([d.joint for d in doubted.drives], KINDS)
    for group, names in split.items():
        links_of = [int(model.joint(n).bodyid[0]) for n in names]
        bodies = [b for w in links_of for b in moved.get(w, [])]
        if bodies:
            name = identifier(f"{group}_mass") if group else "link_mass"
            yield _mass(model, name, bodies, MASSES, "the links behind these joints")


def links(model: mujoco.MjModel) -> dict[int, list[int]]:
    """{body that moves by joints of its own: itself and what is welded to it} of those with a mass."""
    out: dict[int, list[int]] = {}
    for body in range(1, model.nbody):
        weld = int(model.body_weldid[body])
        if weld > 0:
            out.setdefault(weld, []).append(body)
    return {w: bodies for w, bodies in out.items() if sum(model.body_mass[b] for b in bodies) > 0}


def _moved(doubted: Doubted) -> dict[int, list[int]]:
    """The links of the robot: of the trees that its drives, or its free base, move."""
    model = doubted.model
    roots = {int(model.body_rootid[model.joint(d.joint).bodyid[0]]) for d in doubted.drives}
    return {w: bodies for w, bodies in links(model).items() if int(model.body_rootid[w]) in roots}


def _tip(model: mujoco.MjModel, drives: Sequence[Drive], moved: Mapping[int, list[int]]) -> list[int] | None:
    """The links behind an arm's last joint, or behind that on which its gripper hangs; None for several limbs."""
    joints = tied(model, {model.joint(d.joint).id for d in drives})
    driven = [int(model.jnt_bodyid[j]) for j in sorted(joints)]
    ends = [b for b in driven if not any(other != b and other in _below(model, b) for other in driven)]
    holding = [b for b in driven if set(ends) <= _below(model, b)]
    if not holding:
        return None
    return [w for w in moved if w in _below(model, holding[-1])] or None


def _payload(doubted: Doubted, tip: int, mass: float, whole: float) -> tuple[float, str]:
    """How many times the mass of an arm's last links there may be with a payload; what a comment says of it.

    mass, whole : of these links, and of the whole arm [kg].
    """
    if mass < FRAME * whole:
        return PAYLOAD, ""
    held = _held(doubted, tip)
    most = min(rounded(1.0 + min(held, OWN * whole) / mass), MOST)
    if most <= PAYLOAD:
        return PAYLOAD, ""
    if most == MOST:
        return most, f"; at most {MOST:g} times the model's"
    weighs = held > OWN * whole
    return most, "; at most what the arm weighs" if weighs else "; as much as the drives hold in most poses"


def _held(doubted: Doubted, tip: int) -> float:
    """The mass [kg] at the centre of mass of a body that the drives before it hold in most of the arm's poses.

    In each pose the least, over its joints, of the torque that a drive has to spare, over the lever of that mass. 0
    where its weight loads no drive, as on a level slide: then nothing is told of a payload.
    """
    model, data, rng = doubted.model, mujoco.MjData(doubted.model), stream(0, "payload")
    drives = {model.joint(d.joint).id: d for d in doubted.drives}
    before = [j for j in drives if tip in _below(model, int(model.jnt_bodyid[j]))]
    dofs, places = model.jnt_dofadr[before], model.jnt_qposadr[before]
    most = np.array([doubted.most(drives[j]) for j in before])
    ends = np.where(model.jnt_limited[before, None] > 0, model.jnt_range[before], (-np.pi, np.pi))
    moved, found = np.zeros((3, model.nv)), []
    for _ in range(POSES):
        data.qpos[:], data.qvel[:] = model.qpos0, 0.0
        data.qpos[places] = rng.uniform(*ends.T)
        mujoco.mj_forward(model, data)
        mujoco.mj_jacBodyCom(model, data, moved, None, tip)
        spare = np.maximum(most - np.abs(data.qfrc_bias[dofs]), 0.0)
        weight = np.abs(model.opt.gravity @ moved)[dofs]
        if (loads := weight > LOADED).any():
            found.append(np.min(spare[loads] / weight[loads]))
    return float(np.quantile(found, 1.0 - EASY)) if found else 0.0


def _below(model: mujoco.MjModel, body: int) -> set[int]:
    """A body and all that hangs on it."""
    out = {body}
    for other in range(body + 1, model.nbody):
        if int(model.body_parentid[other]) in out:
            out.add(other)
    return out


def _mass(
    model: mujoco.MjModel,
    name: str,
    bodies: Sequence[int],
    ends: tuple[float, float],
    said: str,
    tolerance: float = MASS,
) -> Entry:
    least, most = ends
    heavy = [b for b in bodies if model.body_mass[b] > 0]
    mass = float(sum(model.body_mass[b] for b in heavy))
    names = ",".join(model.body(b).name for b in heavy)
    if len(heavy) == 1:
        return ranged(
            name, f"modifier.mass[{names}] =", mass, "kg", least * mass, most * mass, tolerance, said
        )
    return ranged(
        name,
        f"modifier.mass[{names}] *=",
        1.0,
        "1",
        least,
        most,
        tolerance,
        f"{said}; {mass:.4g} kg together",
    )
