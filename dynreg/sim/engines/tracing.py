"""The ports of effects, and the servo law, as statements about one joint: called with symbols instead of arrays."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

from dynreg.errors import SimulationError
from dynreg.sim.effects import Effect, Moment
from dynreg.sim.engines.acting import begun, shares
from dynreg.sim.engines.symbols import ELSEWHERE, Symbol, Tape, Untraceable, named
from dynreg.sim.ports import TYPES, law_of
from dynreg.sim.sets import DRIVE_DEFAULTS


def traced_law() -> tuple[str, ...]:
    """The statements of `ports.law_of` about joint `k`, by the rows of `joint_kernel`."""
    tape = Tape()
    rows = {key: Symbol(f"x[{key.upper()} + k]", tape) for key in (*DRIVE_DEFAULTS, "scale", "offset")}
    types = {kind: Symbol(f"x[IS_{kind.upper()} + k]", tape) != 0.0 for kind in TYPES}
    law = law_of(rows, types, rows, rows["supply"], Symbol("x[ON + k]", tape) != 0.0)
    values = {field.name: tape.put(named(getattr(law, field.name), tape)).name for field in fields(law)}
    places = {name: "PUSH" if name == "gain" else name.upper() for name in values}
    stores = [f"x[{places[name]} + k] = {value}" for name, value in values.items()]
    return (*tape.lines, *stores)


PORTS = ("feedback", "command", "encoder", "drive", "friction")  # in the order in which the engine calls them
LOOKING = ("feedback", "encoder")
_SEEN = {  # what a port sees, by the rows of `joint_kernel`
    "feedback": {"q": "SEEN", "v": "SEEN_V"},
    "command": {"q": "MEASURED"},
    "encoder": {"q": "Q", "torque": "TORQUE"},
    "drive": {"q": "Q", "torque": "TORQUE", "load": "LOAD"},
    "friction": {"q": "Q", "torque": "NET", "load": "LOAD"},
}
_GIVEN = {"feedback": ("SEEN", "SEEN_V"), "command": ("U",), "drive": ("TORQUE",)}  # what it changes
_ADDED = {"encoder": ("AHEAD", "FASTER"), "friction": ("FRICTION",)}  # what it adds to
_ALWAYS = {
    "v": "V",
    "h": "H",
    "limit": "LIMIT",
    "stiffness": "STIFFNESS",
    "rate": "RATE",
    "damping": "DAMPING",
    "fade": "FADE",
    "inertia": "INERTIA",
}


@dataclass(frozen=True)
class Traced:
    """The ports of an effect as statements about joint `k`, a column of the table x, with rows of its own in `own`.

    parameters : how many; they are the first rows, its memory those behind them. configured : the keys of memory
    that `configure` fills. slots : (key, row behind the parameters, how many) of all memory. bodies : (port, statements
    of the first time step, of later ones). recalls : as of the effect.
    """

    parameters: int
    configured: tuple[str, ...]
    slots: tuple[tuple[str, int, int], ...]
    bodies: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...]
    recalls: bool = False

    @property
    def looks(self) -> bool:
        """Whether it changes what the drive's loop or the log sees of the joint."""
        return any(port in LOOKING for port, _, _ in self.bodies)

    @property
    def rows(self) -> int:
        """Of its parameters and memory."""
        return self.parameters + sum(width for _, _, width in self.slots)


@lru_cache(maxsize=256)
def traced(effect: Effect, configured: tuple[str, ...] | None = None) -> Traced:
    """The ports of an effect between time steps.

    configured : the keys of memory that its `configure` has filled; None for those that it takes for granted.
    Raises SimulationError for a port that cannot be said of one joint, with the reason.
    """
    tracer = _Tracer(effect, configured)
    ports = [port for port in PORTS if getattr(effect, port) is not None]
    rounds = []
    try:
        for _ in range(3):  # the first time step, later ones, and once more
            rounds.append([tracer.record(port) for port in ports])
        if rounds[1] != rounds[2]:
            raise Untraceable(ELSEWHERE)
    except Exception as problem:  # whatever a plugin raises where it is given symbols
        why = str(problem) if isinstance(problem, Untraceable) else f"{type(problem).__name__}: {problem}"
        raise SimulationError(
            f"effect {effect.id!r}: its port {tracer.port!r} cannot be compiled for the joint engine ({why})",
            expected="elementwise numpy of what the port is given, of x and of p",
            do="write it so (np.where for an if, x.memory for what goes on), or run the robot on the mujoco engine",
        ) from problem
    slots = tuple((key, row, width) for key, (row, width) in tracer.slots.items())
    bodies = tuple(zip(ports, rounds[0], rounds[1], strict=True))
    configured = tuple(sorted(tracer.configured))
    return Traced(len(effect.parameters), configured, slots, bodies, effect.recalls)


class _Memory(dict):
    """An effect's memory: what is read before it was written has been there from `configure` on."""

    def __init__(self, missing: Callable[[str], Any]):
        self.missing = missing

    def __missing__(self, key: str) -> Any:
        self[key] = self.missing(key)
        return self[key]


class _Tracer:
    """Calls the ports of one effect in the order in which the engine does, with the memory that is there by then."""

    def __init__(self, effect: Effect, configured: tuple[str, ...] | None):
        self.effect, self.closed = effect, configured is not None
        self.configured: set[str] = set()
        self.slots: dict[str, tuple[int, int]] = {}  # first row behind the parameters, width
        self.written: dict[str, None] = {}  # keys, in a fixed order: statements are compared as text
        self.port = ""
        for key in configured or ():
            self._expect(key)
            self.written[key] = None

    def record(self, port: str) -> tuple[str, ...]:
        """The statements of one port, called once."""
        self.port, tape = port, Tape()
        memory = _Memory(lambda key: self._missing(key, tape))
        for key in self.written:
            memory[key] = self._held(key, tape)
        self.before = dict(memory)
        seen = {name: Symbol(f"x[{row} + k]", tape) for name, row in (_ALWAYS | _SEEN[port]).items()}
        given = [Symbol(f"x[{row} + k]", tape) for row in _GIVEN.get(port, ())]
        parameters = {
            p.name: Symbol(f"own[{i} * WIDTH + k]", tape) for i, p in enumerate(self.effect.parameters)
        }
        x = Moment(**seen, memory=memory, **self._clock(tape, seen["h"]))
        answer = getattr(self.effect, port)(*given, x, parameters)
        rows, sign = (_GIVEN[port], "=") if port in _GIVEN else (_ADDED[port], "+=")
        answers = answer if len(rows) > 1 else (answer,)
        names = [tape.put(named(one, tape)).name for one in answers]
        stores = [f"x[{row} + k] {sign} {name}" for row, name in zip(rows, names, strict=True)]
        for key, value in memory.items():
            if value is not self.before.get(key):
                stores += self._stored(key, value, tape)
        return (*tape.lines, *stores)

    def _clock(self, tape: Tape, h: Symbol) -> dict[str, Callable]:
        """What `x.time`, `x.past` and `x.draw` say."""
        names = ("step", "substep", "x[PERIOD + k]", "x[FIRST + k]")
        step, substep, period, first = (Symbol(name, tape) for name in names)

        def past(delay: Any) -> Symbol:
            late, early, share = shares(step, substep, period, h, delay, first)
            rows = (named(row, tape) for row in (late, early))
            now, before = (tape.put(f"commands[sims[k], {row}, drives[k]]") for row in rows)
            return share * now + (1.0 - share) * before

        def ago(delay: Any) -> tuple[Symbol, Symbol]:
            steps = named(delay / h, tape)
            told = f"trail, k, x[COUNT + k], {steps}, {h.name}"
            return tape.put(f"ago({told}, 0)"), tape.put(f"ago({told}, 1)")

        return {
            "ago": ago,
            "now": lambda: begun(Symbol("x[BEGIN + k]", tape), step, substep, period, h),
            "drawn": lambda: Symbol("x[DRAW + k]", tape),
            "past": past,
        }

    def _expect(self, key: str) -> None:
        self.slots[key] = (sum(width for _, width in self.slots.values()), 1)
        self.configured.add(key)

    def _missing(self, key: str, tape: Tape) -> Any:
        if self.closed:
            raise KeyError(key)
        self._expect(key)
        self.written[key] = None
        self.before[key] = self._held(key, tape)
        return self.before[key]

    def _held(self, key: str, tape: Tape) -> Any:
        row, width = self.slots[key]
        rows = [
            Symbol(f"own[{len(self.effect.parameters) + row + i} * WIDTH + k]", tape) for i in range(width)
        ]
        return tuple(rows) if width > 1 else rows[0]

    def _stored(self, key: str, value: Any, tape: Tape) -> list[str]:
        values = value if isinstance(value, tuple | list) else (value,)
        if key not in self.slots:
            self.slots[key] = (sum(width for _, width in self.slots.values()), len(values))
        row, width = self.slots[key]
        if width != len(values):
            raise Untraceable(f"x.memory[{key!r}], of which there are {width} arrays, then {len(values)}")
        self.written[key] = None
        names = [tape.put(named(v, tape)).name for v in values]
        return [
            f"own[{len(self.effect.parameters) + row + i} * WIDTH + k] = {name}"
            for i, name in enumerate(names)
        ]
