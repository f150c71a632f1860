"""What mkdocs does while it builds the site: the README is the front page, and the navigation names every page."""

import re
from pathlib import Path

import commands
import documents
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]


def on_files(files: Files, config, **_) -> Files:
    """Add the front page, and name the pages of commands and documents in the navigation."""
    text = front_page((ROOT / "README.md").read_text(encoding="utf-8"))
    files.append(File.generated(config, "index.md", content=text))
    _fill(config.nav, "Commands", ["verbs/index.md", *map(commands.page_of, commands.names())])
    _fill(config.nav, "JSON documents", list(documents.pages()))
    return files


def on_page_markdown(markdown: str, page, **_) -> str:
    """Lead links to the README to the front page."""
    return re.sub(
        r"\]\((?:\.\./)+README\.md", "](" + "../" * page.file.src_uri.count("/") + "index.md", markdown
    )


def front_page(readme: str) -> str:
    """The README as a page of the site: its links begin in docs/."""
    return re.sub(r"(\]\()docs/", r"\1", readme)


def _fill(nav: list, title: str, pages: list[str]) -> None:
    for item in nav:
        if isinstance(item, dict):
            for key, inner in item.items():
                if key == title:
                    inner[:] = pages
                elif isinstance(inner, list):
                    _fill(inner, title, pages)
