"""Effects at work in an engine: which simulations have them, what they see, when they are called."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from dynreg.data.names import parts_of
from dynreg.errors import UsageError
from dynreg.sim.effects import Effect, Moment, Site, Term, Terms, Values, effects
from dynreg.sim.effects.integral import INTEGRAL, integral_values
from dynreg.sim.ports import Ports, ServoLaw, slice_of
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run
from dynreg.sim.sets import is_limit

BACK = (
    0.2  # s that a drive's loop can look back on its own encoder: by contract, twice the most of any effect
)

NO_TIME = 1e-100  # s: a time step in which nothing gets anywhere, to the bit


@dataclass
class Acting:
    """One term in one batch of simulations.

    rows : its simulations (slice or numbers). joints : its drives (A',). where : both, to index (n, A) arrays. at : the
    term's place.
    """

    effect: Effect
    rows: Any
    joints: np.ndarray
    where: tuple
    values: Values
    moment: Moment = field(default_factory=Moment)
    at: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Of its term."""
        return Term(self.effect, self.at).key

    def see(self, **arrays: np.ndarray) -> Moment:
        """The moment with these (n, A) arrays cut to the term's rows and joints."""
        for name, array in arrays.items():
            setattr(self.moment, name, array[self.where])
        return self.moment

    def ask(self, port: Callable, clock: "Clock", *arguments: Any) -> np.ndarray:
        """What a port of the effect answers now; the memory of simulations that are done with this command stays.

        Simulations of all command rates share the arrays, and a motor must not go on warming in one that waits.
        """
        done, memory = clock.done(self.rows), self.moment.memory
        if done is None:
            return port(*arguments, self.values)
        before = {key: np.array(value) for key, value in memory.items()}
        answer = port(*arguments, self.values)
        for key, value in before.items():
            memory[key] = np.where(done, value, memory[key])
        return answer


def acting(robot: Robot, terms: Terms | None) -> list[Acting]:
    """The terms that any of n simulations has, (n, K) values of each, in the order of the table of effects.

    Raises UsageError where a term cannot act on this robot, or not at its place.
    """
    if terms is None:
        return []
    out = []
    for number, term in enumerate(terms.terms):
        require(robot, term)
        rows = terms.rows(number)
        if not isinstance(rows, slice) and not len(rows):
            continue
        joints = np.array(robot.drives_of(term.joints), dtype=int)
        where = _where(rows, joints, len(robot.joints))
        out.append(Acting(term.effect, rows, joints, where, terms.at(number, rows), at=term.at))
    return _in_order(out)


def _in_order(active: list[Acting]) -> list[Acting]:
    order = {name: i for i, name in enumerate(effects())}
    # of one effect at several places by place: whatever else is in the batch, a simulation adds them up alike
    return sorted(
        active, key=lambda a: (order.get(a.effect.id, len(order)), a.effect.id, tuple(a.joints), a.at)
    )


def with_drives(active: list[Acting], robot: Robot, ports: Ports) -> list[Acting]:
    """The terms, and what drives of n simulations do as effects do: profiles of targets, and integral parts.

    Call it when ports are set. An integral part sees the target that all effects on commands have left.
    """
    out = _with_profiles(active, robot, ports)
    position = np.array([kind == "position" for kind in ports.types], dtype=bool)
    joints = np.flatnonzero((ports.drive["integral_gain"] > 0.0).any(axis=0) & position)
    if len(joints):
        out.append(_of_drives(INTEGRAL, robot, ports, joints, integral_values(ports, joints)))
    return out


def _with_profiles(active: list[Acting], robot: Robot, ports: Ports) -> list[Acting]:
    """The terms, and the effect `profile_speed` on the drives that state one of their own.

    What a drive's own profile generator does and what a hidden one does is one law.
    """
    speed, acceleration = ports.drive["profile_speed"], ports.drive["profile_acceleration"]
    stated = (is_limit(speed) | is_limit(acceleration)).any(axis=0)
    generator, out = effects()["profile_speed"], list(active)
    for joint in np.flatnonzero(stated):
        reach = 0.5 * speed[:, [joint]] ** 2 / acceleration[:, [joint]]
        values = {"speed": speed[:, [joint]], "reach": reach}
        out.append(_of_drives(generator, robot, ports, np.array([joint]), values))
    return _in_order(out)


def _of_drives(effect: Effect, robot: Robot, ports: Ports, joints: np.ndarray, values: Values) -> Acting:
    """An effect on drives (A',) by their numbers, of all simulations; (n, A') each of its values."""
    rows = slice(0, len(ports.drive["gain"]))
    return Acting(effect, rows, joints, _where(rows, joints, len(robot.joints)), values)


def require(robot: Robot, term: Term) -> None:
    """UsageError where a term cannot act on this robot, or not at its place."""
    reason = term.effect.why_not(robot)
    wrong = (reason, "an effect that can act there") if reason else term.effect.misplaced(robot, term.at)
    if wrong:
        raise UsageError(
            f"effect {term.key!r} on robot {robot.name!r}: {wrong[0]}",
            expected=wrong[1],
            do="see `dynreg effects`",
        )


def configure_terms(
    robot: Robot, active: list[Acting], ports: Ports, expand: Callable[[str], np.ndarray]
) -> None:
    """Let static effects write ports and model fields, after the parameters and before anything moves."""
    for a in active:
        if a.effect.configure is not None:
            a.effect.configure(Site(robot, ports, a.rows, a.joints, expand, a.moment.memory, a.at), a.values)


def prepare(active: list[Acting], law: ServoLaw, inertia: np.ndarray, clock: "Clock") -> None:
    """Tell the terms what holds for their rows: the drive's law (n, A), inertia (n, A), and the clock."""
    clock.show(active)
    told = {name: getattr(law, name) for name in ("limit", "stiffness", "rate", "damping", "fade")}
    for a in active:
        a.see(**told, inertia=inertia)


def on(active: list[Acting], port: str) -> list[Acting]:
    """The terms that act on a port."""
    return [a for a in active if getattr(a.effect, port) is not None]


@dataclass
class Clock:
    """Where a rollout is: command step, substep, and the commands so far; for delays and drifts.

    commands : (n, T, A), draws : as many, None for 0. before : (n, L, A) those told before, NaN where they are not
    known. period, h : (n,) [s]. begin : (n,) [s] from the log's start to the episode's.
    substeps : (n,) time steps of each simulation in one command.
    """

    commands: np.ndarray
    period: np.ndarray
    h: np.ndarray
    begin: np.ndarray
    draws: np.ndarray | None = None
    before: np.ndarray | None = None
    step: int = 0
    substep: int = 0

    @cached_property
    def substeps(self) -> np.ndarray:
        return np.rint(self.period / self.h).astype(int)

    @cached_property
    def _fewest(self) -> int:
        return int(self.substeps.min())

    def done(self, rows: Any) -> np.ndarray | None:
        """(rows, 1) which simulations have taken all their time steps of this command; None where none has."""
        if self.substep < self._fewest:
            return None
        return (self.substeps[rows] <= self.substep)[:, None]

    def show(self, active: list[Acting]) -> None:
        """Let the terms read the clock from here on: the time step, and when they ask the time and past commands."""
        for a in active:
            a.moment.h = self.h[a.rows, None]
            a.moment.now, a.moment.past = partial(self.now, a), partial(self.past, a)
            a.moment.drawn = partial(self.drawn, a)

    def now(self, a: Acting) -> np.ndarray:
        """What `Moment.time` answers for one term."""
        begin, period, h = (of[a.rows, None] for of in (self.begin, self.period, self.h))
        return begun(begin, self.step, self.substep, period, h)

    def drawn(self, a: Acting) -> np.ndarray:
        """What `Moment.draw` answers for one term."""
        return np.zeros((1, 1)) if self.draws is None else self.draws[:, self.step][a.where]

    def past(self, a: Acting, delay: np.ndarray) -> np.ndarray:
        """What `Moment.past` answers for one term."""
        rows = np.arange(len(self.commands))[a.rows]
        period, h, first = self.period[a.rows, None], self.h[a.rows, None], self.first[a.rows, None]
        late, early, share = shares(self.step, self.substep, period, h, delay, first)
        now, before = (self.told[rows[:, None], command, a.joints] for command in (late, early))
        return share * now + (1.0 - share) * before

    @cached_property
    def first(self) -> np.ndarray:
        """(n,) as of `first_known`."""
        return first_known(self.before, len(self.period))

    @property
    def told(self) -> np.ndarray:
        """(n, T + L, A) the commands, then those told before them: -1 is the last of these."""
        return self.commands if self.before is None else self._told

    @cached_property
    def _told(self) -> np.ndarray:
        return with_before(self.commands, self.before, self.first)


def begun(begin: Any, step: Any, substep: Any, period: Any, h: Any) -> Any:
    """[s] since the log began, as a time step begins; elementwise, as what `Clock` has."""
    return begin + (step * period + substep * h)


def first_known(before: np.ndarray | None, simulations: int) -> np.ndarray:
    """(n,) number of the first command that is known of each simulation: below 0 of those told `before` (n, L, A).

    -1 is the last of these: they stand behind the commands of the run, where negative numbers find them.
    """
    if before is None:
        return np.zeros(simulations)
    unknown = np.isnan(before).any(axis=2)[:, ::-1]
    return -np.where(unknown.any(axis=1), unknown.argmax(axis=1), before.shape[1]).astype(float)


def with_before(commands: np.ndarray, before: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(n, T + L, A) commands (n, T, A), then those before them; what is not known was as the `first_known`."""
    whole = np.concatenate([commands, before], axis=1)
    known = np.maximum(np.arange(-before.shape[1], 0), first[:, None]).astype(int)
    whole[:, commands.shape[1] :] = whole[np.arange(len(whole))[:, None], known]
    return whole


def shares(step: Any, substep: Any, period: Any, h: Any, delay: Any, first: Any) -> tuple[Any, Any, Any]:
    """Numbers of the two commands that act, `delay` [s] late, in a time step, and the share of the first of them.

    first : number of the first command that is known; what came before it is not, and taken to have been the same.
    """
    begins = step * period + substep * h - delay
    ends = begins + h
    last = np.floor(ends / period - 1e-9)
    share = np.clip((ends - last * period) / h, 0.0, 1.0)  # of the time step after the change
    return np.clip(last, first, step).astype(int), np.clip(last - 1, first, step).astype(int), share


def clock_of(ports: Ports, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Of n simulations (n,): the period between commands [s], and when each episode of the log began [s]."""
    period = 1.0 / ports.control["rate"] if run.period is None else run.period
    return period * ports.control["clock"], np.zeros(run.episodes) if run.begin is None else run.begin


def commanded(
    active: list[Acting], u: np.ndarray, measured: np.ndarray, v: np.ndarray, clock: Clock
) -> np.ndarray:
    """(n, A) commands after the effects on them; `measured` (n, A) is what the encoders say."""
    if not active:
        return u
    if clock.step == clock.substep == 0 and clock.before is not None:
        _recall([a for a in active if a.effect.recalls], measured, v, clock)
    return _after_effects(active, u, measured, v, clock)


def _recall(active: list[Acting], measured: np.ndarray, v: np.ndarray, clock: Clock) -> None:
    """Let effects remember the commands before the run; the joint is taken to have stood on the first of these.

    Else a lag would begin each window of a log on its first command, and a fit would find it too short. Simulations of
    which no command before is known begin as if they were alone: for them no time passes.
    """
    known, last = clock.first[:, None] < 0, -clock.before.shape[1]
    measured, v = np.where(known, clock.told[:, last], measured), np.where(known, 0.0, v)
    for a in active:
        a.moment.h = np.where(known, clock.h[:, None], NO_TIME)[a.rows]
    for step in range(last, 0):
        for substep in range(clock.substeps.max()):
            clock.step, clock.substep = step, substep
            _after_effects(active, clock.told[:, step], measured, v, clock)
        if not any(a.moment.memory for a in active):
            break
    clock.step = clock.substep = 0
    clock.show(active)


def _after_effects(
    active: list[Acting], u: np.ndarray, measured: np.ndarray, v: np.ndarray, clock: Clock
) -> np.ndarray:
    u = u.copy()
    for a in active:
        x = a.see(q=measured, v=v)
        u[a.where] = a.ask(a.effect.command, clock, u[a.where], x)
    return u


def fed_back(
    active: list[Acting], q: np.ndarray, v: np.ndarray, trail: "Trail", clock: Clock
) -> tuple[np.ndarray, np.ndarray]:
    """(n, A), (n, A) position and speed that the loops of the drives see, of those that their encoders say."""
    q, v = q.copy(), v.copy()
    for a in active:
        x = a.see(q=q, v=v)
        x.ago = partial(trail.ago, a)
        q[a.where], v[a.where] = a.ask(partial(a.effect.feedback, q[a.where]), clock, v[a.where], x)
    return q, v


def ahead(
    active: list[Acting], torque: np.ndarray, q: np.ndarray, v: np.ndarray, clock: Clock
) -> tuple[np.ndarray, np.ndarray]:
    """(n, A), (n, A) how far ahead of the joint each drive's encoder stands, and how much faster it turns."""
    further, faster = np.zeros_like(q), np.zeros_like(v)
    for a in active:
        x = a.see(q=q, v=v, torque=torque)
        own = a.effect.encoder(x, a.values)
        further[a.where] += own[0]
        faster[a.where] += own[1]
    return further, faster


class Trail:
    """What the encoders of n simulations said in their last time steps, for loops that see it late.

    Between two time steps in proportion; before the first one they turned on at their first speed.
    """

    def __init__(self, clock: Clock, actions: int):
        self._h = clock.h
        self._kept = int(np.ceil(BACK / clock.h.min())) + 2
        self._said = np.zeros((2, self._kept, len(clock.h), actions))
        self._first: np.ndarray | None = None
        self._count = np.full(len(clock.h), -1)

    def keep(self, q: np.ndarray, v: np.ndarray, clock: Clock) -> None:
        """Add a time step, (n, A) each, to the simulations that take one."""
        self._first = np.stack([q, v]) if self._first is None else self._first
        done = clock.done(slice(None))
        going = np.arange(len(q)) if done is None else np.flatnonzero(~done[:, 0])
        self._count[going] += 1
        self._said[:, self._count[going] % self._kept, going] = q[going], v[going]

    def ago(self, a: Acting, delay: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What `Moment.ago` answers for one term."""
        rows = np.arange(len(self._h))[a.rows][:, None]
        h, count = self._h[rows], self._count[rows]
        at = count - delay / h
        kept = np.maximum(at, np.maximum(count - self._kept + 1.0, 0.0))
        low = np.floor(kept).astype(int)
        share = kept - low
        high = np.minimum(low + 1, count)
        before, after = (self._said[:, i % self._kept, rows, a.joints] for i in (low, high))
        q, v = before + share * (after - before)
        first = self._first[:, rows, a.joints]
        return np.where(at <= 0.0, first[0] + at * h * first[1], q), np.where(at <= 0.0, first[1], v)


def driven(
    active: list[Acting], torque: np.ndarray, q: np.ndarray, v: np.ndarray, load: np.ndarray, clock: Clock
) -> np.ndarray:
    """(n, A) torque after the effects on drives and transmissions."""
    if not active:
        return torque
    torque = torque.copy()
    for a in active:
        x = a.see(q=q, v=v, torque=torque, load=load)
        torque[a.where] = a.ask(a.effect.drive, clock, torque[a.where], x)
    return torque


def bound(
    active: list[Acting],
    friction: np.ndarray,
    torque: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    load: np.ndarray,
    clock: Clock,
) -> np.ndarray:
    """(n, A) dry friction after the effects on it; `friction` is that of the plain model."""
    if not active:
        return friction
    friction = friction.copy()
    for a in active:
        x = a.see(q=q, v=v, torque=torque, load=load)
        friction[a.where] += a.ask(a.effect.friction, clock, x)
    return friction


def observed(
    robot: Robot, active: list[Acting], states: np.ndarray, ports: Ports, period: np.ndarray
) -> np.ndarray:
    """(n, T+1, S) what the log holds of true states: encoders, then the effects on sensors."""
    states = read_encoders(robot, states, ports)
    for a in on(active, "observe"):
        times = np.arange(states.shape[1]) * period[a.rows, None]
        columns = _columns(robot, a.joints)
        states[a.rows] = a.effect.observe(states[a.rows], columns, times, a.values)
    return states


def read_encoders(robot: Robot, states: np.ndarray, ports: Ports) -> np.ndarray:
    """States (n, T, S) as encoders read them; in place."""
    if not has_sensors(ports):
        return states
    for kind, column, joint in _encoders(robot):
        scale, offset = ports.sensor["scale"][:, joint, None], ports.sensor["offset"][:, joint, None]
        states[..., column] = scale * (states[..., column] + (offset if kind == "position" else 0.0))
    return states


def true_states(robot: Robot, measured: np.ndarray, ports: Ports) -> np.ndarray:
    """(n, S) true states behind encoder readings: the inverse of `read_encoders`."""
    if not has_sensors(ports):
        return measured
    out = measured.copy()
    for kind, column, joint in _encoders(robot):
        offset = ports.sensor["offset"][:, joint] if kind == "position" else 0.0
        out[:, column] = out[:, column] / ports.sensor["scale"][:, joint] - offset
    return out


def has_sensors(ports: Ports) -> bool:
    """Whether any encoder reads something else than the truth."""
    return bool((ports.sensor["scale"] != 1.0).any() or (ports.sensor["offset"] != 0.0).any())


def _encoders(robot: Robot) -> list[tuple[str, int, int]]:
    """(kind, channel column, drive number) of every joint channel that a drive's encoder measures."""
    out = []
    for column, name in enumerate(robot.channels):
        owner, kind = parts_of(name)
        if owner in robot.joints and kind in ("position", "velocity"):
            out.append((kind, column, robot.joints.index(owner)))
    return out


def _columns(robot: Robot, joints: np.ndarray) -> dict[str, list[int]]:
    """{quantity: channel columns} of the drives `joints`, and of the base's own quantities.

    "moving" and "moving at" are positions and velocities of joints that log both, one for one.
    """
    out: dict[str, list[int]] = {"moving": [], "moving at": []}
    names = {name: column for column, name in enumerate(robot.channels)}
    for name, column in names.items():
        owner, kind = parts_of(name)
        if owner in robot.joints and robot.joints.index(owner) not in joints:
            continue
        out.setdefault(kind, []).append(column)
        if kind == "position" and f"{owner}/velocity" in names:
            out["moving"].append(column)
            out["moving at"].append(names[f"{owner}/velocity"])
    return out


def _where(rows: Any, joints: np.ndarray, count: int) -> tuple:
    columns = slice(None) if len(joints) == count else slice_of(joints)
    crossed = not isinstance(rows, slice) and not isinstance(columns, slice)
    return (rows[:, None] if crossed else rows, columns)
