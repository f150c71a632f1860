"""A session on a copy of the tiny registry, and its population exported in every form, once."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from dynreg import session
from dynreg.datasets.formats import FORMATS
from dynreg.session import Session


@dataclass(frozen=True)
class Exported:
    """The population of the tiny registry in every form: `folder / form`."""

    opened: Session
    population: str
    folder: Path


@pytest.fixture(scope="session")
def exported(registry_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Exported]:
    place = tmp_path_factory.mktemp("exported")
    registry = shutil.copytree(registry_folder, place / "registry")
    (place / "forms").mkdir()
    with session.open(registry) as opened:
        (population,) = (item.id for item in opened.populations().items)
        for form in FORMATS:
            opened.export_dataset(population, place / "forms" / form, form, licence="apache-2.0")
        yield Exported(opened, population, place / "forms")
