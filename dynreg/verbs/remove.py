"""Things taken out of a registry, and what it need not keep."""

from collections.abc import Sequence
from functools import partial

import dynreg.registry as store
from dynreg.errors import CorruptError, DynregError
from dynreg.registry import Registry
from dynreg.results.stored import CollectedFile, Collection, EntrySummary, Removal
from dynreg.verbs.list import listing
from dynreg.verbs.subjects import lacking


def remove(registry: Registry, refs: Sequence[str], dry_run: bool = False) -> Removal:
    """Remove things with what cannot be used without them; dry_run : say what would go, and change nothing.

    Raises NoMatchError for a ref that fits nothing or several things, UsageError for an entry or for no ref.
    """
    named = {(i.kind, i.id): i for i in listing(registry).items}
    recordings = {i.id: i.name for i in registry.recordings()}
    plan = (store.removal if dry_run else store.remove)(registry, list(refs), partial(_fits, registry))
    items = []
    for (kind, identity), needs in plan.things.items():
        held = named.get((kind, identity))
        name, robot = (held.name, held.robot) if held else ("", "")
        detail = {"needs": needs} if needs else {}
        items.append(EntrySummary(id=identity, kind=kind, name=name, robot=robot, detail=detail))
    moved = [
        f"recording {recordings[identity]} stays, and is used with {info} from then on"
        for identity, info in plan.moved.items()
    ]
    moved += [
        f"the name {name!r} means {'the robot of its recording' if info is None else info} from then on"
        for name, info in plan.named.items()
    ]
    return Removal(
        registry=str(registry.path),
        removed=not dry_run,
        items=tuple(items),
        moved=tuple(moved),
        bytes=plan.size,
    )


def _fits(registry: Registry, recording: str, robot: str) -> bool:
    """Whether a recording can be used with a version of its robot; True for a damaged one, where it is unknown."""
    from dynreg.sim.robot import load_robot

    try:
        loaded = registry.recording(recording)
    except CorruptError:
        return True
    try:
        return not lacking(loaded, load_robot(registry.robot_folder(robot)))
    except DynregError:
        return False


def collect(registry: Registry, *, caches: bool = False, dry_run: bool = False) -> Collection:
    """Remove what the registry need not keep; see `registry.collect`."""
    found = store.collect(registry, caches=caches, dry_run=dry_run)
    return Collection(
        registry=str(registry.path),
        removed=not dry_run,
        files=tuple(CollectedFile(path=one.path, why=one.why, bytes=one.size) for one in found),
        bytes=sum(one.size for one in found),
    )
