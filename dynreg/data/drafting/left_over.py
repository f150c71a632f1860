"""The command of a robot with one drive, which a log need not call by its joint: nothing else there could be it."""

from collections.abc import Mapping, Sequence

import numpy as np

from dynreg.data.drafting.offers import EPISODE_COLUMNS, Offer
from dynreg.data.drafting.source import Source, best, used
from dynreg.data.drafting.units import KINDS
from dynreg.data.names import joint_of
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.words import quantity

ONLY_COMMAND = "the only command in the log, which names no joint: check it"
ONLY_COLUMN = "the only column left: check it"


def left_over(offers: Sequence[Offer], spec: RecordingSpec, found: Mapping[str, Source]) -> dict[str, Source]:
    """{action: Source} of the one action of a robot for which nothing was found, where one signal is left for it.

    That is the one command of the log, or else its one column that nothing took, once the joint's position is found:
    before, it may be that as well.
    """
    actions = [c for c in spec.channels if c.kind == "action"]
    if len(actions) != 1 or not (actions[0].name not in found or found[actions[0].name].measured):
        return {}
    (action,) = actions
    left = _left(offers, spec, found)
    asked = [offer for offer in left if offer.command]
    position = f"{joint_of(action.name)}/position"
    placed = position in found or all(c.name != position for c in spec.channels)
    if len(asked) == 1:
        return _taken(asked[0], action, ONLY_COMMAND)
    if len(left) == 1 and placed and not left[0].topic:
        return _taken(left[0], action, ONLY_COLUMN)
    return {}


def _left(offers: Sequence[Offer], spec: RecordingSpec, found: Mapping[str, Source]) -> list[Offer]:
    """The signals that nothing took; no numbers of rows or episodes, nor what never changes."""
    taken = {*EPISODE_COLUMNS, *spec.settings, *used(found)}
    return [o for o in offers if not (o.source in taken or o.header or not o.moves or _counts(o))]


def _counts(offer: Offer) -> bool:
    """Whether a signal goes up by the same from row to row, as the number of a row does."""
    steps = np.diff(offer.series.values)
    return bool(len(steps) and steps[0] != 0 and (steps == steps[0]).all())


def _taken(offer: Offer, action: ChannelSpec, note: str) -> dict[str, Source]:
    """The action from this signal, where that is in a unit of the action and says no other quantity."""
    source, told = best([(0, offer)], action), quantity(offer.words, offer.topic)
    if source is None or told is not None and not (offer.command and told == KINDS.get(action.unit)):
        return {}  # a position that nothing took was measured
    return {action.name: Source(source.keys, (note,), guessed=True)}
