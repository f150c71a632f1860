"""Is everything that was stored still there?"""

from pathlib import Path

from dynreg.registry import verify
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
