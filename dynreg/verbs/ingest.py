"""Logs of a robot as a registered recording."""

import numpy as np

from dynreg.data.recording import Recording
from dynreg.registry import Registry
from dynreg.results import RecordingSummary
from dynreg.sim.robot import Robot
from dynreg.verbs.subjects import register


def ingested(registry: Registry, recording: Recording, robot: Robot, name: str | None) -> RecordingSummary:
    """Register a recording under a name, which may be left out, and say what was found in it."""
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
