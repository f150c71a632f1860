"""What a servo might log."""

import sys
from pathlib import Path


def write_log(folder: Path) -> Path:
    """A log of the servo that nobody simulated with: the tests' made-up one."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    import tiny_registry

    (folder / "run.csv").write_text(tiny_registry.bench_csv(), encoding="utf-8")
    return folder / "run.csv"
