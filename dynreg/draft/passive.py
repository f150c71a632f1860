"""Joints that nothing drives, such as the hinge of a pole on a cart: their damping and dry friction as parameters."""

from collections.abc import Iterator, Sequence

import mujoco

from dynreg.draft.doubted import ALONE, Doubted
from dynreg.draft.drives import Drive, effective_inertia, name_of
from dynreg.draft.entry import Entry, Notes, listed, ranged, rounded
from dynreg.draft.joints import groups, identifier
from dynreg.draft.parameters import (
    COULOMB,
    DOUBLED,
    FIELDS,
    TOLERANCES,
    VISCOUS,
    WIDE,
    unit_of,
    values_of,
)
from dynreg.sim.held import loose_joints

SWUNG = 10.0  # rad/s^2 or m/s^2 at which such a joint moves that its weight does not load: much as a pendulum falls
REASON = (
    f"Of joints that nothing drives: dry friction from 0 to {COULOMB:.0%} of what their weight makes, damping to "
    f"{VISCOUS:.0%} of it per rad/s; about what the model states, from 1/{WIDE:g} to {WIDE:g} times, if that is more."
)


def passive_joints(model: mujoco.MjModel, drives: Sequence[Drive]) -> list[str]:
    """The hinges and slides of the robot that nothing moves but its motion.

    Not those that an actuator without a command, a tendon or an equality constraint holds.
    """
    driven = {model.joint(d.joint).id for d in drives}
    roots = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in driven}
    free = [j for j in loose_joints(model) if j not in driven]
    return [name_of(model, j) for j in free if int(model.body_rootid[model.jnt_bodyid[j]]) in roots]


def of_passive(doubted: Doubted, notes: Notes) -> tuple[Entry, ...]:
    """Dry friction and damping of each group of such joints; a note names them."""
    names = passive_joints(doubted.model, doubted.drives)
    if not names:
        return ()
    notes.add(
        f"no drive moves {listed(names)}: damping and dry friction there are parameters. A diagnosis looks for effects "
        "at driven joints alone"
    )
    return tuple(entry for kind in ("friction", "damping") for entry in _entries(doubted, names, kind))


def _entries(doubted: Doubted, names: Sequence[str], what: str) -> Iterator[Entry]:
    model = doubted.model
    for group, joints in groups(names, ALONE).items():
        name = identifier(f"{group or 'passive'}_{what}")
        target = f"mj.{FIELDS[what]}[{','.join(joints)}] ="
        values = values_of(model, what, joints)
        value = float(values[0])
        if (values != value).any():
            some = [j for j, v in zip(joints, values, strict=True) if v > 0]
            said = f"no drive moves them; factor on the model's, of at most {values.max():.3g}"
            target = f"mj.{FIELDS[what]}[{','.join(some)}] *="
            yield ranged(name, target, 1.0, "1", 1 / WIDE, WIDE, DOUBLED, said)
            continue
        most = rounded((COULOMB if what == "friction" else VISCOUS) * min(_weight(model, j) for j in joints))
        unit = unit_of(model, joints[0], what)
        if WIDE * value >= most:
            ends, tolerance, said = (value / WIDE, WIDE * value), DOUBLED, "of the model"
            yield ranged(name, target, value, unit, *ends, tolerance, f"no drive moves it; {said}")
            continue
        # a linear range; what the model states is next to nothing, so that 1 sigma is a share of the range
        tolerance = TOLERANCES[what] * (rounded(most / value) if value > 0 else 1.0)
        said = "next to none" if value > 0 else "none"
        yield ranged(
            name, target, value, unit, 0.0, most, tolerance, f"no drive moves it; the model says {said}"
        )


def _weight(model: mujoco.MjModel, joint: str) -> float:
    """The force [N*m or N] that the weight of a joint's links makes on it, or their inertia where that makes none."""
    inertia, load = effective_inertia(model, model.joint(joint).id)
    return max(load, SWUNG * inertia)
