"""The joint engine's kernel: written out for the effects that are asked for, compiled by numba, and kept on disk.

One kernel holds all effects of the table, the integral part of drives, and the noise of hidden robots, so that one
compilation (8 s) serves every robot; other effects make another.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

from dynreg.compiled import compiled, numba
from dynreg.errors import SimulationError
from dynreg.sim.effects import effects
from dynreg.sim.effects.disturbance import Disturbance
from dynreg.sim.effects.integral import INTEGRAL
from dynreg.sim.engines import joint_kernel
from dynreg.sim.engines.tracing import PORTS, Traced, traced, traced_law

_DISTURBANCE = Disturbance()
_ARGUMENTS = "x, kinds, places, n, first, commands, sims, drives, step, substep, trail"
# No reordering of sums and no fused products: the same numbers as one operation after the other, on every processor.
_HEAD = """
from numba import njit, types

_plain = njit(error_model="numpy", boundscheck=False)
_read, _written = types.Array(types.float64, 3, "A", readonly=True), types.float64[:, :, ::1]
_signature = types.void(
    types.int64[:, ::1], types.int64[::1], types.int64[:, ::1], types.int64[::1], types.int64[::1],
    types.int64[::1], types.float64, types.float64[:, ::1], types.float64[:, ::1], _read, types.int64[:, ::1],
    types.float64[:, :, ::1], _read, _written, _written,
)
"""
_TAIL = """
sine, exponential, ago = _plain(sine), _plain(exponential), _plain(ago)
obey, listen, press, remember = _plain(obey), _plain(listen), _plain(press), _plain(remember)
turn, advance, load, recall = _plain(turn), _plain(advance), _plain(load), _plain(recall)
run = njit(_signature, nogil=True, cache={cache}, error_model="numpy", boundscheck=False)(run)
"""


def kernel(needed: Sequence[Traced]) -> tuple[Callable, dict[Traced, int]]:
    """`joint_kernel.run` compiled, and the number of each effect's kind in it."""
    table = _table()
    kinds = (*table, *sorted({*needed} - {*table}, key=repr))
    return _compiled(kinds), {one: number for number, one in enumerate(kinds)}


@lru_cache(maxsize=1)
def _of(every: tuple) -> tuple[Traced, ...]:
    found: dict[Traced, None] = {}
    for effect in every:
        try:
            made = traced(effect)
        except SimulationError:  # not one for joints; told when it is asked for
            continue
        if made.bodies:
            found[made] = None
    return tuple(found)


def _table() -> tuple[Traced, ...]:
    return _of((*effects().values(), _DISTURBANCE, INTEGRAL))


@lru_cache(maxsize=16)
def _compiled(kinds: tuple[Traced, ...]) -> Callable:
    try:
        return compiled(source(kinds), "joint").run
    except numba().core.errors.NumbaError as problem:
        raise SimulationError(
            f"the effects of this batch cannot be compiled for the joint engine: {str(problem).splitlines()[0]}",
            expected="functions of numpy that numba knows, too",
            do="write the ports with those, or run the robot on the mujoco engine",
        ) from problem


def source(kinds: Sequence[Traced]) -> str:
    """The text of the module; the same for the same kinds."""
    parts = [Path(joint_kernel.__file__).read_text(encoding="utf-8"), _HEAD]
    parts.append("@_plain\ndef law(x, n):\n    for k in range(n):\n" + _block(traced_law(), 8))
    for port in PORTS:
        acting = [
            (i, one, *body[1:]) for i, one in enumerate(kinds) for body in one.bodies if body[0] == port
        ]
        parts += [_function(port, *one) for one in acting]
        parts.append(_dispatch(port, [one[0] for one in acting]))
    return "\n\n".join(parts) + _TAIL.format(cache=True)


def _function(port: str, number: int, one: Traced, first: Sequence[str], later: Sequence[str]) -> str:
    lines = [f"@_plain\ndef {port}_{number}({_ARGUMENTS.replace('kinds, places', 'own')}):"]
    if first == later:
        return "\n".join([*lines, "    for k in range(n):", _block(later, 8)])
    begins = "first == 1" if one.recalls and port == "command" else "first"
    told = [f"    if {begins}:", "        for k in range(n):", _block(first, 12)]
    return "\n".join([*lines, *told, "    else:", "        for k in range(n):", _block(later, 12)])


def _dispatch(port: str, numbers: Sequence[int]) -> str:
    call = _ARGUMENTS.replace("kinds, places", "x[places[j] :]")
    lines = [
        f"@_plain\ndef {port}({_ARGUMENTS}):",
        "    for j in range(len(kinds)):",
        "        kind = kinds[j]",
    ]
    for number in numbers:
        lines += [f"        if kind == {number}:", f"            {port}_{number}({call})"]
    return "\n".join(lines)


def _block(lines: Sequence[str], indent: int) -> str:
    return "\n".join(" " * indent + line for line in lines) + "\n"
