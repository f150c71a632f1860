"""The room of what a registry holds and of what was done to it."""

from collections.abc import Sequence
from functools import singledispatch
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.data.names import joint_of, quantity_of
from dynreg.errors import CorruptError, command
from dynreg.report.grid import table, value_text
from dynreg.report.words import count, number
from dynreg.results.result import Result
from dynreg.results.stored import (
    Collection,
    DatasetExport,
    EntrySummary,
    Expected,
    Import,
    Listing,
    PopulationSummary,
    RecordingSummary,
    Removal,
    ReportFile,
    Verification,
)

NAMED = 8  # channels up to which each is named


@singledispatch
def tables(result: Result) -> RenderableType:
    """The tables of a summary, by its kind."""
    raise TypeError(type(result).__name__)


@tables.register
def _population(result: PopulationSummary) -> Group:
    if result.expected is not None:
        return _expected(result, result.expected)
    added = f"{result.added} added in {result.seconds:.1f} s" if result.added else "none added"
    text = (
        f"population {result.population[:12]} of {result.robot}: {result.entries} of {result.planned}"
        f" simulators, {added}"
    )
    spent = [
        ("simulate", result.simulate_seconds),
        ("train", result.train_seconds),
        ("link", result.link_seconds),
    ]
    steps = [table(("step", "time [s]"), spent)] if any(seconds for _, seconds in spent) else []
    return Group(Text(text, style="bold"), *steps)


def _expected(result: PopulationSummary, expected: Expected) -> Group:
    """What a dry run says."""
    total = sum(expected.seconds.values())
    text = (
        f"population {result.population[:12]} of {result.robot}: {result.entries} of {result.planned} simulators are"
        f" there; {expected.missing} more take about {total / 60:.0f} min on"
        f" {count(expected.cores, 'core')} as busy as now"
    )
    size = f"about {expected.disk_bytes / 1e9:.2g} GB"
    where = (
        f"disk: {size} of {expected.free_bytes / 1e9:.0f} GB that are free"
        if expected.bucket is None
        else f"{size} go to {expected.bucket}, with a copy on each machine that makes them"
    )
    sizes = (
        f"{where}; memory: about {expected.memory_bytes / 1e9:.1f} GB."
        f" Told from {expected.made} simulators that were not kept."
    )
    rows = table(("step", "time [s]"), list(expected.seconds.items()))
    return Group(Text(text, style="bold"), rows, Text(sizes))


@tables.register
def _recording(result: RecordingSummary) -> Group:
    kind = "measured" if result.measured else "simulated"
    version = f" (version {result.version})" if (result.version or 1) > 1 else ""
    rate = "uneven times" if result.rate is None else f"{number(result.rate)} Hz"
    text = (
        f"{result.name} ({result.recording[:12]}): {kind} recording of {result.robot}{version},"
        f" {count(result.episodes, 'episode')}, {result.rows_count} rows, {result.duration:.1f} s, {rate}"
    )
    lines = [f"channels: {channel_words(result.channels)}"]
    lines += [f"settings: {', '.join(result.settings)}"] if result.settings else []
    return Group(
        Text(text, style="bold"),
        *map(Text, lines),
        *(Text(f"- {f}") for f in (*result.notes, *result.findings)),
    )


def channel_words(names: Sequence[str]) -> str:
    """The names of channels; of many only how many joints have which quantities.

    >>> channel_words([f"{part}/{what}" for what in ("position", "target") for part in "abcde"] + ["supply"])
    '5 joints: position, target; supply'
    """
    if len(names) <= NAMED:
        return ", ".join(names)
    owned: dict[str, list[str]] = {}
    for name in names:
        owned.setdefault(joint_of(name), []).append(quantity_of(name))
    alike: dict[str, list[str]] = {}
    for owner, quantities in owned.items():
        alike.setdefault(", ".join(quantities), []).append(owner)
    plain = alike.pop("", [])
    groups = [
        f"{owners[0] if len(owners) == 1 else count(len(owners), 'joint')}: {quantities}"
        for quantities, owners in alike.items()
    ]
    return "; ".join((*groups, *plain))


@tables.register
def _listing(result: Listing) -> RenderableType:
    if not result.items:
        return Text(f"{result.registry}: nothing yet")
    rows = [(i.id[:12], i.kind, i.name or "-", i.robot, _short(i.detail)) for i in result.items]
    return table(("id", "kind", "name", "robot", "detail"), rows, result.registry)


@tables.register
def _entry(result: EntrySummary) -> RenderableType:
    head = {"id": result.id, "kind": result.kind, "name": result.name, "robot": result.robot}
    told = {"schema", "robot_name", result.kind, *head}  # a detail may say again what the head says
    rows = [(key, value) for key, value in head.items() if value]
    for key, value in result.detail.items():
        if key in told or value in (None, "", [], {}):
            continue
        if isinstance(value, dict):
            rows.append((key, ""))
            rows += [(f"  {name}", value_text(part)) for name, part in value.items()]
        else:
            rows.append((key, value_text(value)))
    return table(("", ""), rows)


@tables.register
def _verification(result: Verification) -> Group:
    counts = ", ".join(f"{what} {how_many}" for what, how_many in result.checked.items())
    state = "sound" if result.clean else count(len(result.faults), "fault")
    lines = [f"{'lost' if fault in result.lost else '-'}: {fault}" for fault in result.faults]
    return Group(Text(f"{result.registry}: {state} ({counts})", style="bold"), *map(Text, lines))


@tables.register
def _import(result: Import) -> Group:
    rows = [(kind, result.added[kind], result.known[kind]) for kind in result.added]
    shown = table(
        ("kind", "new", "here before"), rows, f"import of {result.source!r} into {result.registry!r}"
    )
    return Group(shown, *(Text(f"left out: {one}") for one in result.left_out))


def refusal(result: Result) -> CorruptError | None:
    """The error of an import that had to leave out what is damaged."""
    if not isinstance(result, Import) or not result.damaged:
        return None
    mend = command("verify", "--repair", "--registry", result.source)
    return CorruptError(
        f"{count(result.damaged, 'thing')} left out, as {result.source!r} is damaged",
        expected="a sound registry; everything else was taken",
        do=f"export again from a sound registry, or run `{mend}`, and import again",
    )


@tables.register
def _removal(result: Removal) -> Group:
    rows = [
        (i.id[:12], i.kind, i.name or "-", i.robot, i.detail.get("needs", "asked for")) for i in result.items
    ]
    done = "removed" if result.removed else "would be removed"
    head = Text(f"{count(len(result.items), 'thing')} {done}, {_size(result.bytes)}", style="bold")
    shown = table(("id", "kind", "name", "robot", "because it needs"), rows, result.registry)
    return Group(head, shown, *map(Text, result.moved))


@tables.register
def _collection(result: Collection) -> Group:
    done = "removed" if result.removed else "would be removed"
    head = Text(f"{count(len(result.files), 'file')} {done}, {_size(result.bytes)}", style="bold")
    by_reason: dict[str, list[int]] = {}
    for file in result.files:
        by_reason.setdefault(file.why, []).append(file.bytes)
    rows = [(why, len(sizes), _size(sum(sizes))) for why, sizes in sorted(by_reason.items())]
    return Group(head, *([table(("why", "files", "size"), rows, result.registry)] if rows else []))


def _size(many: int) -> str:
    """Bytes in the unit that fits.

    >>> _size(512), _size(3_500_000)
    ('512 bytes', '3.5 MB')
    """
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if many >= size:
            return f"{many / size:.3g} {unit}"
    return f"{many} bytes"


@tables.register
def _dataset(result: DatasetExport) -> Text:
    what = [
        count(many, one)
        for many, one in ((result.entries, "simulator"), (result.recordings, "recording"))
        if many
    ]
    holds = {"episode": result.episodes, "complete transition": result.transitions, "model": result.models}
    held = ", ".join(count(many, one) for one, many in holds.items() if many is not None)
    return Text(
        f"{result.place}: {' and '.join(what)} of {result.robot} as {result.form}, {held}, {_size(result.bytes)}",
        style="bold",
    )


@tables.register
def _report(result: ReportFile) -> str:
    return f"{result.path}: {result.bytes / 1024:.0f} KiB"


def _short(detail: dict[str, Any]) -> str:
    return ", ".join(
        f"{k} {value_text(v)}" for k, v in detail.items() if not isinstance(v, dict | list | tuple)
    )
