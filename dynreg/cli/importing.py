"""`dynreg import`: another registry taken into this one."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call


def import_(
    call: Call,
    source: Annotated[Path, typer.Argument(metavar="DIR", help="The folder of another registry.")],
) -> None:
    """Take everything that another registry holds into this one.

    Ids stay as they are, so results still name their simulators. What is here already stays as it is, and so does DIR.
    A name that means another recording here is left out, and so is what is damaged in DIR: each is listed. Where
    something is damaged, the command ends with exit status 3.

    Example: dynreg import monday-registry
    """
    with call.open(create=True) as session, call.progress() as progress:
        result = session.import_registry(source, progress=progress)
    call.emit(result, hint="dynreg list")
