"""What the README, the tutorial and the pages of the commands show is what is printed, ids included."""

import json
import re
import shlex
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import pytest
import typer
from executed_pages import (
    LANGUAGES,
    QUICK,
    ROOT,
    SESSION,
    Runner,
    blocks,
    checkout,
    close,
    commands,
    comparable,
    difference,
    languages,
    run_page,
    section,
    shortened,
)
from golden.comparing import fingerprint

from dynreg.cli.main import app

PAGES = ["README.md", *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))]
WRITTEN_ON = json.loads((ROOT / "tests/golden/machine.json").read_text(encoding="utf-8"))
# all that decides how numbers round; without hnswlib a query meets its candidates in another order
STRICT = fingerprint() | {"system": ""} == WRITTEN_ON | {"system": ""} and find_spec("hnswlib") is not None


def read(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


@pytest.fixture
def needs_logs(data_dir: Path) -> Path:
    for name in ("bam_xl330_pendulum/raw", "emps", "husky_rosbag", "utias_mrclam"):
        if not (data_dir / name).is_dir():
            pytest.skip(f"no {name} in DYNREG_DATA_DIR: the pages are not run")
    return data_dir


def differences(place: Path, data: Path, pages: Sequence[str]) -> str:
    """Run pages in one registry; how what is printed differs from what they say."""
    ids: dict[str, str] = {}
    with checkout(place, data) as folder:
        runner, found = Runner(folder), []
        for page in pages:
            said = read(page)
            found.append(difference(page, said, run_page(runner, said), strict=STRICT, ids=ids))
    return "\n".join(filter(None, found))


def test_the_readme_and_the_tutorial_print_what_they_show(needs_logs: Path, tmp_path: Path) -> None:
    """Every line. `make pages` writes all pages anew where an answer changes on purpose."""
    assert not (found := differences(tmp_path, needs_logs, QUICK)), f"{found}\n`make pages` writes them anew"


@pytest.mark.slow
def test_all_pages_print_what_they_show(needs_logs: Path, tmp_path: Path) -> None:
    assert not (found := differences(tmp_path, needs_logs, SESSION)), (
        f"{found}\n`make pages` writes them anew"
    )


@pytest.mark.slow
def test_your_own_robot_needs_no_log_of_others(tmp_path: Path) -> None:
    """The README's section is run by itself, in a checkout without data."""
    said = section(read("README.md"), "Your own robot")
    with checkout(tmp_path, None) as folder:
        assert not (found := difference("README.md", said, run_page(Runner(folder), said), strict=STRICT)), (
            found
        )


@pytest.mark.parametrize("page", PAGES)
def test_a_block_says_its_language_and_is_run_where_it_shows_commands(page: str) -> None:
    """A bare fence is an error; other pages than those of the session show commands in ```sh blocks alone."""
    opened = languages(read(page))
    assert set(opened) <= (LANGUAGES if page in SESSION else LANGUAGES - {"console"}), page
    if page in SESSION:
        run = [block.language for block in blocks(read(page))]
        assert run == [language for language in opened if language in ("console", "python")], page


@pytest.mark.parametrize("page", QUICK)
def test_every_command_of_the_first_pages_is_run(page: str) -> None:
    """Their ```sh blocks hold `make`, `pip` and comments alone."""
    for line in shell_lines(page):
        assert not line.startswith(("dynreg ", "python ")), f"{page}: {line} is in no ```console block"


@pytest.mark.parametrize("page", PAGES)
def test_a_command_that_is_not_run_has_options_that_there_are(page: str) -> None:
    """`dynreg` lines of ```sh blocks are held against the program."""
    for line in shell_lines(page):
        if line.startswith("dynreg ") and " [OPTIONS]" not in line:
            check(shlex.split(line, comments=True)[1:])


def shell_lines(page: str) -> list[str]:
    """The lines of a page's ```sh blocks."""
    parts = read(page).split("\n```")
    bodies = [part.partition("\n")[2] for part in parts[1::2] if part.partition("\n")[0] == "sh"]
    return [line for body in bodies for line in body.replace("\\\n", " ").splitlines()]


def test_each_set_of_the_data_has_at_most_three_commands_that_there_are() -> None:
    """From file to diagnosis: the last command is the diagnosis, and nothing is written by hand before it."""
    text = (ROOT / "docs/data.md").read_text(encoding="utf-8")
    rows = [row for row in text.partition("## From file to diagnosis")[2].splitlines() if "`dynreg" in row]
    assert len(rows) == 9
    for row in rows:
        lines = re.findall(r"`(dynreg [^`]+)`", row)
        assert 2 <= len(lines) <= 3 and lines[-1].startswith("dynreg diagnose"), row
        for line in lines:
            check(shlex.split(line)[1:])


def check(words: list[str]) -> None:
    command = typer.main.get_command(app)
    while words and words[0] in getattr(command, "commands", {}):
        command = command.commands[words.pop(0)]
    known = {flag for parameter in command.params for flag in (*parameter.opts, *parameter.secondary_opts)}
    assert not hasattr(command, "commands"), words
    assert {word for word in words if word.startswith("-")} <= known, words


TIMED = [
    "population a of b: 2 of 2 simulators, 2 added in 4.1 s",
    "step   time [s]",
    "-----",
    "link       1.2",
    "",
    "k 5",
]


def test_times_of_the_clock_are_not_compared() -> None:
    other = [line.replace("4.1", "17").replace("1.2", "0.3") for line in TIMED]
    assert comparable(TIMED) == comparable(other)
    for said in (
        "cost: 3 simulations, 1.4 s",
        "cost: 3 simulations, 1.4 s, 4298 s of simulated time",
        "1.4 s",
        "effect 0.1; 1.4 s a diagnosis",
        "effect 0.1; median time of a diagnosis 1.4",
        "effect 0.1; median time of a diagnosis 1.4 s",
    ):
        assert comparable([said]) == comparable([said.replace("1.4", "11")])
    for said in ("cost: 3 simulations, 1.4 s, 4298 s of simulated time", "median time of a diagnosis 1.4"):
        assert comparable([said]) != comparable([said.replace("3 ", "4 ").replace("median", "mean")])
    assert comparable(["row 5.0 s"]) != comparable(["row 6.0 s"])  # a number of the answer


def test_a_change_of_an_id_a_number_or_a_word_is_a_difference() -> None:
    said = "```console\n$ dynreg x\nsimulator 97cdefab0123, error 0.13\n```\n"
    for other in (
        said.replace("97cd", "97ce"),
        said.replace("0.13", "0.14"),
        said.replace("error", "errors"),
        said.replace("0.13", "0.13\n0.13"),
    ):
        assert difference("page", said, other, strict=True)
    assert not difference("page", said, said, strict=True)


def test_another_processor_may_round_a_number_and_no_word() -> None:
    """Ids that hang on numbers change together: one id of a page is one id wherever it stands."""
    said = "simulator 97cdefab0123\nerror   0.134\n─────\nuse 97cdefab0123, not 819f979caab8"
    other = said.replace("97cdefab0123", "00aa11bb22cc").replace("0.134", "0.14").replace("─────", "────")
    assert not difference("page", said, other, strict=False)
    for wrong in (
        other.replace("0.14", "0.18"),
        other.replace("use 00aa", "use 0baa"),
        other.replace("error", "errors"),
        other.replace("819f979caab8", "819f979"),
    ):
        assert difference("page", said, wrong, strict=False), wrong
    assert close("0.134", "0.136") and close("12", "13") and close("1", "3") and close("2.1e-05", "2.2e-05")
    assert not close("0.134", "0.16") and not close("12", "15") and not close("-0.2", "0.2")


def test_lines_are_left_out_where_the_page_leaves_them_out() -> None:
    assert shortened("$ x\na\n...\nd\n", "$ x\na\nb\nc\nd\n") == "$ x\na\n...\nd\n"
    assert shortened("$ x\na\n...\ne\n", "$ x\na\nb\nc\nd\n") == "$ x\na\nb\nc\nd\n"
    two = "$ x\na\n...\nd\n$ y\nb\n"
    assert shortened(two, "$ x\na\nb\nd\n$ y\nb\nc\n") == "$ x\na\n...\nd\n$ y\nb\nc\n"
    assert commands("$ a b\nout\n$ c\n") == ["a b", "c"]


def test_a_command_may_end_as_in_a_shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    runner = Runner(tmp_path)
    assert runner.run("dynreg robots list --json > robots.json") == ""
    assert len(runner.run("cat robots.json | head -1").splitlines()) == 1
    assert languages("```sh\nx\n```\n\n```\ny\n```\n") == ["sh", ""]
