"""What an effect is: one physical cause that a plain model leaves out, written against ports.

An effect changes a simulator at the ports that it overrides, for the simulators (rows) that have it; every
engine that offers a port calls it there, so an effect is written once. Rows are independent of each other.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import numpy as np

from dynreg.errors import quoted
from dynreg.sim.effects.on_slides import ON_SLIDES, slides_of, unit_at
from dynreg.sim.ports import Ports, slice_of
from dynreg.sim.robot import Robot

Values = Mapping[str, np.ndarray]  # the effect's parameters by name, each (rows, 1)
DEGREE = np.pi / 180


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect.

    unit : of the value. per : the quantity that sizes are multiples of: "1", "torque" (the joint's torque limit),
    "stiffness" (of its servo), "inertia" (of the joint), "length" (joint to centre of mass), "mass" (of the heaviest
    body that moves), "command" (the largest one of a drive that is told a speed; else 1: such units are written for
    positions).
    weak, medium, strong : sizes in multiples of `per`; below weak the effect is not worth naming. A parameter
    of shape (how fast, how wide) has the same three sizes: its typical value.
    most : largest size that a fit may reach. signed : whether the size can be negative. inverse : the effect
    grows as the value falls (a limit), so that fits work on 1 / value. tried : values of a shape that a fit cannot walk
    to (a count of cycles): a screen tries them all, to first order. shared : a simpler effect has it too (the mean
    of asymmetric friction is dry friction): it alone does not make this effect worth naming.
    """

    name: str
    unit: str
    meaning: str
    weak: float
    medium: float
    strong: float
    most: float
    per: Literal["1", "torque", "stiffness", "inertia", "length", "mass", "command"] = "1"
    signed: bool = False
    inverse: bool = False
    shape: bool = False
    tried: tuple[float, ...] = ()
    shared: bool = False

    def size(self, name: str) -> float:
        """The size called weak, medium or strong, in multiples of `per`."""
        return {"weak": self.weak, "medium": self.medium, "strong": self.strong}[name]


@dataclass
class Moment:
    """What an effect sees of its rows at one time step: shapes (rows, joints) unless stated.

    time : (rows, 1) [s] since the log began. h : (rows, 1) the time step [s].
    q, v : position and velocity of the joints. load : gravity and spring torque [N m].
    torque : what the drives give [N m]; friction sees it less the drives' damping (a motor's back-EMF).
    limit, stiffness, rate, damping, inertia : of the drive, and the joint's inertia. fade : share of the limit that the
    drive loses for one unit of speed. memory : the effect's own state, kept between time steps.
    past : command `delay` (rows, 1) [s] ago, averaged over the time step. ago : position and speed that the drive's own
    encoder said `delay` [s] ago (at most 0.2); for `feedback`. draw : of `Run.draws`, for this command.
    Drives of a planar base give speeds, which are its q and v here, and `speeds` is true; it has neither torques nor
    inertia. For `roll` v and q are the speeds [m/s] of the wheels as the time step begins and ends.
    """

    h: Any = 0.0
    q: Any = None
    v: Any = None
    torque: Any = None
    load: Any = None
    limit: Any = None
    stiffness: Any = None
    inertia: Any = None
    rate: Any = None
    damping: Any = None
    fade: Any = None
    past: Callable[[np.ndarray], np.ndarray] | None = None
    ago: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    now: Callable[[], np.ndarray] | None = None
    drawn: Callable[[], np.ndarray] | None = None
    speeds: bool = False
    memory: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def time(self) -> np.ndarray:
        """(rows, 1) [s] since the log began."""
        return self.now()

    @property
    def draw(self) -> np.ndarray:
        """(rows, joints) random numbers, one for each command; 0 where the run has none."""
        return self.drawn()


@dataclass(frozen=True)
class Site:
    """Where a static effect writes: the ports and the model fields of its rows.

    rows : index of its simulators. joints : numbers of its drives (columns of the ports). expand(field) is the
    MjModel field of all simulators (B, ...), to be changed in place at `rows`; an engine without a MuJoCo model
    has no such fields. memory : the effect's own state, which `Moment.memory` then holds. at : the term's place.
    """

    robot: Robot
    ports: Ports
    rows: Any
    joints: np.ndarray
    expand: Callable[[str], np.ndarray]
    memory: dict[str, np.ndarray] = field(default_factory=dict)
    at: tuple[str, ...] = ()

    def drive(self, key: str, change: Callable[[np.ndarray], np.ndarray]) -> None:
        """Replace one key of the drives of these rows and joints by `change` of it."""
        self._change(self.ports.drive[key], change)

    def friction(self, key: str, change: Callable[[np.ndarray], np.ndarray]) -> None:
        """Replace one key of the joints' friction."""
        self._change(self.ports.friction[key], change)

    def sensor(self, key: str, change: Callable[[np.ndarray], np.ndarray]) -> None:
        """Replace one key of the joints' encoders."""
        self._change(self.ports.sensor[key], change)

    def _change(self, array: np.ndarray, change: Callable[[np.ndarray], np.ndarray]) -> None:
        where = np.ix_(np.arange(len(array))[self.rows], self.joints)
        array[where] = change(array[where])


class Effect:
    """One cause. Subclass it, set the attributes, write the ports it acts on; the others stay None.

    id : stable name. acts_on : command, drive, friction, transmission, body, contact or sensor.
    group : the exact equivalence group; no excitation of the standard protocol separates its members.
    near : effects that only the right excitation separates from this one. separate_by : that experiment.
    scope : where it acts, and so what the names of a term's place are: "joint" (one, several or all joints), "body"
    (a body or a tool frame; without a name the one that the effect takes for granted), "material" (one of robot.toml;
    without a name as for a body), "robot" (the whole).

    Ports
    -----
    remodel(robot) : the robot with another model; simulators that have the effect run on that, apart from others, and
        only on the mujoco engine.
    configure(site, p) : write model fields and port constants once, before anything moves.
    feedback(q, v, x, p) : (rows, joints) position and speed that the drive's encoder says -> those that its loop sees.
    begin(robot, batch, rows) : change the state in which an episode starts, in a mujoco.batch.Batch of that model.
    command(u, x, p) : (rows, joints) commands -> commands. `recalls` is true where it looks at commands alone, and at
        the joint's `q` and `v` only to begin: then it is called with those told before a run, too, as if the joint had
        stood on the first of these, so that its memory is that of then.
    encoder(x, p) : how far ahead of the joint the encoder stands [rad] and how much faster it turns, (rows, joints)
        each, for one that does not sit on the joint, or runs out of true. It is asked at first, some times over, when
        `x.torque` is what the drive gives, then after every time step. Both the loop and the log have what it says.
    drive(torque, x, p) : (rows, joints) drive torque -> torque that reaches the joint.
    friction(x, p) : (rows, joints) dry friction [N m] to add to the bound, at the present speed and load.
    roll(speed, x, p) : (rows, wheels) [m/s] that the wheels of a base turn at -> that they roll over the ground at,
        both the mean over the time step.
    observe(states, columns, times, p) : (rows, T+1, S) state vectors -> what the log holds; `columns` by kind
        ("position", "velocity", "base") of the effect's joints, positions "moving" and velocities "moving at" of
        those that log both, times (rows, T+1) [s] since the episode began.
    """

    id: ClassVar[str]
    acts_on: ClassVar[str]
    title: ClassVar[str]
    parameters: ClassVar[tuple[EffectParameter, ...]]
    group: ClassVar[str] = ""
    near: ClassVar[tuple[str, ...]] = ()
    separate_by: ClassVar[str] = ""
    scope: ClassVar[Literal["joint", "body", "material", "robot"]] = "joint"

    remodel: ClassVar[Callable | None] = None
    configure: ClassVar[Callable | None] = None
    recalls: ClassVar[bool] = False
    feedback: ClassVar[Callable | None] = None
    begin: ClassVar[Callable | None] = None
    command: ClassVar[Callable | None] = None
    encoder: ClassVar[Callable | None] = None
    drive: ClassVar[Callable | None] = None
    friction: ClassVar[Callable | None] = None
    roll: ClassVar[Callable | None] = None
    observe: ClassVar[Callable | None] = None

    def why_not(self, robot: Robot) -> str | None:
        """Why the effect cannot act on this robot; None where it can."""
        return None if drives(robot, "position", "duty_servo", "torque", "dcmotor") else "no driven joint"

    def alone(self, robot: Robot) -> bool:
        """Whether it is looked for in single joints, too."""
        return self.scope == "joint"

    def places(self, robot: Robot) -> tuple[tuple[str, ...], ...]:
        """Where it is looked for: () for all joints, or for the place that it takes for granted.

        Of a robot with hinges and slides all of either, where a size is another quantity on these.
        """
        if not self.alone(robot) or len(robot.driven) == 1:
            return ((),)
        slides = slides_of(robot)
        kinds = tuple(j for j in robot.driven if j not in slides), slides
        apart = all(kinds) and any(p.unit in ON_SLIDES for p in self.parameters)
        every = tuple(joints for joints in kinds if len(joints) > 1) if apart else ((),)
        return (*every, *((joint,) for joint in robot.driven))

    def misplaced(self, robot: Robot, at: tuple[str, ...]) -> tuple[str, str] | None:
        """What is wrong with a place, and what is expected; None where the effect can act there."""
        unknown = sorted({*at} - {*robot.joints})
        return (
            (f"no action drives {unknown[0]!r}", f"joints out of {quoted(sorted(robot.driven))}")
            if unknown
            else None
        )

    def title_at(self, at: tuple[str, ...]) -> str:
        """What it is, in some words, at a place."""
        return self.title

    def meaning_at(self, parameter: EffectParameter, at: tuple[str, ...]) -> str:
        """What one of its parameters is at a place."""
        return parameter.meaning

    def separate_by_at(self, at: tuple[str, ...]) -> str:
        """The experiment that separates it, at a place, from the effects near to it; "" where none is known."""
        return self.separate_by

    def told(self, robot: Robot, at: tuple[str, ...], values: Mapping[str, float]) -> Mapping[str, float]:
        """The values of a stored simulator by the names of today's parameters; as they are unless names changed.

        A shape that the effect has got since (the count of cogging) was its typical one.
        """
        return {p.name: p.medium for p in self.parameters if p.shape and p.name not in values} | dict(values)

    def sets(self, robot: Robot, at: tuple[str, ...]) -> Mapping[str, str]:
        """{parameter: entry of `sets` in robot.toml that does the same}, where one entry says it as it is."""
        return {}

    def about(self, robot: Robot, joints: tuple[str, ...]) -> tuple[str, ...] | None:
        """Joints at which the exact group's members cannot be told apart, when this one acts on `joints`.

        None where the robot as a whole has no joint at which they could be mistaken for each other.
        """
        return tuple(sorted({*(joints or robot.joints)}))

    def shown_by(self, robot: Robot) -> tuple[str, ...]:
        """Inputs of the robot that already hold the effect, where a log measured them while it moved."""
        return ()

    @property
    def size(self) -> EffectParameter:
        """The parameter that says how large the effect is: the first."""
        return self.parameters[0]

    def __repr__(self) -> str:
        return f"<effect {self.id}>"


class OfAnyDrive(Effect):
    """An effect that needs drives, of whatever type."""

    def why_not(self, robot: Robot) -> str | None:
        return None if robot.actions else "no driven joint"


@dataclass(frozen=True)
class Term:
    """An effect at a place of a robot.

    at : names of joints, or of a body, tool frame or material, as the effect's scope says; none for all joints, for
    the place that the effect takes for granted, or for the robot as a whole.
    """

    effect: Effect
    at: tuple[str, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that have it; none for all of them, and for an effect of a body or of the whole robot."""
        return self.at if self.effect.scope == "joint" else ()

    @property
    def bodies(self) -> tuple[str, ...]:
        """The body, tool frame or material that has it; none for the one that the effect takes for granted."""
        return self.at if self.effect.scope in ("body", "material") else ()

    @property
    def key(self) -> str:
        """ "load_friction", or "load_friction[arm]" where not all joints have it; "payload[flange]"."""
        return self.effect.id + (f"[{','.join(self.at)}]" if self.at else "")


def one_group(robot: Robot, first: Term, second: Term) -> bool:
    """Whether both belong to one exact group, about the same joints: no commands tell them apart."""
    if not first.effect.group or second.effect.group != first.effect.group:
        return False
    about = first.effect.about(robot, first.joints)
    return about is not None and second.effect.about(robot, second.joints) == about


@dataclass(frozen=True)
class Terms:
    """The effects of B simulators: for each term its values (B, K), NaN in the rows that do not have it."""

    terms: tuple[Term, ...] = ()
    values: tuple[np.ndarray, ...] = ()

    def __add__(self, other: "Terms") -> "Terms":
        """Those of the same simulators, and others that they have besides."""
        return Terms((*self.terms, *other.terms), (*self.values, *other.values))

    def tiled(self, times: int) -> "Terms":
        """Those of the same B simulators, so many times one after the other."""
        return Terms(self.terms, tuple(np.tile(v, (times, 1)) for v in self.values))

    def take(self, simulators: Any) -> "Terms":
        """Only these simulators (numbers or a slice)."""
        return Terms(self.terms, tuple(v[simulators] for v in self.values))

    def rows(self, number: int) -> Any:
        """Simulators that have term `number`: a slice where possible."""
        return slice_of(np.flatnonzero(np.isfinite(self.values[number]).all(axis=1)))

    def at(self, number: int, rows: Any) -> Values:
        """{name: (rows, 1)} values of term `number` in its `rows`."""
        values = self.values[number][rows]
        names = [p.name for p in self.terms[number].effect.parameters]
        return MappingProxyType({name: values[:, i, None].copy() for i, name in enumerate(names)})


def unit_of(robot: Robot, term: Term, parameter: EffectParameter) -> str:
    """The unit of an effect's parameter where it acts: on slides, forces and metres instead of torques and angles.

    A drive that is told a speed has commands in the unit of its action; where those of a base differ (speed and yaw
    rate), one number is of each in its own: "m/s or rad/s".
    """
    if robot.planar and parameter.per == "command":
        told = dict.fromkeys(action.unit for action in robot.file.actions)
        return " or ".join(unit if parameter.unit == "rad" else unit.replace("/s", "/s^2") for unit in told)
    if term.effect.scope != "joint" or robot.planar:
        return parameter.unit
    return unit_at(robot, term.joints or robot.driven, parameter.unit)


def stacked(count: int, groups: Iterable[tuple[Sequence[int], Terms]]) -> Terms | None:
    """The effects of so many simulators, from those of groups of them: (their numbers, theirs); None without any."""
    table: dict[Term, np.ndarray] = {}
    for members, own in groups:
        for term, values in zip(own.terms, own.values, strict=True):
            table.setdefault(term, np.full((count, values.shape[1]), np.nan))[members] = values
    return Terms(tuple(table), tuple(table.values())) if table else None


def drives(robot: Robot, *types: str) -> bool:
    """Whether the robot has a drive with the law of one of these types."""
    return bool(robot.actions) and any(t.law in types for t in robot.file.drives)
