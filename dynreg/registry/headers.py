"""The header of a shard's Parquet file, checked before anything is made of what it says."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from dynreg.errors import CorruptError, LimitError
from dynreg.limits import limits, refuse

SCHEMA = "dynreg/shard/2"  # of the Parquet file; the first had episode, step and states alone, and no name
# Entries whose rows are a row group. Commands are the same in each: a dictionary for a few costs little.
TOGETHER = 20


def is_old(header: dict[str, Any]) -> bool:
    """Whether a shard's Parquet file is of the first form, which tells episode, step and states alone."""
    return "schema" not in header


def together(header: dict[str, Any]) -> int:
    """Entries in a row group."""
    return 1 if is_old(header) else TOGETHER


def checked_header(path: Path, stream: pq.ParquetFile) -> dict[str, Any]:
    """The header of an open shard, with `shape` (n, E, T+1, S), the names of its `states` and `periods` (n, E).

    Raises CorruptError where a newer dynreg wrote it, LimitError where it holds more numbers than the limit allows, and
    ValueError, KeyError, TypeError or RecursionError where it is none of a shard's.
    """
    header = json.loads(stream.schema_arrow.metadata[b"dynreg"])
    if not isinstance(header, dict):
        raise ValueError("its header is no JSON object")
    if header.get("schema", SCHEMA) != SCHEMA:
        raise CorruptError(
            f"{str(path)!r} was written by a newer dynreg: it is of the form {str(header['schema'])[:40]!r}",
            expected=f"the form {SCHEMA!r}",
            do="upgrade dynreg to the version that wrote it",
        )
    n, *_, channels = header["shape"] = _shape_of(header)
    if header["stop"] - header["start"] != n:
        raise ValueError(f"it holds {n} entries, not those from {header['start']} to {header['stop']}")
    header["states"] = _states_of(header, stream.schema_arrow.names)
    if len(header["states"]) != channels:
        raise ValueError(f"it has {len(header['states'])} states, not {channels}")
    header["periods"] = _periods_of(header)
    _check_groups(header, stream)
    check_size(path.name, header["shape"])
    return header


def check_size(what: str, shape: Sequence[int]) -> None:
    """LimitError where a shard, of which `what` tells, has states of so large a `shape` that it would not be read."""
    if math.prod(shape) > limits().numbers:
        refuse(LimitError, what, f"{' x '.join(map(str, shape))} numbers", "numbers")


def _shape_of(header: dict[str, Any]) -> list[int]:
    shape = header["shape"]
    if not isinstance(shape, list) or len(shape) != 4:
        raise ValueError(f"its shape is {shape!r:.80}")
    odd = [size for size in shape if type(size) is not int or size < 1]
    odd += [header[name] for name in ("start", "stop") if type(header[name]) is not int or header[name] < 0]
    if odd or not isinstance(header["population"], str):
        raise ValueError(
            f"its shape, its numbers or its population is odd: {(odd or ['population'])[0]!r:.40}"
        )
    return shape


def _states_of(header: dict[str, Any], names: Sequence[str]) -> list[str]:
    told = names[2:] if is_old(header) else header["states"]
    if not isinstance(told, list) or not all(isinstance(name, str) for name in told):
        raise ValueError(f"its states are {told!r:.80}")
    if len(set(told)) < len(told) or not set(told) <= set(names):
        raise ValueError(f"it lacks the states {told!r:.80}, or has some twice")
    return told


def _periods_of(header: dict[str, Any]) -> np.ndarray | None:
    """(n, E) seconds from a row to the next; None where nobody told them."""
    if header.get("periods") is None:
        return None
    periods = np.array(header["periods"])
    if periods.dtype.kind not in "fiu" or periods.shape != tuple(header["shape"][:2]):
        raise ValueError(
            f"periods of shape {periods.shape} for {header['shape'][:2]} episodes, or no numbers"
        )
    if not (np.isfinite(periods).all() and (periods > 0).all()):
        raise ValueError("a period that is not a finite number above 0")
    return periods.astype(np.float64)


def _check_groups(header: dict[str, Any], stream: pq.ParquetFile) -> None:
    """Row groups are of whole entries; their number is compared first, before any list is made."""
    n, episodes, steps, _ = header["shape"]
    per, held = together(header), stream.num_row_groups
    if held != -(-n // per):
        raise ValueError(f"it has {held} row groups for {n} entries")
    rows = [stream.metadata.row_group(i).num_rows for i in range(held)]
    if rows != [episodes * steps * min(per, n - at) for at in range(0, n, per)]:
        raise ValueError(f"its {held} row groups have {sorted(set(rows))!r:.80} rows")
