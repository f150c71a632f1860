import time
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict, Field

from dynreg.errors import RobotError
from dynreg.tomlfile import line_of, literal, read_toml

TEXT = '''# a comment with name = 1
[robot]
name = "a"  # low = 3
title = """
name = "not this one"
[not.a.table]
"""

[[parameters]]
name = "first"
low = 1

[[parameters]]
low = 2
name = "second"
sets = [
  "control.rate =",
]

[populations.slow]
ranges = { low = [1, 2] }

[populations."very fast".ranges]
low = [3, 4]

[[parameters]]
name = "third"
'''
LINES = {
    ("robot",): 2,
    ("robot", "name"): 3,
    ("robot", "title"): 4,
    ("parameters",): 9,
    ("parameters", 0, "low"): 11,
    ("parameters", 1): 13,
    ("parameters", 1, "low"): 14,
    ("parameters", 1, "sets", 0): 16,
    ("parameters", 2, "name"): 27,
    ("populations", "slow", "ranges", "low"): 21,
    ("populations", "very fast", "ranges", "low"): 24,
}


@pytest.mark.parametrize("location", LINES)
def test_keys_are_found_where_they_stand(location: tuple):
    tomllib.loads(TEXT)  # the text is TOML
    assert line_of(TEXT, location) == LINES[location]


def test_what_is_not_there_is_told_at_the_table_above_it():
    assert line_of(TEXT, ("parameters", 1, "nominal")) == 13
    assert line_of(TEXT, ("parameters", 1, "position", "low")) == 14  # the tag of a union is passed over
    assert line_of(TEXT, ("channels", 0)) == 1
    assert line_of("", ("robot",)) == 1


@given(
    st.lists(st.dictionaries(st.sampled_from("abc"), st.integers(0, 9), min_size=1), min_size=1, max_size=5)
)
@settings(max_examples=50)
def test_lines_of_generated_tables(tables: list[dict[str, int]]):
    lines, where = [], {}
    for number, table in enumerate(tables):
        lines += ["", "[[items]]"]
        for key, value in table.items():
            lines.append(f"{key} = {value}")
            where["items", number, key] = len(lines)
    text = "\n".join(lines)
    assert tomllib.loads(text) == {"items": tables}
    assert {location: line_of(text, location) for location in where} == where


class _Any(BaseModel):
    model_config = ConfigDict(extra="allow")


ODD = {
    "lists in each other": ("x = " + "[" * 5000 + "]" * 5000, "too deep"),
    "tables in each other": ("x = " + "{a=" * 5000 + "1" + "}" * 5000, "too deep"),
    "a key of many parts": (".".join(["a"] * 200_000) + " = 1", "too deep"),
    "a header of many parts": ("[" + " . ".join(["'a'"] * 100_000) + "]", "too deep"),
    "a number of many digits": ("x = " + "9" * 5000, "digits"),
    "a NUL": ('x = "a\0b"', "Illegal character"),
    "no UTF-8": (b"x = '\xff'", "UTF-8"),
    "too long": ("x = 1\n" * 200_000, "DYNREG_MAX_TOML_BYTES"),
}


@pytest.mark.parametrize("case", ODD)
def test_odd_files_are_one_short_line_and_take_no_time(case: str, tmp_path: Path):
    text, said = ODD[case]
    (tmp_path / "odd.toml").write_bytes(text.encode() if isinstance(text, str) else text)
    begun = time.process_time()
    with pytest.raises(RobotError, match=said) as caught:
        read_toml(tmp_path / "odd.toml", _Any, RobotError)
    assert len(str(caught.value)) < 500 and "\n" not in str(caught.value)
    assert time.process_time() - begun < 2.0


def test_dots_in_prose_and_lists_are_no_keys(tmp_path: Path):
    text = "# " + "." * 300 + "\nx = [" + "0.5, " * 300 + "]\ny = '" + "so it is. " * 80 + "'\n"
    (tmp_path / "plain.toml").write_text(text)
    assert len(read_toml(tmp_path / "plain.toml", _Any, RobotError).x) == 300


def test_a_path_with_a_nul_is_no_file():
    with pytest.raises(RobotError, match="cannot be read"):
        read_toml(Path("a\0b"), _Any, RobotError)


@given(
    st.text(st.characters(exclude_categories=["Cs"]))
    | st.lists(st.text(st.characters(exclude_categories=["Cs"])))
    | st.floats(allow_nan=False)
    | st.integers(-(2**63), 2**63 - 1)
    | st.booleans()
)
def test_a_value_is_read_as_it_was_written(value):
    """Newlines, quotes, control characters and those beyond 16 bits included."""
    read = tomllib.loads(f"x = {literal(value)}")["x"]
    assert read == value and type(read) is type(value)


class _Part(BaseModel):
    mass: float = Field(description="Of the part [kg].")
    name: str


class _Parts(BaseModel):
    parts: list[_Part]


def test_a_missing_key_is_told_with_its_meaning(tmp_path: Path):
    (tmp_path / "parts.toml").write_text('[[parts]]\nname = "arm"\n')
    with pytest.raises(
        RobotError, match=r"'parts.0.mass' is missing; expected .*mass': Of the part \[kg\]; add"
    ):
        read_toml(tmp_path / "parts.toml", _Parts, RobotError)
    (tmp_path / "parts.toml").write_text("[[parts]]\nmass = 1\n")
    with pytest.raises(RobotError, match=r"expected a value for 'parts.0.name'; add it"):
        read_toml(tmp_path / "parts.toml", _Parts, RobotError)
