"""Staged: one search after another, each with its own parameters, recordings and loss (Laue and Hebbel, 2008)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.adapt.plan import Stage
from dynreg.adapt.searched import Searched, searched
from dynreg.errors import UsageError
from dynreg.search.drive import Limits
from dynreg.search.journal import Journal


@dataclass(frozen=True, eq=False)
class Loss:
    """What a stage makes small: of unit parameters (n, P), (n,) losses, `most` where a simulation diverged.

    windows : (W',) numbers of the windows in which something counts.
    """

    of: Callable[[np.ndarray], np.ndarray]
    most: float
    windows: np.ndarray


def staged(
    stages: Sequence[Stage],
    losses: Sequence[Loss],
    start: np.ndarray,
    rng: Callable[[str], np.random.Generator],
    *,
    fitted: np.ndarray | None = None,
    generations: Sequence[int] | None = None,
    journal: Callable[[str], Journal | None] = lambda _: None,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Searched, ...]:
    """What each stage found by its loss; it begins where the one before it ended, first with unit parameters `start`
    (P,).

    A parameter that was fitted before begins with the small step `carry`: by an earlier stage, or where `fitted` (P,)
    says so. rng, journal : of a stage, by its name. generations : of each stage; those of its table by default.
    """
    out: list[Searched] = []
    fitted = np.zeros(len(start), dtype=bool) if fitted is None else fitted.copy()
    every = [stage.table.generations for stage in stages] if generations is None else generations
    for stage, own, many in zip(stages, losses, every, strict=True):
        table, free = stage.table, stage.parameters
        steps = np.where(fitted, table.carry, table.step)[free]
        found = searched(
            own.of,
            out[-1].unit if out else start,
            free,
            lambda point, table=table, steps=steps: table.begin(point, steps, rng(table.name)),
            Limits(1 + many * table.children),
            most=own.most,
            journal=journal(table.name),
            progress=progress and (lambda done, total, name=table.name: progress(name, done, total)),
        )
        out.append(found)
        fitted[free] = True
    return tuple(out)


def within(stages: Sequence[Stage], simulations: int | None) -> list[int]:
    """Generations of each stage of so many simulations in all: those of its table, or the same share of all of them.

    Raises UsageError for fewer than one generation each, and the simulator that each stage begins with.
    """
    asked = [stage.table.generations for stage in stages]
    children = [stage.table.children for stage in stages]
    least = len(stages) + sum(children)
    if simulations is None:
        return asked
    if simulations < least:
        raise UsageError(
            f"a budget of {simulations} simulations for a plan of {len(stages)} stages",
            expected=f"at least {least}: one generation of each, and what each begins with",
            do="raise --budget, or lower `children` in the plan",
        )
    more = sum((g - 1) * c for g, c in zip(asked, children, strict=True))
    share = min((simulations - least) / max(more, 1), 1.0)
    return [1 + int(share * (g - 1)) for g in asked]
