"""Results: frozen, strict, the same after a trip through JSON, and the schemas on disk are theirs."""

import json
import math

import made_up_results
import pytest
from pydantic import ValidationError

from dynreg.cli.schemas import PLACE, model_of, schema_files
from dynreg.results import RESULTS, Cost, Neighbour, Result


@pytest.mark.parametrize("result", made_up_results.every_kind(), ids=lambda r: type(r).__name__)
def test_a_result_comes_back_from_its_json(result: Result) -> None:
    document = json.loads(result.to_json())
    again = model_of(document["schema"]).model_validate(document)
    assert again == result
    assert again.to_json() == result.to_json()


def test_every_kind_of_result_is_made_up_here() -> None:
    assert {type(r) for r in made_up_results.every_kind()} == set(RESULTS.values())


def test_the_schemas_on_disk_are_those_of_the_code() -> None:
    on_disk = {path.name: path.read_text(encoding="utf-8") for path in PLACE.glob("*.json")}
    assert on_disk == schema_files(), "run `python -m dynreg.cli.schemas`"


def test_every_schema_asks_for_its_name_and_refuses_other_fields() -> None:
    for text in schema_files().values():
        schema = json.loads(text)
        assert schema["properties"]["schema"]["const"].startswith("dynreg/")
        assert schema["additionalProperties"] is False


def test_documents_have_names_of_their_own() -> None:
    names = [model.model_fields["schema_"].default for model in RESULTS.values()]
    assert len(set(names)) == len(names)


def test_numbers_that_are_not_finite_become_null() -> None:
    neighbour = Neighbour(
        entry="a", name="a", index=0, distance=math.inf, replay_error=math.nan, parameters={}
    )
    document = json.loads(neighbour.to_json())
    assert document["distance"] is None and document["replay_error"] is None


def test_results_are_frozen_and_strict() -> None:
    cost = Cost(evaluations=1, rollouts=2, seconds=0.5)
    with pytest.raises(ValidationError):
        cost.seconds = 1.0
    with pytest.raises(ValidationError):
        Cost(evaluations=1, rollouts=2, seconds=0.5, colour="red")


def test_a_notebook_shows_a_table_with_a_row_for_each_neighbour() -> None:
    result = made_up_results.neighbours(k=3)
    assert len(result.to_frame()) == 3
    shown = result._repr_html_()
    assert shown.count("<tr") == 4 and "bench_monday" in shown


def test_a_notebook_escapes_what_a_log_was_named() -> None:
    result = made_up_results.neighbours().model_copy(update={"recording_name": "<script>x</script>"})
    assert "<script>" not in result._repr_html_()
