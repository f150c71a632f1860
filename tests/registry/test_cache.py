"""What can be computed again is kept by key, and met by nobody who did not ask for that key."""

import json
from pathlib import Path

import pytest

from dynreg.errors import NoMatchError, RegistryError
from dynreg.registry import Registry, export, verify
from dynreg.registry.files import temporary_name

KEY = {"robot": "ab" * 32, "runs": 20, "engine": None, "share": 0.1}
FOUND = {"nats": 18.25, "scores": [0.1 + 0.2, 3.0]}


def _file(registry: Registry) -> Path:
    (path,) = (registry.path / "cache").rglob("*.json")
    return path


def test_what_was_kept_comes_back_under_its_key_alone(registry):
    assert registry.cached("threshold", KEY) is None
    registry.cache("threshold", KEY, FOUND)
    assert registry.cached("threshold", dict(reversed(KEY.items()))) == FOUND
    assert registry.cached("threshold", KEY | {"runs": 21}) is None and registry.cached("other", KEY) is None
    registry.cache("threshold", KEY, FOUND | {"nats": 20.0})
    with Registry.open(registry.path) as other:
        assert other.cached("threshold", KEY) == FOUND | {"nats": 20.0}


@pytest.mark.parametrize("document", [{"nats": float("nan")}, {"nats": {1, 2}}])
def test_what_is_no_plain_json_is_refused(registry, document):
    with pytest.raises(RegistryError, match="plain JSON"):
        registry.cache("threshold", KEY, document)
    assert registry.cached("threshold", KEY) is None


DAMAGES = {
    "torn": lambda data: data[: len(data) // 2],
    "empty": lambda data: b"",
    "no object": lambda data: b"[1]",
    "another number": lambda data: data.replace(b"18.25", b"28.25"),
    "another key": lambda data: json.dumps(json.loads(data) | {"document": {}}).encode(),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_counts_as_not_there_and_is_replaced(registry, damage):
    registry.cache("threshold", KEY, FOUND)
    path = _file(registry)
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    assert registry.cached("threshold", KEY) is None
    report = verify(registry.path)
    assert [fault.kind for fault in report.faults] == ["cache"] and not report.lost
    registry.cache("threshold", KEY, FOUND)
    assert registry.cached("threshold", KEY) == FOUND
    assert verify(registry.path).faults == ()


def test_it_is_no_result_no_stray_and_not_exported(registry, tmp_path):
    before = registry.ids("result"), registry.latest()
    checked = verify(registry.path).checked
    registry.cache("threshold", KEY, FOUND)
    left = temporary_name(_file(registry))
    left.write_bytes(b"half")
    assert (registry.ids("result"), registry.latest()) == before
    with pytest.raises(NoMatchError):
        registry.resolve(_file(registry).stem)
    for repair in (False, True):
        report = verify(registry.path, repair)
        assert report.faults == () and report.leftovers == () and report.checked == checked
    assert registry.cached("threshold", KEY) == FOUND and not left.exists()
    export(registry, ["bench", registry.latest().id], tmp_path / "exported")
    assert not (tmp_path / "exported" / "cache").exists()


def test_thresholds_that_older_versions_kept_as_results_are_met_by_nobody(registry):
    """They were written by `put_result` with an ordinal of their own, after a result that somebody asked for."""
    before = registry.ids("result"), registry.latest()
    kept = registry.put_result("threshold", None, {"key": "0" * 64, "nats": 18.0, "scores": [1.0]})
    with Registry.open(registry.path) as again:
        assert (again.ids("result"), again.latest()) == before
        for ref in (kept, kept[:12]):
            with pytest.raises(NoMatchError):
                again.resolve(ref)
    assert verify(registry.path).faults == ()
    verify(registry.path, repair=True)
    assert (registry.ids("result"), registry.latest()) == before
