"""`dynreg info`: versions, the registry, the machine."""

from dynreg.cli.call import Call


def info(call: Call) -> None:
    """Show versions, registry and machine.

    Example: dynreg info
    """
    from dynreg.results.stored import Info

    with call.open() as session:
        result = Info.model_validate(session.info())
    call.emit(result)
