"""Notebooks, run from the first cell to the last, and stored with what their cells printed and drew.

    python tests/executed_notebooks.py 02_diagnose

runs these notebooks (`make notebooks`: all of them) with their own settings, and writes their outputs into them.

A fresh run agrees with the stored one where its text has the same words, its numbers are near (`close` in
`executed_pages`), and each cell has as many pictures. What is written to stderr is not kept.
"""

import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter

import nbformat
from executed_pages import difference
from nbformat import NotebookNode

ROOT = Path(__file__).parents[1]
NOTEBOOKS = {path.stem: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
LONGEST = 1800  # s that one cell may take on a busy machine
KEPT = {"text/plain", "image/png", "text/html"}
_SECONDS = re.compile(r"\b[\d.]+ s$", re.MULTILINE)  # of the clock: the end of a line


def code(notebook: NotebookNode) -> Iterator[NotebookNode]:
    """Its cells that are run."""
    return (cell for cell in notebook.cells if cell.cell_type == "code")


def executed(name: str, place: Path, data: Path) -> NotebookNode:
    """The notebook after a run, with its registry in `place` and measured data in `data`."""
    from nbclient import NotebookClient

    notebook = nbformat.read(NOTEBOOKS[name], 4)
    with _environment(DYNREG_DATA_DIR=str(data.resolve()), DYNREG_NOTEBOOK_REGISTRY=str(place / "registry")):
        client = NotebookClient(
            notebook,
            timeout=LONGEST,
            record_timing=False,
            resources={"metadata": {"path": str(ROOT / "notebooks")}},
        )
        client.execute()
    for cell in code(notebook):
        cell.outputs = [_kept(output) for output in cell.outputs if output.get("name") != "stderr"]
        cell.metadata.pop("execution", None)
    notebook.metadata.pop("widgets", None)
    notebook.metadata.get("language_info", {}).pop("version", None)
    return notebook


@contextmanager
def _environment(**given: str) -> Iterator[None]:
    """These variables, and no other choice of where a notebook draws; as before afterwards."""
    before = dict(os.environ)
    os.environ.update(given)
    os.environ.pop("MPLBACKEND", None)  # the kernel draws into the notebook
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _kept(output: NotebookNode) -> NotebookNode:
    if "data" in output:
        output.data = NotebookNode({kind: what for kind, what in output.data.items() if kind in KEPT})
    return output


def texts(cell: NotebookNode) -> str:
    """What a cell printed and answered, without seconds of the clock."""
    said = [_plain(output) for output in cell.outputs]
    return _SECONDS.sub("T s", "\n".join(said))


def _plain(output: NotebookNode) -> str:
    said = output.get("text") or output.get("data", {}).get("text/plain", "")
    return re.sub(r"<Figure size.*?>", "<Figure>", said if isinstance(said, str) else "".join(said))


def pictures(cell: NotebookNode) -> int:
    """How many pictures a cell drew."""
    return sum("image/png" in output.get("data", {}) for output in cell.outputs)


def apart(name: str, stored: NotebookNode, fresh: NotebookNode) -> str:
    """The first difference between two runs of a notebook; "" where there is none."""
    ids: dict[str, str] = {}
    for number, (old, new) in enumerate(zip(code(stored), code(fresh), strict=True), start=1):
        where = f"{name}, code cell {number}"
        if pictures(old) != pictures(new):
            return f"{where}: {pictures(old)} pictures -> {pictures(new)}"
        if found := difference(where, texts(old), texts(new), strict=False, ids=ids):
            return found
    return ""


def main(names: list[str]) -> None:
    """Run these notebooks, else all of them, and write their outputs."""
    data = Path(os.environ.get("DYNREG_DATA_DIR", ROOT.parent / "shared" / "data"))
    if not data.is_dir():
        sys.exit(f"no logs in {data}: set DYNREG_DATA_DIR to a folder with copies of them (docs/data.md)")
    for name in names or NOTEBOOKS:
        began = perf_counter()
        with tempfile.TemporaryDirectory() as place:
            notebook = executed(name, Path(place), data)
        nbformat.write(notebook, NOTEBOOKS[name])
        print(f"{name}: {perf_counter() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
