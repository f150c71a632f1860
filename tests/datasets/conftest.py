"""The tiny registry with a second shard, and its population exported in every form, once."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from dynreg import session
from dynreg.datasets.formats import FORMATS
from dynreg.registry import ShardData
from dynreg.session import Session


@dataclass(frozen=True)
class Exported:
    """A population of 8 and 4 entries in every form: `folder / form`."""

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
        held = opened.registry.load(population)
        more = ShardData(
            held.values[:4],
            held.states[:4] + np.float32(0.25),
            {name: array[:4] * np.float16(0.5) for name, array in held.weights.items()},
            held.own_loss[:4],
            held.train_loss[:4],
            {},
            np.full(held.states.shape[:2], 0.01)[:4],
        )
        opened.registry.put_population(replace(opened.registry.population(population), size=12))
        opened.registry.put_shard(population, 8, more)
        for form in FORMATS:
            opened.export_dataset(population, place / "forms" / form, form, licence="apache-2.0")
        yield Exported(opened, population, place / "forms")
