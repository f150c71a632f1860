"""The updated displacement table as a file."""

import io

import numpy as np

from dynreg.drift.drift import Drifted
from dynreg.timed.commands import AXES


def parquet(found: Drifted) -> bytes:
    """A Parquet file with a row for each sample, the earlier ones first, and which still count."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    both = found.both
    columns: dict[str, np.ndarray] = {
        "born": np.repeat([0, 1], [both.old.drives, both.new.drives]),
        "cell": np.concatenate([both.old.cell_of_drive, both.new.cell_of_drive]),
    }
    parts = ((both.old, both.old_off), (both.new, both.new_off))
    asked = [np.stack(p.commands.columns[:3], axis=1) for p, _ in parts]
    told_columns = np.concatenate([p.by_drive(a) for (p, _), a in zip(parts, asked, strict=True)])
    moved = np.concatenate([p.by_drive(p.moved) for p, _ in parts])
    off = np.concatenate([p.by_drive(o) for p, o in parts])
    columns |= dict(zip(("left", "right", "seconds"), told_columns.T, strict=True))
    for name, values in (("", moved), ("off_", off), ("kept_", found.counts)):
        columns |= {f"{name}{axis}": values[:, i] for i, axis in enumerate(AXES)}
    out = io.BytesIO()
    pq.write_table(pa.table(columns), out)
    return out.getvalue()
