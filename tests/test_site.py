"""The documentation as a site: it builds without a warning (dead links and anchors are some) and asks no other host."""

import logging
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LOADED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src", "video": "src"}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """The site, built once, and what mkdocs warned of."""
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    warned: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: warned.append(record.getMessage())
    logger = logging.getLogger("mkdocs")
    logger.addHandler(handler)
    place = tmp_path_factory.mktemp("site")
    before = sys.path.copy()
    try:
        build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(place), strict=False))
    finally:
        sys.path[:] = before
        logger.removeHandler(handler)
    return place, warned


def page(built: tuple[Path, list[str]], name: str) -> str:
    return (built[0] / name).read_text(encoding="utf-8")


def test_no_link_and_no_anchor_is_dead(built):
    assert not built[1]


class Assets(HTMLParser):
    """What a page loads: scripts, styles, pictures."""

    def __init__(self):
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag, attrs):
        told = dict(attrs)
        if tag in LOADED and told.get("rel") != "canonical":
            self.found.append(told.get(LOADED[tag]) or "")


def test_pages_load_nothing_from_another_host(built):
    pages, away = sorted(built[0].rglob("*.html")), []
    for path in pages:
        reader = Assets()
        reader.feed(path.read_text(encoding="utf-8"))
        away += [f"{path.name}: {asset}" for asset in reader.found if re.match(r"(https?:)?//", asset)]
    for path in built[0].rglob("*.css"):
        away += re.findall(r"(?:url\(|@import )['\"]?(?:https?:)?//[^)]*", path.read_text(encoding="utf-8"))
    assert len(pages) > 50 and not away


def test_every_table_and_key_is_in_the_reference(built):
    text = page(built, "robot_file.html")
    for said in (
        "[reset]",
        "[fall]",
        "[replay]",
        "[excitation]",
        "[gait]",
        "[[gait.legs]]",
        "[[tasks]]",
        "[base]",
    ):
        assert said in text
    for key in ("weight", "quantum", "known", "tolerance", "supply_input", "mirrored"):
        assert f"<code>{key}</code>" in text
    assert "<code>filter_hz</code>" in page(built, "map_file.html")


def test_every_command_and_every_document_has_a_page(built):
    import typer

    from dynreg.cli.main import app
    from dynreg.cli.schemas import schema_files

    for name, command in typer.main.get_command(app).commands.items():
        names = [f"{name}_{inner}" for inner in getattr(command, "commands", {})] or [name]
        assert all("<h1" in page(built, f"verbs/{one}.html") for one in names)
    assert all((built[0] / "schemas" / name).with_suffix(".html").exists() for name in schema_files())


def test_the_front_page_is_the_readme(built):
    text = page(built, "index.html")
    assert "A first session" in text and 'href="tutorial.html"' in text and 'src="story.png"' in text
