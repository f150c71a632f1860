"""Small diagnoses, queries, gaits, drifts and comparisons say what they said when they were written down.

`make golden` writes them anew, after it has seen that each comes out the same twice and on one thread and on two. With
DYNREG_GOLDEN=strict they are compared strictly on any machine.
"""

import copy
import json
import os
from importlib.util import find_spec
from pathlib import Path

import pytest
from golden.cases import CASES, Place, Skipped
from golden.comparing import NETWORKS, STRICT, brief, differences, fingerprint

HERE = Path(__file__).parent
SINGLE = (
    1e-6  # hnswlib, with which they were written, keeps vectors in single precision; exact search does not
)
WITHIN = {"compare_networks": NETWORKS} | ({} if find_spec("hnswlib") else {"query_servo": SINGLE})
# Contacts of four feet make another search of what another processor rounds otherwise: there, only these are compared.
CHAOTIC = {
    "diagnose_quadruped": ("schema", "verdict", "causes", "channels", "recordings"),
    "gait_neighbours": ("gait",),
}
LONG = ("diagnose_quadruped", "diagnose_leg_air")


def stored(name: str) -> dict:
    return json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def strict() -> bool:
    """Whether this machine is the one that wrote them, or shall be held to it."""
    return os.environ.get("DYNREG_GOLDEN") == "strict" or fingerprint() == stored("machine")


@pytest.fixture
def measured() -> Path | None:
    folder = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parents[2] / "shared" / "data"))
    return folder if folder.is_dir() else None


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in CASES]
)
def test_it_says_what_it_said(name: str, strict: bool, measured: Path | None, tmp_path: Path) -> None:
    try:
        made = CASES[name](Place(tmp_path, measured))
    except Skipped as missing:
        pytest.skip(str(missing))
    old, new = stored(name), json.loads(json.dumps(brief(made)))
    if name in CHAOTIC and not strict:
        old, new = ({key: one.get(key) for key in CHAOTIC[name]} for one in (old, new))
    found = differences(old, new, strict=strict, within=WITHIN.get(name, STRICT))
    assert not found, "\n".join([f"{len(found)} values differ:", *found[:40]])


def test_a_file_for_every_case_and_none_more() -> None:
    assert {p.stem for p in HERE.glob("*.json")} == {*CASES, "machine"}


# ---- the comparison itself can fail ----

DOCUMENT = {
    "verdict": "named",
    "simulator": "0123456789abcdef",
    "causes": [{"effect": "cogging", "gap": {"value": 1.0, "low": 0.9, "high": 1.1}}, {"effect": "payload"}],
    "tests": 12,
    "clean": True,
    "none": None,
    "cost": {"rollouts": 40},
}


def altered(*way: str | int, to: object) -> dict:
    """The document with one value changed."""
    other = copy.deepcopy(DOCUMENT)
    part = other
    for step in way[:-1]:
        part = part[step]
    part[way[-1]] = to
    return other


@pytest.mark.parametrize("strict", [True, False])
def test_a_document_is_like_itself(strict: bool) -> None:
    assert not differences(DOCUMENT, copy.deepcopy(DOCUMENT), strict=strict)


@pytest.mark.parametrize(
    ("way", "to", "says"),
    [
        (("verdict",), "none", "verdict: 'named' -> 'none'"),
        (("causes", 0, "effect"), "backlash", "causes[0].effect: 'cogging' -> 'backlash'"),
        (("causes", 0, "gap", "value"), 1.2, "causes[0].gap.value: 1.0 -> 1.2"),
        (("causes",), DOCUMENT["causes"][::-1], "causes[0].effect: 'cogging' -> 'payload'"),
        (("causes",), DOCUMENT["causes"][:1], "causes: 2 of them -> 1 of them"),
        (("tests",), 13, "tests: 12 -> 13"),
        (("tests",), None, "tests: 12 -> None"),
        (("clean",), 1, "clean: True -> 1"),
        (("none",), 0.0, "none: None -> 0.0"),
        (("new",), 3, "new: (missing) -> 3"),
    ],
)
@pytest.mark.parametrize("strict", [True, False])
def test_what_differs_is_told_with_its_place(way: tuple, to: object, says: str, strict: bool) -> None:
    assert says in differences(DOCUMENT, altered(*way, to=to), strict=strict)


@pytest.mark.parametrize(
    ("way", "to"),
    [
        (("simulator",), "fedcba9876543210"),
        (("cost", "rollouts"), 41),
        (("causes", 0, "gap", "value"), 1.0 + 1e-8),
        (("causes", 0, "gap", "low"), 0.91),
    ],
)
def test_elsewhere_ids_costs_and_rounding_may_differ(way: tuple, to: object) -> None:
    other = altered(*way, to=to)
    assert len(differences(DOCUMENT, other)) == 1 and not differences(DOCUMENT, other, strict=False)


def test_a_small_rounding_is_no_difference() -> None:
    assert not differences(DOCUMENT, altered("causes", 0, "gap", "value", to=1.0 + 1e-10))


def test_every_number_of_a_long_row_counts() -> None:
    row = [0.1 * i for i in range(200)]
    other = [*row]
    other[77] += 1e-6
    swapped = [*row]
    swapped[3], swapped[4] = row[4], row[3]
    for changed in (other, swapped, [*row[:9], None, *row[10:]], row[:-1]):
        assert differences(brief({"row": row}), brief({"row": changed}))
    rows = [{"x": x, "name": "n"} for x in row]
    assert differences(brief(rows), brief([*rows[:-1], {"x": 0.0, "name": "n"}]))
    assert differences(brief(["a"] * 20), brief(["a"] * 19 + ["b"])) == ["[19]: 'a' -> 'b'"]
    deep = [{"x": [*row], "low": None} for _ in range(20)]
    assert differences(brief(deep), brief([*deep[:-1], {"x": other, "low": None}]))


def test_times_of_a_clock_on_the_wall_are_left_out() -> None:
    told = {"cost": {"rollouts": 3, "seconds": 4.0}, "schema": "dynreg/gait/2", "seconds": 5.0}
    assert brief(told) == {"cost": {"rollouts": 3}, "schema": "dynreg/gait/2", "seconds": 5.0}
