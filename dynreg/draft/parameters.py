"""The parameters that a lab doubts of a robot: masses, damping, dry friction, rotors, gains, the ground."""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from dynreg.draft.doubted import Doubted
from dynreg.draft.drives import Drive, is_hinge
from dynreg.draft.entry import Entry, ranged, rounded
from dynreg.draft.joints import groups, identifier
from dynreg.draft.masses import LINKS, MASSES, PAYLOAD, masses
from dynreg.draft.masses import MOST as MASS_MOST
from dynreg.draft.measured import AGREES

MOST = 16  # parameters in all, about
GAINED = 3  # types of joints of a robot that stands up to which each has a gain of its own
WIDE = 5.0  # factor about the nominal in which friction and damping are looked for
COULOMB = 0.15  # largest dry friction where the model has none, as a share of the drive's torque
VISCOUS = 0.1  # largest damping, as that share per rad/s: ten times as fast, and it takes all of the torque
ROTOR = 0.5  # largest inertia of a rotor, as a share of the joint's
FIELDS = {
    "damping": "dof_damping",
    "friction": "dof_frictionloss",
    "armature": "dof_armature",
}  # of MuJoCo's model
# Ranges, as factors on the nominal.
GAINS = (0.4, 2.5)
LIMITS = (0.5, 1.5)
FLOORS = (0.3, 2.0)
TOLERANCES = {  # 1 sigma of what is stated, relative to it; of what is not, relative to the range
    "gain": 0.12,
    "rate_gain": 0.3,
    "torque_limit": 0.15,
    "friction": 0.3,
    "damping": 0.3,
    "armature": 0.3,
    "lag": 0.3,
    "ground": 0.3,
}
GUESSED = 0.7  # of a gain that is guessed here
DOUBLED = 0.5  # of friction and damping that the model states: half of that is nothing unusual
REASONS = (
    f"Ranges: masses of what may carry something from {MASSES[0]:g} to {MASSES[1]:g} times the model's (of an arm to "
    f"{PAYLOAD:g}, or to what its drives hold and no more than it weighs, if that is more; at most {MASS_MOST:g}), of "
    f"all else from {LINKS[0]:g} to {LINKS[1]:g}; gains from "
    f"{GAINS[0]:g} to {GAINS[1]:g} ({AGREES:.0%} to each side where the log's torques follow them), torque limits from "
    f"{LIMITS[0]:g} to {LIMITS[1]:g}. Friction and damping that the model states, from 1/{WIDE:g} to {WIDE:g} times, "
    f"or to what it may be where the model states none, if that is more (at most {WIDE**2:g} times); that it does not, "
    f"from 0 to {COULOMB:.0%} of the drive's torque, and to "
    f"{VISCOUS:.0%} of it per rad/s; armature to {ROTOR:.0%} of the joint's inertia.",
    "tolerance is 1 sigma of what the lab knows, relative to nominal; to the width of the range where nominal is 0.",
)
TRADE = (
    "A log without torques tells only ratios: gains, torque limits, friction, damping and inertia that all grow by one "
    "factor move a joint alike, but for its weight. What the lab is surest of has the smallest tolerance."
)


def parameters(doubted: Doubted) -> tuple[Entry, ...]:
    """The parameters, the most doubted first; about `MOST` at most."""
    found = [
        *masses(doubted),
        *_gains(doubted),
        *_of_joints(doubted, "friction"),
        *_of_joints(doubted, "damping"),
        *_lags(doubted),
        *_ground(doubted),
    ]
    rotors = list(_of_joints(doubted, "armature"))
    if len(found) + len(rotors) > MOST:
        rotors = list(_of_joints(doubted, "armature", whole=True))
    return (*found, *rotors)


def reasons(doubted: Doubted) -> tuple[str, ...]:
    """What is said above the parameters: how ranges and tolerances came about."""
    return (*REASONS, TRADE) if any(d.kind != "torque" for d in doubted.drives) else REASONS


def _gains(doubted: Doubted) -> Iterator[Entry]:
    """The gain of each kind of drive, one factor a kind of joint; of the whole robot its rate gain and torque limit.

    Not the gain of torque drives: twice the torque moves a robot as half its masses and half its friction would.
    """
    keys = {"position": "gain", "dcmotor": "kt", "velocity": "rate_gain"}
    usual = {"kt": "torque_constant", "rate_gain": "speed_gain"}
    for kind, key in keys.items():
        alike = [d for d in doubted.drives if d.kind == kind]
        split = (
            groups([d.joint for d in alike], GAINED) if doubted.floating else {"": [d.joint for d in alike]}
        )
        for group, names in split.items():
            mine = [d for d in alike if d.joint in names]
            name = identifier(f"{group}_{key}") if group else usual.get(key, key)
            yield from _of_drives(doubted, mine, name, key)
    servos = [d for d in doubted.drives if d.kind == "position" and d.rate_gain > 0]
    yield from _of_drives(doubted, servos, "rate_gain", "rate_gain")
    limited = [d for d in doubted.drives if d.kind in ("position", "velocity") and d.limit is not None]
    yield from _of_drives(doubted, limited, "torque_limit", "torque_limit")


def _of_drives(doubted: Doubted, mine: Sequence[Drive], name: str, key: str) -> Iterator[Entry]:
    """One number of these drives: its value where they share it, else a factor on all of theirs."""
    if not mine:
        return
    ends, tolerance = _doubt(mine, key)
    values = {d.limit if key == "torque_limit" else getattr(d, key) for d in mine}
    source = mine[0].said
    if key == "torque_limit":
        known = [key in d.measured for d in mine]
        source = "of the log" if all(known) else f"of the model{', the log' if any(known) else ''} or stated"
    said = f"of the {mine[0].kind} drives; {source}"
    target = f"port.drive.{key}[{_pattern([d.joint for d in mine], doubted)}]"
    if len(values) == 1 and (value := values.pop()) > 0:
        low, high = (float(f"{end * value:.3g}") for end in ends)
        unit = _unit_of(key, mine[0], doubted.model)
        yield ranged(name, f"{target} =", value, unit, low, high, tolerance, said)
    else:
        yield ranged(name, f"{target} *=", 1.0, "1", *ends, tolerance, said)


def _doubt(mine: Sequence[Drive], key: str) -> tuple[tuple[float, float], float]:
    """((low, high) as factors on the nominal, tolerance) of a number of these drives."""
    if all(key in d.measured for d in mine):
        return (1.0 - AGREES, 1.0 + AGREES), AGREES / 2
    if key == "torque_limit":
        return LIMITS, TOLERANCES[key]
    if mine[0].guessed:
        return GAINS, GUESSED
    return GAINS, TOLERANCES.get(key, TOLERANCES["gain"])


def _unit_of(key: str, drive: Drive, model: mujoco.MjModel) -> str:
    hinge = is_hinge(model, model.joint(drive.joint).id)
    force, way = ("N*m", "rad") if hinge else ("N", "m")
    units = {
        "gain": f"{force}/{way}",
        "rate_gain": f"{force}*s/{way}",
        "kt": f"{force}/A",
        "torque_limit": force,
    }
    return units[key]


def _pattern(names: Sequence[str], doubted: Doubted) -> str:
    return "*" if len(names) == len(doubted.drives) else ",".join(names)


def _of_joints(doubted: Doubted, what: str, whole: bool = False) -> Iterator[Entry]:
    """Damping, dry friction or rotors' inertia of each group of joints; `whole` : one of all."""
    field = FIELDS[what]
    split = {"": [d.joint for d in doubted.drives]} if whole else doubted.grouped
    for group, names in split.items():
        name = identifier(f"{group}_{what}") if group else what
        values = values_of(doubted.model, what, names)
        target = f"mj.{field}[{','.join(names)}]"
        most = rounded(float(np.median([_largest(doubted, n, what) for n in names])))
        tolerance = DOUBLED if what != "armature" and values.any() else TOLERANCES[what]
        if (values <= 0).all():
            said = "the model says none"
            yield ranged(
                name, f"{target} =", 0.0, unit_of(doubted.model, names[0], what), 0.0, most, tolerance, said
            )
        elif np.ptp(values) == 0:
            value = float(values[0])
            high = max(WIDE * value, min(most, WIDE**2 * value) if what != "armature" else 0.0)
            unit = unit_of(doubted.model, names[0], what)
            yield ranged(name, f"{target} =", value, unit, value / WIDE, high, tolerance, "of the model")
        else:
            some = [n for n, v in zip(names, values, strict=True) if v > 0]
            target = f"mj.{field}[{','.join(some)}]"
            said = f"factor on the model's {values[values > 0].min():.3g} to {values.max():.3g}"
            yield ranged(name, f"{target} *=", 1.0, "1", 1 / WIDE, WIDE, tolerance, said)


def values_of(model: mujoco.MjModel, what: str, names: Sequence[str]) -> np.ndarray:
    """(J,) damping, dry friction or rotors' inertia of these joints, as the model states it."""
    field = FIELDS[what]
    return np.array([float(getattr(model, field)[model.joint(n).dofadr[0]]) for n in names])


def _largest(doubted: Doubted, joint: str, what: str) -> float:
    """The largest friction, damping or rotor inertia that is looked for where the model has none."""
    if what == "armature":
        return ROTOR * doubted.inertias[joint]
    return (COULOMB if what == "friction" else VISCOUS) * doubted.strengths[joint]


def unit_of(model: mujoco.MjModel, joint: str, what: str) -> str:
    """The unit of a joint's damping, dry friction or rotor."""
    hinge = is_hinge(model, model.joint(joint).id)
    if what == "armature":
        return "kg*m^2" if hinge else "kg"
    force, way = ("N*m", "rad") if hinge else ("N", "m")
    return force if what == "friction" else f"{force}*s/{way}"


def _lags(doubted: Doubted) -> Iterator[Entry]:
    """The time constant of actuators that filter their commands."""
    slow = [d for d in doubted.drives if d.lag > 0]
    if slow:
        names = ",".join(d.joint for d in slow)
        yield ranged(
            "lag",
            f"mj.actuator_dynprm[{names}][0] *=",
            1.0,
            "1",
            0.3,
            3.0,
            TOLERANCES["lag"],
            f"factor on {slow[0].lag:g} s of the model",
        )


def _ground(doubted: Doubted) -> Iterator[Entry]:
    """Friction between the ground and what stands on it."""
    ground = doubted.ground
    if ground is not None and ground.friction is not None:
        names = ",".join((*ground.scene, *ground.feet))
        value = ground.friction
        said = "of the model, between the ground and what touches it first"
        low, high = FLOORS[0] * value, max(FLOORS[1] * value, 1.2)
        target = f"mj.geom_friction[{names}][0] ="
        yield ranged("ground_friction", target, value, "1", low, high, TOLERANCES["ground"], said)
