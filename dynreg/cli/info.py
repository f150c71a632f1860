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
    from dynreg.results import Info

    with call.open() as session:
        result = Info.model_validate(session.info())
    call.emit(result)
