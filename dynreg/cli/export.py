"""`dynreg export`: stored things as a new registry, a dataset, a robot folder, a log, a picture or commands."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import one_of, stored_names
from dynreg.datasets.formats import FORMATS
from dynreg.errors import UsageError, command
from dynreg.verbs.settings import Option
from dynreg.verbs.simulator import NAMES

if TYPE_CHECKING:
    from dynreg.session import Session

# csv and mcap are forms of a gait and of a dataset: what is named decides
_GAITS = ("csv", "mcap", "python", "foxglove", "gif", "png")
Form = StrEnum("Form", list(dict.fromkeys(("registry", "robot", "ranges", *FORMATS, *_GAITS, "rerun"))))

_PLAYED = "play it, then `dynreg ingest LOG --robot ROBOT --gait @last`"
_OPENED = {Form.rerun: "rerun FILE", Form.foxglove: "open it in Foxglove; plot /channels/NAME.residual"}


def _is_run(session: "Session", ref: str, simulator: str | None) -> bool:
    """Whether a log for Foxglove is of a recording; without a simulator @last is the last gait."""
    from dynreg.verbs.watched import is_run

    return simulator is not None or (ref != "@last" and is_run(session.registry, ref))


def _is_dataset(session: "Session", refs: list[str], form: Form) -> bool:
    """Whether a dataset is meant, and not a gait."""
    from dynreg.verbs.gaits import is_gait

    if form not in FORMATS:
        return False
    return form not in _GAITS or len(refs) > 1 or not is_gait(session.registry, refs[0])


def _is_plan(session: "Session", ref: str) -> bool:
    """Whether a plan of `navigate` is meant; @last is the last gait."""
    from dynreg.verbs.export_plan import is_plan

    return ref != "@last" and is_plan(session.registry, ref)


def _check(refs: list[str], form: Form, simulator: str | None, licence: str | None) -> None:
    """UsageError for options that do not go together."""
    if form not in (Form.registry, *FORMATS) and len(refs) != 1:
        what = "simulator" if form is Form.robot else "thing"
        raise UsageError(
            f"--as {form} with {len(refs)} things", expected=f"one {what}", do="export them one by one"
        )
    if simulator is not None and form not in (Form.foxglove, Form.rerun):
        raise UsageError(f"--with and --as {form}", expected="--as foxglove or rerun", do="leave --with out")
    if licence is not None and form not in FORMATS:
        raise UsageError(
            f"--licence and --as {form}", expected=f"--as {', '.join(FORMATS)}", do="leave --licence out"
        )


def export(
    call: Call,
    refs: Annotated[
        list[str],
        typer.Argument(
            metavar="ID...",
            help="What to export: hashes, prefixes, names, @last (the last recording), @answer.",
            autocompletion=stored_names,
        ),
    ],
    to: Annotated[
        Path,
        typer.Option(
            help="New folder of a registry, a robot or a dataset; new file of csv, mcap and anything else."
        ),
    ],
    named: Annotated[
        str,
        typer.Option(
            "--as",
            help="What is written; see above.",
            metavar="|".join(Form),
            autocompletion=one_of(tuple(Form)),
        ),
    ] = Form.registry.value,
    simulator: Annotated[
        str | None,
        typer.Option(
            "--with",
            metavar="ID",
            help=f"As foxglove or rerun: the simulator beside the recording, an id or one of {', '.join(NAMES)}."
            "  [default: what the result recommends, else nominal]",
        ),
    ] = None,
    licence: Annotated[
        str | None,
        typer.Option(
            metavar="TEXT",
            help="Of a dataset: what its card states, such as apache-2.0.  [default: that none is stated]",
        ),
    ] = None,
) -> None:
    """Write stored things as a registry, dataset, robot or file.

    --as registry: a new registry with the things and all that they need.

    Entries, populations and recordings of one robot as a dataset for other programs, with a card:

    DATASETS

    --as robot: a simulator as a robot folder: robot.toml with its parameters and effects, and one MJCF file. A result
    means the simulator that it recommends. A warning lists what robot.toml cannot express, and of a simulator that was
    fitted joint by joint its held-out error in MuJoCo.

    --as ranges: what a log leaves open, for training: the posterior of a query or a diagnosis with its correlations,
    and the fields of a MuJoCo model that each parameter sets. A recording means its newest such result.

    --as foxglove, rerun: a recording beside a simulator under the same commands, with both robots, every channel
    and its residual. Foxglove gets an MCAP log, Rerun an .rrd file. A result means its recording and the simulator
    that it recommends.

    --as csv, mcap, python of a gait: its joint commands. ID is the gait's id, its JSON file or @last, the last gait.

    --as csv of a plan of `dynreg navigate`, by its id: its commands, with when each begins and how long it holds.

    --as gif, png: a picture of a gait in the query's answer, else in the simulator in which it walks least. A gait as
    foxglove is its run there.

    @last is the last recording, but for gaits. `dynreg list --kind result` shows the ids of results.

    Example: dynreg export monday --to monday-registry
    """
    Option("A form.", choices=tuple(Form)).check("--as", named)
    form = Form(named)
    _check(refs, form, simulator, licence)
    with call.open() as session:
        if form is Form.rerun or (form is Form.foxglove and _is_run(session, refs[0], simulator)):
            session.export_run(refs[0], to, form.value, simulator)
            call.emit(session.show(refs[0]), f"{to}: written", hint=_OPENED[form])
            return
        if form is Form.csv and len(refs) == 1 and _is_plan(session, refs[0]):
            call.emit(session.export_plan(refs[0], to), f"{to}: written")
            return
        if _is_dataset(session, refs, form):
            call.emit(session.export_dataset(refs, to, form.value, licence))
            return
        if form is Form.ranges:
            ranges = session.export_ranges(refs[0], to)
            call.emit(
                ranges, hint=command("export", ranges.simulator[:12], "--as", "robot", "--to", "FOLDER")
            )
            return
        if form not in (Form.registry, Form.robot):
            hint = None if form in (Form.gif, Form.png, Form.foxglove) else _PLAYED
            call.emit(session.export_gait(refs[0], to, form.value), f"{to}: written", hint=hint)
            return
        if form is Form.robot:
            folder = session.export_robot(refs[0], to)
            call.emit(folder, hint=command("robots", "check", to))
            return
        result = session.export(refs, to)
    call.emit(result, hint=command("list", "--registry", to))


export.__doc__ = (export.__doc__ or "").replace(
    "DATASETS", "\n\n    ".join(f"--as {one.id}: {one.writes}." for one in FORMATS.values())
)
