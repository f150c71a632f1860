"""The verbs on a real registry, from the log to the page; every document fits its schema."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tiny_registry

from dynreg.cli.schemas import model_of
from dynreg.errors import NotStored

QUERY = ("query", "monday", "-k", "2", "--budget", "8", "--hold-out", "kp=400")


@pytest.fixture
def place(tmp_path: Path, registry_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("DYNREG_REGISTRY", raising=False)
    monkeypatch.chdir(tmp_path)
    shutil.copytree(registry_folder, tmp_path / "dynreg-registry")
    changed = tiny_registry.bench_csv(lambda i, row: [*row[:4], 7.2, *row[5:]])
    (tmp_path / "run.csv").write_text(changed, encoding="utf-8")
    return tmp_path


@pytest.fixture
def document(dynreg: Callable) -> Callable[..., dict[str, Any]]:
    def of(*line: str, statuses: tuple[int, ...] = (0,)) -> dict[str, Any]:
        ended = dynreg(*line, "--json")
        assert ended.status in statuses, ended.err
        found = json.loads(ended.out)
        assert json.loads(model_of(found["schema"]).model_validate(found).to_json()) == found
        return found

    return of


def test_from_the_log_to_the_page(place: Path, dynreg: Callable, document: Callable) -> None:
    recording = document("ingest", "run.csv", "--robot", "servo_pendulum", "--name", "monday")
    assert recording["episodes"] == 5 and recording["settings"] == ["kp"]
    answer = document(*QUERY, statuses=(0, 4))
    assert answer["recording"] == recording["recording"] and len(answer["neighbours"]) == 2
    assert set(answer["parts"]["test"]) == {"e2", "e3"}
    kinds = [item["kind"] for item in document("list")["items"]]
    assert {"population", "recording", "result", "robot"} <= set(kinds)
    (result,) = document("list", "--kind", "result")["items"]
    assert document("show", result["id"])["detail"]["answer"] == answer["answer"]
    shown = dynreg("show", result["id"])
    assert shown.status == 0 and "best 2 by replay error, of the nearest" in shown.out
    written = document("report", "@last", "--out", "page.html")
    assert written["bytes"] == (place / "page.html").stat().st_size
    assert "monday" in (place / "page.html").read_text(encoding="utf-8")
    assert document("info")["holds"]["recording"] == 2
    assert document("verify")["clean"] is True
    exported = document("export", "monday", "--to", "copy")
    assert recording["recording"] in [item["id"] for item in exported["items"]]
    assert document("list", "--registry", "copy", "--kind", "recording")["items"][0]["name"] == "monday"
    document("export", result["id"], "--to", "answer")
    for simulator in {answer["answer"], answer["synthesised"]["simulator"]}:
        assert document("show", simulator, "--registry", "answer")["id"] == simulator
    assert document("verify", "--registry", "answer")["clean"] is True


def still(i: int, row: list) -> list:
    """The command never changes: nothing can be said, which the diagnosis finds out after the log was read."""
    return [row[0], row[1], row[2], 0.3, *row[4:]]


IN_VAIN = {
    "a log in which nothing is commanded": ("diagnose", "still.csv", "--robot", "servo_pendulum"),
    "a log that is none": ("diagnose", "notes.csv", "--robot", "servo_pendulum"),
    "no such effect": ("diagnose", "run.csv", "--robot", "servo_pendulum", "--effects", "rust"),
    "a log that cannot be ingested": ("ingest", "notes.csv", "--robot", "servo_pendulum"),
    "a name that cannot be one": ("ingest", "run.csv", "--robot", "servo_pendulum", "--name", "@last"),
    "a query of a log that is none": ("query", "notes.csv", "--robot", "servo_pendulum"),
    "a query without simulators": ("query", "run.csv", "--robot", "servo_pendulum"),
}


@pytest.mark.parametrize("line", IN_VAIN.values(), ids=IN_VAIN)
def test_what_fails_first_leaves_nothing_behind(line, tmp_path: Path, dynreg: Callable, monkeypatch) -> None:
    monkeypatch.delenv("DYNREG_REGISTRY", raising=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run.csv").write_text(tiny_registry.bench_csv(), encoding="utf-8")
    (tmp_path / "still.csv").write_text(tiny_registry.bench_csv(still), encoding="utf-8")
    (tmp_path / "notes.csv").write_text("spare,columns\n1,2\n", encoding="utf-8")
    before = sorted(path.name for path in tmp_path.iterdir())
    ended = dynreg(*line)
    assert ended.status in (1, 2, 4) and ended.err.startswith("error: ") and "bug" not in ended.err
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_the_same_query_gives_the_same_answer(place: Path, dynreg: Callable, document: Callable) -> None:
    document("ingest", "run.csv", "--robot", "servo_pendulum", "--name", "monday")
    first, second = (document(*QUERY, statuses=(0, 4)) for _ in range(2))
    for found in (first, second):
        found["cost"].pop("seconds")
    assert first == second


def test_a_damaged_catalogue_is_repaired(place: Path, dynreg: Callable, document: Callable) -> None:
    held = document("list")["items"]
    (place / "dynreg-registry" / "catalog.sqlite").write_bytes(b"junk" * 1000)
    assert dynreg("list").status == 3
    assert document("verify", statuses=(3,))["clean"] is False
    (fault,) = document("verify", "--dry-run", statuses=(3,))["faults"]
    assert "would be written anew from the ledger" in fault
    assert dynreg("verify", "--repair").status == 0, "the ledger tells all, the names of recordings too"
    assert dynreg("verify").status == 0 and document("list")["items"] == held


def test_a_registry_that_may_only_be_read_answers_and_stores_nothing(
    place: Path, dynreg: Callable, document: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    document("ingest", "run.csv", "--robot", "servo_pendulum", "--name", "monday")
    files = {p: p.read_bytes() for p in (place / "dynreg-registry").rglob("*") if p.is_file()}
    monkeypatch.setattr(
        "dynreg.registry.opening.may_write", lambda path: False
    )  # as on a mount that is read-only
    with pytest.warns(NotStored, match="read-only: the result is shown, and not stored"):
        answer = document(*QUERY, statuses=(0, 4))
    assert len(answer["neighbours"]) == 2
    with pytest.warns(NotStored):
        log = dynreg("query", "run.csv", "--robot", "servo_pendulum", "-k", "2", "--budget", "8")
    assert log.status in (0, 4), log.err
    for line in (
        ("ingest", "run.csv", "--robot", "servo_pendulum"),
        ("populate", "servo_pendulum", "-n", "9"),
    ):
        ended = dynreg(*line)
        assert ended.status == 1 and "is read-only" in ended.err and "copy it" in ended.err
    assert document("list", "--kind", "result")["items"] == [] and document("verify")["clean"] is True
    assert {p: p.read_bytes() for p in (place / "dynreg-registry").rglob("*") if p.is_file()} == files
