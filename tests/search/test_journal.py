"""The journal of a search: it gives back what was found, and is trusted only where it is as it was written."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from dynreg.errors import CorruptError, RegistryError, UsageError
from dynreg.rng import stream
from dynreg.search.drive import Found, Limits, Search, drive
from dynreg.search.journal import Journal
from dynreg.search.start import Start
from dynreg.search.table import SEARCHES


def search_at_random() -> Search:
    kind = SEARCHES["random"]
    return kind.begin(Start(3, stream(1, "a"), kind.batch))


def hump(asked: np.ndarray) -> np.ndarray:
    """(n, 1) highest, 1, at (0.2, 0.7, 0.4)."""
    return 1.0 - ((asked - [0.2, 0.7, 0.4]) ** 2).sum(axis=1, keepdims=True)


def journal_of(path: Path, batches: int = 2) -> None:
    kept = Journal(path, {"seed": 1}, resume=False)
    search = search_at_random()
    for _ in range(batches):
        asked = search.ask()
        kept.next(asked)
        kept.add(asked, hump(asked))
        search.tell(-hump(asked)[:, 0])


def test_a_journal_gives_back_what_was_found_and_drops_a_torn_line(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    journal_of(path)
    text = path.read_text()
    path.write_text(text + '{"asked": "12')
    kept, search = Journal(path, {"seed": 1}, resume=True), search_at_random()
    for _ in range(2):
        asked = search.ask()
        assert np.array_equal(kept.next(asked), hump(asked))
        search.tell(-hump(asked)[:, 0])
    assert kept.next(search.ask()) is None
    assert path.read_text() == text
    assert Journal(path, {"seed": 1}, resume=False).next(asked) is None  # begun anew


def test_a_journal_that_was_shaped_by_something_else_is_begun_anew(tmp_path: Path) -> None:
    path, asked, other = tmp_path / "j.jsonl", np.array([[0.5, 0.5, 0.5]]), np.array([2.0])
    kept = Journal(path, {"seed": 1}, resume=False)
    kept.shaped(np.ones(2), other)
    kept.add(asked, hump(asked))
    same = Journal(path, {"seed": 1}, resume=True)
    same.shaped(np.ones(2), other)
    assert np.array_equal(same.next(asked), hump(asked)) and same.next(asked) is None
    another = Journal(path, {"seed": 1}, resume=True)
    another.shaped(np.ones(2), other + 1.0)
    assert another.next(asked) is None
    assert len(path.read_text().splitlines()) == 2, "what it is of, and what shaped it"


@pytest.mark.parametrize("name", SEARCHES)
def test_an_interrupted_search_goes_on_to_the_same_bytes(name: str, tmp_path: Path) -> None:
    kind, judge = SEARCHES[name], lambda grades: (grades[:, 0], 0.5 - grades[:, 0])

    def found(path: Path, resume: bool, most: int) -> Found:
        asked = 0

        def grades(x: np.ndarray) -> np.ndarray:
            nonlocal asked
            asked += len(x)
            if asked > most:
                raise KeyboardInterrupt
            return hump(x)

        search = kind.begin(Start(3, stream(1, name), kind.batch))
        return drive(search, grades, judge, Limits(200), journal=Journal(path, {"seed": 1}, resume=resume))

    whole = found(tmp_path / "whole.jsonl", False, 200)
    with pytest.raises(KeyboardInterrupt):
        found(tmp_path / "torn.jsonl", False, 100)
    gone_on = found(tmp_path / "torn.jsonl", True, 150)  # so few are left to try
    assert gone_on.resumed >= 75 and np.array_equal(gone_on.best, whole.best)
    assert gone_on.history == whole.history
    assert (tmp_path / "torn.jsonl").read_bytes() == (tmp_path / "whole.jsonl").read_bytes()


def test_a_journal_of_another_search_or_of_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    journal_of(path)
    with pytest.raises(UsageError, match="another search .seed differ"):
        Journal(path, {"seed": 2}, resume=True)
    kept = Journal(path, {"seed": 1}, resume=True)
    with pytest.raises(CorruptError, match="asked something else"):
        kept.next(np.zeros((8, 3)))
    path.write_text("not json\n")
    with pytest.raises(CorruptError, match="no journal"):
        Journal(path, {"seed": 1}, resume=True)
    assert path.read_text() == "not json\n"


def answers(path: Path) -> list[list[list[float]]]:
    """What a search that is resumed takes from the journal."""
    kept, search = Journal(path, {"seed": 1}, resume=True), search_at_random()
    out = []
    while (found := kept.next(asked := search.ask())) is not None:
        out.append(found.tolist())
        search.tell(-hump(asked)[:, 0])
    return out


def test_no_flipped_bit_and_no_lost_byte_changes_what_a_search_goes_on_with(tmp_path) -> None:
    """It is an error that says what to do, or changes no value; at the end it may be a step that was not finished."""
    path = tmp_path / "j.jsonl"
    journal_of(path)
    whole, right = path.read_bytes(), answers(path)
    assert len(right) == 2
    damaged = 0
    for bit in range(0, 8 * len(whole), 5):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        shorter = whole[: bit // 8] + whole[bit // 8 + 1 :]
        for data in (bytes(flipped), shorter):
            path.write_bytes(data)
            try:
                found = answers(path)
            except (CorruptError, UsageError) as error:
                damaged += 1
                assert "without --resume" in error.do and path.read_bytes() == data, (
                    "an error changes nothing"
                )
            else:
                assert found == right[: len(found)] and len(found) >= len(right) - 1, bit
    assert damaged > len(whole) / 2


def test_a_damaged_line_is_named_and_the_search_can_go_on_from_there(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    journal_of(path, batches=3)
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    for third in (lines[2].replace(b"0.", b"1.", 1), b"\xff\xfe\n", b"[" * 100_000 + b"\n", b"7\n", b"\n"):
        path.write_bytes(b"".join([*lines[:2], third, *lines[3:]]))
        with pytest.raises(
            CorruptError, match="line 3 of .* is damaged; .*delete that line and all behind it"
        ):
            answers(path)
    path.write_bytes(b"".join(lines[:2]))
    assert len(answers(path)) == 1
    path.write_bytes(b"\xff\xfe not text")
    with pytest.raises(CorruptError, match="no journal"):
        answers(path)


def test_a_journal_from_before_there_were_checksums_still_resumes(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    journal_of(path)
    right = answers(path)
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    for line in lines:
        del line["check"]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert answers(path) == right
    assert all("check" in json.loads(line) for line in path.read_text().splitlines())
    lines[1]["grades"] = [["x"]]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(CorruptError, match="line 2"):
        answers(path)


def test_a_journal_is_on_disk_before_it_takes_its_place(tmp_path: Path, monkeypatch) -> None:
    done = []
    real = os.fsync, os.replace
    monkeypatch.setattr("os.fsync", lambda descriptor: done.append("sync") or real[0](descriptor))
    monkeypatch.setattr("os.replace", lambda *paths: done.append("rename") or real[1](*paths))
    journal_of(tmp_path / "j.jsonl", batches=1)
    assert done == ["sync", "rename", "sync", "sync"], "the file, its name, its folder, the first step"


def test_a_place_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RegistryError, match="cannot write .*; expected a folder that may be written"):
        Journal(tmp_path / "file" / "j.jsonl", {"seed": 1}, resume=False)
