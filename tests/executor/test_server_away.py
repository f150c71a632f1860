"""A populate whose catalogue's server starts anew in the middle: it waits, loses nothing, and makes the same bytes."""

import signal
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest
import tiny_registry
from conftest import EACH, ROBOT, SHARDS

import dynreg.registry.server as server
from dynreg.errors import Awaited, NoPlaceError
from dynreg.executor import Local
from dynreg.neighbours.entries import Stopwatch
from dynreg.registry import Registry, verify
from dynreg.sim.robot import load_robot
from dynreg.verbs.populations import Plan, begin, fill

WHEN = {
    "between two shards": "dynreg.registry.populations:gaps_between",
    "before a shard is begun": "dynreg.registry.registry:open_directory",
    "while its entries are made": "dynreg.verbs.populations:make_entries",
    "in the middle of its put": "dynreg.registry.writing:Writing.page",
}


@pytest.fixture
def shared(stores, tmp_path: Path) -> Iterator[Registry]:
    name = stores.new()
    with Registry.share(tmp_path / "face", stores.catalog(name), stores.blobs(name)) as registry:
        yield registry
    stores.drop(name)


def _populated(registry: Registry, begun: Callable[[], None] = lambda: None) -> int:
    plan, watch = Plan(SHARDS * EACH, 0, tiny_registry.QUICK, EACH, 1), Stopwatch()
    identity = begin(registry, load_robot(ROBOT), plan, watch, lambda *_: None)
    begun()
    return fill(registry, identity, Local(1), watch, lambda _: None)


def _stopping(monkeypatch: pytest.MonkeyPatch, place: str, stop: Callable[[], None]) -> None:
    """Have the server stop when the function at `place` is called for the second time."""
    module, _, name = place.partition(":")
    *owners, last = name.split(".")
    owner = import_module(module)
    for one in owners:
        owner = getattr(owner, one)
    function, calls = getattr(owner, last), []

    def run(*args, **told):
        calls.append(1)
        if len(calls) == 2:
            stop()
        return function(*args, **told)

    monkeypatch.setattr(owner, last, run)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGQUIT], ids=["restart", "crash"])
@pytest.mark.parametrize("when", WHEN)
def test_a_server_that_starts_anew_is_waited_for_and_the_bytes_are_the_same(
    when, how, shared, stores, usual, monkeypatch
):
    pauses = []

    def pause(seconds: float) -> None:
        pauses.append(seconds)
        if len(pauses) == 4:
            stores.postgres.start()

    monkeypatch.setattr(server, "time", SimpleNamespace(sleep=pause))
    with pytest.warns(Awaited, match="cannot be reached, or broke off.* tried again for 61 s"):
        added = _populated(
            shared, lambda: _stopping(monkeypatch, WHEN[when], lambda: stores.postgres.stop(how))
        )
    assert added == SHARDS * EACH and pauses == sorted(pauses) and len(pauses) >= 4
    bucket = shared.directory.bucket
    shards = {name.split("/")[1]: bucket.read(name) for name in bucket.names("shards")}
    assert (shared.content_hash(), shards) == usual
    report = verify(shared.path)
    assert report.faults == () == report.leftovers


def test_a_server_that_stays_away_is_told_of_after_a_minute_and_a_second_populate_goes_on(
    shared, stores, usual, monkeypatch
):
    pauses = []
    monkeypatch.setattr(server, "time", SimpleNamespace(sleep=pauses.append))
    place = WHEN["while its entries are made"]
    with pytest.warns(Awaited), pytest.raises(NoPlaceError, match="tried again for 61 s.* stored stays"):
        _populated(shared, lambda: _stopping(monkeypatch, place, stores.postgres.stop))
    assert tuple(pauses) == server.PAUSES and 50 < sum(pauses) < 70
    stores.postgres.start()
    monkeypatch.undo()
    assert _populated(shared) == (SHARDS - 1) * EACH
    assert shared.content_hash() == usual[0]
