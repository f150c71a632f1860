"""docs/architecture.md cannot drift: its floors are the contract's, and what it cites is there."""

import ast
import re
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", PAGE, re.DOTALL)
PROSE = re.sub(r"```.*?```", "", PAGE, flags=re.DOTALL)
OF_USERS = {"robot.toml"}  # files of which the page tells, and which stand in every robot's folder
PATHS = sorted({*re.findall(r"`(\w+/[\w./]*|\w+\.(?:py|md|toml))`", PROSE)} - OF_USERS)
CITED = [
    (path, name)
    for names, path in re.findall(r"((?:`\w+`(?:, | and )?)+) (?:in|\|) `([\w/]+\.py)`", PROSE)
    for name in re.findall(r"\w+", names.replace(" and ", " "))
]


def test_the_floors_drawn_are_those_of_the_contract():
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]
    stated = [{*re.findall(r"dynreg\.(\w+)", layer)} for layer in contract["layers"]]
    lines = (re.findall(r"\b(\w+)(?:/|\.py\b)", line) for line in BLOCKS[0][1].splitlines())
    assert [{*names} for names in lines if names] == stated


def test_the_page_has_a_recipe_for_each_kind_of_thing_and_stays_a_page():
    recipes = re.findall(r"^### (.*)", PAGE, re.MULTILINE)
    assert [recipe.rpartition(" ")[2] for recipe in recipes] == [
        "effect",
        "format",
        "engine",
        "search",
        "distance",
        "verb",
    ]
    assert len(PAGE.splitlines()) < 230 and len(PATHS) > 60 and len(CITED) > 20


@pytest.mark.parametrize("path", PATHS)
def test_a_path_on_the_page_is_there(path: str):
    assert (ROOT / "dynreg" / path).exists() or (ROOT / path).exists()


@pytest.mark.parametrize(("path", "name"), CITED)
def test_a_name_on_the_page_is_defined_where_it_says(path: str, name: str):
    module = ".".join(("dynreg", *Path(path).with_suffix("").parts)).removesuffix(".__init__")
    found = import_module(module)
    assert getattr(getattr(found, name), "__module__", module) == module


def test_the_page_names_every_door_for_plugins():
    sources = (path.read_text(encoding="utf-8") for path in (ROOT / "dynreg").rglob("*.py"))
    groups = {group for text in sources for group in re.findall(r'with_plugins\(\w+, "(dynreg\.\w+)"', text)}
    assert {*re.findall(r"`(dynreg\.\w+)`", PROSE)} == groups


@pytest.mark.parametrize("code", [text for language, text in BLOCKS if language == "python"])
def test_the_code_of_a_recipe_is_python(code: str):
    assert ast.parse(code).body
