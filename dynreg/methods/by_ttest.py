"""A displacement table that Student's t-tests keep true, and the simulator that it makes: paper C's way."""

from dataclasses import dataclass

import numpy as np

from dynreg.methods.answer import Answer, Version
from dynreg.methods.calibrator import Evidence, Limits, Question
from dynreg.methods.displaced import Displaced, Samples, Simulators, displaced, off
from dynreg.methods.folded import DIFFERENCE, GAIN, Folded, Folder
from dynreg.timed.table import DisplacementTable, Rules, Tested, updated

SIZES = (3, 5, 10, 20)  # cells for each wheel; the paper has 20


@dataclass(frozen=True, eq=False)
class _Turn:
    """The table after an episode, its mean errors [m] there before and after it, and what the tests said of it."""

    table: DisplacementTable
    before: float
    after: float
    tested: Tested


class ByTTest:
    """Gains of the wheels and of turns, by a table of corrections that follows a robot which changes.

    The table holds by how much half a second moved the robot more than the simulator that it begins with, in cells of
    what both wheels were told. Episodes come in turn. Each adds its samples; where the t-test says that they differ
    from those of a cell, old ones go until they do not (`timed.table.updated`). A cell without samples is the
    simulator's. The first samples are the first episode's, not the simulator's: those would not scatter, and a test
    against them would take any number of them for as sure as one likes. There are as many cells as predict the next
    episode best.

    A table is no simulator that a registry knows. So each version is the simulator whose gains bring the table's
    corrections best: `wheel_radius`, `track` and `wheel_gain`, by least squares over the cells. What a table holds
    beyond that (a dead band, a slower turn) stays in it: `explained` of a version's figures is the share of the squared
    corrections that its simulator brings, and scatter is among these. Where it is low in a robot that is clearly off,
    a diagnosis finds the cause. `tests` and `rejected` count tests of cells and axes, 5 % of which reject where nothing
    changed; `removed` counts old samples. `difference` is that of the wheels, 0 where it may as well be.

    before, after : mean distance [m] of the table's predictions from what the robot did in the episode. The first one
    is of the simulator alone.
    """

    def fit(self, question: Question, evidence: Evidence, limits: Limits) -> Answer:
        """One version for each episode. Raises LogError for a recording without pieces of half a second."""
        data = question.data
        pieces, simulators = displaced(data), Simulators(data, limits.threads)
        begun = simulators.moved(pieces, data.values_of(question.begin)[None], {})[0]
        samples, turns = _best(pieces, off(pieces.moved, begun))
        folder, found = Folder(simulators, question.begin, limits.simulations), None
        versions: list[Version] = []
        named = pieces.turns
        ended = "episodes"
        for number, turn in enumerate(turns):
            some = pieces.turn <= number
            found = folder.fold(turn.table, pieces.take(some), samples.until(number), begun[some], found)
            ended = ended if found.whole else "budget"
            versions.append(_version(data.values_of(found.unit), found, turn, named[: number + 1]))
            if limits.progress:
                limits.progress("calibrate", number + 1, len(turns))
        causes = tuple(versions[-1].effects)
        free = np.isin(np.arange(len(question.begin)), folder.free)
        return Answer(tuple(versions), ended, simulators.ran, simulators.seconds, causes=causes, free=free)


def _best(pieces: Displaced, apart: np.ndarray) -> tuple[Samples, list[_Turn]]:
    """Of as many cells as predict the next episode best, from what pieces moved more than a simulator (n, 3)."""
    tried = []
    for each in SIZES:
        samples = Samples.cut(pieces, each)
        tried.append((samples, followed(pieces, samples, apart)))
    return min(tried, key=lambda one: np.mean([turn.before for turn in one[1][1:] or one[1]]))


def followed(pieces: Displaced, samples: Samples, apart: np.ndarray) -> list[_Turn]:
    """The table after each episode in turn, of what the pieces moved more than a simulator (n, 3)."""
    values = samples.mean(apart)
    nothing = np.zeros(0, dtype=int)
    table = DisplacementTable.of(samples.grid.cells, nothing, np.zeros((0, values.shape[1])))
    rules, out = Rules(fresh=len(values)), []
    for number in range(int(samples.turn.max()) + 1):
        own, here = samples.turn == number, pieces.turn == number
        cell = samples.cell[samples.of[here]]
        before = _error(table, cell, apart[here])
        table, tested = updated(table, samples.cell[own], values[own], number, rules)
        out.append(_Turn(table, before, _error(table, cell, apart[here]), tested))
    return out


def _error(table: DisplacementTable, cell: np.ndarray, apart: np.ndarray) -> float:
    """[m] of pieces in cells (n,) that moved (n, 3) more than a simulator."""
    mean = np.nan_to_num(table.moments()[1])[cell]
    return float(np.hypot(*(apart - mean)[:, :2].T).mean())


def _version(values: np.ndarray, found: Folded, turn: _Turn, turns: tuple[tuple[str, str], ...]) -> Version:
    """Of the last of the turns (name, episode) to date."""
    tested = turn.tested
    figures: dict[str, float] = {
        "tests": tested.tests,
        "rejected": int(tested.rejected.sum()),
        "removed": int(tested.removed.sum()),
        DIFFERENCE: found.difference,
    }
    if found.explained is not None:
        figures["explained"] = found.explained
    effects = {GAIN: {DIFFERENCE: found.difference}} if found.difference else {}
    name, parent = turns[-1][0], len(turns) - 2 if len(turns) > 1 else None
    episodes = tuple(dict.fromkeys(episode for _, episode in turns))
    return Version(
        name, values, parent, episodes, turn.before, turn.after, unit="m", effects=effects, figures=figures
    )
