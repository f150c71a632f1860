"""docs/diagnose.md cannot drift: its sections are the steps that it draws, its files are there, and it stays short."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "diagnose.md").read_text(encoding="utf-8")


def test_every_step_that_is_drawn_has_a_section_in_the_order_of_the_pipeline():
    drawing = PAGE.split("```")[1]
    drawn = re.findall(r"(\d) ([A-Z]+)\b", drawing)
    told = re.findall(r"^## (\d)\. (\w+)", PAGE, re.MULTILINE)
    assert len(drawn) == 9 and [(n, name.upper()) for n, name in told] == drawn


def test_files_and_plans_on_the_page_are_there():
    paths = set(re.findall(r"`(\w+/[\w./]+)`", PAGE))
    assert len(paths) > 15 and all((ROOT / "dynreg" / path).exists() for path in paths)
    plans = (ROOT / "dynreg/diagnose/plans/__init__.py").read_text(encoding="utf-8")
    section = PAGE.split("## Plans")[1].split("## ")[0]
    named = re.findall(r"^- `(\w+)`", section, re.MULTILINE)
    assert {*named, "Plan"} == set(re.findall(r'"([A-Z][a-z]+)"', plans))


def test_links_lead_somewhere_and_the_page_stays_short():
    links = re.findall(r"\]\(([\w.]+)\)", PAGE)
    assert "naming.md" in links and all((ROOT / "docs" / link).exists() for link in links)
    assert len(PAGE.splitlines()) < 149
