"""`dynreg verify`: is everything that was stored still there?"""

from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.errors import CorruptError


def verify(
    call: Call,
    repair: Annotated[
        bool, typer.Option("--repair", help="Correct the catalogue so that it agrees with the files.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what --repair would do; change nothing.")
    ] = False,
) -> None:
    """Check that stored data are complete and unchanged.

    It compares the catalogue and the ledger with the stored files, hash by hash. A repair moves unusable files to
    lost+found/ in the registry; it deletes nothing but caches.

    Exit status 3: data are lost or changed.

    Example: dynreg verify --dry-run
    """
    from dynreg.report.words import count
    from dynreg.verbs.verify import verification

    result = verification(call.registry, repair, dry_run)  # a session could not open a damaged registry
    repaired = repair and not dry_run
    call.emit(result, hint=None if result.clean or repaired else "dynreg verify --repair")
    left = result.lost if repaired else result.faults
    if left:
        mend = "`dynreg verify --repair`"
        look = f"`dynreg verify --dry-run` to see what a repair would do, then {mend}"
        raise CorruptError(
            f"{count(len(left), 'fault')}, the first: {left[0]}",
            expected="every stored file as it was registered",
            do="populate or ingest again what was lost" if repaired else f"run {mend if dry_run else look}",
        )
