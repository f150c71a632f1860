"""Every key of robot.toml and of a map says what it means, where it is defined; so does every table."""

from collections.abc import Iterator
from typing import get_args

import pytest
from pydantic import BaseModel

from dynreg.data.maps import LogMap
from dynreg.sim.spec import RobotFile


def models(kind: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """A model and those of the tables in it."""
    yield kind
    for field in kind.model_fields.values():
        for inner in inside(field.annotation):
            yield from models(inner)


def inside(annotation) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from inside(part)


TABLES = [*models(RobotFile), *models(LogMap)]


def test_the_tables_are_found():
    assert {"RobotFile", "DutyServo", "LegTable", "LogMap", "EpisodeMap"} <= {t.__name__ for t in TABLES}


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__)
def test_a_table_and_its_keys_are_described(table: type[BaseModel]):
    assert table.__doc__ and table.__doc__ is not BaseModel.__doc__
    for name, field in table.model_fields.items():
        said = field.description or ""
        assert said.endswith(".") and len(said) > 10, f"{table.__name__}.{name}: {said!r}"
