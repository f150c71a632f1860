"""The Python door to a registry: `dynreg.open(path)` and what can be asked of it."""

import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynreg.folder import expanded
from dynreg.progress import Progress
from dynreg.verbs.arguments import every_method, fitting
from dynreg.verbs.calibrate import CalibrateSettings, calibrate, require_door
from dynreg.verbs.compare import CompareSettings, compare
from dynreg.verbs.diagnose import DiagnoseSettings, diagnose, faster
from dynreg.verbs.drift import DriftSettings, drift
from dynreg.verbs.excite import ExciteSettings, excite, excite_legs
from dynreg.verbs.gait import GaitSettings, gait
from dynreg.verbs.gait_rounds import GaitRoundsSettings, gait_rounds
from dynreg.verbs.navigate import navigate
from dynreg.verbs.navigate_settings import NavigateSettings
from dynreg.verbs.populate import PopulateSettings, populate
from dynreg.verbs.query import QuerySettings, query
from dynreg.verbs.settings import taking
from dynreg.verbs.trial import TrialSettings, trial
from dynreg.verbs.verb import Verb, about_recording, about_robot, of_verb

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from dynreg.adapt.tried import Rules
    from dynreg.data.recording import Recording
    from dynreg.datasets.dataset import Dataset
    from dynreg.distance.population import Training
    from dynreg.methods.scored import Player
    from dynreg.models.dynamics import DynamicsModel
    from dynreg.registry import Registry
    from dynreg.results.calibration import Calibration
    from dynreg.results.changes import Changes
    from dynreg.results.drift import Drift
    from dynreg.results.effects import EffectsList
    from dynreg.results.experiment import Experiment
    from dynreg.results.gait import Gait
    from dynreg.results.gait_rounds import GaitRounds
    from dynreg.results.navigation import Navigation
    from dynreg.results.protocol import LegProtocol
    from dynreg.results.ranges import RangesFile
    from dynreg.results.result import Result
    from dynreg.results.robots import RobotFolder
    from dynreg.results.stored import (
        Collection,
        DatasetExport,
        EntrySummary,
        Import,
        Info,
        Listing,
        PopulationSummary,
        RecordingSummary,
        Removal,
        Verification,
    )
    from dynreg.sim.live import LiveSimulator
    from dynreg.sim.real import RealRobot
    from dynreg.sim.robot import Robot
    from dynreg.watch.frames import Frames

DEFAULT = "dynreg-registry"

_CALIBRATE = Verb(calibrate, CalibrateSettings, "recording", several=True, keeps=True)


def place(path: str | Path | None) -> Path:
    """Where the registry is: `path`, else DYNREG_REGISTRY, else ./dynreg-registry, with `~` for a home.

    Raises UsageError for the address of a server, and for "".
    """
    from dynreg.errors import UsageError

    if path is not None and not str(path):
        raise UsageError("registry ''", expected="a folder", do=f"name one, or leave it out for {DEFAULT!r}")
    told = path or os.environ.get("DYNREG_REGISTRY") or DEFAULT
    if re.match(r"[a-z][a-z0-9+]+:/", str(told)):  # a path has lost one of the two strokes
        raise UsageError(
            f"registry {str(told)!r}",
            expected="a folder on this machine",
            do="join a shared registry by `dynreg init --registry FOLDER --catalog URL --blobs URI`, and name FOLDER",
        )
    return expanded(told)


@fitting
def open(path: str | Path | None = None, *, create: bool = True) -> "Session":
    """Open the registry at `path`, by default that of `place`; make it where it is new.

    Raises RegistryError where there is none (with create=False) or the place cannot be used.
    """
    from dynreg.registry import Registry

    return Session(Registry.open(place(path), create=create))


@fitting
def share(path: str | Path | None = None, *, catalog: str, blobs: str, rebuild: bool = False) -> "Session":
    """Open the shared registry at these addresses, with its local folder at `path` (by default that of `open`).

    catalog : URL of a PostgreSQL database, without a password. blobs : address of a bucket and a prefix in it, without
    a key. What is missing of folder and registry is made. Later, `open(path)` opens it. rebuild : write the bucket's
    catalogue, which is lost, anew into this database, which is empty; a warning says what did not come back.

    Raises UsageError for odd addresses, RegistryError where they cannot be reached or `path` is something else.
    """
    from dynreg.registry import Registry
    from dynreg.verbs.verify import rebuilt

    where = place(path)
    if rebuild:
        rebuilt(where, catalog, blobs)
    return Session(Registry.share(where, catalog, blobs))


def rows() -> dict[str, Verb]:
    """{name: row} of the verbs that a session asks in the ordinary way."""
    return {name: method.verb for name, method in vars(Session).items() if hasattr(method, "verb")}


@every_method
class Session:
    """An open registry; `with dynreg.open(path) as reg: ...`. A block that fails leaves no new, empty one behind.

    Methods return frozen results (`dynreg.results`), which notebooks show as tables and `.to_frame()` turns
    into DataFrames. `progress` is called with (stage, done, total).
    """

    def __init__(self, registry: "Registry"):
        self.registry = registry

    @property
    def path(self) -> Path:
        """The registry's directory."""
        return self.registry.path

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if kind is None:
            self.close()
        else:
            self.registry.take_away()

    def __repr__(self) -> str:
        return f"dynreg.open({str(self.path)!r})"

    def close(self) -> None:
        """Let go of the catalogue."""
        self.registry.close()

    @taking(PopulateSettings)
    def populate(
        self,
        robot: "str | Path | Robot",
        n: int,
        *,
        training: "Training | None" = None,
        progress: Progress | None = None,
        **told: Any,
    ) -> "PopulationSummary":
        """Simulate, train, register and link n randomized simulators of a robot; see `verbs.populate`."""
        from dynreg.verbs.subjects import loaded_robot

        settings = PopulateSettings(**told)
        loaded = loaded_robot(robot, registry=self.registry)
        return populate(self.registry, loaded, n, settings, training=training, progress=progress)

    def ingest(
        self,
        logs: "str | Path | Sequence[str | Path] | Recording",
        robot: "str | Path | Robot",
        *,
        log_map: str | Path | None = None,
        name: str | None = None,
        gait: str | None = None,
        progress: Progress | None = None,
    ) -> "RecordingSummary":
        """Read logs of a robot, check them and register them as one recording.

        log_map : a map file; without one the log's own names are tried, then the robot's packaged maps.
        gait : a stored gait that was played, by id or `@last`; its id goes into the recording's provenance.
        Raises LogError, MapError with what is wrong and where; nothing is registered then.
        """
        from dynreg.verbs.ingest import ingest
        from dynreg.verbs.subjects import loaded_robot

        loaded = loaded_robot(robot, registry=self.registry)
        return ingest(self.registry, logs, loaded, log_map=log_map, name=name, gait=gait, progress=progress)

    query = about_recording(query, QuerySettings, ingest=True)

    @of_verb(_CALIBRATE)
    def calibrate(
        self,
        recording: "str | Path | Robot | RecordingSummary | Sequence[str | Path | RecordingSummary]",
        *,
        robot: "str | Path | Robot | None" = None,
        log_map: str | Path | None = None,
        robot_door: "str | Path | RealRobot | Player | None" = None,
        gait: "str | Path | Mapping[str, float] | None" = None,
        rules: "Rules | None" = None,
        say: Callable[[str], None] = print,
        progress: Progress | None = None,
        **told: Any,
    ) -> "Calibration":
        """Adapt a simulator to a recording by one of many methods; see `verbs.calibrate`. The result is stored.

        recording : one or several, by id, name or `@last`, or logs of `robot`. For `btr` a robot in their place.

        Of `btr`: robot_door is the robot itself. A `RealRobot`; a function that is called with commands (T, A), how
        many a second and the trial's name, plays them and returns the log, the score or None for a fall; or a folder
        (see `ScoredFolder`). gait is what it begins with: a stored gait or {gene: value}; by default the gaits of
        the robot's folder. rules are sizes other than the published ones. say tells what to do in the folder.
        """
        settings, tries = CalibrateSettings(**told), {"robot_door": robot_door, "gait": gait, "rules": rules}
        if settings.tries:
            require_door(settings.method, robot_door, robot)
        from dynreg.verbs.calibrate_by_trials import calibrate_by_trials, require_recordings

        if settings.tries:
            tries |= {"log_map": log_map, "say": say}
            return calibrate_by_trials(self.registry, recording, settings, progress, **tries)
        require_recordings(self.registry, recording, settings.method, tries)
        return _CALIBRATE.ask(self.registry, recording, settings, robot, log_map, progress)

    diagnose = about_recording(diagnose, DiagnoseSettings, several=True, faster=faster)

    compare = about_recording(compare, CompareSettings)

    @taking(DriftSettings)
    def drift(
        self,
        recording: "str | Path | RecordingSummary",
        against: "str | Path | RecordingSummary | None" = None,
        *,
        out: str | Path | None = None,
        robot: "str | Path | Robot | None" = None,
        log_map: str | Path | None = None,
        progress: Progress | None = None,
        **told: Any,
    ) -> "Drift | Changes":
        """What changed since an earlier recording of a robot; the result is stored.

        against : the earlier recording; by default the one of this robot that was ingested first. out : a Parquet file
        for the updated displacement table, a row for each sample, with which of them still count.
        """
        from dynreg.verbs.subjects import every_recorded

        settings = DriftSettings(**told)
        named = [recording] if against is None else [recording, against]
        recent, *earlier = every_recorded(self.registry, named, robot, log_map, ingest=False)
        return drift(recent, earlier[0] if earlier else None, settings, out=out, progress=progress)

    navigate = about_recording(navigate, NavigateSettings)

    gait = about_recording(gait, GaitSettings, ingest=True)

    @taking(GaitRoundsSettings)
    def gait_rounds(
        self,
        recording: "str | Path | RecordingSummary",
        real: "str | Path | RealRobot | Callable[[np.ndarray, float, str], Recording]",
        *,
        robot: "str | Path | Robot | None" = None,
        log_map: str | Path | None = None,
        say: Callable[[str], None] = print,
        progress: Progress | None = None,
        **told: Any,
    ) -> "GaitRounds":
        """Try gaits on the robot in turn, each sought by the log of the trial before; see `verbs.gait_rounds`.

        real : the robot. A `RealRobot`; a function that is called with commands (T, A), how many a second and the
        trial's name, plays them and returns the log (see `read_log`); or a folder, to which the commands are written
        and in which the log is waited for, read with `log_map` (see `TrialFolder`).
        say : tells what to do there, and how the trials go.
        Raises as `verbs.gait_rounds` and the robot do; what is wrong with the arguments, before anything moves.
        """
        from dynreg.data.maps import read_map
        from dynreg.errors import UsageError
        from dynreg.gait.logged import LoggedRobot
        from dynreg.sim.real import RealRobot
        from dynreg.verbs.gait_rounds import require_query
        from dynreg.verbs.subjects import recorded, require_log
        from dynreg.verbs.trial_folder import TrialFolder, folder_of

        settings = GaitRoundsSettings(**told)
        require_query(settings.on)
        self.registry.check_writable()
        if not isinstance(real, str | Path | RealRobot) and not callable(real):
            raise UsageError(
                f"a robot of type {type(real).__name__!r}",
                expected="a folder, a function that plays commands and returns the log, or a RealRobot",
                do="give one of them",
            )
        if log_map is not None and not isinstance(real, str | Path):
            require_log(self.registry, [recording], robot, log_map)
        asked = recorded(self.registry, recording, robot, log_map, ingest=True)
        kept = {}
        if isinstance(real, str | Path):
            given = None if log_map is None else read_map(log_map)
            folder = TrialFolder(folder_of(real), self.registry, asked.robot, given, say)
            kept, real = {"kept": folder.kept}, folder.played
        if not isinstance(real, RealRobot):
            real = LoggedRobot(asked.robot, real)
        found = gait_rounds(asked, settings, real, progress, say=say, **kept)
        asked.keep(found)
        return found

    trial = about_robot(trial, TrialSettings)

    @staticmethod
    def effects(robot: "str | Path | Robot | None" = None) -> "EffectsList":
        """The library of effects; for a robot with those that it can have."""
        from dynreg.verbs.effects import effects_list
        from dynreg.verbs.subjects import loaded_robot

        return effects_list(None if robot is None else loaded_robot(robot))

    @staticmethod
    @taking(ExciteSettings)
    def excite(
        robot: "str | Path | Robot", between: Sequence[str], *, progress: Progress | None = None, **told: Any
    ) -> "tuple[Recording, Experiment]":
        """Commands within the robot's limits that tell two effects apart, and how well they should.

        between : two effects, such as "payload" and "coulomb_friction[arm]"; the commands are a recording whose
        channels are the robot's actions. Raises UsageError where these are not two different effects.
        """
        from dynreg.verbs.subjects import loaded_robot

        return excite(loaded_robot(robot), ExciteSettings(between, **told), progress=progress)

    @staticmethod
    def excite_legs(
        robot: "str | Path | Robot",
        legs: Sequence[str] = ("all",),
        *,
        folder: str | Path,
        seconds: float | None = None,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> "LegProtocol":
        """Commands with which legs hang free in turn and reverse, and what the operator does, as a new folder.

        legs : of the robot, such as "fl", or all. folder : gets a file of commands for each leg, the robot on its stand
        in `robot/`, and the operator's note. seconds : of each leg, 25 by default. Raises UsageError for a leg that the
        robot has not, and where the folder cannot be written.
        """
        from dynreg.verbs.protocol import write_protocol
        from dynreg.verbs.subjects import loaded_robot
        from dynreg.verbs.written import require_new

        require_new(Path(folder))
        settings = ExciteSettings(legs=legs, seconds=seconds, seed=seed)
        made, protocol = excite_legs(loaded_robot(robot), settings, progress=progress)
        return write_protocol(made, protocol, Path(folder))

    def list(self, kind: str | None = None) -> "Listing":
        """What the registry holds: populations, recordings, simulators made by queries, results."""
        from dynreg.verbs.list import listing

        return listing(self.registry, kind)

    def show(self, ref: str) -> "EntrySummary":
        """One thing in the registry, by id, unique prefix, name or `@last`, the last recording.

        Or a word for a simulator of the newest result, such as `@answer`; see `verbs.simulator`.
        """
        from dynreg.verbs.show import summary
        from dynreg.verbs.simulators import told_last

        return summary(self.registry, *self.registry.resolve(told_last(self.registry, ref)), ref)

    def recording(self, ref: str) -> "Recording":
        """A stored recording by id, unique prefix or name: arrays by episode, and `.to_frame()`."""
        return self.registry.recording(self.registry.resolve(ref, ("recording",))[1])

    def result(self, ref: str = "@last") -> "Result":
        """A stored result: by its id, the newest about a recording (its id or name), or `@last`, the last result."""
        from dynreg.verbs.show import stored_result

        return stored_result(self.registry, ref)

    def populations(self) -> "Listing":
        """The populations: ids, robots, numbers of entries."""
        return self.list("population")

    def population(self, ref: str) -> "pd.DataFrame":
        """A population's entries by number: id, parameters, losses, links; see `verbs.datasets.population_frame`."""
        from dynreg.verbs.datasets import population_frame

        return population_frame(self.registry, ref)

    def dataset(self, refs: str | Sequence[str]) -> "Dataset":
        """The transitions of entries, populations and recordings of one robot, streamed; see `datasets.Dataset`.

        `.to_numpy()`, `.to_arrow()`, `.to_frame()` and `.to_torch()` give them, with names and units in `.columns`.
        """
        from dynreg.verbs.datasets import dataset

        return dataset(self.registry, [refs] if isinstance(refs, str) else refs)

    def model(self, refs: str | Sequence[str]) -> "DynamicsModel":
        """The trained models of entries or of a population: `.predict(states, actions)` in numpy, `.torch()` a module.

        One id gives one model; several ids, or a population's, are predicted with at once. See `models.dynamics`.
        """
        from dynreg.verbs.models import dynamics_model

        return dynamics_model(self.registry, refs)

    def neighbours(self, ref: str, k: int = 5) -> "pd.DataFrame":
        """The k entries nearest to an entry, by a walk over the graph: id, kind, name, cross-loss distance."""
        from dynreg.verbs.models import near_entries

        return near_entries(self.registry, ref, k)

    def distance(self, a: str, b: str) -> float:
        """The cross-loss distance of two entries of one population (paper D); 1 for the same entry."""
        from dynreg.verbs.models import entry_distance

        return entry_distance(self.registry, a, b)

    def remove(self, refs: str | Sequence[str], *, dry_run: bool = False) -> "Removal":
        """Remove things by id, prefix or name, with what cannot be used without them; see `verbs.remove`.

        dry_run : say what would go, and change nothing.
        """
        from dynreg.verbs.remove import remove

        return remove(self.registry, [refs] if isinstance(refs, str) else refs, dry_run)

    def collect(self, *, caches: bool = False, dry_run: bool = False) -> "Collection":
        """Remove files that the registry need not keep; caches : all that can be computed again, too."""
        from dynreg.verbs.remove import collect

        return collect(self.registry, caches=caches, dry_run=dry_run)

    def verify(self, repair: bool = False) -> "Verification":
        """Check every hash, row and index of the registry; with `repair`, mend what can be mended."""
        from dynreg.verbs.verify import verification

        return verification(self.registry.path, repair)

    def export(self, refs: str | Sequence[str], destination: str | Path) -> "Listing":
        """Copy entries, populations, recordings or results, with all they need, to a new registry."""
        from dynreg.registry import Registry, export
        from dynreg.verbs.list import listing
        from dynreg.verbs.simulators import told_last

        named = [refs] if isinstance(refs, str) else refs
        export(self.registry, [told_last(self.registry, ref) for ref in named], destination)
        with Registry.open(destination) as copy:
            return listing(copy, None)

    def import_registry(self, source: str | Path, *, progress: Progress | None = None) -> "Import":
        """Take everything that another registry holds into this one, by content; ids stay as they are.

        What is here already stays as it is, and so does the other registry. What is left out is told, and how many
        things were left out because they are `damaged`. Raises RegistryError where there is no registry at `source`,
        or this one may not be written.
        """
        from dynreg.verbs.import_registry import import_registry

        return import_registry(self.registry, Path(source), progress)

    def export_dataset(
        self, refs: str | Sequence[str], destination: str | Path, form: str, licence: str | None = None
    ) -> "DatasetExport":
        """Write entries, populations and recordings of one robot in another project's format, with a dataset card.

        form : parquet, csv, mcap, lerobot, minari or safetensors (the trained models); see `datasets.formats`.
        licence : what the card states, such as "apache-2.0".
        Raises UsageError for things that the form cannot hold or a name that is taken, NoMatchError for a ref that fits
        nothing; nothing is left behind then.
        """
        from dynreg.verbs.export_dataset import export_dataset

        named = [refs] if isinstance(refs, str) else refs
        return export_dataset(self.registry, named, Path(destination), form, licence)

    def export_robot(self, ref: str, destination: str | Path) -> "RobotFolder":
        """Write a simulator or an entry, by id, prefix or name, as a new robot folder; see `verbs.export_robot`."""
        from dynreg.verbs.export_robot import export_simulator

        return export_simulator(self.registry, ref, Path(destination))

    def export_ranges(self, ref: str, destination: str | Path) -> "RangesFile":
        """Write the posterior of a query or a diagnosis to a new file, for training; see `verbs.export_ranges`."""
        from dynreg.verbs.export_ranges import export_ranges

        return export_ranges(self.registry, ref, Path(destination))

    def export_gait(self, ref: "str | Path | Gait", destination: str | Path, form: str = "csv") -> "Gait":
        """Write a gait, itself or its id, `@last` or the path of its JSON, to a new file; see `verbs.export_gait`."""
        from dynreg.verbs.export_gait import export_gait

        return export_gait(self.registry, ref, Path(destination), form)

    def export_plan(self, ref: str, destination: str | Path) -> "Navigation":
        """Write the commands of a stored plan, by its id, to a new CSV file; see `verbs.export_plan`."""
        from dynreg.verbs.export_plan import export_plan

        return export_plan(self.registry, ref, Path(destination))

    def export_run(
        self, ref: str, destination: str | Path, form: str = "rerun", simulator: str | None = None
    ) -> None:
        """Write a recording beside a simulator under the same commands to a new file, for Rerun or Foxglove.

        ref : a recording, or a result about one (its recording and what it recommends), by id, prefix, name or
        `@last`. form : "rerun" (.rrd; needs rerun-sdk) or "foxglove" (MCAP). simulator : nominal, nearest, @answer,
        diagnosed, ... or an id.
        Raises UsageError for another form or a taken name, NoMatchError where there is no such thing.
        """
        from dynreg.verbs.watched import export_run

        export_run(self.registry, ref, Path(destination), form, simulator)

    def frames(self, ref: str, simulator: str | None = None) -> "Frames":
        """Poses (T, nq) and channels (T,) over time of a recording and of a simulator under the same commands.

        As `export_run` writes them and `dynreg view` shows them; a gait has those of its simulator alone.
        """
        from dynreg.verbs.watched import watched

        return watched(self.registry, ref, simulator)

    def simulator(
        self,
        ref: str,
        robot: "str | Path | Robot | None" = None,
        *,
        settings: Mapping[str, float] | None = None,
        inputs: Mapping[str, float] | None = None,
        period: float | None = None,
        seed: int | None = None,
    ) -> "LiveSimulator":
        """A simulator to step by hand on MuJoCo: an entry or a simulator by id or prefix, or a word such as `@answer`.

        robot : whose it has to be; needed for "nominal". The others : of `sim.live.LiveSimulator`.
        Raises NoMatchError where there is no such simulator, UsageError as `verbs.live`.
        """
        from dynreg.verbs.live import live

        told = dict(settings=settings, inputs=inputs, period=period, seed=seed)
        return live(self.registry, ref, robot, **told)

    def info(self) -> "Info":
        """Versions, optional parts, device, cores, and what the registry holds."""
        from dynreg.verbs.info import information

        return information(self.registry)
