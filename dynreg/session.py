"""The Python door to a registry: `dynreg.open(path)` and what can be asked of it."""

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynreg import results
from dynreg.errors import DynregError, LogError, MapError, NoMatchError, UsageError
from dynreg.registry import Registry

if TYPE_CHECKING:
    from dynreg.data.maps import LogMap
    from dynreg.data.recording import Recording
    from dynreg.neighbours.population import Population, Training
    from dynreg.sim.robot import Robot

DEFAULT = "dynreg-registry"
Progress = Callable[[str, int, int], None]


def open(path: str | Path | None = None, *, create: bool = True) -> "Session":
    """Open the registry at `path`, else at DYNREG_REGISTRY, else ./dynreg-registry; make it where it is new.

    Raises RegistryError where there is none (with create=False) or the place cannot be used.
    """
    where = Path(path or os.environ.get("DYNREG_REGISTRY") or DEFAULT)
    return Session(Registry.open(where, create=create))


class Session:
    """An open registry; `with dynreg.open(path) as reg: ...`. A block that fails leaves no new, empty one behind.

    Methods return frozen results (`dynreg.results`), which notebooks show as tables and `.to_frame()` turns
    into DataFrames. `progress` is called with (stage, done, total).
    """

    def __init__(self, registry: Registry):
        self.registry = registry
        self._populations: dict[tuple[str, int], Population] = {}

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

    def populate(
        self,
        robot: "str | Path | Robot",
        n: int,
        *,
        seed: int = 0,
        ranges: str | None = None,
        training: "Training | None" = None,
        shard_size: int = 200,
        link: bool = True,
        threads: int = 0,
        progress: Progress | None = None,
    ) -> results.PopulationSummary:
        """Simulate, train, register and link n randomized simulators of a robot; see `neighbours.populate`.

        ranges : one of the robot's [populations]. link : build the graph and the embedding.
        """
        from dynreg.neighbours.link import link as link_entries
        from dynreg.neighbours.populate import populate

        began = time.perf_counter()
        report = progress or (lambda *_: None)
        identity, added, timing = populate(
            self.registry,
            self._robot(robot, ranges),
            n,
            seed=seed,
            training=training,
            shard_size=shard_size,
            threads=threads,
            progress=progress,
        )
        linked, evaluations, linking = 0, 0, time.perf_counter()
        if link:
            report("link", 0, 1)
            held = self.registry.index(identity, "graph") is not None and not added
            if not held:
                linked, evaluations = link_entries(self.registry, identity, threads=threads)
            report("link", 1, 1)
        record = self.registry.population(identity)
        own = self.registry.load(identity, ()).own_loss
        return results.PopulationSummary(
            population=identity,
            robot=record.name,
            entries=len(own),
            planned=record.size,
            added=added,
            seconds=time.perf_counter() - began,
            simulate_seconds=timing.simulate,
            train_seconds=timing.train + timing.base,
            link_seconds=time.perf_counter() - linking,
            own_loss_median=float(np.median(own)) if len(own) else None,
            linked=linked,
            evaluations=evaluations,
        )

    def ingest(
        self,
        logs: "str | Path | Sequence[str | Path] | Recording",
        robot: "str | Path | Robot",
        *,
        log_map: str | Path | None = None,
        name: str | None = None,
    ) -> results.RecordingSummary:
        """Read logs of a robot, check them and register them as one recording.

        log_map : a map file; without one the log's own names are tried, then the robot's packaged maps.
        Raises LogError, MapError with what is wrong and where; nothing is registered then.
        """
        from dynreg.data.recording import Recording

        loaded = self._robot(robot)
        recording = logs if isinstance(logs, Recording) else read_log(logs, loaded, log_map)
        self.registry.put_robot(loaded.folder, loaded.hash, loaded.name)
        identity = self.registry.put_recording(recording, loaded.hash, name)
        return self._recording_summary(identity, recording, loaded.name, name)

    def query(
        self,
        recording: "str | Path | results.RecordingSummary",
        *,
        k: int = 5,
        distance: str = "auto",
        population: str | None = None,
        replay: bool = True,
        synthesise: bool = True,
        hold_out: str | None = None,
        budget: int | None = None,
        robot: "str | Path | Robot | None" = None,
        log_map: str | Path | None = None,
        threads: int = 0,
        progress: Progress | None = None,
    ) -> results.Neighbours:
        """The simulators nearest to a recording, re-ranked by replay, and a synthesised one; see `neighbours.query`.

        recording : a recording's id, name or `@last`, or the path of a log (then `robot` is needed).
        hold_out : the test part, such as "kp=400", episode names or a share; a fifth by default.
        The result is stored; `fits` is False and `alarm` says why where nothing in the family is close.
        """
        from dynreg.neighbours.query import Settings, query

        identity, loaded = self._recording(recording, robot, log_map)
        ready = self._population(
            population, identity, states=distance == "trajectory" or distance.startswith("cross_loss")
        )
        settings = Settings(
            k=k,
            distance=distance,
            replay=replay,
            synthesise=synthesise,
            hold_out=hold_out,
            budget=budget,
            threads=threads,
        )
        found = query(self.registry, ready, loaded, settings, name=self._name(identity), progress=progress)
        self.registry.put_result("neighbours", identity, found.to_dict())
        return found

    def calibrate(
        self,
        recording: "str | Path | results.RecordingSummary",
        *,
        method: str = "cmaes",
        seed: int = 0,
        budget: int = 600,
        hold_out: str | None = None,
        robot: "str | Path | Robot | None" = None,
        log_map: str | Path | None = None,
        threads: int = 0,
        progress: Progress | None = None,
    ) -> results.Calibration:
        """Fit the robot's parameters to a recording by a search over replays; the reference for `query`."""
        from dynreg.adapt.calibrate import calibrate

        identity, loaded = self._recording(recording, robot, log_map)
        result = calibrate(
            self.registry,
            self._robot_of_recording(identity),
            loaded,
            method=method,
            seed=seed,
            budget=budget,
            hold_out=hold_out,
            threads=threads,
            progress=progress,
        )
        self.registry.put_result("calibration", identity, result.to_dict())
        return result

    def diagnose(
        self,
        recording: "str | Path | results.RecordingSummary",
        *,
        start: str = "nominal",
        hold_out: str | None = None,
        effects: Sequence[str] | None = None,
        without: Sequence[str] = (),
        max_causes: int = 3,
        engine: str | None = None,
        seed: int = 0,
        threshold_runs: int = 20,
        tolerance: float = 1.0,
        horizon: float | None = None,
        joints: Sequence[str] | None = None,
        windows: int | None = None,
        robot: "str | Path | Robot | None" = None,
        log_map: str | Path | None = None,
        threads: int = 0,
        progress: Progress | None = None,
    ) -> results.Diagnosis:
        """Which physical causes a simulator of the recording's robot lacks; see `diagnose.settings.Settings`.

        recording : a recording's id, name or `@last`, or the path of a log (then `robot` is needed). The result is
        stored, and the calibrated and the extended simulator are registered.
        """
        from dynreg.diagnose.diagnose import diagnose
        from dynreg.diagnose.settings import Settings

        settings = Settings(
            start=start,
            hold_out=hold_out,
            effects=None if effects is None else tuple(effects),
            without=tuple(without),
            max_causes=max_causes,
            engine=engine,
            seed=seed,
            threshold_runs=threshold_runs,
            tolerance=tolerance,
            horizon=horizon,
            joints=None if joints is None else tuple(dict.fromkeys(joints)),
            windows=windows,
            threads=threads,
        )
        loaded, owner, name = self._unregistered(recording, robot, log_map)
        found = diagnose(self.registry, owner, loaded, settings, name=name, progress=progress)
        if loaded.id not in {info.id for info in self.registry.recordings()}:
            self.registry.put_robot(owner.folder, owner.hash, owner.name)
            self.registry.put_recording(loaded, owner.hash)
        self.registry.put_result("diagnosis", loaded.id, found.to_dict())
        return found

    def trial(
        self,
        robot: "str | Path | Robot",
        *,
        hide: str = "drawn",
        effects: Sequence[str] = (),
        size: str = "medium",
        count: int = 1,
        seed: int = 0,
        seconds: float = 50.0,
        engine: str | None = None,
        threshold_runs: int = 20,
        threads: int = 0,
        progress: Progress | None = None,
    ) -> results.TrialTable:
        """Diagnose simulated robots whose truth is known; see `diagnose.settings.TrialSettings`.

        The table is stored; the robots and their logs are not.
        """
        from dynreg.diagnose.settings import TrialSettings
        from dynreg.diagnose.trial import trial

        settings = TrialSettings(
            hide=hide,
            effects=tuple(effects),
            size=size,
            count=count,
            seed=seed,
            seconds=seconds,
            engine=engine,
            threshold_runs=threshold_runs,
            threads=threads,
        )
        table = trial(self.registry, self._robot(robot), settings, progress=progress)
        self.registry.put_result("trials", None, table.to_dict())
        return table

    @staticmethod
    def effects(robot: "str | Path | Robot | None" = None) -> results.EffectsList:
        """The library of effects; for a robot with those that it can have."""
        from dynreg.library import effects_list

        return effects_list(None if robot is None else loaded_robot(robot))

    @staticmethod
    def excite(
        robot: "str | Path | Robot",
        between: Sequence[str],
        *,
        seconds: float = 10.0,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> "tuple[Recording, results.Experiment]":
        """Commands within the robot's limits that tell two effects apart, and how well they should.

        between : two effects, such as "payload" and "coulomb_friction[arm]"; the commands are a recording whose
        channels are the robot's actions. Raises UsageError where these are not two different effects.
        """
        from dynreg.diagnose.excite import excite

        pair = tuple(between)
        if len(pair) != 2 or pair[0] == pair[1] or not 0 < seconds < float("inf"):
            raise UsageError(
                f"an experiment of {seconds:g} s between {list(pair)}",
                expected="two different effects and a positive length",
                do="name two of those that `dynreg effects` lists",
            )
        return excite(loaded_robot(robot), pair, seconds=seconds, seed=seed, progress=progress)

    def list(self, kind: str | None = None) -> results.Listing:
        """What the registry holds: populations, recordings, simulators made by queries, results."""
        from dynreg.summaries import listing

        return listing(self.registry, kind)

    def show(self, ref: str) -> results.EntrySummary:
        """One thing in the registry, by id, unique prefix, name or `@last`, the last recording."""
        from dynreg.summaries import summary

        return summary(self.registry, *self.registry.resolve(ref))

    def recording(self, ref: str) -> "Recording":
        """A stored recording by id, unique prefix or name: arrays by episode, and `.to_frame()`."""
        return self.registry.recording(self.registry.resolve(ref, ("recording",))[1])

    def result(self, ref: str = "@last") -> results.Result:
        """A stored result: by its id, the newest about a recording (its id or name), or `@last`, the last result."""
        from dynreg.summaries import stored_result

        return stored_result(self.registry, ref)

    def verify(self, repair: bool = False) -> results.Verification:
        """Check every hash, row and index of the registry; with `repair`, mend what can be mended."""
        from dynreg.summaries import verification

        return verification(self.registry.path, repair)

    def export(self, refs: "Sequence[str]", destination: str | Path) -> results.Listing:
        """Copy entries, populations, recordings or results, with all they need, to a new registry."""
        from dynreg.registry import export
        from dynreg.summaries import listing

        export(self.registry, [refs] if isinstance(refs, str) else list_of(refs), destination)
        with Registry.open(destination) as copy:
            return listing(copy, None)

    def export_robot(self, ref: str, destination: str | Path) -> results.RobotFolder:
        """Write a simulator or an entry, by id, unique prefix or name, as a new robot folder; see `diagnose.extend`.

        Raises UsageError where the destination exists.
        """
        from dynreg.diagnose.extend import export_simulator

        return export_simulator(self.registry, ref, Path(destination))

    def info(self) -> dict[str, Any]:
        """Versions, device, threads and what the registry holds."""
        from dynreg.summaries import information

        return information(self.registry)

    def _robot(self, robot: "str | Path | Robot", ranges: str | None = None) -> "Robot":
        return loaded_robot(robot, ranges)

    def _recording(
        self,
        recording: "str | Path | results.RecordingSummary",
        robot: "str | Path | Robot | None",
        log_map: str | Path | None,
    ) -> "tuple[str, Recording]":
        """(id, recording); a path of a log is ingested on the way."""
        identity = self._registered(recording, robot)
        if identity is None:
            identity = self.ingest(recording, robot, log_map=log_map).recording
        return identity, self.registry.recording(identity)

    def _unregistered(
        self,
        recording: "str | Path | results.RecordingSummary",
        robot: "str | Path | Robot | None",
        log_map: str | Path | None,
    ) -> "tuple[Recording, Robot, str]":
        """(recording, its robot, its name); a path of a log is read, and nothing is registered."""
        identity = self._registered(recording, robot)
        if identity is not None:
            return (
                self.registry.recording(identity),
                self._robot_of_recording(identity),
                self._name(identity),
            )
        owner = self._robot(robot)
        loaded = read_log(recording, owner, log_map)
        return loaded, owner, loaded.id[:12]

    def _registered(
        self, recording: "str | Path | results.RecordingSummary", robot: "str | Path | Robot | None"
    ) -> str | None:
        """The id of a registered recording; None for the path of a log of `robot`.

        Raises NoMatchError for what is neither, UsageError for a recording of another robot.
        """
        if isinstance(recording, results.RecordingSummary):
            return recording.recording
        try:
            identity = self.registry.resolve(str(recording), ("recording",))[1]
        except NoMatchError:
            if not Path(recording).exists():
                raise
            if robot is None:
                raise UsageError(
                    f"{str(recording)!r} is a log, and no robot is named",
                    expected="the robot that it was recorded on",
                    do="add --robot ROBOT, or ingest it first",
                ) from None
            return None
        if robot is not None:
            (info,) = [info for info in self.registry.recordings() if info.id == identity]
            owner, asked = self.registry.robots()[info.robot_hash], self._robot(robot).name
            if owner != asked:
                raise UsageError(
                    f"recording {str(recording)!r} is of robot {owner!r}, not of {asked!r}",
                    expected=f"a recording of {asked!r}",
                    do="leave --robot out, or name another recording",
                )
        return identity

    def _robot_of_recording(self, identity: str) -> "Robot":
        from dynreg.sim.robot import load_robot

        (info,) = [info for info in self.registry.recordings() if info.id == identity]
        return load_robot(self.registry.robot_folder(info.robot_hash))

    def _population(self, ref: str | None, recording: str, *, states: bool) -> "Population":
        from dynreg.neighbours.link import load_population

        (info,) = [info for info in self.registry.recordings() if info.id == recording]
        records = self.registry.populations()
        if ref is not None:
            identity = self.registry.resolve(ref, ("population",))[1]
            record = next(r for r in records if r.id == identity)
        else:
            record = self._only_population(info.robot_hash, records)
        if record.robot_hash != info.robot_hash:
            raise UsageError(
                f"the recording is of robot {self.registry.robots()[info.robot_hash]!r}, "
                f"the population of {record.name!r}",
                expected="a population of the same robot folder",
                do="populate that robot, or ingest the log for this one",
            )
        count = self.registry.count(record.id)
        if count == 0:
            raise NoMatchError(
                f"population {record.id[:12]} has no entries yet",
                expected="at least one simulator",
                do=f"run `dynreg populate {record.name} -n {record.size}`",
            )
        key = (record.id, count)
        held = self._populations.get(key)
        if held is None or (states and held.entries.states is None):
            self._populations = {key: load_population(self.registry, record.id, states=states)}
        return self._populations[key]

    def _only_population(self, robot_hash: str, records: Sequence[Any]) -> Any:
        name = self.registry.robots()[robot_hash]
        fitting = [r for r in records if r.robot_hash == robot_hash]
        if not fitting:
            raise NoMatchError(
                f"no simulators of robot {name!r} (folder hash {robot_hash[:12]}) in {str(self.path)!r}",
                expected="a population of the recording's robot",
                do=f"run `dynreg populate {name} -n 1000` first",
            )
        if len(fitting) > 1:
            raise UsageError(
                f"{len(fitting)} populations of robot {name!r}",
                expected=f"one of {[r.id[:12] for r in fitting]}",
                do="name one with --population",
            )
        return fitting[0]

    def _name(self, identity: str) -> str:
        (info,) = [info for info in self.registry.recordings() if info.id == identity]
        return info.names[0] if info.names else identity[:12]

    def _recording_summary(
        self, identity: str, recording: "Recording", robot: str, name: str | None
    ) -> results.RecordingSummary:
        from dynreg.summaries import recording_summary

        return recording_summary(identity, recording, robot, name or self._name(identity))


def loaded_robot(robot: "str | Path | Robot", ranges: str | None = None) -> "Robot":
    """A robot by its packaged name or folder, with one of its [populations] where `ranges` names it."""
    from dynreg.sim.robot import Robot, load_robot, with_population

    if isinstance(robot, Robot):
        return robot if ranges is None else with_population(robot, ranges)
    return load_robot(robot, ranges)


def list_of(refs: Sequence[str]) -> Sequence[str]:
    """The refs as a plain list."""
    return [str(ref) for ref in refs]


def read_log(
    logs: str | Path | Sequence[str | Path], robot: "Robot", log_map: "str | Path | LogMap | None" = None
) -> "Recording":
    """Logs of a robot as one recording, with the map given, else by their own names or a packaged map.

    Raises LogError or MapError.
    """
    from dynreg.data.ingest import read_recording
    from dynreg.data.maps import LogMap, read_map

    spec = robot.recording_spec
    paths = [Path(p) for p in ([logs] if isinstance(logs, str | Path) else logs)]
    if log_map is not None:
        return read_recording(paths, spec, log_map if isinstance(log_map, LogMap) else read_map(log_map))
    try:
        return read_recording(paths, spec, None)
    except DynregError as first:
        for path in sorted((robot.folder / "maps").glob("*.toml")):
            try:
                return read_recording(paths, spec, read_map(path))
            except (LogError, MapError):
                continue
        raise first from None
