"""What `--help` shows: verbs in groups, every option explained, the global ones last."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer

from dynreg.cli.main import app
from dynreg.cli.ordinary import OTHERS


def commands() -> Iterator[tuple[str, Any]]:
    def walk(command: Any, path: str) -> Iterator[tuple[str, Any]]:
        yield path, command
        for name, below in getattr(command, "commands", {}).items():
            yield from walk(below, f"{path} {name}".strip())

    return walk(typer.main.get_command(app), "")


EVERY = dict(commands())
VERBS = [path for path in EVERY if path and not getattr(EVERY[path], "commands", None)]


@pytest.mark.parametrize("path", EVERY)
def test_every_option_and_argument_is_explained_with_its_choices_or_a_name(path: str, dynreg) -> None:
    shown = dynreg(*path.split(), "--help").out
    assert not [p.name for p in EVERY[path].params if not p.help], path
    assert not re.search(r"<\w+>|\{|list\[", shown), shown
    for parameter in EVERY[path].params:
        assert all(flag in shown for flag in parameter.opts if flag.startswith("-"))


@pytest.mark.parametrize("path", VERBS)
def test_the_options_of_a_verb_come_before_those_of_all_verbs(path: str, dynreg) -> None:
    shown = dynreg(*path.split(), "--help").out
    own, _, shared = shown.partition("Global options:")
    assert "--json" in shared and "--registry" in shared
    assert "--json " not in own.partition("\nOptions:")[2] and "Example: dynreg" in own


def test_verbs_stand_under_what_a_user_does_and_each_in_one_whole_line(dynreg) -> None:
    shown = dynreg("--help").out
    sections = dict(re.findall(r"^(\w[^\n]*):\n((?:  \S[^\n]*\n)+)", shown, re.MULTILINE))
    assert "query" in sections["Ask about a recording"] and "verify" in sections["The registry"]
    assert OTHERS not in sections, "name a heading for it in cli/main.py"
    summaries = [line for body in sections.values() for line in body.splitlines()]
    assert not [line for line in summaries if line.endswith("...")]
