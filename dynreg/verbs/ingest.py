"""Logs of a robot as a registered recording."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dynreg.data.recording import Recording
from dynreg.registry import Registry
from dynreg.results.stored import RecordingSummary
from dynreg.sim.robot import Robot
from dynreg.verbs.subjects import read_log, register


def ingest(
    registry: Registry,
    logs: str | Path | Sequence[str | Path] | Recording,
    robot: Robot,
    *,
    log_map: str | Path | None = None,
    name: str | None = None,
    gait: str | None = None,
) -> RecordingSummary:
    """Read logs of a robot, check them and register them as one recording, under a name where one is given.

    log_map : as for `subjects.read_log`. gait : the stored gait that was played, by id or `@last`; its id goes into the
    recording's provenance.
    Raises LogError, MapError with what is wrong and where, NoMatchError and UsageError for a gait that is not there or
    another robot's; nothing is registered then.
    """
    registry.check_writable()
    recording = logs if isinstance(logs, Recording) else read_log(logs, robot, log_map)
    if gait is not None:
        from dynreg.verbs.gaits import trial_of

        recording = trial_of(registry, recording, gait, robot)
    identity = register(registry, robot, recording, name)
    return recording_summary(identity, recording, robot.name, name or registry.recording_info(identity).name)


def recording_summary(identity: str, recording: Recording, robot: str, name: str) -> RecordingSummary:
    """What was ingested, with the findings of the checks."""
    gaps = [np.diff(e.time) for e in recording.episodes if len(e.time) > 1]
    findings = recording.provenance.get("findings", [])
    return RecordingSummary(
        recording=identity,
        name=name,
        robot=robot,
        measured=recording.measured,
        episodes=len(recording.episodes),
        rows_count=sum(len(e.time) for e in recording.episodes),
        duration=float(sum(e.duration for e in recording.episodes)),
        rate=float(1.0 / np.median(np.concatenate(gaps))) if gaps else None,
        channels=recording.names,
        settings=tuple(sorted({k for e in recording.episodes for k in e.settings})),
        gait=recording.provenance.get("gait"),
        findings=tuple(f"{f['severity']}: {f['where']}: {f['message']}" for f in findings),
    )
