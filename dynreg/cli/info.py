"""`dynreg info`: versions, the registry, the machine."""

import typer

from dynreg.cli.call import Call, verb


def register(app: typer.Typer) -> None:
    """Add `info` to the program."""
    verb(app, "info")(info)


def info(call: Call) -> None:
    """Show versions, registry and machine.

    Example: dynreg info
    """
    from dynreg.cli.documents import Info
    from dynreg.report.tables import table

    with call.open() as session:
        facts = session.info()
    call.emit(Info(facts=facts), table(("", ""), [(key, str(value)) for key, value in facts.items()]))
