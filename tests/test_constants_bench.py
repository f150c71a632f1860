"""The bench of constants: what it changes is there, is changed wherever it is used, and is put back."""

from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

from dynreg.diagnose import score, settle
from dynreg.diagnose.plans import Long, Short
from dynreg.evidence.fit import fit

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def table(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The table of the bench."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    return import_module("constants_table")


def test_every_constant_of_the_table_stands_in_the_code_with_another_value(table) -> None:
    for changes in table.TABLE.values():
        for names, every in changes.items():
            for values in every:
                assert len(values) == len(names)
                before = [table.standing(name) for name in names]
                assert list(values) != before


def test_a_constant_is_changed_where_another_module_has_it_from_its_own(table) -> None:
    before = score.NEAR
    with table.changed("dynreg.diagnose.score:NEAR", 0.5):
        assert (score.NEAR, settle.NEAR) == (0.5, 0.5)
    assert score.NEAR is settle.NEAR is before


def test_a_field_is_changed_in_its_own_plan_alone(table) -> None:
    before = Short().iterations, Long().iterations
    with table.changed("dynreg.diagnose.plans.short:Short.iterations", 11):
        assert (Short().iterations, Long().iterations) == (11, before[1])
    assert (Short().iterations, Long().iterations) == before


def test_what_a_function_takes_where_nothing_is_said_is_put_back_after_an_error(table) -> None:
    before = dict(fit.__kwdefaults__)
    with pytest.raises(KeyError), table.changed("dynreg.evidence.fit:fit.tolerance", 9.0):
        assert fit.__kwdefaults__ == {**before, "tolerance": 9.0}
        raise KeyError
    assert fit.__kwdefaults__ == before
