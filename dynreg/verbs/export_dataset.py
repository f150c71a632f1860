"""Export of entries, populations and recordings as a dataset in another project's format, with a card."""

from collections.abc import Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from dynreg.data.recording import Channel
from dynreg.datasets.card import card
from dynreg.datasets.export import Export, Measured, Recorded, Simulated
from dynreg.datasets.formats import Format, format_of
from dynreg.datasets.measured import RecordingPart
from dynreg.distance.rows import HELD_OUT_EVERY
from dynreg.errors import UsageError
from dynreg.registry import PopulationRecord, Registry
from dynreg.results.stored import DatasetExport
from dynreg.verbs.datasets import KINDS, dataset
from dynreg.verbs.simulators import told_last
from dynreg.verbs.written import new_file_of, new_folder, require_new, write_out

if TYPE_CHECKING:
    from dynreg.sim.robot import Robot

VERSIONS = ("dynreg", "mujoco", "torch")


def export_dataset(
    registry: Registry, refs: Sequence[str], path: Path, form: str, licence: str | None = None
) -> DatasetExport:
    """Write entries, populations and recordings of one robot to a new file or folder, with a card.

    form : a row of `datasets.formats.FORMATS`. licence : what the card says of it, such as "apache-2.0".
    Raises UsageError for another form, things that it cannot hold or a place that cannot be written, NoMatchError for
    a ref that fits nothing; nothing is left behind then.
    """
    chosen = format_of(form)
    if licence is not None and not licence.strip():
        raise UsageError("an empty licence", expected="its name", do="leave it out where there is none")
    require_new(path)  # before anything is read
    told = contents(registry, refs, licence)
    chosen.check(told)
    with new_file_of(path) if chosen.is_file(told) else new_folder(path) as folder:
        size = _write(told, chosen, folder, path.name)
    return DatasetExport(
        place=str(path),
        form=form,
        robot=told.dataset.robot,
        entries=sum(len(p.entries) for p in told.populations),
        recordings=len(told.recordings),
        episodes=None if chosen.models else told.episodes,
        transitions=None if chosen.models else len(told.dataset),
        models=told.models if chosen.models else None,
        bytes=size,
    )


def _write(told: Export, form: Format, folder: Path, name: str) -> int:
    """Fill a folder; the bytes of its files."""
    folder.mkdir(exist_ok=True)
    form.write(told, folder, name)
    size = _size(folder)
    text = card(told, form, name, size).encode()
    write_out(folder / (f"{name}.md" if form.is_file(told) else "README.md"), text)
    return size + len(text)


def _size(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def contents(registry: Registry, refs: Sequence[str], licence: str | None = None) -> Export:
    """What stands behind refs, with all that a card tells; raises as `dataset`."""
    rows = dataset(registry, refs)
    by_population: dict[str, list[str]] = {}
    recordings = []
    for part in rows.parts:
        if isinstance(part, RecordingPart):
            recordings.append(_recorded(registry, part.identity, refs))
        else:
            by_population.setdefault(part.record.id, []).extend(part.entries)
    populations = tuple(_simulated(registry, p, entries) for p, entries in by_population.items())
    robots = [registry.population(p).robot_hash for p in by_population]
    robots += [part.robot for part in rows.parts if isinstance(part, RecordingPart)]
    named = sorted({registry.resolve(told_last(registry, ref), KINDS) for ref in refs})
    models = tuple(_measured(registry, identity) for kind, identity in named if kind == "measured")
    return Export(
        dataset=rows,
        robots=tuple(dict.fromkeys(robots)),
        populations=populations,
        recordings=tuple(recordings),
        measured=models,
        licence=licence,
        versions={name: version(name) for name in VERSIONS},
    )


def _measured(registry: Registry, identity: str) -> Measured:
    entry = registry.measured(identity)
    record = registry.population(entry.population_id)
    usual = _usual(_robot(registry, record))
    return Measured(identity, record.id, record.columns, usual, entry.own_loss, entry.weights)


def _robot(registry: Registry, record: PopulationRecord) -> "Robot":
    """The robot of a population."""
    from dynreg.sim.robot import load_robot

    return load_robot(registry.robot_folder(record.robot_hash))


def _usual(robot: "Robot") -> np.ndarray:
    """Nominal inputs and settings."""
    return robot.context_defaults


def _simulated(registry: Registry, population: str, entries: Sequence[str]) -> Simulated:
    record, held = registry.population(population), registry.load(population, ())
    at = {identity: i for i, identity in enumerate(held.ids)}
    rows = np.array([at[identity] for identity in entries])
    robot = _robot(registry, record)
    return Simulated(
        population=population,
        spec=record.spec,
        columns=record.columns,
        parameters=tuple(Channel(*told) for told in record.units.items()),
        entries=tuple(entries),
        numbers=held.numbers[rows],
        values=held.values[rows],
        own_loss=held.own_loss[rows],
        train_loss=held.train_loss[rows],
        engine=robot.file.robot.engines[0],
        timestep=robot.file.robot.timestep,
        held_out_every=HELD_OUT_EVERY,
        usual=_usual(robot),
        weights=partial(registry.weights, population, entries),
    )


def _recorded(registry: Registry, identity: str, refs: Sequence[str]) -> Recorded:
    info, recording = registry.recording_info(identity), registry.recording(identity)
    files = [file["name"] for file in recording.provenance.get("files", ()) if isinstance(file, dict)]
    return Recorded(
        id=identity,
        name=next((name for name in info.names if name in refs), info.name),
        measured=recording.measured,
        files=tuple(PurePosixPath(str(name)).name for name in files),
        read=partial(registry.recording, identity),
    )
