"""JSON schemas of every document that dynreg prints: `python -m dynreg.cli.schemas` writes them.

They lie in the package, `dynreg/schemas/`, so that a wheel has them: `importlib.resources.files("dynreg") / "schemas"`.
"""

import json
import sys
from pathlib import Path

from dynreg.results import RESULTS
from dynreg.results.result import Result

PLACE = Path(__file__).parents[1] / "schemas"


def schema_files() -> dict[str, str]:
    """{file name: text} of the JSON schemas, named like the documents' `schema`."""
    return {f"{_name(model)}.json": _text(model) for model in RESULTS.values()}


def model_of(schema: str) -> type[Result]:
    """The document type that a JSON document's `schema` names; KeyError for an unknown one."""
    return {model.model_fields["schema_"].default: model for model in RESULTS.values()}[schema]


def main(folder: str | Path = PLACE) -> None:
    """Write all schemas into `folder`; by default where the package keeps them."""
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    for name, text in schema_files().items():
        (place / name).write_text(text, encoding="utf-8")


def _name(model: type[Result]) -> str:
    _, name, version = model.model_fields["schema_"].default.split("/")
    return f"{name}.{version}"


def _text(model: type[Result]) -> str:
    schema = model.model_json_schema(by_alias=True, mode="serialization")
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    main(*sys.argv[1:2])
