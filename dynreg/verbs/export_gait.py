"""Export of a gait: as commands for a robot, as a picture, as a log of its run."""

from pathlib import Path

from dynreg.data.recording import Recording
from dynreg.errors import UsageError
from dynreg.gait.beside import beside, joined, rate_of, rerun
from dynreg.gait.play import FORMS, require_playable, told
from dynreg.gait.runs import Topic, mcap
from dynreg.registry import Registry
from dynreg.results.gait import Gait
from dynreg.sim.film import FORMS as PICTURES
from dynreg.sim.film import draw, moments
from dynreg.verbs.gaits import gait_of, genes_of, trials_of
from dynreg.verbs.written import require_new, write_new

RUN = "foxglove"


def export_gait(registry: Registry, ref: str | Path | Gait, path: Path, form: str) -> Gait:
    """Write a gait, itself or its id, `@last` or the path of its JSON, to a new file; the gait.

    form : csv, mcap or python for a robot, see `gait.play`. gif, or png for one period in four stills: drawn in the
    simulator in which it walks least, in the very simulation that its document tells of; the ground of a slope is drawn
    level. foxglove : a log of its run in that simulator; where `ref` is a recording that was ingested as a trial of a
    gait, of what was measured and what the simulator does under just these commands, from the same place in every
    episode.
    Raises UsageError for another form, a gait that cannot be played and a file that cannot be written, NoMatchError
    where the registry lacks the robot or the simulators, LogError where the recording holds no commands, PictureError
    where this machine cannot draw.
    """
    if form not in (*FORMS, *PICTURES, RUN):
        raise UsageError(
            f"form {form!r} of a gait",
            expected=f"one of {[*FORMS, *PICTURES, RUN]}",
            do="choose one of them",
        )
    gait, recording = _asked(registry, ref, form)
    require_playable(gait)
    require_new(path)  # before time is spent on it
    write_new(path, _data(registry, gait, recording, form))
    return gait


def _asked(registry: Registry, ref: str | Path | Gait, form: str) -> tuple[Gait, Recording | None]:
    """The gait, and for a log of its run the recording that was made as it was played, where `ref` is one."""
    if isinstance(ref, Gait):
        return ref, None
    if form == RUN and ref != "@last" and not Path(ref).is_file():
        kind, identity = registry.resolve(str(ref), ("result", "recording"))
        recording = registry.recording(identity) if kind == "recording" else None
        if recording is not None and "gait" in recording.provenance:
            return gait_of(registry, recording.provenance["gait"]), recording
    return gait_of(registry, ref), None


def _data(registry: Registry, gait: Gait, recording: Recording | None, form: str) -> bytes:
    if form in FORMS:
        return FORMS[form](gait)
    if recording is not None:
        return mcap(_beside(registry, gait, recording))
    trials, least = trials_of(registry, gait, gait.seconds, gait.rate)
    commands = told(trials.space, genes_of(gait), gait, trials.times)
    if form == RUN:
        return mcap(rerun(trials, least, commands))
    model, poses = trials.poses(commands, least)
    return draw(model, poses, gait.rate, moments(gait.seconds, form, 1.0 / gait.frequency), form)


def _beside(registry: Registry, gait: Gait, recording: Recording) -> list[Topic]:
    """The topics of a trial's episodes, one after the other."""
    out = []
    for episode in recording.episodes:
        if len(episode.time) > 1:
            rate = rate_of(episode, gait.rate)
            trials, least = trials_of(registry, gait, (len(episode.time) - 1) / rate, rate)
            out += beside(trials, least, recording, episode)
    return joined(out)
