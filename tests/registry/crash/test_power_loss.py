"""Power loss at any moment, and a disk that refuses any one change: what was acknowledged is there, and opens clean.

A sample of the cases runs here; all of them in `make slow` or by `python tests/registry/crash/full.py`.
"""

import errno
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest
import sqlite_vfs
from checking import Recorded, Tally, crash_states, record, refusals, replay_states, snapshot
from recorder import Fault, Recorder, recording
from scenarios import REGISTRY, SCENARIOS, SHORT

import dynreg.registry.disk as disk
from dynreg.errors import RegistryError
from dynreg.registry import verify

STATES, REFUSED = 10, 6  # of each scenario, about


@pytest.fixture(autouse=True)
def _sqlite_can_be_watched() -> None:
    try:
        sqlite_vfs.library()
    except OSError as error:
        pytest.skip(str(error))


@contextmanager
def _folder() -> Iterator[Path]:
    """A folder in memory, where syncs cost nothing, if there is one."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        yield Path(folder)


@pytest.fixture
def place() -> Iterator[Path]:
    with _folder() as folder:
        yield folder


@pytest.fixture(scope="module")
def recorded() -> Iterator[Callable[[str], Recorded]]:
    """Scenarios by name, each carried out once."""
    with _folder() as folder:
        yield cache(lambda name: record(SCENARIOS[name], folder / name))


def _after_power_cuts(recorded: Recorded, place: Path) -> Tally:
    tally, changes = Tally(), len(recorded.journal.changes)
    share = STATES / (50 * changes)  # there are some 50 states for each change
    replay_states(recorded, crash_states(recorded.journal, share), place / "states", tally)
    return tally


@pytest.mark.parametrize("name", SCENARIOS)
def test_after_a_power_cut_all_that_was_acknowledged_is_there(name, recorded, place):
    tally = _after_power_cuts(recorded(name), place)
    assert tally.cases and tally.wrong == {}


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_refused_change_is_told_in_a_sentence_and_loses_nothing(name, recorded, place):
    tally = Tally()
    refusals(recorded(name), place, tally, REFUSED / (3 * len(recorded(name).journal.changes)))
    assert tally.cases and tally.wrong == {}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_every_crash_state_and_every_refused_change(name, recorded, place):
    states, refused = Tally(), Tally()
    replay_states(recorded(name), crash_states(recorded(name).journal), place / "states", states)
    refusals(recorded(name), place / "refused", refused)
    assert (states.wrong, refused.wrong) == ({}, {})


@pytest.mark.parametrize("forgotten", ["sync", "sync_folder"])
def test_a_sync_that_the_registry_forgets_is_found(forgotten, place, monkeypatch):
    monkeypatch.setattr(disk, forgotten, lambda of: None)
    assert _after_power_cuts(record(SHORT, place / "recorded"), place).wrong["lost"]


@pytest.mark.parametrize(
    "kinds", [("write", "memory"), ("create", "write", "folder", "rename", "sync", "memory")]
)
@pytest.mark.parametrize("name", [name for name, scenario in SCENARIOS.items() if scenario.steps[0].heals])
def test_a_repair_on_a_full_disk_changes_nothing(name, kinds, place):
    root, aside = place / "root", place / "aside"
    root.mkdir()
    aside.mkdir()
    SCENARIOS[name].begin(root, aside)
    before = snapshot(root)
    with recording(Recorder(root, Fault(0, errno.ENOSPC, lasting=True, kinds=kinds))):
        with pytest.raises(RegistryError, match="No space left.*free some space") as error:
            verify(root / REGISTRY, repair=True)
    assert type(error.value) is RegistryError and snapshot(root) == before
    verify(root / REGISTRY, repair=True)
    assert verify(root / REGISTRY).faults == ()


class _NoFolding(Recorder):
    """Refuses what SQLite writes from its log into the database, which SQLite keeps to itself."""

    def allow(self, kind: str, path: str) -> None:
        if kind == "write" and path.endswith("catalog.sqlite") and Path(f"{path}-wal").exists():
            raise OSError(errno.EIO, "Input/output error", path)


def test_a_new_catalogue_that_is_half_in_its_log_takes_no_place(place):
    root, aside = place / "root", place / "aside"
    root.mkdir()
    aside.mkdir()
    SCENARIOS["lost catalogue"].begin(root, aside)
    with recording(_NoFolding(root)):
        with pytest.raises(RegistryError, match="could not be folded in"):
            verify(root / REGISTRY, repair=True)
    assert not (root / REGISTRY / "catalog.sqlite").exists()
    verify(root / REGISTRY, repair=True)
    assert verify(root / REGISTRY).faults == ()


def test_power_cuts_leave_more_than_kills(place):
    """States in which a later change is there and an earlier one is not: no killed process leaves them."""
    journal = record(SHORT, place).journal
    killed = {hash(frozenset(crash.tree.items())) for crash in journal.prefixes()}
    cut = {hash(frozenset(crash.tree.items())) for crash in journal.power_cuts(0.1)}
    assert len(cut - killed) > 100
