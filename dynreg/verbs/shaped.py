"""Which episodes of a recording shaped a simulator.

Its own are those that it was fitted to or chosen by. It inherits those of the simulators that it came from.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dynreg.data.names import episode_of
from dynreg.errors import CorruptError, NoMatchError
from dynreg.verbs.newest import about
from dynreg.verbs.simulator import WORDS, Document, Simulator

if TYPE_CHECKING:
    from dynreg.registry import Registry
    from dynreg.verbs.subjects import Recorded


def origin_of(asked: "Recorded", made_by: str) -> dict[str, Any]:
    """What the lineage of a simulator says that a verb made of recordings."""
    origin: dict[str, Any] = {"made_by": made_by, "recording": asked.recording.id}
    return origin | ({"recordings": [one.recording.id for one in asked.each]} if asked.each else {})


def queried(asked: "Recorded", made_by: str, parts: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """The same of one that a query made, with the episodes that it was fitted to or chosen by.

    parts : {"fit", "select"}: names of episodes, or of windows of them.
    """
    return origin_of(asked, made_by) | {"episodes": sorted(_shaping(parts))}


def shaped(registry: "Registry", found: Simulator, recording: str) -> frozenset[str] | None:
    """Episodes of a recording (its id) that shaped a simulator or one that it came from, as far as these are kept.

    None where one of them was fitted to the recording, and nothing says to which part of it.
    """
    own = _shaped(registry, found.id, found.lineage, found.robot.name, recording)
    before = _inherited(registry, found, recording)
    return None if own is None or before is None else own | before


def fitted_on(registry: "Registry", found: Simulator) -> tuple[Simulator, Document | None]:
    """The simulator with the parts of the recording that it was made of, and the newest result that tells it.

    None where no such result is stored.
    """
    recording = found.lineage.get("recording")
    document = newest_telling(registry, found.id, found.robot.name, recording)
    return with_parts(registry, found, document, recording), document


def with_parts(
    registry: "Registry", found: Simulator, document: Document | None, recording: str | None
) -> Simulator:
    """The simulator with its own episodes and those that it inherits.

    Its own are told by a result about the recording (`document`), else by its lineage.
    """
    if recording is None:
        return found
    before = _inherited(registry, found, recording)
    if before is None:
        return replace(found, fitted_to=None)
    found = replace(found, inherited=before)
    if document is not None:
        told = {"parts": document.get("parts"), "asked": document.get("asked") or {}}
        return replace(found, fitted_to=_fitted(document), **told)
    own = _shaped(registry, found.id, found.lineage, found.robot.name, recording)
    return replace(found, fitted_to=own)


def newest_telling(
    registry: "Registry", identity: str | None, robot: str, recording: str | None
) -> Document | None:
    """The newest of all results about a recording that tells a simulator (its id) of a robot (its name), or None."""
    for word in (each for one in WORDS.values() for each in one.each()) if recording else ():
        for record in about(registry, word.kind, recording):
            if record.document.get("robot", robot) == robot and word.told(record.document) == identity:
                return record.document
    return None


def _fitted(document: Document) -> frozenset[str] | None:
    """Names of the episodes that a result's simulator was fitted to or chosen by; None where it does not say."""
    parts = document.get("parts")
    return None if parts is None else _shaping(parts)


def _shaping(parts: Mapping[str, Sequence[str]]) -> frozenset[str]:
    """The episodes of fit and select, which are told by name, or as "episode[3]" where they were cut into windows."""
    return frozenset(episode_of(name) for name in (*parts["fit"], *parts["select"]))


def _inherited(registry: "Registry", found: Simulator, recording: str) -> frozenset[str] | None:
    """Those that shaped a simulator that it came from; see `shaped`."""
    out, lineage = frozenset(), found.lineage
    while (parent := lineage.get("parent")) is not None:
        try:
            lineage = registry.simulator(parent).get("lineage", {})
        except (NoMatchError, CorruptError):  # an entry, which no recording shaped, or one that is gone
            break
        own = _shaped(registry, parent, lineage, found.robot.name, recording)
        if own is None:
            return None
        out |= own
    return out


def _shaped(
    registry: "Registry", identity: str | None, lineage: Mapping[str, Any], robot: str, recording: str
) -> frozenset[str] | None:
    """Those that shaped this simulator alone, by its lineage, else by the result that tells it; see `shaped`."""
    fitted, several = lineage.get("recording"), lineage.get("recordings", ())
    if recording not in (fitted, *several):
        return frozenset() if fitted is None else _shaped_parts(registry, identity, lineage, robot, recording)
    names = lineage.get("episodes")
    if names is None:
        document = newest_telling(registry, identity, robot, fitted)
        names = document and _fitted(document)
    if names is None:
        return None
    if fitted == recording:
        return frozenset(names)
    mine = _without(names, _prefixes(registry, recording))
    every = tuple(prefix for one in several for prefix in _prefixes(registry, one))
    return mine if mine or all(name.startswith(every) for name in names) else None


def _shaped_parts(
    registry: "Registry", identity: str | None, lineage: Mapping[str, Any], robot: str, recording: str
) -> frozenset[str] | None:
    """As `_shaped`, of a recording that was joined from some that may have shaped the simulator."""
    if not registry.holds(recording):
        return frozenset()
    out = frozenset()
    for part in registry.recording(recording).provenance.get("joined", ()):
        own = _shaped(registry, identity, lineage, robot, part)
        if own is None:
            return None
        out |= {prefix + name for name in own for prefix in _prefixes(registry, part)}
    return out


def _without(names: Collection[str], prefixes: Sequence[str]) -> frozenset[str]:
    """Of episodes of joined recordings, NAME/EPISODE, those that begin so, by their own names."""
    return frozenset(n.removeprefix(p) for n in names for p in prefixes if n.startswith(p))


def _prefixes(registry: "Registry", recording: str) -> list[str]:
    """What the episodes of a recording may be called by where it was joined with others; none where it is gone."""
    if not registry.holds(recording):
        return []
    return [f"{name}/" for name in (*registry.recording_info(recording).names, recording[:12])]
