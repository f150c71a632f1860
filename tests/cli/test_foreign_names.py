"""Names in a stranger's registry or on a command line: no verb hands a terminal or a page what it would obey."""

import sqlite3
from pathlib import Path
from types import SimpleNamespace

import made_up_drift
import made_up_gait
import made_up_results
import pytest
from foreign_text import HOSTILE, obeyed, poisoned

from dynreg.cli.completion import recording_names

LINES = {
    "robots check": ("robots", "check", "servo_pendulum"),
    "populate": ("populate", "servo_pendulum", "-n", "8"),
    "ingest": ("ingest", "run.csv", "--robot", "servo_pendulum"),
    "list": ("list",),
    "show": ("show", "@last"),
    "query": ("query", "bench", "--report", "page.html"),
    "effects": ("effects", "--near"),
    "diagnose": ("diagnose", "bench", "--report", "page.html"),
    "gait": ("gait", "bench"),
    "excite": ("excite", "servo_pendulum", "--for", "payload,backlash", "-o", "next.csv"),
    "trial": ("trial", "servo_pendulum", "--report", "page.html"),
    "calibrate": ("calibrate", "bench", "--report", "page.html"),
    "compare": ("compare", "bench", "--report", "page.html"),
    "drift": ("drift", "bench", "--report", "page.html"),
    "report": ("report", "@last", "--out", "page.html"),
    "export": ("export", "bench", "--to", "copy"),
    "export gait": ("export", "walk", "--as", "csv", "--to", "copy.csv"),
    "export dataset": ("export", "bench", "--as", "parquet", "--to", "copy"),
    "export robot": ("export", "5555", "--as", "robot", "--to", "copy"),
    "export ranges": ("export", "5555", "--as", "ranges", "--to", "ranges.toml"),
    "info": ("info",),
}
NAME = HOSTILE.replace("\x00", "")  # as no argument of a command can hold


@pytest.fixture
def strangers(session):
    """A registry in which every text is a stranger's."""
    more = {
        "gait": made_up_gait.gait(),
        "drift": made_up_drift.drift(),
        "export_gait": made_up_gait.gait(),
        "export_dataset": made_up_results.dataset_export(),
        "export_robot": made_up_results.robot_folder(),
        "export_ranges": made_up_results.ranges_file(),
    }
    for verb, answer in (session.answers | more).items():
        if isinstance(answer, tuple):
            answer = (answer[0], poisoned(answer[1]))
        session.answers[verb] = answer if isinstance(answer, Exception) else poisoned(answer)
    session.answers["resolve"] = ("result", "ab" * 32)  # what is named for a csv is a gait
    # `info` is answered as plain data
    session.answers["info"] = poisoned(made_up_results.information())
    return session


@pytest.mark.parametrize("line", LINES.values(), ids=LINES)
def test_what_a_verb_says_and_writes_is_shown_and_not_obeyed(line, dynreg, strangers) -> None:
    if "csv" in line:
        strangers.answers["result"] = SimpleNamespace(kind="gait")
    for arguments in (line, (*line, "--json")):
        ended = dynreg(*arguments)
        assert ended.status == 0, ended.err
        assert not obeyed(ended.out + ended.err)
    page = Path("page.html")
    assert not page.exists() or not obeyed(page.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "line",
    [
        (NAME,),
        (f"--{NAME}",),
        ("list", "--kind", NAME),
        ("list", "--settings", NAME),
        ("trial", NAME),
        ("robots", "check", NAME),
        ("doctor", NAME),
        ("ingest", NAME, "--robot", "servo_pendulum"),
        ("ingest", "run.csv", "--robot", "servo_pendulum", "--map", NAME),
        ("query", "bench", "--distance", NAME),
        ("query", "bench", "--report", f"{NAME}/page.html"),
        ("excite", "servo_pendulum", "--for", "payload,backlash", "-o", NAME),
        ("export", "bench", "--as", NAME, "--to", "copy"),
        ("drift", "bench", "--out", f"{NAME}/table.parquet", "--debug"),
    ],
    ids=lambda line: ascii(" ".join(line))[:30],
)
def test_an_error_about_it_is_shown_and_not_obeyed(line, dynreg, session) -> None:
    ended = dynreg(*line)
    assert ended.status in (1, 2) and not obeyed(ended.out)
    assert ended.err.splitlines()[-1].startswith("error: ") and not obeyed(ended.err)
    assert "\\x1b" in ended.err


def test_a_bug_that_quotes_it_is_shown_and_not_obeyed(dynreg, session) -> None:
    session.answers["show"] = ZeroDivisionError(HOSTILE)
    for line in (("show", "x"), ("show", "x", "--debug")):
        assert not obeyed(dynreg(*line).err)


def test_a_shell_is_offered_only_names_that_it_takes_as_they_are(tmp_path: Path, monkeypatch) -> None:
    """What is offered to a shell may be run by it: zsh evaluates the offers."""
    monkeypatch.setenv("DYNREG_REGISTRY", str(tmp_path))
    assert recording_names("") == []
    catalog = sqlite3.connect(tmp_path / "catalog.sqlite")
    catalog.execute("CREATE TABLE recording_names (name)")
    strange = [
        "\\$(touch here)",
        "`id`",
        "a\x1b[31m",
        "two words",
        "a;b",
        "",
        None,
        7,
        b"bytes",
        "\u202efile",
    ]
    names = [(name,) for name in [*strange, "monday", "übung-2.5", "a/b@c"]]
    catalog.executemany("INSERT INTO recording_names VALUES (?)", names)
    catalog.commit()
    catalog.close()
    assert recording_names("") == ["a/b@c", "monday", "übung-2.5"]
    assert recording_names("mo") == ["monday"]
