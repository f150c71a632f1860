"""A registry that takes a second to make: 8 simulators of the servo bench, and one recording, "bench"."""

import math
from collections.abc import Callable, Iterable
from pathlib import Path

from dynreg import session
from dynreg.distance.population import Training

QUICK = Training(epochs=1, base_configurations=4, base_epochs=1)
COLUMNS = ("time", "arm/position", "arm/velocity", "arm/target", "supply", "kp", "episode")
Row = list[object]


def bench_csv(edit: Callable[[int, Row], Row] = lambda i, row: row, columns: Iterable[str] = COLUMNS) -> str:
    """A made-up log of the servo bench; `edit` changes rows in the order of `columns`."""
    lines = [",".join(columns)]
    for episode, kp in enumerate((100, 200, 400, 400, 800)):
        for i in range(200):
            phase = 3 * (0.01 * i) + episode
            row: Row = [
                round(0.01 * i, 2),
                round(0.5 * math.sin(phase), 5),
                round(1.5 * math.cos(phase), 5),
                round(0.5 * math.sin(phase + 0.05), 5),
                7.4,
                kp,
                f"e{episode}",
            ]
            lines.append(",".join(str(value) for value in edit(i, row)))
    return "\n".join(lines) + "\n"


def make(folder: Path) -> Path:
    """Make it in a new folder."""
    log = folder / "bench.csv"
    log.write_text(bench_csv(), encoding="utf-8")
    with session.open(folder / "registry") as opened:
        opened.populate("servo_pendulum", 8, training=QUICK)
        opened.ingest(log, "servo_pendulum", name="bench")
    return folder / "registry"
