"""Is everything that was stored still there?"""

from pathlib import Path

from dynreg.registry import verify
from dynreg.results.stored import Verification


def verification(path: Path, repair: bool) -> Verification:
    """`verify` of the registry at `path`, as a result."""
    report = verify(path, repair)
    return Verification(
        registry=str(path),
        clean=not report.faults,
        checked=dict(report.checked),
        faults=tuple(str(fault) for fault in report.faults),
        repaired=tuple(str(f) for f in report.faults if getattr(f, "mended", None)),
        lost=tuple(str(f) for f in report.lost),
    )
