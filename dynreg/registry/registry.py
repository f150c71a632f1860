"""The store of populations, entries, recordings and results: one directory that can be moved, or a shared one."""

import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import func, select

import dynreg.registry.cache as cache
import dynreg.registry.documents as documents
import dynreg.registry.entries as entries
import dynreg.registry.indexes as indexes
import dynreg.registry.loading as loading
import dynreg.registry.mapped as mapped
import dynreg.registry.measured as measured
import dynreg.registry.populations as populations
import dynreg.registry.recordings as recordings
import dynreg.registry.references as references
import dynreg.registry.robots as robots
import dynreg.registry.tables as tables
import dynreg.registry.versions as versions
from dynreg.data.recording import Recording
from dynreg.errors import CorruptError, Damaged, NotStored, RegistryError
from dynreg.folder import Folder
from dynreg.registry.directory import Directory
from dynreg.registry.files import SEARCHES
from dynreg.registry.hashes import hash_of
from dynreg.registry.infos import RecordingInfo, ResultRecord, RobotInfo
from dynreg.registry.opening import open_directory, take_away
from dynreg.registry.records import (
    EntryRecord,
    MeasuredEntry,
    PopulationArrays,
    PopulationRecord,
    ShardData,
)
from dynreg.registry.renewing import renew
from dynreg.registry.server import waiting
from dynreg.registry.sharing import Shared, share, shared_at


@waiting
class Registry:
    """A registry directory, open; `with Registry.open(path) as registry: ...`.

    Every put writes its files first and then enters them in one catalogue transaction, so a process that
    is killed leaves the registry as it was, or with all of the put. Puts are idempotent by content.
    Several processes may read and write at once. A server that was there before is waited for (`server.persistent`).
    A `ref` is what `resolve` understands.
    """

    def __init__(self, directory: Directory):
        self.directory = directory

    @classmethod
    def open(cls, path: Path | str, create: bool = False) -> "Registry":
        """Open the registry at `path`, or make a new one there with `create`.

        Older registries are brought up to date. Of a directory without write access everything can be read and asked;
        what is put there lasts until it is closed (`read_only`).

        Raises
        ------
        RegistryError : no registry there, one of a newer version, or a place that cannot be used.
        CorruptError : the catalogue is lost or damaged.
        """
        directory = open_directory(Path(path), create)
        renew(directory)
        return cls(directory)

    @classmethod
    def share(cls, path: Path | str, catalog: str, blobs: str) -> "Registry":
        """Open the registry at these addresses with its local folder at `path`, which is made; see `sharing.share`."""
        share(Path(path), Shared(catalog, blobs))
        return cls.open(path)

    def __enter__(self) -> "Registry":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the catalogue."""
        self.directory.close()

    def take_away(self) -> None:
        """Close, and remove what this opening made where nothing has come of it; see `directory.take_away`."""
        take_away(self.directory)

    @property
    def path(self) -> Path:
        """The registry's directory."""
        return self.directory.path

    @property
    def addresses(self) -> dict[str, str]:
        """Where the `catalog` and the `blobs` of a shared registry lie; empty of one in its own folder."""
        shared = shared_at(self.path)
        return {} if shared is None else vars(shared)

    @property
    def read_only(self) -> bool:
        """Whether the directory may only be read: what is put is gone when it is closed."""
        return self.directory.read_only

    def check_writable(self) -> None:
        """RegistryError where the registry may only be read: for what is asked for the sake of being stored."""
        if self.read_only:
            raise RegistryError(
                f"the registry {str(self.path)!r} is read-only",
                expected="a directory that may be written",
                do="copy it to a place of your own, or mend its permissions",
            )

    def resolve(self, ref: str, kinds: Collection[str] = references.KINDS) -> tuple[str, str]:
        """(kind, id) of a hash, a unique prefix of one, a name or `@last`; else NoMatchError."""
        with self.directory.catalog.read() as connection:
            return references.resolve(connection, ref, kinds)

    def _id(self, ref: str, kind: str) -> str:
        return self.resolve(ref, (kind,))[1]

    def put_robot(self, folder: Folder | Path, hash: str, name: str, version: int | None = None) -> None:
        """Copy a robot folder; see `robots.put_robot`."""
        robots.put_robot(self.directory, folder, hash, name, version)

    def robot_folder(self, ref: str) -> Path:
        """The registry's own copy of a robot folder; CorruptError when files of it are missing."""
        return robots.robot_folder(self.directory, self._id(ref, "robot"))

    def robots(self) -> dict[str, str]:
        """Names of the robots by their hashes."""
        return {info.hash: info.name for info in self.robot_versions()}

    def robot_versions(self, name: str | None = None) -> tuple[RobotInfo, ...]:
        """All robots, or those of one name, by name and version."""
        with self.directory.catalog.read() as connection:
            return tuple(info for info in versions.numbered(connection) if name in (None, info.name))

    def robot_info(self, ref: str) -> RobotInfo:
        """Hash, name and version of one robot."""
        identity = self._id(ref, "robot")
        return next(info for info in self.robot_versions() if info.hash == identity)

    def put_population(self, record: PopulationRecord) -> None:
        """Register a population or let it grow; RegistryError when its id holds something else."""
        populations.put_population(self.directory, record)

    def population(self, ref: str) -> PopulationRecord:
        """A population's record with its arrays."""
        return populations.get_population(self.directory, self._id(ref, "population"))

    def populations(self) -> tuple[PopulationRecord, ...]:
        """All populations whose files are sound, by name and id; of others a warning tells (`Damaged`)."""
        table = tables.populations
        with self.directory.catalog.read() as connection:
            ids = connection.execute(select(table.c.id).order_by(table.c.name, table.c.id)).scalars().all()
        found = []
        for identity in ids:
            try:
                found.append(populations.get_population(self.directory, identity))
            except CorruptError as error:
                warnings.warn(f"population {identity[:12]} is passed over: {error.problem}", Damaged, 2)
        return tuple(found)

    def count(self, ref: str) -> int:
        """Entries that a population holds now."""
        table = tables.entries
        query = (
            select(func.count())
            .select_from(table)
            .where(table.c.population_id == self._id(ref, "population"))
        )
        with self.directory.catalog.read() as connection:
            return connection.execute(query).scalar_one()

    def missing_spans(self, ref: str) -> tuple[tuple[int, int], ...]:
        """Entry numbers (first, one past the last) that are left to populate, a shard at most in each."""
        return populations.missing_spans(self.directory, self._id(ref, "population"))

    def claim(self, ref: str, start: int) -> AbstractContextManager[bool]:
        """Take the missing span that begins at `start`; gives False where another has it or has done it."""
        return populations.claim(self.directory, self._id(ref, "population"), start)

    def put_shard(self, ref: str, start: int, data: ShardData) -> tuple[str, ...]:
        """Store the entries from number `start` on and return their ids; see `entries.put_shard`."""
        return entries.put_shard(self.directory, self._id(ref, "population"), start, data)

    def load(
        self, ref: str, columns: Collection[str] = loading.COLUMNS, *, since: int = 0
    ) -> PopulationArrays:
        """The entries of a population, stacked; see `loading.load_population`."""
        return loading.load_population(self.directory, self._id(ref, "population"), columns, since)

    def load_entry(self, ref: str) -> EntryRecord:
        """One entry with its states and weights."""
        return loading.load_entry(self.directory, self._id(ref, "entry"))

    def parts(self, ref: str, entries: Collection[str] | None = None) -> tuple[loading.ShardPart, ...]:
        """Where the rows of a population's entries are, or of those with these ids; see `loading.shard_parts`."""
        return loading.shard_parts(self.directory, self._id(ref, "population"), entries)

    def weights(self, ref: str, entries: Collection[str]) -> Iterator[dict[str, np.ndarray]]:
        """The models of a population's entries with these ids, a shard at a time; see `loading.load_weights`."""
        return loading.load_weights(self.directory, self._id(ref, "population"), entries)

    def numbers(self, ref: str) -> dict[str, int]:
        """{id of an entry: its number} of a population, by number; no shard is read."""
        return loading.entry_numbers(self.directory, self._id(ref, "population"))

    def models(
        self, ref: str, numbers: Collection[int], digests: np.ndarray | None = None
    ) -> mapped.MappedModels:
        """The models of a population's entries, read when they are asked for; see `mapped.MappedModels`."""
        rows = np.array([*numbers], dtype=np.int64)
        return mapped.MappedModels(self.directory, self._id(ref, "population"), rows, digests)

    def entry(self, ref: str) -> tuple[str, int]:
        """The id of an entry's population, and its number in it; the entry is not read."""
        return loading.entry_place(self.directory, self._id(ref, "entry"))

    def put_recording(self, recording: Recording, robot_hash: str, name: str | None = None) -> str:
        """Store a recording, which becomes `@last`; RegistryError when the name stands for other log files."""
        return recordings.put_recording(self.directory, recording, robot_hash, name)

    def recording(self, ref: str) -> Recording:
        """A stored recording."""
        return recordings.get_recording(self.directory, self._id(ref, "recording"))

    def recording_path(self, ref: str) -> Path:
        """Where a stored recording lies, after its bytes were compared with their hash."""
        return recordings.recording_path(self.directory, self._id(ref, "recording"))

    def recordings(self) -> tuple[RecordingInfo, ...]:
        """Ids, robots and names of all recordings, the last ingested at the end."""
        return recordings.list_recordings(self.directory)

    def recording_info(self, ref: str) -> RecordingInfo:
        """Id, robot and names of one recording, which is not read."""
        (info,) = recordings.list_recordings(self.directory, self._id(ref, "recording"))
        return info

    def name_holder(self, name: str) -> str | None:
        """The id of the recording that has this name; None where none has."""
        return recordings.name_holder(self.directory, name)

    def may_be_called(self, recording: Recording, name: str) -> bool:
        """Whether no recording of other log files has this name: one of the same log files may take it over."""
        return recordings.may_be_called(self.directory, recording, name)

    def holds(self, recording_id: str) -> bool:
        """Whether a recording of this id is stored."""
        return bool(recordings.list_recordings(self.directory, recording_id))

    def put_measured(self, entry: MeasuredEntry) -> str:
        """Store the model of a recording as an entry of a population; returns its id. See `measured.put_measured`."""
        return measured.put_measured(self.directory, entry)

    def measured(self, ref: str) -> MeasuredEntry:
        """The model of a recording in a population."""
        return measured.get_measured(self.directory, self._id(ref, "measured"))

    def measured_in(self, ref: str) -> dict[str, str]:
        """{id of a recording: id of its entry} of those that have a model in a population."""
        return measured.measured_in(self.directory, self._id(ref, "population"))

    def put_simulator(self, config: Mapping[str, Any]) -> str:
        """Store a simulator's configuration (plain JSON); returns the hash of its canonical form."""
        return documents.put_simulator(self.directory, dict(config))

    def simulator(self, ref: str) -> dict[str, Any]:
        """A stored configuration."""
        return documents.get_simulator(self.directory, self._id(ref, "simulator"))

    def put_result(self, kind: str, recording_ref: str | None, document: Mapping[str, Any]) -> str:
        """Store a result (plain JSON) about a recording, None for one about no recording, and return its id."""
        if self.read_only:
            warnings.warn(
                f"{str(self.path)!r} is read-only: the result is shown, and not stored", NotStored, 2
            )
        recording_id = self._id(recording_ref, "recording") if recording_ref else ""
        return documents.put_result(self.directory, kind, recording_id, dict(document))

    def result(self, ref: str) -> ResultRecord:
        """A stored result."""
        return documents.get_result(self.directory, self._id(ref, "result"))

    def latest(self, kind: str | None = None, recording_ref: str | None = None) -> ResultRecord:
        """The result stored last, of this kind and about this recording; NoMatchError when there is none."""
        recording_id = self._id(recording_ref, "recording") if recording_ref else None
        return documents.latest_result(self.directory, kind, recording_id)

    def results_about(self, kind: str | None, recording_ref: str | None) -> tuple[str, ...]:
        """Ids of the results of a kind (None for all) about a recording (None for none), that stored last first."""
        recording_id = self._id(recording_ref, "recording") if recording_ref else ""
        return documents.results_about(self.directory, kind, recording_id)

    def put_index(
        self, ref: str, key: str, arrays: Mapping[str, np.ndarray], entries: Sequence[str] | None = None
    ) -> bool:
        """Keep an index's arrays, computed for these entries; see `indexes.put_index`."""
        return indexes.put_index(self.directory, self._id(ref, "population"), key, dict(arrays), entries)

    def index(self, ref: str, key: str, entries: Sequence[str] | None = None) -> dict[str, np.ndarray] | None:
        """An index's arrays; None where there are none for these entries (the population's present ones)."""
        return indexes.get_index(self.directory, self._id(ref, "population"), key, entries)

    def grown_index(
        self, ref: str, key: str, entries: Sequence[str]
    ) -> tuple[int, dict[str, np.ndarray]] | None:
        """An index's arrays for the first of these entries, and how many; see `indexes.get_grown`."""
        return indexes.get_grown(self.directory, self._id(ref, "population"), key, entries)

    def cached(self, kind: str, key: Mapping[str, Any]) -> dict[str, Any] | None:
        """What `cache` kept under this key (plain JSON); None where there is nothing, or nothing that is whole."""
        return cache.get_cached(self.directory, kind, key)

    def cache(self, kind: str, key: Mapping[str, Any], document: Mapping[str, Any]) -> None:
        """Keep what can be computed again; no result, so that no list and no `@last` meets it."""
        cache.put_cached(self.directory, kind, key, document)

    def journal_path(self, name: str) -> Path:
        """Where a search that has not ended keeps its journal; `name` says which search."""
        return self.directory.home / SEARCHES / f"{name}.jsonl"

    def ids(self, kind: str) -> tuple[str, ...]:
        """Ids of all simulators (sorted), or of all results in the order in which they came."""
        table = {"simulator": tables.simulators, "result": tables.results_of_verbs}[kind]
        with self.directory.catalog.read() as connection:
            return tuple(
                connection.execute(select(table.c.id).order_by(table.c.get("ordinal", table.c.id))).scalars()
            )

    def content_hash(self) -> str:
        """Hash over all entries and recordings: equal for two registries that hold the same ones."""
        kinds = {"entry": tables.entries, "recording": tables.recordings}
        with self.directory.catalog.read() as connection:
            found = {kind: connection.execute(select(t.c.id)).scalars().all() for kind, t in kinds.items()}
        return hash_of(sorted(f"{kind} {identity}" for kind, ids in found.items() for identity in ids))
