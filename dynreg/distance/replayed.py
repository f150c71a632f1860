"""Distance by replay: every entry's simulator drives the recording's own commands."""

import numpy as np

from dynreg.distance.query import DistanceQuery, Ranked, in_order

AT_ONCE = 32  # entries that are replayed together, at most


def rank(asked: DistanceQuery) -> Ranked:
    """Entries by their replay error."""
    unit, allowed = asked.population.unit, asked.allowed
    parts = np.array_split(allowed, max(-(-len(allowed) // AT_ONCE), 1))
    found = np.concatenate([asked.replayed(unit[part]) for part in parts])
    return in_order(allowed, found, len(allowed), replays=len(allowed))
