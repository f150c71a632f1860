"""LeRobot datasets: a folder with meta/info.json and one Parquet row a frame.

Format: https://github.com/huggingface/lerobot (dataset versions 2 and 3).
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from dynreg.data.readers import ReadOptions
from dynreg.data.readers.batches import Columns
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.numbers import parse_json
from dynreg.data.readers.parquet import gather
from dynreg.data.readers.signals import MAX_ITEMS
from dynreg.data.series import RawLog, Series
from dynreg.errors import LogError

EPISODES = "episode_index"


def read(path: Path, options: ReadOptions) -> RawLog:
    """Read all frames: "observation.state[0]" and, where the names are known, "observation.state[elbow.pos]".

    Episodes are told apart by the column `episode_index`. Raises LogError where the folder is not a dataset.
    """
    budget = Budget(path.name)
    try:
        info = _info(path, budget)
        names = {feature: _names(about) for feature, about in (info.get("features") or {}).items()}
        table = Columns(path, budget, _by_column(options, names))
        for file in _files(path, budget):
            with file.open("rb") as stream:
                gather(stream, table)
    except (OSError, ValueError, AttributeError, RecursionError, pa.ArrowException) as error:
        raise LogError(
            f"{path.name!r} is not a LeRobot dataset: {error}",
            expected="meta/info.json and data/**/*.parquet",
            do="download it again",
        ) from error
    if table.rows == 0:
        raise LogError(f"{path.name!r} has no frames", expected="data/**/*.parquet", do="download it again")
    log = table.log({})
    sources = dict(log.sources)
    for feature, items in names.items():
        sources.update(_by_name(feature, items, log.sources))
    if EPISODES in log.sources:
        log = replace(log, metadata={**log.metadata, "episode_column": EPISODES})
    metadata = {**log.metadata, **{k: info[k] for k in ("fps", "robot_type") if k in info}}
    return replace(
        log, sources=sources, metadata=metadata, names=tuple(dict.fromkeys((*log.names, *sources)))
    )


def _info(path: Path, budget: Budget) -> dict[str, Any]:
    file = path / "meta" / "info.json"
    budget.check("settings_bytes", file.stat().st_size)
    info = parse_json(file.read_text(encoding="utf-8"))
    if not isinstance(info, dict) or not isinstance(info.get("features") or {}, dict):
        raise ValueError("meta/info.json does not hold names with what they stand for")
    return info


def _files(path: Path, budget: Budget) -> list[Path]:
    out = []
    for file in (path / "data").rglob("*.parquet"):
        if file.is_file():
            budget.spend("log_files")
            out.append(file)
    return sorted(out)


def _names(about: Any) -> list[str]:
    """What the items of a feature are called; older versions have {"motors": [...]}."""
    names = about.get("names") if isinstance(about, Mapping) else None
    if isinstance(names, Mapping):
        names = next((v for v in names.values() if isinstance(v, list)), None)
    return [str(name) for name in _flat(names)] if isinstance(names, list) else []


def _flat(names: list[Any]) -> Iterator[Any]:
    """The names in lists of any shape, in order."""
    left = [iter(names)]
    while left:
        name = next(left[-1], left)
        if name is left:
            left.pop()
        elif isinstance(name, list):
            left.append(iter(name))
        else:
            yield name


def _by_column(options: ReadOptions, names: Mapping[str, list[str]]) -> ReadOptions:
    """Options that ask for the columns of the items that are asked for by name."""
    if options.sources is None:
        return options
    columns = (EPISODES, *(f"{feature}[0]" for feature in names if options.wants_signal(feature)))
    return replace(options, sources=(*options.sources, *columns))


def _by_name(feature: str, names: list[str], sources: Mapping[str, Series]) -> dict[str, Series]:
    return {
        f"{feature}[{n}]": sources[f"{feature}[{i}]"]
        for i, n in enumerate(names[:MAX_ITEMS])
        if f"{feature}[{i}]" in sources
    }
