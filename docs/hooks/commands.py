"""Pages of the commands, from the program itself: what each does, its arguments, its options."""

from functools import cache

import typer

from dynreg.cli.call import Shared
from dynreg.cli.main import app

_GLOBAL = {*vars(Shared()), "help"}


@cache
def _program() -> typer.core.TyperGroup:
    return typer.main.get_command(app)


def names() -> list[str]:
    """Every command, in the order of the program's help; "robots check" for one of a group."""
    found = []
    for name, command in _program().commands.items():
        found += [f"{name} {inner}" for inner in getattr(command, "commands", {})] or [name]
    return found


def page_of(name: str) -> str:
    """Where the page of a command lies."""
    return f"verbs/{name.replace(' ', '_')}.md"


def index() -> str:
    """A table of all commands, each with its first sentence."""
    rows = [
        f"| [`dynreg {name}`]({page_of(name).removeprefix('verbs/')}) | {_paragraphs(name)[0]} |"
        for name in names()
    ]
    return "\n".join(["| command | what it does |", "|---|---|", *rows])


def help_of(name: str) -> str:
    """What a command does, its form, its arguments and its options."""
    command = _command(name)
    context = typer.Context(command, info_name=f"dynreg {name}")
    form = " ".join(command.get_usage(context).removeprefix("Usage:").split())
    takes = [p for p in command.params if p.name and p.name not in _GLOBAL]
    arguments = [p for p in takes if p.param_type_name == "argument"]
    parts = ["\n\n".join(_paragraphs(name)), f"```sh\n{form}\n```"]
    if arguments:
        rows = [f"| `{p.metavar or p.name.upper()}` | {_cell(p.help)} |" for p in arguments]
        parts.append("\n".join(["| argument | meaning |", "|---|---|", *rows]))
    if options := [p for p in takes if p.param_type_name == "option"]:
        rows = [f"| {_flags(p)} | {' | '.join(map(_cell, _meaning(p)))} |" for p in options]
        parts.append("\n".join(["| option | meaning | default |", "|---|---|---|", *rows]))
    return "\n\n".join(parts)


def _command(name: str):
    command = _program()
    for word in name.split():
        command = command.commands[word]
    return command


def _paragraphs(name: str) -> list[str]:
    said = (_command(name).help or "").split("\n\n")
    return [" ".join(part.split()) for part in said if not part.lstrip().startswith("Example:")]


def _flags(option) -> str:
    flags = (*option.opts, *option.secondary_opts)
    return ", ".join(f"`{flag}`" for flag in flags) + (
        f" `{_cell(option.metavar)}`" if option.metavar else ""
    )


def _meaning(option) -> tuple[str, str]:
    """What an option is for, and its default, which the program's help holds in brackets at its end."""
    said, _, default = (option.help or "").partition("[default: ")
    return said.strip(), default.rstrip("]")


def _cell(text: str | None) -> str:
    return (text or "").replace("|", "\\|").replace("\n", " ")
