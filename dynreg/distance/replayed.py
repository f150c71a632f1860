"""Distance by replay: every entry's simulator drives the recording's own commands."""

import numpy as np

from dynreg.distance.asked import Asked, Ranked, in_order
from dynreg.errors import UsageError

AT_ONCE = 32  # entries that are replayed together, at most


def rank(asked: Asked) -> Ranked:
    """Entries by their replay error; raises UsageError where nothing can be replayed."""
    if asked.replayed is None:
        raise UsageError(
            "distance 'replay' without a replay", expected="what replays entries", do="give `replayed`"
        )
    unit, allowed = asked.population.unit, asked.allowed
    parts = np.array_split(allowed, max(-(-len(allowed) // AT_ONCE), 1))
    found = np.concatenate([asked.replayed(unit[part]) for part in parts])
    return in_order(allowed, found, len(allowed), replays=len(allowed))
