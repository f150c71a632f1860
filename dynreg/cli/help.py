"""What `--help` looks like: commands grouped by what a user does, a verb's own options before the global ones."""

from collections.abc import Iterable
from typing import Any

from typer.core import TyperCommand, TyperGroup

OWN = "Options"
WIDTH = 100  # columns, on a terminal that has as many
_PLACEHOLDERS = {
    "<str>": "NAME",
    "<list[str]>": "NAME",
    "<list[Path]>": "PATH",
    "<int>": "N",
    "<float>": "X",
    "<path>": "PATH",
}


class VerbHelp(TyperCommand):
    """A command."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Its arguments without the library's braces."""
        return [_bare(piece) for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Arguments, its own options, then the global ones."""
        _write_parameters(self.get_params(ctx), ctx, formatter)


class GroupHelp(TyperGroup):
    """The program, or a command that has others."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """The commands first: they are what a user looks for."""
        self.format_commands(ctx, formatter)
        _write_parameters(self.get_params(ctx), ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """A section for each group of commands, in the order in which they were registered."""
        known = {name: self.get_command(ctx, name) for name in self.list_commands(ctx)}
        width = formatter.width - 6 - max(map(len, known), default=0)
        sections: dict[str, list[tuple[str, str]]] = {}
        for name, command in known.items():
            group = getattr(command, "rich_help_panel", None) or "Commands"
            sections.setdefault(group, []).append((name, command.get_short_help_str(width)))
        longest = max(map(len, known), default=0)
        for title, rows in sections.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(longest), text) for name, text in rows])


def _write_parameters(parameters: Iterable[Any], ctx: Any, formatter: Any) -> None:
    sections: dict[str, list[tuple[str, str]]] = {}
    for one in parameters:
        record = one.get_help_record(ctx)
        if record is None:
            continue
        names, text = record
        if one.param_type_name == "argument":
            title, names = "Arguments", _bare(names.split(" ")[0])
        else:
            title = getattr(one, "rich_help_panel", None) or OWN
        for library, ours in _PLACEHOLDERS.items():
            names = names.replace(library, ours)
        sections.setdefault(title, []).append((names, text))
    last = sorted(sections, key=lambda title: title not in ("Arguments", OWN))  # a stable order
    for title in last:
        with formatter.section(title):
            formatter.write_dl(sections[title])


def _bare(piece: str) -> str:
    return piece.replace("{", "").replace("}", "").replace("......", "...")
