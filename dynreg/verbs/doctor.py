"""What is wrong with logs, before they are ingested."""

from collections.abc import Sequence
from pathlib import Path

from dynreg.data.ingest import Finding, doctor
from dynreg.data.maps import read_map
from dynreg.results.doctor import LogFinding, LogFindings
from dynreg.sim.robot import load_robot


def findings(logs: Sequence[Path], robot: str | None, log_map: Path | None) -> LogFindings:
    """What the checks find without a map; where logs cannot be used so, with the robot's first map that helps."""
    loaded = load_robot(robot) if robot else None
    spec = loaded.recording_spec if loaded else None
    found = doctor(logs, spec, read_map(log_map) if log_map else None)
    if log_map is None and loaded is not None and not _usable(found):
        others = (
            doctor(logs, spec, read_map(path)) for path in sorted((loaded.folder / "maps").glob("*.toml"))
        )
        found = next(filter(_usable, others), found)
    return LogFindings(
        logs=tuple(map(str, logs)),
        robot=robot,
        usable=_usable(found),
        findings=tuple(LogFinding(**vars(f)) for f in found),
    )


def _usable(found: Sequence[Finding]) -> bool:
    return all(f.severity != "error" for f in found)
