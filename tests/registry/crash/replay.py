"""A disk that loses power: what may be on it after a crash, and each such state put into a folder of its own.

The model. A file's bytes are safe once the file was synced, its name once the folder that holds the name was synced
(either folder of a rename, which is done whole or not at all). Of what was done since, any part may be there, and
the last write of it may be torn: only a beginning of it, or its length with zeros in place of the data.
Changes of the same place keep their order, as they do in a page cache; those of different places have the same effect
in any order. So every reordering of some changes, cut off anywhere, leaves what one of their subsets leaves.
SQLite's shared memory (`-shm`) is not kept on a disk, and in no state.
"""

import itertools
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from recorder import Change, Recorder

ALL_SUBSETS_OF = 6  # changes; of more, so many subsets are drawn at random
DRAWN = 1000
OLDER_DRAWN = 3  # subsets of what was not synced before the last sync either, beside none and all of it

Tree = dict[str, bytes | None]  # files by path, None for folders


@dataclass(frozen=True)
class Crash:
    """A state of the disk: what is in the folder; the steps that were done; the one that was under way, or ""."""

    tree: Tree
    done: int
    under_way: str
    why: str


@dataclass
class Disk:
    """Files and folders by number; folder 0 is the one that was watched."""

    files: dict[int, bytes] = field(default_factory=dict)
    folders: dict[int, dict[str, int]] = field(default_factory=lambda: {0: {}})

    def copy(self) -> "Disk":
        return Disk(dict(self.files), {number: dict(names) for number, names in self.folders.items()})

    def tree(self) -> Tree:
        """What can be reached from the top."""
        found: Tree = {}
        waiting = [(0, "")]
        while waiting:
            folder, prefix = waiting.pop()
            for name, number in self.folders[folder].items():
                if number in self.folders:
                    found[prefix + name] = None
                    waiting.append((number, f"{prefix}{name}/"))
                else:
                    found[prefix + name] = self.files.get(number, b"")
        return found


@dataclass(frozen=True)
class Names:
    """A change of names: what each (folder, name) stands for afterwards, None for nothing."""

    sets: tuple[tuple[tuple[int, str], int | None], ...]
    made: int | None = None  # number of a folder that is new

    def apply(self, disk: Disk, torn: random.Random | None = None) -> None:
        if self.made is not None:
            disk.folders.setdefault(self.made, {})
        for (folder, name), number in self.sets:
            names = disk.folders.setdefault(folder, {})
            if number is None:
                names.pop(name, None)
            else:
                names[name] = number

    @property
    def places(self) -> frozenset:
        return frozenset(place for place, _ in self.sets)

    @property
    def safe_with(self) -> set[tuple[str, int]]:
        """What makes it last: a sync of a folder that it changes."""
        return {("sync_folder", folder) for (folder, _), _ in self.sets}


@dataclass(frozen=True)
class Bytes:
    """A change of a file's bytes; `data` is None where it is cut to a length of `offset`."""

    file: int
    offset: int
    data: bytes | None

    def apply(self, disk: Disk, torn: random.Random | None = None) -> None:
        before = disk.files.get(self.file, b"")
        data = self.data
        if torn is not None and data:
            cut = torn.randrange(len(data))
            data = torn.choice((data[:cut], bytes(len(data))))
        if data is None:
            disk.files[self.file] = before[: self.offset].ljust(self.offset, b"\0")
        elif data:
            head = before[: self.offset].ljust(self.offset, b"\0")
            disk.files[self.file] = head + data + before[self.offset + len(data) :]

    @property
    def places(self) -> frozenset:
        return frozenset()  # a sync makes all changes of a file last, in their order

    @property
    def safe_with(self) -> set[tuple[str, int]]:
        return {("sync", self.file)}


Pending = list[tuple[int, Names | Bytes]]  # each with the number of the change


class Journal:
    """What a recorder noted, ready to be replayed."""

    def __init__(self, recorder: Recorder):
        self.changes = tuple(recorder.changes)
        self.start, self._live, self._last = Disk(), Disk(), 0
        for path, held in recorder.start.items():
            if held is None:
                self._apply(self._live, Change("folder", path))
            else:
                number, data = held
                self._apply(self._live, Change("create", path, number))
                self._live.files[number] = data
        self.start = self._live.copy()
        self.effects = tuple(self._apply(self._live, change) for change in self.changes)
        self.last: Tree = self._live.tree()

    def after_steps(self) -> Iterator[Tree]:
        """What is there in the beginning, and when each step was done."""
        disk = self.start.copy()
        yield disk.tree()
        for change, effect in zip(self.changes, self.effects, strict=True):
            if isinstance(effect, Names | Bytes):
                effect.apply(disk)
            elif change.kind == "done":
                yield disk.tree()

    def prefixes(self, share: float = 1.0) -> Iterator[Crash]:
        """What is left where everything until some change was done: a process that was killed."""
        disk, rng = self.start.copy(), random.Random("prefixes")
        for i, (effect, done, under_way) in enumerate(self._steps()):
            if isinstance(effect, Names | Bytes):
                effect.apply(disk)
                if rng.random() < share:
                    yield Crash(disk.tree(), done, under_way, f"everything until change {i}")

    def power_cuts(self, share: float = 1.0) -> Iterator[Crash]:
        """What may be left by a power cut just before each sync, and in the end."""
        safe, pending, fresh = self.start.copy(), [], 0
        for i, (effect, done, under_way) in enumerate((*self._steps(), (("end", 0), *self._end()))):
            if isinstance(effect, Names | Bytes):
                pending.append((i, effect))
            elif effect is not None:
                for tree, why in _subsets(safe, pending, fresh, random.Random(f"power cut {i}"), share):
                    yield Crash(tree, done, under_way, f"before change {i}: {why}")
                pending, fresh = _synced(safe, pending, effect), i

    def _steps(self) -> Iterator[tuple[Names | Bytes | tuple[str, int] | None, int, str]]:
        done, under_way = 0, ""
        for change, effect in zip(self.changes, self.effects, strict=True):
            if change.kind == "begin":
                under_way = change.path
            elif change.kind == "done":
                done, under_way = done + 1, ""
            yield effect, done, under_way

    def _end(self) -> tuple[int, str]:
        return sum(change.kind == "done" for change in self.changes), ""

    def _apply(self, live: Disk, change: Change) -> Names | Bytes | tuple[str, int] | None:
        """Carry a change out, and return what it means in numbers: an effect, or what it makes safe."""
        if change.kind in ("begin", "done"):
            return None
        if change.kind == "sync":
            return ("sync", change.file)
        if change.kind == "sync_folder":
            return ("sync_folder", self._number(live, change.path))
        effect: Names | Bytes
        if change.kind in ("write", "truncate"):
            effect = Bytes(change.file, change.offset, change.data if change.kind == "write" else None)
        else:
            place = self._place(live, change.path)
            if change.kind == "create":
                effect = Names(((place, change.file),))
            elif change.kind == "folder":
                self._last -= 1
                effect = Names(((place, self._last),), made=self._last)
            elif change.kind == "remove":
                live.folders[place[0]][place[1]]  # KeyError: it came to be without being noted
                effect = Names(((place, None),))
            else:
                number = live.folders[place[0]][place[1]]
                effect = Names(((place, None), (self._place(live, change.new), number)))
        effect.apply(live)
        return effect

    def _place(self, live: Disk, path: str) -> tuple[int, str]:
        folder, _, name = path.rpartition("/")
        return self._number(live, folder or "."), name

    def _number(self, live: Disk, path: str) -> int:
        number = 0
        for name in path.split("/") if path != "." else ():
            number = live.folders[number][name]
        return number


def build(tree: Tree, folder: Path) -> None:
    """Make `folder` hold what is in the tree."""
    folder.mkdir(parents=True)
    for path, data in sorted(tree.items()):
        if data is None:
            (folder / path).mkdir(exist_ok=True)
        else:
            (folder / path).write_bytes(data)


def _synced(safe: Disk, pending: Pending, what: tuple[str, int]) -> Pending:
    """Make what a sync covers safe; returns the rest."""
    settled = {i for i, effect in pending if what in effect.safe_with}
    places: set = set()
    for i, effect in reversed(pending):  # an older change of the same name is over with the newer one
        if i in settled:
            places |= effect.places
        elif effect.places & places:
            settled.add(i)
    for i, effect in pending:
        if i in settled:
            effect.apply(safe)
    return [(i, effect) for i, effect in pending if i not in settled]


def _subsets(
    safe: Disk, pending: Pending, since: int, rng: random.Random, share: float
) -> Iterator[tuple[Tree, str]]:
    fresh = [change for change in pending if change[0] > since]
    older = [change for change in pending if change[0] <= since]
    of_older = [set(), set(range(len(older))), *(_some(older, rng) for _ in range(OLDER_DRAWN))]
    of_older = [some for i, some in enumerate(of_older) if some not in of_older[:i]]
    if len(fresh) <= ALL_SUBSETS_OF:
        few = [set(s) for n in range(len(fresh) + 1) for s in itertools.combinations(range(len(fresh)), n)]
        chosen = itertools.product(of_older, few)
    else:
        chosen = ((rng.choice(of_older), _some(fresh, rng)) for _ in range(DRAWN))
    for from_older, from_fresh in chosen:
        if rng.random() >= share:
            continue
        kept = [older[i] for i in sorted(from_older)] + [fresh[i] for i in sorted(from_fresh)]
        yield _left(safe, kept, None, rng)
        writes = [i for i, effect in kept if isinstance(effect, Bytes) and effect.data]
        if writes:
            yield _left(safe, kept, rng.choice(writes), rng)


def _some(changes: Pending, rng: random.Random) -> set[int]:
    return {i for i in range(len(changes)) if rng.random() < 0.5}


def _left(safe: Disk, kept: Pending, torn: int | None, rng: random.Random) -> tuple[Tree, str]:
    disk = safe.copy()
    for i, effect in kept:
        effect.apply(disk, rng if i == torn else None)
    return disk.tree(), f"kept {[i for i, _ in kept]}" + (f", {torn} torn" if torn is not None else "")
