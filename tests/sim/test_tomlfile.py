import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynreg.tomlfile import line_of

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
