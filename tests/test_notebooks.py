"""Notebooks run from the first cell to the last, and are stored with what a fresh run prints."""

import os
from pathlib import Path

import nbformat
import pytest
from executed_notebooks import NOTEBOOKS as FILES
from executed_notebooks import apart, code, executed, pictures, texts

NOTEBOOKS = list(FILES.values())


def printed(notebook: nbformat.NotebookNode) -> str:
    """What the cells wrote and answered, as text."""
    return "\n".join(map(texts, code(notebook)))


def drawings(notebook: nbformat.NotebookNode) -> int:
    return sum(map(pictures, code(notebook)))


def has_run(notebook: nbformat.NotebookNode) -> bool:
    return any(cell.execution_count for cell in code(notebook))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_is_stored_with_all_outputs_of_one_run_or_with_none(path: Path) -> None:
    """From the top, without an error and without what a terminal is told on stderr."""
    notebook = nbformat.read(path, 4)
    nbformat.validate(notebook)
    cells = list(code(notebook))
    outputs = [output for cell in cells for output in cell.outputs]
    if not has_run(notebook):
        assert not outputs
        return
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1)), "run `make notebooks`"
    assert printed(notebook) and drawings(notebook)
    assert not [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_a_notebook_prints_what_it_shows(name: str, data_dir: Path, tmp_path: Path) -> None:
    """A fresh run with the notebook's own settings; `make notebooks` writes it anew where it changes on purpose."""
    stored = nbformat.read(FILES[name], 4)
    if not has_run(stored):
        pytest.skip("stored without outputs: `make notebooks` writes them")
    assert not (found := apart(name, stored, executed(name, tmp_path, data_dir))), found


def test_two_runs_that_differ_in_a_word_a_number_or_a_picture_are_apart() -> None:
    def run(text: str, many: int = 1) -> nbformat.NotebookNode:
        cell = nbformat.v4.new_code_cell("1")
        drawn = [nbformat.v4.new_output("display_data", {"image/png": ""}) for _ in range(many)]
        cell.outputs = [nbformat.v4.new_output("stream", text=text), *drawn]
        return nbformat.v4.new_notebook(cells=[cell])

    said = run("gain 0.134, 32 simulations and 1.4 s")
    assert not apart("n", said, run("gain 0.136, 32 simulations and 17.9 s"))
    for other in (run("gain 0.2, 32 simulations and 1.4 s"), run("loss 0.134, 32 simulations and 1.4 s")):
        assert apart("n", said, other)
    assert apart("n", said, run("gain 0.134, 32 simulations and 1.4 s", 2))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the notebook's registry is, once populated for both logs."""
    return tmp_path_factory.mktemp("notebook")


@pytest.mark.parametrize("source", ["hidden", pytest.param("measured", marks=pytest.mark.slow)])
def test_the_query_notebook(
    source: str, place: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """On the hidden servo and on the measured log, with few simulators."""
    from nbclient import NotebookClient

    data = request.getfixturevalue("data_dir") if source == "measured" else place
    monkeypatch.setenv("DYNREG_DATA_DIR", str(data.resolve()))
    monkeypatch.setenv("DYNREG_NOTEBOOK_REGISTRY", str(place / "registry"))
    monkeypatch.setenv("DYNREG_NOTEBOOK_N", "24")
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel draws into the notebook
    (path,) = [p for p in NOTEBOOKS if p.stem == "01_query"]
    notebook = nbformat.read(path, 4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(path.parent)}}).execute()
    assert drawings(notebook) == 3
    text = printed(notebook)
    assert "gain over the nominal model" in text and "tip_mass" in text
    assert ("secret" in text) == (source == "hidden")


@pytest.mark.parametrize("source", [pytest.param("hidden", marks=pytest.mark.slow), "measured"])
def test_the_diagnosis_notebook(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """On a hidden servo whose friction grows with the load and on the measured log, with few effects."""
    from nbclient import NotebookClient

    data = request.getfixturevalue("data_dir") if source == "measured" else tmp_path
    monkeypatch.setenv("DYNREG_DATA_DIR", str(data.resolve()))
    monkeypatch.setenv("DYNREG_NOTEBOOK_REGISTRY", str(tmp_path / "registry"))
    monkeypatch.setenv("DYNREG_NOTEBOOK_EFFECTS", "load_friction,backlash")
    monkeypatch.delenv("MPLBACKEND", raising=False)
    (path,) = [p for p in NOTEBOOKS if p.stem == "02_diagnose"]
    notebook = nbformat.read(path, 4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(path.parent)}}).execute()
    assert drawings(notebook) == 2
    text = printed(notebook)
    assert "['load_friction" in text and "gain on held-out runs" in text and "tip_mass" in text
    assert "dynreg export" in text
    assert ("no copy of the real log" in text) == (source == "hidden")


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_wheeled_notebook(tmp_path: Path) -> None:
    """As it is: on a hidden robot, and on the Create's log where there is a copy. Its cells check what they say.

    Where there is a copy, it prints what is stored.
    """
    data = Path(os.environ.get("DYNREG_DATA_DIR", FILES["04_wheeled"].parents[2] / "shared" / "data"))
    notebook, stored = executed("04_wheeled", tmp_path, data), wheeled()
    text, skipped = printed(notebook), "no copy of the Create's log" in printed(notebook)
    assert drawings(notebook) == (4 if skipped else 5)
    assert "named: drive_inertia" in text and "monday shows drive_inertia" in text
    assert "monday is still true" in text and "left wheel x 0." in text
    if has_run(stored) and not skipped:
        assert not (found := apart("04_wheeled", stored, notebook)), (
            f"{found}\n`make notebooks` writes it anew"
        )


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
