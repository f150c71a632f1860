"""The results about a recording: a recording may be asked with several robots, and each has results of its own."""

import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING

from dynreg.errors import Assumed, CorruptError

if TYPE_CHECKING:
    from dynreg.registry import Registry, ResultRecord


def about(registry: "Registry", kind: str | None, recording: str | None) -> "Iterator[ResultRecord]":
    """The results of a kind (None for all) about a recording (its id, None for no recording), that stored last first.

    Damaged ones are left out, which is said.
    """
    known = recording is None or registry.holds(recording)
    for identity in registry.results_about(kind, recording) if known else ():
        try:
            yield registry.result(identity)
        except CorruptError as problem:
            warnings.warn(f"result {identity[:12]} is left out: {problem}", Assumed, 3)


def newest_for(registry: "Registry", kind: str | None, recording: str, robot: str) -> "ResultRecord | None":
    """The newest of these that was made for a robot (its name), if there is one; one that tells no robot counts."""
    found = about(registry, kind, recording)
    return next((record for record in found if record.document.get("robot", robot) == robot), None)
