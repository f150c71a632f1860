"""LeRobot datasets: a folder with meta/info.json and one Parquet row a frame.

Format: https://github.com/huggingface/lerobot (dataset versions 2 and 3).
"""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa

from dynreg.data.readers import ReadOptions
from dynreg.data.readers.tables import from_table
from dynreg.data.series import RawLog, Series
from dynreg.errors import LogError


def read(path: Path, options: ReadOptions) -> RawLog:
    """Read all frames: "observation.state[0]" and, where the names are known, "observation.state[elbow.pos]".

    Episodes are in the column `episode_index`. Raises LogError where the folder is not a dataset.
    """
    try:
        info = json.loads((path / "meta" / "info.json").read_text(encoding="utf-8"))
        files = sorted((path / "data").rglob("*.parquet"))
        tables = [_frames(file) for file in files]
        table = pa.concat_tables(tables, promote_options="default")
    except (OSError, ValueError, pa.ArrowException) as error:
        raise LogError(
            f"{path.name!r} is not a LeRobot dataset: {error}",
            expected="meta/info.json and data/**/*.parquet",
            do="download it again",
        ) from error
    if table.num_rows == 0:
        raise LogError(f"{path.name!r} has no frames", expected="data/**/*.parquet", do="download it again")
    log = from_table(path, table, options)
    sources = dict(log.sources)
    for feature, description in info.get("features", {}).items():
        sources.update(_by_name(feature, description, log.sources))
    metadata = {**log.metadata, **{k: info[k] for k in ("fps", "robot_type") if k in info}}
    return RawLog(path, sources, metadata, log.labels, log.findings)


def _frames(file: Path) -> pa.Table:
    import pyarrow.parquet as pq

    with file.open("rb") as stream:  # of a path, a colon would make an address
        return pq.read_table(stream)


def _by_name(feature: str, description: dict, sources: dict[str, Series]) -> dict[str, Series]:
    names = description.get("names") if isinstance(description, dict) else None
    if isinstance(names, dict):  # older versions: {"motors": [...]}
        names = next((v for v in names.values() if isinstance(v, list)), None)
    if not isinstance(names, list):
        return {}
    flat = [str(name) for name in np.ravel(names)]
    return {
        f"{feature}[{n}]": sources[f"{feature}[{i}]"]
        for i, n in enumerate(flat)
        if f"{feature}[{i}]" in sources
    }
