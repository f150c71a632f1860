"""What the joint engine's kernel works on: joints in blocks that have the same effects, on as many threads as asked."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from dynreg.sim.engines import joint_kernel
from dynreg.sim.engines.acting import BACK, Acting, with_before
from dynreg.sim.engines.compiling import kernel
from dynreg.sim.engines.tracing import PORTS, Traced, traced


@dataclass(frozen=True)
class Joints:
    """n simulations of A joints on their way.

    rows : {name of a row of `joint_kernel`: (n, A) or what spreads to it}, all that it is given. substeps : (n,) time
    steps in a command. commands : (n, T, A). draws : as many; None for 0. before : (n, L, A) commands before them, as
    `Clock` has them. inputs : (n, T, I). heard : (2, A) the channels of inputs that are a drive's supply and its
    enable; -1 for none.
    """

    rows: Mapping[str, np.ndarray]
    substeps: np.ndarray
    commands: np.ndarray
    draws: np.ndarray | None
    before: np.ndarray | None
    inputs: np.ndarray
    heard: np.ndarray


@dataclass(frozen=True)
class Placed:
    """A term: `numbers` (rows, A') of its joints, simulation times A + joint, and the rows (R, rows, A') of its own."""

    traced: Traced
    numbers: np.ndarray
    own: np.ndarray


def integrate(joints: Joints, active: Sequence[Acting], drives: np.ndarray, threads: int) -> np.ndarray:
    """(2, n, T+1, A) positions and velocities of the joints, which are the `drives` (numbers) of the terms.

    Raises SimulationError where the port of a term cannot be compiled.
    """
    n, steps, count = joints.commands.shape
    placed = [_placed(a, drives) for a in active if any(getattr(a.effect, port) for port in PORTS)]
    placed = [one for one in placed if one.numbers.size]
    run, kinds = kernel([one.traced for one in placed])
    given = np.empty((joint_kernel.GIVEN, n, count))
    for name, values in joints.rows.items():
        given[getattr(joint_kernel, name) // joint_kernel.WIDTH] = values
    own = np.concatenate([np.zeros((0, n * count)), *(_spread(one, n * count) for one in placed)])
    blocks, order, terms = _blocks(joints.substeps, joints.rows["FIRST"][:, 0], placed, kinds, count)
    sizes = np.array([one.rows for one in kinds] or [0])
    looking = np.array([int(one.looks) for one in kinds] or [0])
    recalling = np.array([one.recalls * (2 if one.slots else 1) for one in kinds] or [0])
    draws = np.zeros((n, 0, count)) if joints.draws is None else joints.draws
    moved = np.empty((2, n, steps + 1, count))
    told = (order, terms, sizes, looking, recalling, BACK, given.reshape(len(given), -1), own)
    commands = joints.commands
    if joints.before is not None:
        commands = with_before(commands, joints.before, joints.rows["FIRST"][:, 0])
    # some joints of all are no whole piece of memory, which the kernel wants
    heard, commands, draws = map(np.ascontiguousarray, (joints.heard, commands, draws))
    told = (*told, joints.inputs, heard, commands, draws, *moved)
    many = threads or os.cpu_count() or 1
    if many == 1 or len(blocks) <= 1:
        run(blocks, *told)
        return moved
    work = np.cumsum((blocks[:, 1] - blocks[:, 0]) * blocks[:, 4])
    parts = np.split(blocks, np.searchsorted(work, work[-1] * np.arange(1, many) / many))
    with ThreadPoolExecutor(many) as pool:
        list(pool.map(lambda part: run(part, *told), parts))
    return moved


def _placed(a: Acting, drives: np.ndarray) -> Placed:
    """A term on those of its joints that are looked at."""
    made = traced(a.effect, tuple(sorted(a.moment.memory)))
    places = {int(drive): place for place, drive in enumerate(drives)}
    kept = [i for i, joint in enumerate(a.joints.tolist()) if joint in places]
    columns = np.array([places[int(a.joints[i])] for i in kept], dtype=int)
    values = np.stack([v[:, 0] for v in a.values.values()])
    own = np.zeros((made.rows, values.shape[1], len(kept)))
    own[: len(values)] = values[..., None]
    for key, row, _ in made.slots:
        if key in a.moment.memory:
            own[len(values) + row] = np.asarray(a.moment.memory[key])[:, kept]
    rows = np.arange(a.rows.stop)[a.rows] if isinstance(a.rows, slice) else a.rows
    return Placed(made, rows[:, None] * len(drives) + columns, own)


def _spread(one: Placed, joints: int) -> np.ndarray:
    """(R, joints) the numbers of a term, 0 for joints that do not have it."""
    out = np.zeros((len(one.own), joints))
    out[:, one.numbers.ravel()] = one.own.reshape(len(one.own), -1)
    return out


def _blocks(
    substeps: np.ndarray,
    first: np.ndarray,
    placed: Sequence[Placed],
    kinds: Mapping[Traced, int],
    count: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`blocks`, `order` and `terms` of `joint_kernel.run`. first : (n,) as of `first_known`."""
    has = np.zeros((len(substeps) * count, 2 + len(placed)), dtype=np.int64)
    has[:, 0], has[:, 1] = np.repeat(substeps, count), np.repeat(first < 0, count)
    for column, one in enumerate(placed, start=2):
        has[one.numbers.ravel(), column] = 1
    unlike, group = np.unique(has, axis=0, return_inverse=True)
    order, ends = np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))
    begins = np.cumsum([0, *(one.traced.rows for one in placed)])
    blocks, terms = [], []
    for kind, begin, end in zip(unlike, [0, *ends], ends, strict=False):
        first = len(terms)
        terms += [(kinds[placed[i].traced], begins[i]) for i in np.flatnonzero(kind[2:])]
        cuts = np.linspace(begin, end, -(-(end - begin) // joint_kernel.WIDTH) + 1).astype(int)
        blocks += [(*cut, first, len(terms), kind[0]) for cut in zip(cuts, cuts[1:], strict=False)]
    whole = np.array(blocks, dtype=np.int64).reshape(-1, 5)  # none for a robot whose joints are all left out
    return whole, order, np.array(terms, dtype=np.int64).reshape(-1, 2)
