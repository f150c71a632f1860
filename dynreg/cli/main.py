"""The program `dynreg`: its global options, its verbs, and what an error looks like."""

import errno
import os
import re
import sys
import traceback
from collections.abc import Sequence
from typing import Annotated

import typer

from dynreg.cli import (
    calibrate,
    doctor,
    drift,
    effects,
    excite,
    export,
    gait,
    importing,
    info,
    ingest,
    init,
    listing,
    navigate,
    ordinary,
    populate,
    removing,
    report,
    robots,
    show,
    trial,
    verify,
    view,
)
from dynreg.cli.call import (
    DebugOption,
    JsonOption,
    QuietOption,
    RegistryOption,
    SettingsOption,
    Shared,
)
from dynreg.cli.help import WIDTH, GroupHelp
from dynreg.cli.output import say
from dynreg.errors import Assumed, Awaited, Damaged, DynregError, NotStored, OldWord, Renewed
from dynreg.foreign import visible

INTERRUPTED = 130  # 128 + the signal's number, as shells have it
READER_GONE = 1  # the status that typer and rich give to a broken pipe

# what a machine refuses, whatever a program does
REFUSALS = {
    getattr(errno, name)
    for name in ("ENOSPC", "EDQUOT", "EFBIG", "EIO", "EROFS", "EACCES", "EPERM", "EMFILE", "ENFILE", "ENOMEM")
}

# what typer says of text where a number is asked for, and what was expected
_NUMBER = re.compile(r"valid (integer|number)\b")
_NUMBERS = {"integer": "a whole number, such as 12", "number": "a number, such as 0.5"}

# click's errors, wherever typer keeps its click
_UsageError = typer.BadParameter.__bases__[0]
_ClickError = _UsageError.__bases__[0]

app = typer.Typer(
    name="dynreg",
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    cls=GroupHelp,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": WIDTH},
)


def _version(wanted: bool) -> None:
    if wanted:
        from dynreg import __version__

        print(f"dynreg {__version__}")
        raise typer.Exit()


@app.callback()
def _root(
    ctx: typer.Context,
    registry: RegistryOption = None,
    settings_file: SettingsOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Find the simulators that are nearest to a real robot's log, and what they lack.

    Fill a registry with simulators (populate), bring in a log (ingest), ask for its neighbours (query), and
    for the physical causes that no simulator has (diagnose).

    Exit status: 0 done, 1 error, 2 usage, 3 data lost or corrupt, 4 no match or nothing close enough.
    An error is one line on stderr, with --json too.
    """
    ctx.obj = Shared(registry, settings_file, json, quiet, debug)


PREPARE = "Robots, logs and simulators"
robots.register(app, PREPARE)
ordinary.register(
    app,
    {
        PREPARE: {
            "doctor": doctor.doctor,
            "ingest": ingest.ingest,
            "populate": populate.populate,
        },
        "Ask about a recording": {
            "query": None,
            "diagnose": None,
            "calibrate": calibrate.calibrate,
            "compare": None,
            "drift": drift.drift,
        },
        "Use an answer": {
            "report": report.report,
            "export": export.export,
            "view": view.view,
            "gait": gait.gait,
            "navigate": navigate.navigate,
        },
        "Effects and experiments": {
            "effects": effects.effects,
            "excite": excite.excite,
            "trial": trial.trial,
        },
        "The registry": {
            "init": init.init,
            "list": listing.list_,
            "import": importing.import_,
            "show": show.show,
            "rm": removing.rm,
            "gc": removing.gc,
            "verify": verify.verify,
            "info": info.info,
        },
    },
)


def main(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit status; errors go to stderr as one line."""
    debug = "--debug" in arguments
    try:
        status = app(list(arguments) or ["--help"], prog_name="dynreg", standalone_mode=False)
        sys.stdout.flush()
        if status == INTERRUPTED:  # typer takes Ctrl-C for an exit
            raise KeyboardInterrupt
        return status if isinstance(status, int) else 0
    except DynregError as error:
        return _fail(str(error), error.exit_status, debug)
    except _UsageError as error:
        return _fail(_usage(error, arguments), 2, debug)
    except _ClickError as error:
        return _fail(error.format_message(), error.exit_code, debug)
    except (KeyboardInterrupt, typer.Abort):
        return _fail(
            "interrupted; what was registered stays; where a command has --resume, it goes on from here",
            INTERRUPTED,
            debug,
        )
    except BrokenPipeError:
        return _end_quietly()
    except Exception as error:
        return _fail(_unforeseen(error), 1, debug)


def run() -> None:
    """The console script."""
    if "--debug" not in sys.argv:
        _only_own_warnings()
    _without_opengl()
    # a letter that the terminal's encoding lacks is no error
    sys.stdout.reconfigure(errors="backslashreplace")
    status = main(sys.argv[1:])
    try:
        sys.stdout.flush()
    except OSError:  # said already; what is still held back would be tried, and fail, once more at the end
        _end_quietly()
    sys.exit(status)


def _only_own_warnings() -> None:
    """Warnings of the libraries below are kept back; dynreg's own are one line each."""
    import warnings

    warnings.simplefilter("ignore")
    for kind in (OldWord, NotStored, Damaged, Assumed, Awaited, Renewed):
        warnings.simplefilter("default", kind)
    warnings.showwarning = lambda message, *_: say(f"note: {message}")


def _without_opengl() -> None:
    """Keep MuJoCo from loading an OpenGL: one that does not work would keep MuJoCo itself from being imported.

    Only a film needs one, in a process of its own, which is told what the user chose.
    """
    os.environ.setdefault("DYNREG_GL", os.environ.get("MUJOCO_GL", ""))
    os.environ["MUJOCO_GL"] = "disable"


def _fail(text: str, status: int, debug: bool) -> int:
    if debug:
        print(visible(traceback.format_exc(), keep="\n"), file=sys.stderr, end="")
    say(f"error: {text}")
    return status


def _unforeseen(error: Exception) -> str:
    """What the machine refused, or else a bug, in one line."""
    if isinstance(error, MemoryError):
        why = str(error) or "the memory of this machine does not suffice"
    elif isinstance(error, OSError) and error.errno in REFUSALS:
        why = f"{error.strerror}{f': {error.filename!r}' if error.filename else ''}"
    else:
        said = " ".join(f"{type(error).__name__}: {error}".split())
        return f"{said}; this is a bug in dynreg; run again with --debug"
    return f"{why}; expected enough disk space, memory and permissions; provide them, then run it again"


def _usage(error: Exception, arguments: Sequence[str]) -> str:
    """A misused command in one line: what is wrong, the form of the command, where its help is."""
    problem, given = " ".join(error.format_message().split()).rstrip("."), _given(error, arguments)
    context = getattr(error, "ctx", None)
    kind = _NUMBER.search(problem)
    if kind and given and context is not None:
        return f"{' '.join(given)}; expected {_NUMBERS[kind[1]]}; see `{context.command_path} --help`"
    problem += f" (given: {given[1]})" if given else ""
    if context is None:
        return f"{problem}; expected another value; see `dynreg --help`"
    form = " ".join(context.command.get_usage(context).removeprefix("Usage:").split())
    return f"{problem}; expected {form}; see `{context.command_path} --help`"


def _given(error: Exception, arguments: Sequence[str]) -> tuple[str, ...]:
    """The option and the value that it was given, which the message of a failed conversion leaves out; () for none."""
    for option in getattr(getattr(error, "param", None), "opts", ()):
        for here, following in zip(arguments, (*arguments[1:], ""), strict=True):
            if here == option and following:
                return option, repr(following)
            attached = f"{option}=" if option.startswith("--") else option  # --count=9, but -n9
            if here.startswith(attached) and here != option:
                return option, repr(here.removeprefix(attached))
    return ()


def _end_quietly() -> int:
    """The reader of stdout went away: nothing more can be said there, and Python need not try at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return READER_GONE
