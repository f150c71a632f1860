"""`dynreg verify`: is everything that was stored still there?"""

from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.errors import CorruptError


def verify(
    call: Call,
    repair: Annotated[
        bool, typer.Option("--repair", help="Bring the catalogue in line with the files.")
    ] = False,
) -> None:
    """Check that all that was stored is still there.

    Compares the catalogue with the stored files, hash by hash. Exit status 3 when data are lost or changed.

    Example: dynreg verify --repair
    """
    from dynreg.report.words import count
    from dynreg.verbs.verify import verification

    result = verification(call.registry, repair)  # a session could not open a damaged registry
    call.emit(result, hint=None if result.clean or repair else "dynreg verify --repair")
    left = result.lost if repair else result.faults
    if left:
        raise CorruptError(
            f"{count(len(left), 'fault')}, the first: {left[0]}",
            expected="every stored file as it was registered",
            do="populate or ingest again what was lost" if repair else "run `dynreg verify --repair`",
        )
