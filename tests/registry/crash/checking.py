"""Is what was acknowledged still there? States of a crash and refused changes, each judged in a folder of its own."""

import errno
import os
import random
import shutil
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from recorder import SHARED, Fault, Recorder, recording
from replay import Crash, Journal, build
from scenarios import REGISTRY, Scenario, Step, look

from dynreg.errors import CorruptError, DynregError
from dynreg.registry import Registry, verify

FAULTS = (Fault(0, errno.ENOSPC), Fault(0, errno.ENOSPC, lasting=True), Fault(0, errno.EIO))


@dataclass
class Tally:
    """How many cases there were, and what was wrong: by kind, the case's number and a line about it.

    Kinds: "lost" (acknowledged and not there, or half of a step is), "not clean" (verify finds a fault), "refused" (the
    step cannot be done again), "traceback" (an error that is no sentence), "unclear" (one that is no good sentence).
    """

    cases: int = 0
    wrong: dict[str, dict[int, str]] = field(default_factory=dict)

    def add(self, kind: str, line: str) -> None:
        """Note what is wrong in the present case."""
        self.wrong.setdefault(kind, {}).setdefault(self.cases, line)

    def take(self, other: "Tally") -> None:
        """Count the cases of another tally, too."""
        for kind, lines in other.wrong.items():
            self.wrong.setdefault(kind, {}).update((self.cases + case, line) for case, line in lines.items())
        self.cases += other.cases

    def __str__(self) -> str:
        bad = set().union(*self.wrong.values())
        found = "".join(f", {kind} {len(lines)}" for kind, lines in sorted(self.wrong.items()))
        return f"{self.cases}, of these sound {self.cases - len(bad)}" + (found or ", lost 0")


@dataclass(frozen=True)
class Recorded:
    """A scenario that was carried out once: its journal, and what could be read after each step."""

    scenario: Scenario
    journal: Journal
    aside: Path
    sights: tuple[Any, ...]  # the first is the one before the first step
    trees: tuple[dict, ...]


def record(scenario: Scenario, place: Path) -> Recorded:
    """Carry a scenario out once, watched."""
    root, aside = place / "watched", place / "aside"
    root.mkdir(parents=True)
    aside.mkdir()
    scenario.begin(root, aside)
    recorder = Recorder(root)
    with recording(recorder):
        for step in scenario.steps:
            recorder.mark("begin", step.name)
            step.do(root, aside)
            recorder.mark("done", step.name)
    journal = Journal(recorder)
    held = snapshot(root)
    if held != journal.last:
        different = {
            name for name in held.keys() | journal.last.keys() if held.get(name) != journal.last.get(name)
        }
        raise AssertionError(f"changed, and nobody noted how: {sorted(different)}")
    trees = tuple(journal.after_steps())
    sights = tuple(_seen(scenario, i, tree, place / f"after {i}") for i, tree in enumerate(trees))
    return Recorded(scenario, journal, aside, sights, trees)


def _seen(scenario: Scenario, step: int, tree: dict, place: Path) -> Any:
    build(tree, place)
    try:
        return look(place)
    except DynregError:
        if not scenario.steps[step].heals:
            raise
        return None  # damaged, and not yet repaired


def crash_states(journal: Journal, share: float = 1.0) -> Iterator[Crash]:
    """Every state that is unlike the others (or a share of them, drawn), the prefixes first."""
    seen = set()
    for crashes in (journal.prefixes(share), journal.power_cuts(share)):
        for crash in crashes:
            key = hash((frozenset(crash.tree.items()), crash.done, crash.under_way))
            if key not in seen:
                seen.add(key)
                yield crash


def replay_states(recorded: Recorded, crashes: Iterable[Crash], place: Path, tally: Tally) -> None:
    """Judge each state: it opens clean, what was acknowledged is there, and the step can be done again.

    States that are the same, byte for byte, once the registry was opened (or repaired, where it is damaged) are judged
    once: all that is read and done later begins with those bytes. Of what has a temporary name, only the name is
    compared: nothing reads it.
    """
    verdicts: dict[int, dict[str, str]] = {}
    for crash in crashes:
        tally.cases += 1
        doing = f"in {crash.under_way!r}" if crash.under_way else f"after {crash.done} steps"
        case = f"{recorded.scenario.name}, {doing}, {crash.why}"
        folder = place / f"state {tally.cases}"
        build(crash.tree, folder)
        key = _settled(recorded, crash, folder)
        verdict = verdicts.get(key)
        if verdict is None:
            shutil.rmtree(folder)
            build(crash.tree, folder)
            one = Tally()
            _judge(recorded, crash.done, crash.under_way, folder, case, one)
            verdict = {kind: line for kind, lines in one.wrong.items() for line in lines.values()}
            verdicts |= {} if key is None else {key: verdict}
        for kind, line in verdict.items():
            tally.add(kind, line)
        shutil.rmtree(folder)


def _settled(recorded: Recorded, crash: Crash, folder: Path) -> int | None:
    """A number for what is in a folder once it was opened; None where it cannot be."""
    try:
        if crash.under_way and recorded.scenario.steps[crash.done].heals:
            recorded.scenario.steps[crash.done].do(folder, recorded.aside)
        elif (folder / REGISTRY).is_dir():
            Registry.open(folder / REGISTRY).close()
    except Exception:  # it is judged, and told
        return None
    found = snapshot(folder)
    held = {path: data for path, data in found.items() if ".tmp-" not in path}
    names = {path.partition(".tmp-")[0] for path in found} - held.keys()
    return hash((crash.done, crash.under_way, frozenset(held.items()), frozenset(names)))


def _judge(recorded: Recorded, done: int, under_way: str, folder: Path, case: str, tally: Tally) -> None:
    step = recorded.scenario.steps[done] if under_way else None
    allowed = recorded.sights[done : done + (2 if step else 1)]
    try:
        if step is not None and step.heals:
            step.do(folder, recorded.aside)
            allowed = allowed[1:]
        if any((allowed[0] or {}).values()):  # else the creation may be half done, and is done again below
            _check(folder, allowed, case, tally, under_way=bool(step and not step.heals))
        if step is not None:
            step.do(folder, recorded.aside)
            _check(folder, recorded.sights[done + 1 : done + 2], f"{case}, done again", tally)
    except DynregError as error:
        tally.add("refused", f"{case}: {error}")
    except Exception as error:  # whatever it is, nobody should see it
        tally.add("traceback", f"{case}: {error!r}")


def _check(
    folder: Path, allowed: Sequence[dict[str, Any]], case: str, tally: Tally, under_way: bool = False
) -> None:
    try:
        faults = [fault for fault in verify(folder / REGISTRY).faults if fault.lost or not under_way]
        if faults:
            tally.add("not clean", f"{case}: verify finds {faults[0]}")
        sight = look(folder)
    except DynregError as error:
        tally.add("lost", f"{case}: {error}")
        return
    if under_way:  # of several maps some may be the old ones and some the new ones
        sight, *allowed = (_without_maps(seen) for seen in (sight, *allowed))
    if sight not in allowed:
        tally.add("lost", f"{case}: {_difference(sight, allowed)}")


def _without_maps(sight: dict[str, Any]) -> dict[str, Any]:
    return {place: told and {k: v for k, v in told.items() if k != "maps"} for place, told in sight.items()}


def _difference(sight: dict[str, Any], allowed: Sequence[dict[str, Any]]) -> str:
    """How a sight differs from the one of the allowed ones that is nearest."""

    def against(wanted: dict[str, Any]) -> list[str]:
        found = []
        for place, told in wanted.items():
            seen = sight[place]
            if told is None or seen is None:
                found += [f"the {place} is {'missing' if told else 'there'}"] if told != seen else []
                continue
            different = [what for what in told if told[what] != seen[what]]
            found += [f"{place}: {what}: {seen[what]!s:.150}, not {told[what]!s:.150}" for what in different]
        return found

    return "; ".join(min(map(against, allowed), key=len))


def refusals(recorded: Recorded, place: Path, tally: Tally, share: float = 1.0) -> None:
    """Refuse every change of every step (or a share of them, drawn) once in each way, and judge what is left."""
    rng, case = random.Random("refusals"), 0
    for number, step in enumerate(recorded.scenario.steps):
        for at, kind in enumerate(_refusable(recorded, number, step, place)):
            for mode in FAULTS:
                fault = replace(mode, at=at)
                if fault.hits(at, kind) and rng.random() < share:
                    case += 1
                    _refuse(recorded, number, fault, kind, place / f"refused {case}", tally)


def _refusable(recorded: Recorded, number: int, step: Step, place: Path) -> list[str]:
    folder = place / f"whole {number}"
    build(recorded.trees[number], folder)
    recorder = Recorder(folder)
    with recording(recorder):
        step.do(folder, recorded.aside)
    shutil.rmtree(folder)
    return recorder.kinds


def _refuse(recorded: Recorded, number: int, fault: Fault, kind: str, folder: Path, tally: Tally) -> None:
    step = recorded.scenario.steps[number]
    build(recorded.trees[number], folder)
    recorder = Recorder(folder, fault)
    name = errno.errorcode[fault.code] + (" from then on" if fault.lasting else "")
    case = f"{recorded.scenario.name}, {step.name!r}, {kind} {fault.at}, {name}"
    returned, raised = False, None
    with recording(recorder):
        try:
            step.do(folder, recorded.aside)
            returned = True
        except Exception as error:
            raised = error
    if recorder.refused:
        tally.cases += 1
        if not isinstance(raised, DynregError | None):
            tally.add("traceback", f"{case}: {raised!r}")
        elif isinstance(raised, CorruptError) and not step.heals:
            tally.add("unclear", f"{case}: {raised}")  # nothing is damaged
        done = number + returned
        _judge(recorded, done, "" if returned else step.name, folder, case, tally)
    shutil.rmtree(folder)


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """Every file of a folder with its bytes, but SQLite's shared memory."""
    paths = (path for path in folder.rglob("*") if SHARED not in path.name)
    return {os.path.relpath(path, folder): None if path.is_dir() else path.read_bytes() for path in paths}
