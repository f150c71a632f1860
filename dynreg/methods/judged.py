"""One measure for the answers of all methods: replay errors of simulators, with their effects."""

from collections.abc import Sequence

import numpy as np

from dynreg.replay.data import Data
from dynreg.replay.parts import names
from dynreg.replay.windows import Replayer, Windows, errors
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import Case, rollouts


def replay_errors(data: Data, configs: Sequence[SimConfig], threads: int = 0) -> np.ndarray:
    """(n, 2) replay errors of simulators on the windows that are not held out and on the others, NaN without any.

    1 is as large as the motion; see `replay.windows.errors`. Channels that are not measured do not count.
    """
    replayer, robot = Replayer(data.robot, data.windows, threads), data.robot
    out = np.full((len(configs), 2), np.nan)
    for part, windows in enumerate((data.parts.chosen, np.flatnonzero(data.parts.test))):
        if not len(windows):
            continue
        run, measured = data.windows.run.take(windows), data.windows.measured[windows]
        cases = [
            Case(robot.space.from_dict(dict(c.values))[None], run, terms_of(c, robot) if c.effects else None)
            for c in configs
        ]
        for number, done in enumerate(rollouts(robot, cases, threads=threads)):
            out[number, part] = float(errors(replayer.against(done.states, measured)).mean())
    return out


def saw(data: Data, windows: Windows, chosen: np.ndarray) -> tuple[str, ...]:
    """Names of what is held out of a recording that windows `chosen` of another cut of it show, by episode or piece.

    A diagnosis cuts a recording in its own way: it leaves out gaps, and no rollout is longer than its horizon. Where
    few episodes are parted by windows, or one is all gaps, it may hold out something else.
    """
    own, mask = data.windows, np.zeros(len(data.windows), dtype=bool)
    for w in np.flatnonzero(data.parts.test):
        here = chosen[windows.episode[chosen] == own.episode[w]]
        first = np.maximum(windows.rows[here, 0], own.rows[w, 0])
        last = np.minimum(windows.rows[here, 1], own.rows[w, 1])
        mask[w] = (last - first > 1).any()  # windows in a row share the row between them
    return names(data.recording, own, mask)
