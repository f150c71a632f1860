"""What `navigate` can be told from Python, and what it refuses with a form to copy."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.verbs.navigate_settings import NavigateSettings

PLACE = [(0.8, 0.4)]


def test_places_are_pairs_or_one_pair() -> None:
    several = [(0.5, 0.2), [1, 2], np.array([3.0, 4.0])]
    assert NavigateSettings(visit=several).visit == ((0.5, 0.2), (1.0, 2.0), (3.0, 4.0))
    assert NavigateSettings(visit=(0.5, 0.2)).visit == ((0.5, 0.2),)
    assert NavigateSettings(visit=np.array(PLACE), area=[-1, -1, 2, 2]).area == (-1.0, -1.0, 2.0, 2.0)


@pytest.mark.parametrize(
    "wrong",
    [
        [(1, 2, 3), (4, 5, 6)],
        [(1,), (2,)],
        [(1, 2), 3],
        "0.5,0.2",
        None,
        5,
        True,
        (True, False),
        [(1.0, np.nan)],
        [(1.0, None)],
        [None],
        [[]],
        (),
        [(10**400, 0)],
        b"12",
    ],
)
def test_what_is_no_place_is_refused_with_an_example(wrong: object) -> None:
    with pytest.raises(UsageError, match=r"^visit .*such as \[\(0\.5, -0\.2\)\]"):
        NavigateSettings(visit=wrong)


@pytest.mark.parametrize("wrong", [1, 5.0, True, "0.2,2", (True, True), (1.0, None), [[1, 2]], ()])
def test_other_numbers_are_refused_with_an_example(wrong: object) -> None:
    with pytest.raises(UsageError, match=r"^seconds .*such as \(0\.2, 2\); give seconds so$"):
        NavigateSettings(visit=PLACE, seconds=wrong)
    with pytest.raises(UsageError, match=r"^area .*such as \(-1, -1, 1, 1\); give area so$"):
        NavigateSettings(visit=PLACE, area=wrong)


def test_a_wrong_number_of_places_is_shown_as_it_was_given() -> None:
    with pytest.raises(UsageError, match=r"visit \(1, 2, 3\); expected metres ahead"):
        NavigateSettings(visit=[(1, 2, 3), (4, 5, 6)])


def test_an_area_holds_the_start_and_every_place() -> None:
    assert NavigateSettings(visit=PLACE, area=(0, 0, 0.8, 0.4)).area == (0.0, 0.0, 0.8, 0.4)
    with pytest.raises(UsageError, match="area '0.1,-1,2,2' leaves out the start; expected an area with"):
        NavigateSettings(visit=PLACE, area=(0.1, -1, 2, 2))
    with pytest.raises(UsageError, match="leaves out the place 3,0.4; .*; ask for a larger area"):
        NavigateSettings(visit=[*PLACE, (3, 0.4)], area=(-1, -1, 2, 2))
