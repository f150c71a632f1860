"""What every verb shares: the global options, the settings, the way to the registry and to the output."""

import functools
import inspect
import os
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynreg.cli.help import VerbHelp
from dynreg.cli.told import naming, parameters, told
from dynreg.errors import DynregError, RobotError, UsageError, command
from dynreg.foreign import visible
from dynreg.session import DEFAULT, place
from dynreg.verbs.settings import Settings

if TYPE_CHECKING:
    from rich.console import RenderableType

    from dynreg.cli.settings import Settings as File
    from dynreg.results.result import Result
    from dynreg.session import Session
    from dynreg.sim.robot import Robot

# A command in a text: from `dynreg VERB` at its beginning, or after a sign or word that leads to it, to the closing
# backtick, a remark of the shell or the end.
_COMMAND = re.compile(r"(?:(?<=^)|(?<=`)|(?<=: )|(?<=then ))dynreg [a-z][^`]*?(?=`|\s+#|$)")
_FLAGS = {"log_map": "--map"}  # of what is no verb's setting
_PANEL = "Global options"
RegistryOption = Annotated[
    Path | None,
    typer.Option(
        help=f"Registry directory.  [default: DYNREG_REGISTRY, else ./{DEFAULT}]", rich_help_panel=_PANEL
    ),
]
SettingsOption = Annotated[
    Path | None,
    typer.Option(
        "--settings", help="File with settings, in TOML.  [default: ./dynreg.toml]", rich_help_panel=_PANEL
    ),
]
JsonOption = Annotated[
    bool,
    typer.Option(
        "--json", help="Print one JSON document on stdout, and nothing else.", rich_help_panel=_PANEL
    ),
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", help="Show no progress and no hints.", rich_help_panel=_PANEL)
]
DebugOption = Annotated[
    bool, typer.Option("--debug", help="Show the traceback of an error.", rich_help_panel=_PANEL)
]


@dataclass(frozen=True)
class Shared:
    """The global options as they were given, before or after the verb."""

    registry: Path | None = None
    settings_file: Path | None = None
    json: bool = False
    quiet: bool = False
    debug: bool = False

    def over(self, earlier: "Shared") -> "Shared":
        """These options, and where they were not given those that stood before the verb."""
        return Shared(*(new or old for new, old in zip(_values(self), _values(earlier), strict=True)))


_OPTIONS = {
    "registry": RegistryOption,
    "settings_file": SettingsOption,
    "json": JsonOption,
    "quiet": QuietOption,
    "debug": DebugOption,
}


@dataclass(frozen=True)
class Call:
    """One run of one verb."""

    shared: Shared
    settings: "File"

    @property
    def registry(self) -> Path:
        """The registry directory that the flags and settings name."""
        return place(self.shared.registry or self.settings.registry)

    @property
    def quiet(self) -> bool:
        """Whether to leave progress and hints out."""
        return self.shared.quiet or self.settings.quiet

    def open(self, create: bool = False) -> "Session":
        """The session on the registry; RegistryError where there is none and `create` is False."""
        from dynreg import session

        return session.open(self.registry, create=create)

    def open_for(self, robot: str | Path | None, *recordings: str | None) -> "Session":
        """The session that is asked about recordings; made where all of these are logs of a robot that is named.

        Logs may be the first things in a registry; RegistryError where there is none, and nothing to put there.
        """
        from dynreg.verbs.subjects import exists

        logs = (one is not None and exists(one) for one in recordings)
        return self.open(create=robot is not None and all(logs))

    def robot(self, ref: str, ranges: str | None = None) -> "Robot":
        """A robot by its packaged name or folder, or as the registry knows it, where there is one: none is made."""
        from dynreg.verbs.subjects import loaded_robot

        try:
            return loaded_robot(ref, ranges)
        except RobotError:
            if not self.registry.is_dir():
                raise
        with self.open() as session:
            return loaded_robot(ref, ranges, session.registry)

    def progress(self, faster: str = ""):
        """Context manager around a progress function; see `output.progress_bars`, also for `faster`."""
        from dynreg.cli.output import progress_bars

        return progress_bars(not self.quiet, faster)

    def here(self, text: str) -> str:
        """A text with the flags that named the registry and the settings file in each dynreg command in it."""
        given = {"--settings": self.shared.settings_file, "--registry": self.shared.registry}

        def whole(found: re.Match[str]) -> str:
            typed = found.group()
            words = [
                [flag, str(path)] for flag, path in given.items() if path is not None and flag not in typed
            ]
            return " ".join([typed, *map(shlex.join, words)])

        return _COMMAND.sub(whole, text)

    def _completed(self, shown: "RenderableType") -> "RenderableType":
        """What is shown, with each line of text by `here`."""
        from rich.console import Group
        from rich.text import Text

        if isinstance(shown, Group):
            return Group(*map(self._completed, shown.renderables))
        if isinstance(shown, Text) and (whole := self.here(shown.plain)) != shown.plain:
            return Text("\n".join(map(visible, whole.split("\n"))), style=shown.style)
        return shown

    def emit(
        self, result: "Result", shown: Any | None = None, hint: str | Sequence[str] | None = None
    ) -> None:
        """Print a result: its JSON document, or what is `shown` (else its tables) and a next-step hint.

        hint : what comes next, or several of which one comes next, a line each. Commands are completed by `here`.
        Raises the error that its room ends with, where it answers that nothing fits or works.
        """
        from dynreg.cli.output import console
        from dynreg.report.tables import refusal, render

        if self.shared.json:
            sys.stdout.write(result.to_json() + "\n")
        else:
            out = console()
            out.print(self._completed(render(result) if shown is None else shown))
            if hint and not self.quiet:
                first, *others = (visible(self.here(h)) for h in ([hint] if isinstance(hint, str) else hint))
                out.print("\n".join([f"next: {first}", *(f"  or: {one}" for one in others)]))
        if (problem := refusal(result)) is not None:
            raise problem

    def emit_and_write(self, result: "Result", page: Path | None, identity: str | None = None) -> None:
        """Print a result, and write its page where one is asked for; else a hint says what comes next, if it is stored.

        identity : of the result, where the hint is to name it.
        """
        from dynreg.registry.opening import may_write
        from dynreg.report.tables import hint

        if page is not None:
            from dynreg.report.html import write_report

            write_report(result, page)
        following = command("report", identity[:12]) if identity else hint(result)
        gone = self.registry.is_dir() and not may_write(self.registry)
        self.emit(result, hint=None if page or gone else following)


def verb(
    app: typer.Typer, name: str, help: str | None = None, group: str | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register `function(call, ...)` as a command, with the global options among its own.

    Its help, else its docstring, is what it does and an example. group : its heading in the program's help. A
    parameter whose type is a verb's `Settings` stands for an option for each of them.
    """

    def register(function: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(function)
        def run(ctx: typer.Context, **given: Any) -> None:
            late = Shared(**{option: given.pop(option) for option in _OPTIONS})
            call = call_of(late.over(ctx.obj or Shared()))
            settings = {name: told(kind, given, call.settings) for name, kind in _settings(function)}
            try:
                with naming(_FLAGS):
                    function(call, **given, **settings)
            except DynregError as error:
                error.do = call.here(error.do)
                raise

        run.__signature__ = _signature(function)
        run.__annotations__ = {p.name: p.annotation for p in run.__signature__.parameters.values()}
        app.command(name, help=help, cls=VerbHelp, rich_help_panel=group)(run)
        return function

    return register


def call_of(shared: Shared) -> Call:
    """The call with its settings read."""
    from dynreg.cli.settings import read_settings

    return Call(shared, read_settings(shared.settings_file))


def can_write(*files: Path | None) -> None:
    """UsageError for files that could not be written, or are one and the same, before time is spent on them."""
    named = [file for file in files if file is not None]
    for out in named:
        folder = out.absolute().parent
        if out.is_dir() or not folder.is_dir() or not os.access(out if out.exists() else folder, os.W_OK):
            raise UsageError(
                f"cannot write {str(out)!r}",
                expected="a file that may be written, in an existing folder",
                do="name another file",
            )
    if len({out.resolve() for out in named}) < len(named):
        raise UsageError(
            f"{str(named[0])!r} is named twice", expected="a file for each", do="name another one"
        )


def _signature(function: Callable[..., None]) -> inspect.Signature:
    settings = dict(_settings(function))
    own = [
        option
        for p in [*inspect.signature(function).parameters.values()][1:]  # without `call`
        for option in (parameters(settings[p.name]) if p.name in settings else [p])
    ]
    kind = inspect.Parameter.KEYWORD_ONLY
    shared = [
        inspect.Parameter(name, kind, default=getattr(Shared(), name), annotation=option)
        for name, option in _OPTIONS.items()
    ]
    context = inspect.Parameter("ctx", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context)
    return inspect.Signature([context, *(p.replace(kind=kind) for p in own), *shared])


def _settings(function: Callable[..., None]) -> list[tuple[str, type[Settings]]]:
    """The parameters of a verb that are its settings, with their kind."""
    return [
        (p.name, p.annotation)
        for p in inspect.signature(function).parameters.values()
        if isinstance(p.annotation, type) and issubclass(p.annotation, Settings)
    ]


def _values(shared: Shared) -> tuple[Any, ...]:
    return (shared.registry, shared.settings_file, shared.json, shared.quiet, shared.debug)
