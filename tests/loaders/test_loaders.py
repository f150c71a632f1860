"""Other projects' own loaders on what dynreg has written: `make test-loaders` makes their environment and runs this.

Each `with_NAME.py` runs there, prints what it reads and keeps the numbers, which are compared with the registry's here.
"""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from dynreg import session
from dynreg.session import Session

HERE = Path(__file__).parent
PYTHON = HERE.parents[1] / ".venv-loaders" / "bin" / "python"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not PYTHON.exists(), reason="no .venv-loaders: run `make test-loaders`"),
]


@dataclass(frozen=True)
class Written:
    """A session and what it has exported of its only population."""

    opened: Session
    population: str
    folder: Path

    @property
    def states(self) -> np.ndarray:
        """(N, 2) of all entries, in order."""
        return self.opened.registry.load(self.population, ("states",)).states.reshape(-1, 2)

    @property
    def actions(self) -> np.ndarray:
        """(N', 1) of all entries: those that are followed by a state."""
        bank = self.opened.registry.population(self.population).arrays["bank.actions"][:, :50]
        return np.tile(bank.astype(np.float32).reshape(-1, 1), (8, 1))


@pytest.fixture(scope="module")
def written(registry_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Written]:
    place = tmp_path_factory.mktemp("loaders")
    (place / "out").mkdir()
    with session.open(shutil.copytree(registry_folder, place / "registry")) as opened:
        (population,) = (item.id for item in opened.populations().items)
        names = {"csv": "csv.csv", "minari": "servo_pendulum-v0"}
        for form in ("parquet", "csv", "lerobot", "minari", "safetensors"):
            opened.export_dataset(population, place / "out" / names.get(form, form), form)
        yield Written(opened, population, place / "out")


@pytest.fixture
def read(written: Written, tmp_path: Path) -> Callable[[str], dict[str, np.ndarray]]:
    """Runs `with_NAME.py` in the other environment, shows what it prints, and gives the numbers that it kept."""

    def ran(name: str) -> dict[str, np.ndarray]:
        out = tmp_path / "out.npz"
        line = [PYTHON, HERE / f"with_{name}.py", written.folder, written.opened.path, out]
        there = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "hf")}
        done = subprocess.run(line, capture_output=True, text=True, timeout=600, env=there | offline)
        print(f"\n== {name}\n{done.stdout}")
        assert done.returncode == 0, done.stderr
        return dict(np.load(out, allow_pickle=False))

    return ran


@pytest.mark.parametrize("name", ["datasets", "duckdb"])
def test_tables(name: str, read, written: Written) -> None:
    found, frame = read(name), written.opened.population(written.population)
    assert all(
        np.array_equal(found[k].astype(np.float32), written.states) for k in ("states", "again", "shard")
    )
    recording = np.concatenate([e.values[:, 0] for e in written.opened.recording("bench").episodes])
    assert np.array_equal(found["recording"], recording)
    assert np.array_equal(found["resistance"], frame["resistance"])


@pytest.mark.parametrize("name", ["minari", "lerobot"])
def test_episodes(name: str, read, written: Written) -> None:
    found = read(name)
    assert found["states"].dtype == np.float32 and np.array_equal(found["states"], written.states)
    assert np.array_equal(found["actions"], written.actions)


def test_models(read, written: Written) -> None:
    states, actions = np.zeros((8, 5, 2)), np.linspace(-1, 1, 5)[:, None]
    expected = written.opened.model(written.population).predict(states, actions)
    assert np.allclose(read("torch")["predicted"], expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("form", ["parquet", "csv.csv", "servo_pendulum-v0"])
def test_a_card_says_how_to_read_it(form: str, written: Written, tmp_path: Path) -> None:
    """Its own words, run as they stand there beside what was written."""
    place = written.folder / form
    card = (place / "README.md" if place.is_dir() else Path(f"{place}.md")).read_text(encoding="utf-8")
    (code,) = (part.partition("```")[0] for part in card.split("```python\n")[1:])
    done = subprocess.run(
        [PYTHON, "-c", code],
        capture_output=True,
        text=True,
        timeout=600,
        cwd=written.folder,
        env={**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path)},
    )
    print(f"\n== {form}\n{done.stdout}")
    assert done.returncode == 0 and done.stdout, done.stderr
