"""Every option that a message, a help text, a docstring or a page names is one of the command line."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

import dynreg
from dynreg.cli.main import app

SOURCES = Path(dynreg.__file__).parent
OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")
COMMAND = re.compile(r"dynreg ((?:robots )?[a-z]+)\b([^`;&|\n]*)")
BENCH = re.compile(r"make bench-(\w+) ARGS=(\"[^\"]*\"|[^\s`]+)")
OF_OTHERS = {"--play", "--seeds", "--without-effects", "--head"}  # of examples, a benchmark, Ray


def options() -> dict[str, set[str]]:
    """Of each command ("" for the program itself), those shared by all among them."""

    def walk(command, path: str) -> Iterator[tuple[str, set[str]]]:
        own = {flag for p in command.params for flag in (*p.opts, *p.secondary_opts)}
        yield path, own | {"--help"}
        for name, below in getattr(command, "commands", {}).items():
            yield from walk(below, f"{path} {name}".strip())

    return dict(walk(typer.main.get_command(app), ""))


OPTIONS = options()
EVERY = set().union(*OPTIONS.values())


def texts(path: Path) -> Iterator[str]:
    """The strings of a source file, what is filled in left out as `{}`; a page as it stands."""
    if path.suffix != ".py":
        yield path.read_text(encoding="utf-8")
        return
    inside: set[int] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.JoinedStr):
            inside |= {id(part) for part in node.values}
            yield "".join(part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside:
            yield node.value


def wrong(text: str) -> list[str]:
    """What a text says of options that is not so: of `dynreg`, and of a benchmark where `make` runs it with some."""
    out = [
        f"bench_{name} has no {flag}" for name, rest in BENCH.findall(text) for flag in unknown(name, rest)
    ]
    text = BENCH.sub("", text)
    out += [f"{flag} is no option" for flag in OPTION.findall(text) if flag not in EVERY | OF_OTHERS]
    for command, rest in COMMAND.findall(text):
        if command in OPTIONS:
            lacks = [flag for flag in OPTION.findall(rest) if flag not in OPTIONS[command]]
            out += [f"`dynreg {command}` has no {flag}" for flag in lacks]
    return out


def unknown(bench: str, rest: str) -> list[str]:
    """Options that a benchmark does not have."""
    source = (SOURCES.parent / "benchmarks" / f"bench_{bench}.py").read_text(encoding="utf-8")
    return [flag for flag in OPTION.findall(rest) if f'"{flag}"' not in source]


ROOT = SOURCES.parent
PAGES = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")] if (ROOT / "docs").is_dir() else []
FILES = sorted([*SOURCES.rglob("*.py"), *PAGES])


def test_texts_name_options_that_exist() -> None:
    found = {str(path.relative_to(ROOT)): [w for text in texts(path) for w in wrong(text)] for path in FILES}
    assert not {path: problems for path, problems in found.items() if problems}


@pytest.mark.parametrize(
    "text",
    [
        "name more with --simulators",
        "run `dynreg compare monday --windows 3`",
        "see `dynreg robots check arm --log a.csv`",
        'run `make bench-graph ARGS="--sizes 200 --no-such 3"`',
        "what `--sizes` of a benchmark says",
    ],
)
def test_a_wrong_option_is_found(text: str) -> None:
    assert len(wrong(text)) == 1


def test_options_of_other_programs_are_named_somewhere() -> None:
    assert {flag for path in FILES for text in texts(path) for flag in OPTION.findall(text)} >= OF_OTHERS
