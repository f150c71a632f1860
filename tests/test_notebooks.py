"""Notebooks run from the first cell to the last, and are stored without outputs."""

from collections.abc import Iterator
from pathlib import Path

import nbformat
import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


def code(notebook: nbformat.NotebookNode) -> Iterator[nbformat.NotebookNode]:
    return (cell for cell in notebook.cells if cell.cell_type == "code")


def printed(notebook: nbformat.NotebookNode) -> str:
    """What the cells wrote and answered, as text."""
    outputs = [output for cell in code(notebook) for output in cell.outputs]
    texts = [o.get("text") or o.get("data", {}).get("text/plain", "") for o in outputs]
    return "\n".join(texts)


def drawings(notebook: nbformat.NotebookNode) -> int:
    outputs = [output for cell in code(notebook) for output in cell.outputs]
    return sum("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_is_stored_without_outputs(path: Path) -> None:
    notebook = nbformat.read(path, 4)
    nbformat.validate(notebook)
    assert not [cell.id for cell in code(notebook) if cell.outputs or cell.execution_count]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the notebook's registry is, once populated for both logs."""
    return tmp_path_factory.mktemp("notebook")


@pytest.mark.parametrize("source", ["hidden", "measured"])
def test_the_query_notebook(
    source: str, place: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """On the hidden servo and on the measured log, with few simulators."""
    from nbclient import NotebookClient

    data = request.getfixturevalue("data_dir") if source == "measured" else place
    monkeypatch.setenv("DYNREG_DATA_DIR", str(data.resolve()))
    monkeypatch.setenv("DYNREG_NOTEBOOK_REGISTRY", str(place / "registry"))
    monkeypatch.setenv("DYNREG_NOTEBOOK_N", "64")
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel draws into the notebook
    (path,) = [p for p in NOTEBOOKS if p.stem == "01_query"]
    notebook = nbformat.read(path, 4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(path.parent)}}).execute()
    assert drawings(notebook) == 3
    text = printed(notebook)
    assert "gain over the nominal model" in text and "tip_mass" in text
    assert ("secret" in text) == (source == "hidden")


@pytest.mark.parametrize("source", ["hidden", "measured"])
def test_the_diagnosis_notebook(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """On a hidden servo whose friction grows with the load and on the measured log, with few effects."""
    from nbclient import NotebookClient

    data = request.getfixturevalue("data_dir") if source == "measured" else tmp_path
    monkeypatch.setenv("DYNREG_DATA_DIR", str(data.resolve()))
    monkeypatch.setenv("DYNREG_NOTEBOOK_REGISTRY", str(tmp_path / "registry"))
    monkeypatch.setenv("DYNREG_NOTEBOOK_EFFECTS", "load_friction,payload,backlash")
    monkeypatch.delenv("MPLBACKEND", raising=False)
    (path,) = [p for p in NOTEBOOKS if p.stem == "02_diagnose"]
    notebook = nbformat.read(path, 4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(path.parent)}}).execute()
    assert drawings(notebook) == 2
    text = printed(notebook)
    assert "['load_friction" in text and "gain on held-out runs" in text and "tip_mass" in text
    assert "dynreg export" in text
    assert ("no copy of the real log" in text) == (source == "hidden")


def test_the_gait_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a hidden quadruped, with few simulators and a short search."""
    from nbclient import NotebookClient

    monkeypatch.setenv("DYNREG_NOTEBOOK_REGISTRY", str(tmp_path / "registry"))
    monkeypatch.setenv("DYNREG_NOTEBOOK_N", "40")
    monkeypatch.setenv("DYNREG_NOTEBOOK_ROLLOUTS", "60")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.delenv("MPLBACKEND", raising=False)
    (path,) = [p for p in NOTEBOOKS if p.stem == "03_gait"]
    notebook = nbformat.read(path, 4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(path.parent)}}).execute()
    text = printed(notebook)
    assert drawings(notebook) >= 3  # and the robot, where this machine can draw it
    assert "Spent(trials=10" in text and "the budget of" in text
    assert all(name in text for name in ("gait.csv", "gait.py", "run.mcap", "def targets(t)"))


def wheeled() -> nbformat.NotebookNode:
    (path,) = [p for p in NOTEBOOKS if p.stem == "04_wheeled"]
    return nbformat.read(path, 4)


def test_the_wheeled_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As it is: on a hidden robot, and on the Create's log where there is a copy. Its cells check what they say."""
    from nbclient import NotebookClient

    monkeypatch.setenv("DYNREG_NOTEBOOK_REGISTRY", str(tmp_path / "registry"))
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = wheeled()
    NotebookClient(
        notebook, timeout=300, resources={"metadata": {"path": str(NOTEBOOKS[0].parent)}}
    ).execute()
    text = printed(notebook)
    assert drawings(notebook) == (4 if "no copy of the Create's log" in text else 5)
    assert "named: drive_inertia" in text and "monday shows drive_inertia" in text
    assert "monday is still true" in text and "left wheel x 0." in text


def test_the_wheeled_notebook_does_without_the_real_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its cells about the Create, with none: one line, and no error."""
    from nbclient import NotebookClient

    monkeypatch.setenv("DYNREG_NOTEBOOK_REGISTRY", str(tmp_path / "registry"))
    monkeypatch.setenv("DYNREG_DATA_DIR", str(tmp_path))
    notebook = wheeled()
    begin, end = (
        next(i for i, cell in enumerate(notebook.cells) if title in cell.source)
        for title in ("## A real robot", "## Is Monday's log still true?")
    )
    notebook.cells = notebook.cells[1:3] + notebook.cells[begin:end]
    NotebookClient(
        notebook, timeout=100, resources={"metadata": {"path": str(NOTEBOOKS[0].parent)}}
    ).execute()
    assert printed(notebook).strip() == "no copy of the Create's log: skipped"
    assert drawings(notebook) == 0
