"""The room of `info`: one table."""

from rich.console import RenderableType

from dynreg.report.grid import table
from dynreg.report.words import count
from dynreg.results.stored import Info


def tables(result: Info) -> RenderableType:
    """The registry, the versions, the optional parts, the machine."""
    holds = ", ".join(count(number, kind) for kind, number in result.holds.items()) or "nothing yet"
    holds += f", {count(result.entries, 'simulator')} in populations" if result.entries else ""
    parts = {name: found or "not installed" for name, found in result.optional.items()}
    rows = [
        ("registry", result.registry),
        ("", holds if result.exists else "none there yet: `dynreg populate` or `dynreg ingest` makes it"),
        *(("catalogue", result.catalog), ("files", result.blobs))[: 2 * bool(result.catalog)],
        *result.versions.items(),
        *((f"{name} (optional)", found) for name, found in parts.items()),
        ("system", result.system or "-"),
        ("GPU", "none: models are evaluated on the CPU" if result.device == "cpu" else result.device),
        ("cores", str(result.cores)),
    ]
    return table(("", ""), rows)
