"""Every reader of what strangers wrote answers any bytes with a result or one plain line; the fuzzer finds others."""

import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from fuzzer import findings
from fuzzer.corpus import Case, cases
from fuzzer.formats import small
from fuzzer.journal import Journal, table
from fuzzer.loop import SPAN, Loop
from fuzzer.mutate import raw
from fuzzer.table import TARGETS
from fuzzer.target import Target, drawn, judge
from fuzzer.worker import LIMITS, Bounds
from hypothesis import given, settings
from hypothesis import strategies as st

from dynreg.errors import LogError
from dynreg.limits import variable
from dynreg.registry.files import CONTENTS, INDEX, ROBOTS

EXAMPLES = 25  # of each target, in every run of the tests; `make fuzz` draws many more
BOUNDS = Bounds()


@pytest.fixture
def bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The limits and the folder for temporary files that the fuzzer's own processes have."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.chdir(tmp_path.parent)  # where MuJoCo leaves its log
    for name, limit in LIMITS.items():
        monkeypatch.setenv(variable(name), str(limit))


def test_files_of_every_folder_of_a_registry_are_changed() -> None:
    assert {name.split("/")[0] for name, _ in small.files()} == {*CONTENTS, INDEX} - {ROBOTS}


@pytest.mark.usefixtures("bounded")
@pytest.mark.parametrize("name", TARGETS)
def test_any_bytes_are_read_or_refused(name: str) -> None:
    target = TARGETS[name]

    @settings(max_examples=EXAMPLES, database=None)
    @given(
        st.integers(0, 2**32), st.lists(st.tuples(st.integers(0, 5000), st.binary(max_size=4)), max_size=2)
    )
    def check(number: int, edits: list[tuple[int, bytes]]) -> None:
        data = target.make(random.Random(number))
        for at, piece in edits:
            data = data[:at] + piece + data[at + len(piece) :]
        verdict = judge(target, data, BOUNDS.seconds)
        assert verdict.good, f"{verdict.kind}: {verdict.sign}\n{verdict.text}"

    check()


@pytest.mark.parametrize("case", list(cases()), ids=lambda case: case.title)
def test_known_inputs_are_read_or_refused(case: Case) -> None:
    verdict = findings.alone(case.target, case.make(), BOUNDS)
    assert verdict.good, f"{verdict.kind}: {verdict.sign}\n{verdict.text}"


@pytest.mark.parametrize("name", TARGETS)
def test_the_same_number_gives_the_same_input(name: str) -> None:
    target = TARGETS[name]
    first = [drawn(target, 7, index) for index in range(20)]
    assert [drawn(target, 7, index) for index in reversed(range(20))] == first[::-1]
    assert len({*first, *(drawn(target, 8, index) for index in range(20))}) > 20


def _sleeps(data: bytes) -> None:
    time.sleep(60)


def _hoards(data: bytes) -> None:
    bytearray(b"x" * (200 * 2**20))


def _hides(data: bytes) -> None:
    try:
        bytearray(2**50)
    except MemoryError as error:
        raise LogError("no log", expected="a log", do="x") from error


def _litters(data: bytes) -> None:
    handle, _ = tempfile.mkstemp()
    os.close(handle)


def _colours(data: bytes) -> None:
    error = LogError("no log", expected="a log", do="x")
    error.problem = "\x1b[31m"
    raise error


MISDEEDS: dict[str, tuple[Callable[[bytes], object], str]] = {
    "an error of its own": (lambda data: {}[0], "crash"),
    "a process that ends": (lambda data: os.abort(), "died"),
    "an exit": (lambda data: sys.exit(3), "crash"),
    "no answer": (_sleeps, "hang"),
    "memory": (_hoards, "memory"),
    "memory that was refused": (_hides, "memory"),
    "a temporary file": (_litters, "leftover"),
    "a colour": (_colours, "control"),
    "nothing wrong": (lambda data: None, "read"),
}


@pytest.mark.parametrize("title", MISDEEDS)
def test_what_a_reader_must_not_do_is_found(title: str, monkeypatch: pytest.MonkeyPatch) -> None:
    check, kind = MISDEEDS[title]
    monkeypatch.setitem(TARGETS, "toy", Target("toy", lambda rng: rng.randbytes(4), check))
    # only a check that never answers shall run into the time; a busy machine needs more for the others
    seconds = 0.5 if kind == "hang" else 20.0
    assert findings.alone("toy", b"abcd", Bounds(seconds=seconds, megabytes=100)).kind == kind


def _picky(data: bytes) -> None:
    if b"\x07" in data[:1]:
        os.abort()
    if b"\x08" in data:
        raise KeyError("eight")


def test_a_run_goes_on_where_it_was_stopped_and_keeps_small_reproducers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(TARGETS, "toy", Target("toy", lambda rng: rng.randbytes(3), _picky))
    bounds = Bounds(seconds=2.0)
    first = Loop(tmp_path, ["toy"], 0, bounds)
    first.run(100.0, 1, inputs=2 * SPAN)
    (tmp_path / "journal.jsonl").open("a").write('{"seed": 0, "targ')  # a kill cut the line off
    second = Loop(tmp_path, ["toy"], 0, bounds)
    second.run(100.0, 2, inputs=SPAN)
    total = Journal(tmp_path / "journal.jsonl", 0).totals["toy"]
    assert total.next > first.journal.totals["toy"].next > 0
    assert total.kinds["died"] and total.kinds["crash"] and total.kinds["read"]
    assert not second.new, "the same finding is kept once"
    assert "toy" in table({"toy": total})
    for path in first.new:
        findings.make_small(path, bounds)
    assert sorted(path.read_bytes() for path in first.new) == [b"\x07", b"\x08"]
    assert Journal(tmp_path / "journal.jsonl", 1).totals["toy"].next == 0, "another seed begins anew"


def test_what_does_not_matter_is_taken_out() -> None:
    data = bytes(range(256)) * 20
    small = findings.minimized(data, lambda d: d.count(b"\x41") >= 2 and b"\x90" in d, time.monotonic() + 10)
    assert sorted(small) == [0x41, 0x41, 0x90]


def test_the_command_runs_and_prints_what_it_did(tmp_path: Path) -> None:
    program = [sys.executable, str(Path(__file__).with_name("run.py")), "--folder", str(tmp_path)]
    asked = [*program, "--targets", "bam", "--seconds", "1"]
    ended = subprocess.run(asked, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    told = subprocess.run([*program, "--totals"], capture_output=True, text=True, timeout=60).stdout
    row = next(line.split() for line in told.splitlines() if line.split()[0] == "bam")
    assert int(row[1]) >= SPAN and row[-3:] == ["0", "0", "0"]
    wrong = subprocess.run([*program, "--targets", "bim"], capture_output=True, text=True, timeout=60)
    assert wrong.returncode == 2 and "bim" in wrong.stderr


def test_bytes_are_changed_by_the_generator_alone() -> None:
    assert raw(random.Random(3), b"abc" * 50) == raw(random.Random(3), b"abc" * 50)
