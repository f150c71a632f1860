"""Rates of trials: exact intervals, and counts that add up."""

import made_up_diagnosis
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_diagnosis import trial

from dynreg.results import TrialTable, rate

# hits, of, and the two-sided 90 % Clopper-Pearson interval, from tables
KNOWN = [(0, 10, 0.0, 0.2589), (10, 10, 0.7411, 1.0), (5, 10, 0.2224, 0.7776), (1, 20, 0.0026, 0.2161)]


@pytest.mark.parametrize("hits, of, low, high", KNOWN)
def test_intervals_are_exact(hits: int, of: int, low: float, high: float) -> None:
    found = rate([True] * hits + [False] * (of - hits))
    assert (found.hits, found.of, found.value) == (hits, of, hits / of)
    assert (found.low, found.high) == (pytest.approx(low, abs=2e-4), pytest.approx(high, abs=2e-4))


@given(st.integers(1, 60), st.data())
def test_intervals_hold_the_share_and_mirror_each_other(of: int, data: st.DataObject) -> None:
    hits = data.draw(st.integers(0, of))
    found, other = rate([i < hits for i in range(of)]), rate([i >= hits for i in range(of)])
    assert 0 <= found.low <= found.value <= found.high <= 1
    assert found.low == pytest.approx(1 - other.high, abs=1e-9)


def test_nothing_tried_has_no_rate() -> None:
    assert rate([]) is None
    empty = TrialTable.of("leg", [])
    assert empty.right is None and empty.false_alarm is None and empty.set_median is None
    assert str(empty) == "leg: no trials"


def test_counts_are_those_of_the_trials() -> None:
    table = made_up_diagnosis.trials()
    assert (table.right.hits, table.right.of) == (8, 10)
    assert (table.wrong.hits, table.wrong.of) == (1, 10), "a missed effect is not a wrong name"
    assert (table.false_alarm.hits, table.false_alarm.of) == (1, 4)
    assert {(g.hidden, g.trials, g.right.hits) for g in table.by_effect} == {
        ("load_friction", 5, 4),
        ("backlash", 5, 4),
        (None, 4, 3),
    }
    assert {(c.hidden, c.named, c.count) for c in table.confusions} == {
        ("load_friction", "stribeck_friction", 1),
        ("backlash", None, 1),
        (None, "payload", 1),
    }
    assert sum(c.count for c in table.confusions) == sum(not t.right for t in table.trials)


def test_sizes_are_told_apart_weak_first() -> None:
    of = [trial(i).model_copy(update={"size": s}) for i, s in enumerate(("strong", "weak", "strong"))]
    table = TrialTable.of("leg", of)
    assert list(table.by_size) == ["weak", "strong"] and table.by_size["strong"].of == 2


def test_joints_and_pairs_keep_their_names_apart() -> None:
    wrong = trial(0, "backlash+payload", "backlash[hip,knee]+inertia")
    (confusion,) = TrialTable.of("leg", [wrong]).confusions
    assert (confusion.hidden, confusion.named) == ("backlash+payload", "backlash+inertia")


def test_the_95th_percentile_is_a_size_that_was_seen() -> None:
    of = [trial(i).model_copy(update={"size_of_set": 1 + (i >= 19) * 3}) for i in range(20)]
    table = TrialTable.of("leg", of)
    assert (table.set_median, table.set_p95) == (1, 1)
    more = TrialTable.of("leg", [*of, of[-1]])
    assert more.set_p95 == 4


def test_a_notebook_shows_rates_and_trials() -> None:
    shown = made_up_diagnosis.trials()._repr_html_()
    assert "right 8 of 10" in shown and shown.count("<table") == 2
    assert len(made_up_diagnosis.trials().to_frame()) == 14


def test_a_right_name_for_a_part_is_neither_right_nor_wrong() -> None:
    part = trial(0, "backlash", "backlash").model_copy(
        update={"verdict": "partly_explained", "right": False, "in_part": True}
    )
    table = TrialTable.of("leg", [part, trial(1)])
    assert (table.in_part.hits, table.wrong.hits) == (1, 0) and table.in_part.of == 2
    assert "right in part 1 of 2" in str(table)
