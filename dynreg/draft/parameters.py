"""The parameters that a lab doubts of a robot: masses, damping, dry friction, rotors, gains, the ground."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np

from dynreg.draft.drives import OF_MODEL, QUICK, Drive, effective_inertia, is_hinge
from dynreg.draft.entry import Entry
from dynreg.draft.ground import Ground
from dynreg.draft.joints import groups, identifier
from dynreg.draft.measured import AGREES
from dynreg.rng import stream

MOST = 16  # parameters in all, about
ALONE = 7  # joints of a robot that stands on the ground by its base, up to which each has friction of its own
KINDS = 4  # types of joints of other robots that have numbers of their own
GAINED = 3  # types of joints of a robot that stands up to which each has a gain of its own
WIDE = 5.0  # factor about the nominal in which friction and damping are looked for
COULOMB = 0.15  # largest dry friction where the model has none, as a share of the drive's torque
VISCOUS = 0.1  # largest damping, as that share per rad/s: ten times as fast, and it takes all of the torque
ROTOR = 0.5  # largest inertia of a rotor, as a share of the joint's
USED = 0.6  # share of its torque that the largest of a log is of a drive: dry friction is up to 0.21 of that in an arm
WEAKEST = 0.02  # of the strongest joint's torque and inertia: no joint of one robot has less, whatever its link weighs
SPARE = 4.0  # times what holds and quickens a joint: the torque of a drive of which nothing is stated
PAYLOAD = 4.0  # times the last link's mass, where its drives hold no more: a gripper beside a flange
POSES = 128  # of an arm that are looked at
EASY = 0.9  # share of them in which its drives hold a payload
FRAME = 1e-4  # of the mass that moves: what weighs less marks a place, and no multiple of it is a payload
# Ranges, as factors on the nominal.
MASSES = (0.5, 2.0)  # of what may carry something
LINKS = (0.7, 1.4)  # of all else: 3.5 times the tolerance of a mass, to each side
GAINS = (0.4, 2.5)
LIMITS = (0.5, 1.5)
FLOORS = (0.3, 2.0)
TOLERANCES = {  # 1 sigma of what is stated, relative to it; of what is not, relative to the range
    "mass": 0.1,
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
    f"{PAYLOAD:g}, or to what its drives hold), of all else from {LINKS[0]:g} to {LINKS[1]:g}; gains from "
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


def parameters(doubted: Doubted) -> tuple[Entry, ...]:
    """The parameters, the most doubted first; about `MOST` at most."""
    found = [
        *_masses(doubted),
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


def _scaled(
    name: str, sets: str, nominal: float, unit: str, low: float, high: float, tolerance: float, said: str
):
    return Entry(
        {
            "name": name,
            "unit": unit,
            "nominal": nominal,
            "low": low,
            "high": high,
            "scale": "log" if low > 0 else "linear",
            "tolerance": tolerance,
            "sets": [sets],
        },
        said,
    )


def links(model: mujoco.MjModel) -> dict[int, list[int]]:
    """{body that moves by joints of its own: itself and what is welded to it} of those with a mass."""
    out: dict[int, list[int]] = {}
    for body in range(1, model.nbody):
        weld = int(model.body_weldid[body])
        if weld > 0:
            out.setdefault(weld, []).append(body)
    return {w: bodies for w, bodies in out.items() if sum(model.body_mass[b] for b in bodies) > 0}


def _masses(doubted: Doubted) -> Iterator[Entry]:
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
    most = PAYLOAD if mass < FRAME * whole else max(PAYLOAD, _rounded(1.0 + _held(doubted, tip[0]) / mass))
    held = "; as much as the drives hold in most poses" if most > PAYLOAD else ""
    yield _mass(model, name, bodies, (MASSES[0], most), f"{said}: a payload shows here{held}")
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


def _moved(doubted: Doubted) -> dict[int, list[int]]:
    """The links of the robot: of the trees that its drives, or its free base, move."""
    model = doubted.model
    roots = {int(model.body_rootid[model.joint(d.joint).bodyid[0]]) for d in doubted.drives}
    return {w: bodies for w, bodies in links(model).items() if int(model.body_rootid[w]) in roots}


def _tip(model: mujoco.MjModel, drives: Sequence[Drive], moved: Mapping[int, list[int]]) -> list[int] | None:
    """The links behind an arm's last joint, or behind that on which its gripper hangs; None for several limbs."""
    driven = [int(model.joint(d.joint).bodyid[0]) for d in drives]
    ends = [b for b in driven if not any(other != b and other in _below(model, b) for other in driven)]
    holding = [b for b in driven if set(ends) <= _below(model, b)]
    if not holding:
        return None
    return [w for w in moved if w in _below(model, holding[-1])] or None


def _held(doubted: Doubted, tip: int) -> float:
    """The mass [kg] at the centre of mass of a body that the drives before it hold in most of the arm's poses.

    In each pose the least, over its joints, of the torque that a drive has to spare, over the lever of that mass.
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
        found.append(np.min(spare / np.maximum(np.abs(model.opt.gravity @ moved)[dofs], 1e-9)))
    return float(np.quantile(found, 1.0 - EASY))


def _below(model: mujoco.MjModel, body: int) -> set[int]:
    """A body and all that hangs on it."""
    out = {body}
    for other in range(body + 1, model.nbody):
        if int(model.body_parentid[other]) in out:
            out.add(other)
    return out


def _mass(
    model: mujoco.MjModel, name: str, bodies: Sequence[int], ends: tuple[float, float], said: str
) -> Entry:
    (least, most), tolerance = ends, TOLERANCES["mass"]
    heavy = [b for b in bodies if model.body_mass[b] > 0]
    mass = float(sum(model.body_mass[b] for b in heavy))
    names = ",".join(model.body(b).name for b in heavy)
    if len(heavy) == 1:
        return _scaled(
            name, f"modifier.mass[{names}] =", mass, "kg", least * mass, most * mass, tolerance, said
        )
    return _scaled(
        name,
        f"modifier.mass[{names}] *=",
        1.0,
        "1",
        least,
        most,
        tolerance,
        f"{said}; {mass:.4g} kg together",
    )


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
    source = "of the model or stated" if key == "torque_limit" else mine[0].said
    said = f"of the {mine[0].kind} drives; {source}"
    target = f"port.drive.{key}[{_pattern([d.joint for d in mine], doubted)}]"
    if len(values) == 1 and (value := values.pop()) > 0:
        low, high = (float(f"{end * value:.3g}") for end in ends)
        unit = _unit_of(key, mine[0], doubted.model)
        yield _scaled(name, f"{target} =", value, unit, low, high, tolerance, said)
    else:
        yield _scaled(name, f"{target} *=", 1.0, "1", *ends, tolerance, said)


def _doubt(mine: Sequence[Drive], key: str) -> tuple[tuple[float, float], float]:
    """((low, high) as factors on the nominal, tolerance) of a number of these drives."""
    if key == "torque_limit":
        return LIMITS, TOLERANCES[key]
    if all(key in d.measured for d in mine):
        return (1.0 - AGREES, 1.0 + AGREES), AGREES / 2
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
    field = {"damping": "dof_damping", "friction": "dof_frictionloss", "armature": "dof_armature"}[what]
    split = {"": [d.joint for d in doubted.drives]} if whole else doubted.grouped
    for group, names in split.items():
        name = identifier(f"{group}_{what}") if group else what
        values = _field(doubted.model, field, names)
        target = f"mj.{field}[{','.join(names)}]"
        most = _rounded(float(np.median([_largest(doubted, n, what) for n in names])))
        tolerance = DOUBLED if what != "armature" and values.any() else TOLERANCES[what]
        if (values <= 0).all():
            said = "the model says none"
            yield _scaled(
                name, f"{target} =", 0.0, _unit(doubted.model, names[0], what), 0.0, most, tolerance, said
            )
        elif np.ptp(values) == 0:
            value = float(values[0])
            high = max(WIDE * value, min(most, WIDE**2 * value) if what != "armature" else 0.0)
            unit = _unit(doubted.model, names[0], what)
            yield _scaled(name, f"{target} =", value, unit, value / WIDE, high, tolerance, "of the model")
        else:
            some = [n for n, v in zip(names, values, strict=True) if v > 0]
            target = f"mj.{field}[{','.join(some)}]"
            said = f"factor on the model's {values[values > 0].min():.3g} to {values.max():.3g}"
            yield _scaled(name, f"{target} *=", 1.0, "1", 1 / WIDE, WIDE, tolerance, said)


def _field(model: mujoco.MjModel, field: str, names: Sequence[str]) -> np.ndarray:
    return np.array([float(getattr(model, field)[model.joint(n).dofadr[0]]) for n in names])


def _largest(doubted: Doubted, joint: str, what: str) -> float:
    """The largest friction, damping or rotor inertia that is looked for where the model has none."""
    if what == "armature":
        return ROTOR * doubted.inertias[joint]
    return (COULOMB if what == "friction" else VISCOUS) * doubted.strengths[joint]


def _rounded(value: float) -> float:
    return float(f"{value:.2g}")


def _unit(model: mujoco.MjModel, joint: str, what: str) -> str:
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
        yield _scaled(
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
        yield _scaled("ground_friction", target, value, "1", low, high, TOLERANCES["ground"], said)
