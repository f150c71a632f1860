"""`dynreg rm` and `dynreg gc`: things taken out of the registry, and what it need not keep."""

import sys
from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import stored_names
from dynreg.errors import command


def rm(
    call: Call,
    refs: Annotated[
        list[str],
        typer.Argument(
            metavar="ID...",
            help="What to remove: hashes, prefixes, names or @last (the last recording).",
            autocompletion=stored_names,
        ),
    ],
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Remove it without asking.")] = False,
) -> None:
    """Remove stored things, with what cannot be used without them.

    A robot goes with its populations and simulators, a recording with its results, a population or a simulator with
    the results that name it. The name of a robot means its newest version. A recording stays as long as one version
    of its robot does.

    Without --yes it lists what would be removed. Then it asks on a terminal, and changes nothing elsewhere.

    Example: dynreg rm monday --yes
    """
    with call.open() as session:
        planned = session.remove(refs, dry_run=True)
        # By id: @last or a name may have become another thing meanwhile.
        asked_for = [one.id for one in planned.items if "needs" not in one.detail]
        if not yes:
            again = command("rm", *(identity[:12] for identity in asked_for), "--yes")
            call.emit(planned, hint=None if _on_terminal(call) else again)
            if not _on_terminal(call) or not typer.confirm("remove all of this?", err=True):
                return
        result = session.remove(asked_for)
    call.emit(result, hint="dynreg gc")


def _on_terminal(call: Call) -> bool:
    return sys.stdin.isatty() and sys.stdout.isatty() and not call.shared.json


def gc(
    call: Call,
    caches: Annotated[
        bool, typer.Option("--caches", help="Also all caches and indexes; populate makes an index again.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what would be removed, and change nothing.")
    ] = False,
) -> None:
    """Remove files that the registry need not keep.

    These are files that nothing names any more, unfinished work, indexes of removed entries, and temporary copies of
    catalogues that killed readers left behind.

    Example: dynreg gc --dry-run
    """
    with call.open() as session:
        result = session.collect(caches=caches, dry_run=dry_run)
    call.emit(result, hint="dynreg gc" if dry_run and result.files else None)
