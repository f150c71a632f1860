"""The Python door to a registry: `dynreg.open(path)` and what can be asked of it."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynreg import results
from dynreg.registry import Registry
from dynreg.verbs.subjects import loaded_robot, population_for, read_log, recorded

if TYPE_CHECKING:
    from dynreg.data.recording import Recording
    from dynreg.distance.population import Population, Training
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
        """Simulate, train, register and link n randomized simulators of a robot; see `verbs.populate`.

        ranges : one of the robot's [populations]. link : build the graph and the embedding.
        """
        from dynreg.verbs.populate import PopulateSettings, populate

        settings = _settings(PopulateSettings, locals())
        return populate(self.registry, loaded_robot(robot), n, settings, training=training, progress=progress)

    def ingest(
        self,
        logs: "str | Path | Sequence[str | Path] | Recording",
        robot: "str | Path | Robot",
        *,
        log_map: str | Path | None = None,
        name: str | None = None,
        gait: str | None = None,
    ) -> results.RecordingSummary:
        """Read logs of a robot, check them and register them as one recording.

        log_map : a map file; without one the log's own names are tried, then the robot's packaged maps.
        gait : a stored gait that was played, by id or `@last`; its id goes into the recording's provenance.
        Raises LogError, MapError with what is wrong and where; nothing is registered then.
        """
        from dynreg.data.recording import Recording
        from dynreg.verbs.ingest import ingested

        loaded = loaded_robot(robot)
        recording = logs if isinstance(logs, Recording) else read_log(logs, loaded, log_map)
        if gait is not None:
            from dynreg.walks import of_gait

            recording = of_gait(self.registry, recording, gait, loaded)
        return ingested(self.registry, recording, loaded, name)

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
        """The simulators nearest to a recording, re-ranked by replay, and a synthesised one; see `verbs.query`.

        recording : a recording's id, name or `@last`, or the path of a log (then `robot` is needed).
        distance : "auto", or one of `distance.table.DISTANCES`. hold_out : the test part, such as
        "kp=400", episode names or a share; a fifth by default. The result is stored; `fits` is False and `alarm` says
        why where nothing in the family is close.
        """
        from dynreg.verbs.query import QuerySettings, query

        asked = recorded(self.registry, recording, robot, log_map, ingest=True)
        settings = _settings(QuerySettings, locals())
        ready = self._population(population, asked.recording.id, states=settings.states)
        found = query(asked, settings, progress, population=ready)
        self.registry.put_result("neighbours", asked.recording.id, found.to_dict())
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

        asked = recorded(self.registry, recording, robot, log_map, ingest=True)
        result = calibrate(
            self.registry,
            asked.robot,
            asked.recording,
            method=method,
            seed=seed,
            budget=budget,
            hold_out=hold_out,
            threads=threads,
            progress=progress,
        )
        self.registry.put_result("calibration", asked.recording.id, result.to_dict())
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

        joints = None if joints is None else dict.fromkeys(joints)
        settings = _settings(Settings, locals())
        asked = recorded(self.registry, recording, robot, log_map, ingest=False)
        found = diagnose(
            self.registry, asked.robot, asked.recording, settings, name=asked.name, progress=progress
        )
        asked.register()
        self.registry.put_result("diagnosis", asked.recording.id, found.to_dict())
        return found

    def compare(
        self,
        recording: "str | Path | results.RecordingSummary",
        *,
        models: Sequence[str] = ("kinematic", "dynamic", "table", "network", "mlp"),
        simulators: Sequence[str] = (),
        seed: int = 0,
        starts: int = 30,
        generations: int = 60,
        longest: float = 2.0,
        robot: "str | Path | Robot | None" = None,
        log_map: str | Path | None = None,
        threads: int = 0,
        progress: Progress | None = None,
    ) -> results.Comparison:
        """Models and simulators on the last commands of a wheeled robot's recording; see `verbs.compare`.

        simulators : ids of simulators, entries or results that recommend one, or a word of `verbs.simulators.NAMES`.
        The result is stored.
        """
        from dynreg.verbs.compare import CompareSettings, compare

        settings = _settings(CompareSettings, locals())
        asked = recorded(self.registry, recording, robot, log_map, ingest=False)
        found = compare(asked, settings, progress)
        asked.register()
        self.registry.put_result("comparison", asked.recording.id, found.to_dict())
        return found

    def drift(
        self,
        recording: "str | Path | results.RecordingSummary",
        against: "str | Path | results.RecordingSummary | None" = None,
        *,
        sample: float = 0.5,
        cells: int = 20,
        level: float = 0.05,
        welch: bool = False,
        together: bool = True,
        splits: int = 200,
        seed: int = 0,
        out: str | Path | None = None,
        robot: "str | Path | Robot | None" = None,
        log_map: str | Path | None = None,
        progress: Progress | None = None,
    ) -> results.Drift:
        """Whether an earlier recording is still true of a wheeled robot; see `verbs.drift.DriftSettings`.

        The result is stored. against : the earlier recording; by default the one of this robot that was ingested
        first. out : a Parquet file for the updated displacement table, a row for each sample, with which of them still
        count.
        """
        from dynreg.verbs.drift import DriftSettings, drift

        settings = _settings(DriftSettings, locals())
        recent, earlier = (
            None if one is None else recorded(self.registry, one, robot, log_map, ingest=False)
            for one in (recording, against)
        )
        return drift(recent, earlier, settings, out=out, progress=progress)

    def gait(
        self,
        recording: "str | Path | results.RecordingSummary",
        *,
        on: str = "neighbours",
        k: int = 5,
        task: str | None = None,
        method: str = "cma",
        accept: str | None = None,
        rollouts: int = 750,
        patience: int | None = None,
        seed: int = 0,
        resume: bool = False,
        population: str | None = None,
        robot: "str | Path | Robot | None" = None,
        log_map: str | Path | None = None,
        threads: int = 0,
        progress: Progress | None = None,
    ) -> results.Gait:
        """Joint commands that walk in the simulators that stand for the recording's robot; see `walks.walk`.

        on : neighbours, synthesised, diagnosed, nominal, random, population, or ids of simulators. The gait is stored.
        accept : what the search raises, min, mean or quantile; the minimum by default, over a population the mean.
        """
        from dynreg.gait.methods import usual_accept
        from dynreg.gait.seek import AGAIN, SearchSettings
        from dynreg.walks import Asked, WalkSettings, walk

        search = SearchSettings(method, accept or usual_accept(on), rollouts, seed, patience, again=AGAIN)
        settings = WalkSettings(on, k, task, search, resume, threads)
        known = recorded(self.registry, recording, robot, log_map, ingest=True)
        identity = known.recording.id
        asked = Asked(
            self.registry,
            known.robot,
            known.recording,
            known.name,
            lambda: self.query(identity, k=k, population=population, threads=threads, progress=progress),
            lambda: self._population(population, identity, states=False).record.id,
        )
        return walk(asked, settings, progress)

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

        settings = _settings(TrialSettings, locals())
        table = trial(self.registry, loaded_robot(robot), settings, progress=progress)
        self.registry.put_result("trials", None, table.to_dict())
        return table

    @staticmethod
    def effects(robot: "str | Path | Robot | None" = None) -> results.EffectsList:
        """The library of effects; for a robot with those that it can have."""
        from dynreg.verbs.effects import effects_list

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
        from dynreg.verbs.excite import ExciteSettings, excite

        settings = ExciteSettings(tuple(between), seconds, seed)
        return excite(loaded_robot(robot), settings, progress=progress)

    def list(self, kind: str | None = None) -> results.Listing:
        """What the registry holds: populations, recordings, simulators made by queries, results."""
        from dynreg.verbs.list import listing

        return listing(self.registry, kind)

    def show(self, ref: str) -> results.EntrySummary:
        """One thing in the registry, by id, unique prefix, name or `@last`, the last recording."""
        from dynreg.verbs.show import summary

        return summary(self.registry, *self.registry.resolve(ref))

    def recording(self, ref: str) -> "Recording":
        """A stored recording by id, unique prefix or name: arrays by episode, and `.to_frame()`."""
        return self.registry.recording(self.registry.resolve(ref, ("recording",))[1])

    def result(self, ref: str = "@last") -> results.Result:
        """A stored result: by its id, the newest about a recording (its id or name), or `@last`, the last result."""
        from dynreg.verbs.show import stored_result

        return stored_result(self.registry, ref)

    def verify(self, repair: bool = False) -> results.Verification:
        """Check every hash, row and index of the registry; with `repair`, mend what can be mended."""
        from dynreg.verbs.verify import verification

        return verification(self.registry.path, repair)

    def export(self, refs: "Sequence[str]", destination: str | Path) -> results.Listing:
        """Copy entries, populations, recordings or results, with all they need, to a new registry."""
        from dynreg.registry import export
        from dynreg.verbs.list import listing

        export(self.registry, [refs] if isinstance(refs, str) else [str(ref) for ref in refs], destination)
        with Registry.open(destination) as copy:
            return listing(copy, None)

    def export_robot(self, ref: str, destination: str | Path) -> results.RobotFolder:
        """Write a simulator or an entry, by id, unique prefix or name, as a new robot folder; see `extend`.

        Raises UsageError where the destination exists.
        """
        from dynreg.verbs.export_robot import export_simulator

        return export_simulator(self.registry, ref, Path(destination))

    def export_gait(
        self, ref: "str | Path | results.Gait", destination: str | Path, form: str = "csv"
    ) -> results.Gait:
        """Write a gait, itself or its id, `@last` or the path of its JSON, to a new file.

        form : csv, mcap or python for a robot, see `gait.play`; gif or png to look at, see `walks.film`; foxglove, a
        log of the run, for which `ref` may be a recording of the gait's trial, see `side_by_side`.
        """
        from dynreg.gait.play import write
        from dynreg.sim.film import FORMS
        from dynreg.walks import film, gait_of

        if form == "foxglove":
            from dynreg.side_by_side import side_by_side

            return side_by_side(self.registry, ref, Path(destination))
        gait = ref if isinstance(ref, results.Gait) else gait_of(self.registry, ref)
        if form in FORMS:
            film(self.registry, gait, Path(destination), form)
        else:
            write(gait, Path(destination), form)
        return gait

    def info(self) -> dict[str, Any]:
        """Versions, device, threads and what the registry holds."""
        from dynreg.verbs.info import information

        return information(self.registry)

    def _population(self, ref: str | None, recording: str, *, states: bool) -> "Population":
        """The population to ask about a recording; the last one stays loaded."""
        from dynreg.verbs.populations import load_population

        key = population_for(self.registry, recording, ref)
        held = self._populations.get(key)
        if held is None or (states and held.entries.states is None):
            self._populations = {key: load_population(self.registry, key[0], states=states)}
        return self._populations[key]


def _settings(kind: type, given: Mapping[str, Any]) -> Any:
    """Settings of a verb from those of its arguments that they name; sequences as tuples."""
    return kind(**{field.name: _plain(given[field.name]) for field in fields(kind)})


def _plain(value: Any) -> Any:
    return tuple(value) if isinstance(value, Iterable) and not isinstance(value, str) else value
