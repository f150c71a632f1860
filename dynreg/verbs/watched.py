"""A recording beside a simulator, or a robot alone: the frames to view, and the files that hold them."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from dynreg.errors import NoMatchError, UsageError, one_of
from dynreg.gait.play import told
from dynreg.registry import Registry, ResultRecord
from dynreg.results.gait import Gait
from dynreg.verbs.gaits import gait_of, genes_of, trials_of
from dynreg.verbs.simulator import NOMINAL, RECOMMENDED
from dynreg.verbs.simulators import own, simulator
from dynreg.verbs.subjects import Recorded, called, require_fits, robot_of
from dynreg.verbs.written import require_new, write_new
from dynreg.watch.frames import SIMULATED, Frames, frames


def watched(registry: Registry, ref: str, beside: str | None = None, *, threads: int = 0) -> Frames:
    """The frames of a thing: a recording, or that of a result, beside a simulator; a gait in its simulator.

    ref : a recording or a result, by id, unique prefix or name, or `@last`, the last recording. beside : a simulator,
    see `simulators`; by default what the result recommends, and for a recording the nominal simulator.
    Raises NoMatchError where there is no such thing, UsageError for a result about no recording, a simulator beside a
    gait, and one of another robot or of a version of it that the recording does not fit, LogError for a recording
    without commands.
    """
    kind, identity = registry.resolve(ref, ("recording", "result"))
    asked: str | ResultRecord = ref
    if kind == "result":
        asked = record = registry.result(identity)
        if record.kind == "gait":
            if beside is not None:
                raise UsageError(
                    f"simulator {beside!r} beside gait {ref!r}",
                    expected="a recording, or a result about one: a gait is shown in its own simulator",
                    do="name no simulator, or a recording of the played gait",
                )
            return _walk(registry, gait_of(registry, identity))
        if not record.recording_id:
            raise UsageError(
                f"result {ref!r} is a {record.kind}, about no recording",
                expected="a recording, or a result about one",
                do="see `dynreg list --kind recording`",
            )
        beside = beside or (record.id if record.kind in RECOMMENDED else NOMINAL)
        identity = record.recording_id
    robot, recording = robot_of(registry, identity, asked), registry.recording(identity)
    found = simulator(registry, beside or NOMINAL, robot, identity)
    if found.robot.name != robot.name:
        own(found, robot)
    elif found.robot.hash != robot.hash:  # another version, which a diagnosis was asked with
        name = called(registry.recording_info(identity), ref, robot.hash)
        require_fits(Recorded(registry, robot, recording, name), found.robot)
    return frames(found.robot, recording, found.config, threads=threads)


def is_run(registry: Registry, ref: str) -> bool:
    """Whether `ref` is a recording that was made without a gait, or a result about one other than a gait."""
    try:
        kind, identity = registry.resolve(ref, ("recording", "result"))
    except NoMatchError:
        return False
    if kind == "recording":
        return "gait" not in registry.recording(identity).provenance
    return registry.result(identity).kind != "gait"


def _walk(registry: Registry, gait: Gait) -> Frames:
    """A gait in the simulator that shows it."""
    trials, shown = trials_of(registry, gait, gait.seconds, gait.rate)
    model, poses = trials.poses(told(trials.space, genes_of(gait), gait, trials.times), shown)
    known = np.isfinite(poses).all(axis=1)
    return Frames(
        model, trials.robot.base, np.flatnonzero(known) / gait.rate, {SIMULATED: poses[known]}, {}, {}
    )


def export_run(registry: Registry, ref: str, path: Path, form: str, beside: str | None = None) -> None:
    """Write a recording beside a simulator to a new file; see `watched`. form : one of `FILES`.

    Raises UsageError for another form or a file that cannot be written, and what `watched` does.
    """
    if form not in FILES:
        raise UsageError(f"form {form!r}", expected=one_of(FILES), do="choose one of them")
    require_new(path)
    write_new(path, FILES[form](watched(registry, ref, beside), path.stem))


def _foxglove(found: Frames, name: str) -> bytes:
    from dynreg.watch.foxglove import log

    return log(found)


def _rerun(found: Frames, name: str) -> bytes:
    from dynreg.watch.rrd import rrd

    return rrd(found, name)


FILES: Mapping[str, Callable[[Frames, str], bytes]] = {"foxglove": _foxglove, "rerun": _rerun}
