"""Names from a stranger's log or registry: a terminal and a browser show them, and obey nothing in them."""

import io
import json
import sys
import unicodedata
from typing import Any

import made_up_results
import pytest
from foreign_text import HOSTILE, OBEYED, obeyed, poisoned

from dynreg.cli.output import console
from dynreg.errors import DynregError, UsageError
from dynreg.foreign import visible
from dynreg.report.html import page
from dynreg.report.tables import refusal, render
from dynreg.results import Result


def poisoned_kinds() -> list[Any]:
    return [pytest.param(poisoned(r), id=type(r).__name__) for r in made_up_results.every_kind()]


def test_every_character_that_is_obeyed_becomes_an_escape_and_no_other() -> None:
    for code in range(sys.maxunicode + 1):
        character = chr(code)
        kind = unicodedata.category(character)
        if kind in OBEYED:
            assert not obeyed(visible(character), keep="") and visible(character, keep=character) == character
        elif kind != "Cn":
            assert visible(character) == character


@pytest.mark.parametrize("result", poisoned_kinds())
def test_tables_show_it_and_obey_nothing(result: Result) -> None:
    stream = io.StringIO()
    console(stream).print(render(result))
    text = stream.getvalue()
    assert not obeyed(text)


@pytest.mark.parametrize("result", poisoned_kinds())
def test_pages_and_notebooks_show_it_and_obey_nothing(result: Result) -> None:
    texts = [result._repr_html_()]
    try:
        texts.append(page(result))
    except UsageError as error:
        assert "has no report" in str(error)
    for text in texts:
        assert not obeyed(text) and "<b onclick" not in text
    assert all("[red]\\x1b[31m" in text and "$\\frac{$" in text for text in texts[1:])


@pytest.mark.parametrize("result", poisoned_kinds())
def test_a_json_document_is_plain_and_reads_as_it_was(result: Result) -> None:
    text = result.to_json()
    assert text.isascii() and not obeyed(text, keep="")
    assert json.loads(text) == result.to_dict()


@pytest.mark.parametrize("result", poisoned_kinds())
def test_a_refusal_is_one_line_that_obeys_nothing(result: Result) -> None:
    problem = refusal(result)
    assert problem is None or not obeyed(str(problem), keep="")


def test_an_error_is_one_line_that_obeys_nothing() -> None:
    error = DynregError(HOSTILE, expected=HOSTILE, do=HOSTILE)
    assert not obeyed(str(error), keep="") and "[red]\\x1b[31m" in error.problem
