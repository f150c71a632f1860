"""What the pages say of commands, files and documents is what the program says, in a clone without mkdocs, too."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dynreg.distance.table import NAMES

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture(scope="module")
def wanted() -> dict[str, str]:
    """Every page that the program fills, as it should be."""
    told = "import json, made; print(json.dumps(made.pages()))"
    out = subprocess.run(
        [sys.executable, "-c", told], cwd=DOCS / "hooks", check=True, capture_output=True, text=True
    )
    return json.loads(out.stdout)


def test_every_page_is_as_the_program_says(wanted: dict[str, str]) -> None:
    stale = [
        n for n, text in wanted.items() if not (DOCS / n).exists() or (DOCS / n).read_text("utf-8") != text
    ]
    assert not stale, f"`make reference` writes them anew: {', '.join(stale)}"


def test_no_page_is_left_of_a_command_or_document_that_is_gone(wanted: dict[str, str]) -> None:
    there = {
        p.relative_to(DOCS).as_posix() for folder in ("verbs", "schemas") for p in (DOCS / folder).glob("*")
    }
    assert there == {name for name in wanted if name.startswith(("verbs/", "schemas/"))}


def test_links_of_the_pages_lead_to_files_of_a_clone() -> None:
    """No page needs the site to be built: links between pages are files of the repository."""
    for path in [DOCS.parent / "README.md", *DOCS.rglob("*.md")]:
        for link in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", path.read_text("utf-8")):
            assert (path.parent / link).exists(), f"{path.name}: {link}"


def test_every_distance_of_a_query_is_explained() -> None:
    page = (DOCS / "numbers.md").read_text(encoding="utf-8")
    assert [name for name in NAMES if f"\n| `{name}` | " not in page] == []
