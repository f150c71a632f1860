"""The card of an exported dataset: what is in it and how to read it, for people and for Hugging Face."""

import json
import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from dynreg.data.recording import SAME_RATE, Channel
from dynreg.data.table import to_table
from dynreg.datasets.export import Export, Simulated
from dynreg.datasets.formats import Format
from dynreg.foreign import visible

_SHORT = re.compile(r"[a-z0-9][a-z0-9.\-]*")  # how Hugging Face names a licence, such as apache-2.0
NO_LICENCE = (
    "No licence is stated. Ask whoever made the robot's model or the recordings before you pass it on."
)


def card(export: Export, form: Format, name: str, size: int) -> str:
    """The card in Markdown, with the YAML head that Hugging Face reads.

    name : of the file or folder. size : its bytes without the card.
    """
    parts = [
        _head(export, form),
        f"# Dynamics of {_text(export.dataset.robot)}\n\n{_what(export)}",
        _models(export, size) if form.models else _counts(export, size),
        *map(_population, export.populations),
        _entries(export, form, name),
        _recordings(export),
        _passed(export) if form.models else _columns(export, form),
        _read(export, form, name),
        f"## Licence\n\n{NO_LICENCE if export.licence is None else _text(export.licence)}",
        _source(export),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _head(export: Export, form: Format) -> str:
    told = {"pretty_name": f"Dynamics of {export.dataset.robot}"}
    if export.licence is not None:
        short = _SHORT.fullmatch(export.licence)
        told |= {"license": export.licence} if short else {"license": "other", "license_name": export.licence}
    lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in told.items()]
    lines += ["task_categories:", "- robotics", "tags:", "- robotics", "- dynamics", "- dynreg"]
    lines += ["- LeRobot"] if form.id == "lerobot" else []
    if form.configs:
        lines.append("configs:")
        for i, (config, files) in enumerate(form.configs):
            lines += [f"- config_name: {config}", f"  data_files: {json.dumps(files)}"]
            lines += ["  default: true"] if i == 0 else []
    return "\n".join(["---", *lines, "---"])


def _what(export: Export) -> str:
    simulated, recorded = sum(len(p.entries) for p in export.populations), export.recordings
    kinds = []
    if simulated:
        kinds.append(
            f"{_count(simulated, 'simulated entry', 'simulated entries')}, each the same robot with other"
        )
        kinds[-1] += " parameters, under the same commands"
    measured = sum(r.measured for r in recorded)
    if measured:
        kinds.append(_count(measured, "real recording", "real recordings"))
    if len(recorded) > measured:
        kinds.append(_count(len(recorded) - measured, "simulated recording", "simulated recordings"))
    return f"It holds {'; and '.join(kinds)}."


def _counts(export: Export, size: int) -> str:
    rates = 1.0 / export.dataset.periods
    rates = rates[np.isfinite(rates)]
    if not len(rates):
        rate = "not told"
    elif export.dataset.uneven:
        rate = "uneven times: each row has its own"
    elif rates.max() <= rates.min() * (1 + SAME_RATE):
        rate = f"{np.median(rates):.6g} Hz"
    else:
        rate = f"{rates.min():.4g} to {rates.max():.4g} Hz: it differs from episode to episode"
    rows = [
        ("entries and recordings", str(export.count)),
        ("episodes", str(export.episodes)),
        ("transitions", str(len(export.dataset))),
        ("rate", rate),
        ("bytes", str(size)),
    ]
    meant = "A transition is counted where everything in it was measured: a row, its command and the row after it."
    return f"## Counts\n\n{_table(('what', 'how many'), rows)}\n\n{meant}"


def _models(export: Export, size: int) -> str:
    c = export.dataset.columns
    inputs = len(c.states) + len(c.actions) + len(c.context)
    rows = [("models", export.models), ("inputs", inputs), ("outputs", len(c.states)), ("bytes", size)]
    return "## Counts\n\n" + _table(("what", "how many"), [(what, str(many)) for what, many in rows])


def _population(told: Simulated) -> str:
    lines = [f"## Population {told.population[:12]}", _excitation(told), "### Parameters"]
    ranges = told.spec.get("ranges", {})
    rows = []
    for i, c in enumerate(told.parameters):
        low, high, scale = (*ranges.get(c.name, (np.nan, np.nan)), "")[:3]
        values = told.values[:, i]
        told_range = f"{low:.6g} to {high:.6g}" if np.isfinite([low, high]).all() else "not told"
        rows.append((c.name, c.unit, told_range, scale, f"{values.min():.6g} to {values.max():.6g}"))
    lines.append("Drawn from these ranges; the last column is what these entries have.")
    lines.append(_table(("parameter", "unit", "range", "scale", "here"), rows))
    return "\n\n".join(lines)


def _excitation(told: Simulated) -> str:
    excitation = told.spec.get("excitation", {})
    kinds = ", ".join(map(str, excitation.get("kinds", ()))) or "not told"
    words = [f"Commands: {kinds}."]
    if "episodes" in excitation and "steps" in excitation:
        words.append(f"{excitation['episodes']} episodes of {excitation['steps']} steps for each entry.")
    words.append(f"Simulated by the engine `{told.engine}` with a time step of {told.timestep:g} s.")
    words.append("The states are those of the simulator, without noise of sensors.")
    return " ".join(words)


def _entries(export: Export, form: Format, name: str) -> str:
    """The table of entries, and what is measured of their models."""
    if not form.entries or not export.populations:
        return ""
    every = export.populations[0].held_out_every
    words = [
        f"`{form.entries.replace('PLACE', name)}` has a row for each entry.",
        *(["Its `id` is the `entry` of the rows."] if "entry" in form.keys else []),
        "A model was trained for each simulated entry.",
        f"One episode in {every} of an entry was held out from this training: "
        f"those with the numbers {every - 1}, {2 * every - 1} and so on, counted from 0.",
        "`own_loss` is the model's mean squared error on the held-out episodes, `train_loss` on the others.",
        "The error is that of the change of the state, "
        "each channel less its mean and divided by its standard deviation.",
    ]
    return "## Entries\n\n" + " ".join(words)


def _recordings(export: Export) -> str:
    if not export.recordings:
        return ""
    rows = [
        (r.id[:12], r.name, "measured" if r.measured else "simulated", ", ".join(r.files) or "made in memory")
        for r in export.recordings
    ]
    return "## Recordings\n\n" + _table(("id", "name", "kind", "log files"), rows)


def _roles(export: Export) -> Iterator[tuple[str, Channel]]:
    """States, actions, inputs and settings, each with what it is."""
    return ((role, c) for role, some in export.dataset.columns.by_role.items() for c in some)


def _passed(export: Export) -> str:
    """What goes into a model, and what comes out."""
    heads, each = ("name", "unit", "role"), list(_roles(export))
    inputs = [(c.name, c.unit or "1", role) for role, c in each]
    outputs = [(c.name, c.unit or "1", "change of the state") for role, c in each if role == "state"]
    words = ["## Inputs", "In this order.", _table(heads, inputs), "## Outputs"]
    words += ["From one command to the next.", _table(heads, outputs)]
    return "\n\n".join(words)


def _columns(export: Export, form: Format) -> str:
    keys = form.alone_keys if export.is_log else form.keys
    logs = form.as_logs(export)
    roles = _logged(export) if logs and export.is_log else _roles(export)
    rows = [(key, "s" if key == "time" else "", "key") for key in keys]
    rows += [(c.name, c.unit or "1", role) for role, c in roles]
    words = ["## Columns", _table(("column", "unit", "role"), rows)]
    if "step" in keys:
        words.append(
            "`entry` is the id of an entry or of a recording. `number` is the entry's in its population; a recording "
            "has none. `episode` is the name or number of an episode in its entry, `step` that of a row in its "
            "episode."
        )
    if export.recordings and logs:
        words.append("A recording has the columns of its log and no others.")
    elif export.recordings:
        words.append("Where a log lacks an input or a setting, its nominal value stands in its rows.")
    return "\n\n".join(words)


def _logged(export: Export) -> Iterator[tuple[str, Channel]]:
    """Likewise of the log of the one recording, as it is written."""
    known = {c.name: (role, c) for role, c in _roles(export)}
    for field in to_table(export.recordings[0].read()).schema:
        told = {key.decode(): value.decode() for key, value in field.metadata.items()}
        if told["role"] != "key":
            yield known.get(field.name, (told["role"], Channel(field.name, told.get("unit", ""))))


def _read(export: Export, form: Format, name: str) -> str:
    notes = "\n".join(f"- {note}" for note in form.notes)
    code = (form.alone if form.alone and export.is_log else form.read).replace("PLACE", name)
    return f"## How to read it\n\n{notes}\n\n`pip install {form.loader}`, then:\n\n```python\n{code}```"


def _source(export: Export) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in export.versions.items())
    rows = [("robot", hash) for hash in export.robots]
    rows += [("population", p.population) for p in export.populations]
    rows += [("recording", r.id) for r in export.recordings]
    return f"## Where it comes from\n\nWritten by {versions}.\n\n" + _table(("what", "id"), rows)


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *([_text(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _text(text: str) -> str:
    """Foreign text in a line or a cell of Markdown."""
    return visible(text).replace("|", "\\|").replace("<", "&lt;").replace("`", "\\`")


def _count(many: int, one: str, several: str) -> str:
    return f"{many} {one if many == 1 else several}"
