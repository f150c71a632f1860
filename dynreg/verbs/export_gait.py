"""Export of a gait: as commands for a robot, as a picture, or as a log of its run."""

from pathlib import Path

from dynreg.data.recording import Recording
from dynreg.data.topics import Topic, mcap
from dynreg.errors import UsageError, one_of
from dynreg.gait.beside import beside, joined, rate_of, rerun
from dynreg.gait.play import FORMS, require_playable, told
from dynreg.registry import Registry
from dynreg.results.gait import Gait
from dynreg.sim.film import FORMS as PICTURES
from dynreg.sim.film import draw, moments
from dynreg.verbs.gaits import gait_of, genes_of, trials_of
from dynreg.verbs.written import require_new, write_new

RUN = "foxglove"


def export_gait(registry: Registry, ref: str | Path | Gait, path: Path, form: str) -> Gait:
    """Write a gait to a new file, and return the gait.

    ref : the gait, its id, `@last`, or the path of its JSON document.
    form : "csv", "mcap" or "python" are commands for a robot (see `gait.play`). "gif" is a film and "png" four stills
    of one period, both of the stored run in the simulator that shows the gait (`Gait.shown`); a slope is drawn level.
    "foxglove" is a log of the run there. If `ref` is a recording of a played gait, the log holds the measured channels
    and the simulator's under the same commands, from the same initial pose in every episode.
    Raises UsageError for another form, a gait that cannot be played or a file that cannot be written, NoMatchError if
    the robot or a simulator is not in the registry, LogError if the recording has no commands, PictureError if this
    machine cannot draw.
    """
    if form not in (*FORMS, *PICTURES, RUN):
        raise UsageError(
            f"form {form!r} of a gait",
            expected=one_of([*FORMS, *PICTURES, RUN]),
            do="choose one of them",
        )
    gait, recording = _asked(registry, ref, form)
    require_playable(gait)
    require_new(path)  # before the simulation, which takes time
    write_new(path, _data(registry, gait, recording, form))
    return gait


def _asked(registry: Registry, ref: str | Path | Gait, form: str) -> tuple[Gait, Recording | None]:
    """The gait; and the recording of the played gait if `ref` is one and the form is a log of the run."""
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
    trials, shown = trials_of(registry, gait, gait.seconds, gait.rate)
    commands = told(trials.space, genes_of(gait), gait, trials.times)
    if form == RUN:
        return mcap(rerun(trials, shown, commands))
    model, poses = trials.poses(commands, shown)
    return draw(
        model, poses, gait.rate, moments(gait.seconds, form, gait.table.period or gait.table.times[-1]), form
    )


def _beside(registry: Registry, gait: Gait, recording: Recording) -> list[Topic]:
    """The topics of a trial's episodes, one after the other."""
    out = []
    for episode in recording.episodes:
        if len(episode.time) > 1:
            rate = rate_of(episode, gait.rate)
            trials, shown = trials_of(registry, gait, (len(episode.time) - 1) / rate, rate)
            out += beside(trials, shown, recording, episode)
    return joined(out)
