"""Logs of the pendulum test bench for servos of Rhoban/bam: one JSON object, `entries` one a sample.

Format: https://github.com/Rhoban/bam (file written by its `record.py`).
"""

import numpy as np

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.columns import from_columns
from dynreg.data.readers.numbers import column, doubles, parse_json
from dynreg.data.series import Finding, RawLog
from dynreg.errors import LogError

PWM_FULL = 885.0  # Present PWM register of a Dynamixel at full duty


def read(file: LogFile, options: ReadOptions) -> RawLog:
    """Read one bench run: entries as columns, everything else as metadata.

    The raw `load` register of Dynamixel servos (uint16) is also given as "duty" [1], int16 / 885.
    Raises LogError where the file is not of this form.
    """
    budget = Budget(file.name)
    budget.check("json_bytes", file.size)
    try:
        document = parse_json(file.read().decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise LogError(
            f"{file.name!r} is not JSON: {error}", expected="a bench log", do="copy it again"
        ) from error
    entries = document.get("entries") if isinstance(document, dict) else None
    if not isinstance(entries, list) or not entries or not all(isinstance(e, dict) for e in entries):
        raise LogError(
            f"{file.name!r} has no list of `entries`",
            expected="a bench log of Rhoban/bam",
            do="convert other JSON to CSV, or to MCAP with JSON messages",
        )
    names = dict.fromkeys(name for entry in entries for name in entry)
    budget.check("columns", len(names))
    budget.check("numbers", len(names) * len(entries))
    columns, findings = {}, []
    for name in names:
        cells, odd = column(entry.get(name) for entry in entries)
        if np.isfinite(doubles(cells)).any():
            columns[name] = cells
            text = f"{odd} of {len(cells)} cells hold no number, and are empty"
            findings += [Finding("warning", "left_out", f"{file.name}, {name}", text)] if odd else []
    raw = doubles(columns["load"]) if "load" in columns else np.array([np.nan])
    if np.all(np.isfinite(raw)) and raw.min() >= 0 and raw.max() <= 0xFFFF:
        columns["duty"] = raw.astype(np.uint16).view(np.int16) / PWM_FULL
    metadata = {key: value for key, value in document.items() if key != "entries"}
    return from_columns(file.path, columns, options, metadata=metadata, findings=tuple(findings))
