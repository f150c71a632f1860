"""Is everything that was stored still there?"""

import warnings
from pathlib import Path

from dynreg.errors import Damaged
from dynreg.registry import rebuild, verify
from dynreg.results.stored import Verification


def verification(path: Path, repair: bool, dry_run: bool = False) -> Verification:
    """`verify` of the registry at `path`, as a result."""
    report = verify(path, repair, dry_run)
    return Verification(
        registry=str(path),
        clean=not report.faults,
        checked=dict(report.checked),
        faults=tuple(str(fault) for fault in report.faults),
        repaired=() if dry_run else tuple(str(f) for f in report.faults if f.mended),
        lost=tuple(str(f) for f in report.lost),
    )


def rebuilt(path: Path, catalog: str, blobs: str) -> None:
    """Write the lost catalogue of a shared registry anew, and say what did not come back (`Damaged`)."""
    lost = rebuild(path, catalog, blobs).lost
    if lost:
        more = f", and {len(lost) - 1} more" if len(lost) > 1 else ""
        warnings.warn(f"it did not come back: {lost[0]}{more}", Damaged, 2)
