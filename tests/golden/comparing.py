"""Two documents held against each other: strictly on the machine that wrote them, loosely elsewhere.

Strictly, everything is equal and floats agree within `STRICT`, the networks' of a comparison within `NETWORKS`.
Loosely, what is compared are verdicts, causes in their order, names, counts, and floats within `LOOSE`: of their size,
or of the width of the interval that stands beside them, or of the spread of the row that they sum up. Ids, sentences,
costs, searches' histories, rankings and paths, which rounding turns, are left out there.
"""

import math
import platform
import re
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

STRICT = 1e-9
NETWORKS = 1e-4
LOOSE = 0.05
LONG = 8  # lists longer than this are told in brief
WALL_TIME = {"core_seconds", "seconds_median", "simulate_seconds", "train_seconds", "link_seconds", "paces"}
PLACES = {"registry", "path"}
LENGTHS = ("dynreg/gait/", "dynreg/experiment/")  # whose seconds are those of a robot
TURNED = {"cost", "history", "ranking", "where", "residual", "stages", "driven", "queries", "gait", "genes"}
ID = re.compile(r"\b[0-9a-f]{8,}\b")


def brief(part: Any) -> Any:
    """A document without times of a clock on the wall, its long lists told by a few numbers each."""
    if isinstance(part, dict):
        drop = WALL_TIME | PLACES | ({"seconds"} if not _lengths(part) else set())
        return {key: brief(value) for key, value in part.items() if key not in drop}
    if not isinstance(part, list | tuple):
        return part
    if len(part) <= LONG:
        return [brief(value) for value in part]
    if all(value is None or isinstance(value, int | float) for value in part):
        return _summed([math.nan if value is None else float(value) for value in part])
    if not all(isinstance(value, dict) for value in part):
        part = [brief(value) for value in part]
    if not all(isinstance(value, dict) for value in part):
        return part
    keys = list(dict.fromkeys(key for value in part for key in value))
    return {"rows": len(part), "columns": brief({k: [v.get(k) for v in part] for k in keys})}


def _lengths(part: dict[str, Any]) -> bool:
    return str(part.get("schema", "")).startswith(LENGTHS)


def _summed(row: list[float]) -> dict[str, Any]:
    """A long row of numbers: how many, how many missing, mean and deviation, and a sum that order changes."""
    known = [value for value in row if math.isfinite(value)]
    mean = math.fsum(known) / max(len(known), 1)
    spread = math.sqrt(math.fsum((value - mean) ** 2 for value in known) / max(len(known), 1))
    turned = math.fsum(v * math.cos(0.7 * i) for i, v in enumerate(row) if math.isfinite(v)) / len(row)
    missing = {"missing": len(row) - len(known)} if len(known) < len(row) else {}
    return {"many": len(row), **missing, "mean": mean, "spread": spread, "turned": turned}


def differences(old: Any, new: Any, *, strict: bool = True, within: float = STRICT) -> list[str]:
    """A line for each value that differs: its place, as it was and as it is. within : of floats, where strict."""
    return list(_differing(old, new, "", within if strict else None, 0.0))


def _differing(old: Any, new: Any, at: str, within: float | None, width: float) -> Iterator[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        width = 0.0 if within is not None else _width(old)
        for key in dict.fromkeys((*old, *new)):
            if within is None and key in TURNED and isinstance(old.get(key), list | dict):
                if not _holds_documents(old[key]):
                    continue
            place = f"{at}.{key}" if at else str(key)
            if key not in old or key not in new:
                yield f"{place}: {_told(old, key)} -> {_told(new, key)}"
            else:
                yield from _differing(old[key], new[key], place, within, width)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield f"{at}: {len(old)} of them -> {len(new)} of them"
        for i, (before, after) in enumerate(zip(old, new, strict=False)):
            yield from _differing(before, after, f"{at}[{i}]", within, width)
    elif not _same(old, new, within, width):
        yield f"{at}: {old!r} -> {new!r}"


def _holds_documents(part: Any) -> bool:
    """Whether results stand in it, such as the queries of a case: these are compared."""
    return "schema" in part or any(isinstance(v, dict) and "schema" in v for v in _values(part))


def _values(part: Any) -> list[Any]:
    return list(part.values()) if isinstance(part, dict) else list(part)


def _told(part: dict[str, Any], key: str) -> str:
    return repr(part[key])[:200] if key in part else "(missing)"


def _width(part: dict[str, Any]) -> float:
    """Of the interval, or the spread of the row, that these numbers belong to."""
    ends = part.get("low"), part.get("high")
    if all(isinstance(end, int | float) for end in ends):
        return abs(ends[1] - ends[0])
    spread, mean = part.get("spread"), part.get("mean")
    return abs(spread) + abs(mean) if isinstance(spread, float) and isinstance(mean, float) else 0.0


def _same(old: Any, new: Any, within: float | None, width: float) -> bool:
    if isinstance(old, bool) or isinstance(new, bool) or old is None or new is None:
        return old is new
    if isinstance(old, float) or isinstance(new, float):
        if not (isinstance(old, int | float) and isinstance(new, int | float)):
            return False
        if math.isnan(old) and math.isnan(new):
            return True
        if within is not None:
            return math.isclose(old, new, rel_tol=within, abs_tol=1e-3 * within)
        return abs(old - new) <= LOOSE * max(abs(old), width) + 1e-9
    if within is None and isinstance(old, str) and isinstance(new, str):
        return " " in old or bool(ID.search(old)) or old == new
    return type(old) is type(new) and old == new


def fingerprint() -> dict[str, str]:
    """What decides how floats round here: the processor, the system, and the libraries that compute."""
    told = {"machine": platform.machine(), "system": platform.platform(), "processor": _processor()}
    told["kernels"] = _kernels()
    told["python"] = platform.python_version()
    libraries = ("numpy", "scipy", "mujoco", "torch", "scikit-learn", "cma", "pyarrow")
    return told | {name: version(name) for name in libraries}


def _kernels() -> str:
    """What the libraries of linear algebra compute with: they choose it by the processor, or are told to."""
    import scipy.linalg  # noqa: F401 -- loads its own library
    import torch
    from threadpoolctl import threadpool_info

    blas = {
        one["architecture"]
        for one in threadpool_info()
        if one["user_api"] == "blas" and "architecture" in one
    }
    return " ".join([*sorted(blas), torch.backends.cpu.get_cpu_capability()])


def _processor() -> str:
    """Its model: processors of one name round otherwise, where the libraries choose other kernels for them."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor()
    told = dict(re.findall(r"^([^\t:]+?)\s*:[ ]?(.*)$", text.partition("\n\n")[0], re.MULTILINE))
    return " ".join(told[name] for name in ("model name", "cpu family", "model") if name in told)
