"""Limits come from the environment, and a refusal names the limit and how to set it."""

import pytest

from dynreg.errors import LogError, UsageError
from dynreg.limits import Limits, limits, refuse


def test_the_environment_sets_a_limit(monkeypatch):
    assert limits() == Limits()
    monkeypatch.setenv("DYNREG_MAX_ROWS", "12")
    assert limits() == Limits(rows=12)


@pytest.mark.parametrize("text", ["", "0", "-3", "1e6", "many", "٣", "9" * 30])
def test_a_limit_that_is_no_number_is_refused(monkeypatch, text):
    monkeypatch.setenv("DYNREG_MAX_ROWS", text)
    with pytest.raises(UsageError, match="DYNREG_MAX_ROWS"):
        limits()


def test_a_refusal_names_the_limit_and_its_variable(monkeypatch):
    monkeypatch.setenv("DYNREG_MAX_ROWS", "12")
    with pytest.raises(LogError, match="run.csv: 13 rows; expected at most 12 .*DYNREG_MAX_ROWS"):
        refuse(LogError, "run.csv", "13 rows", "rows")
