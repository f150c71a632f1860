"""`dynreg info`: versions, the registry, the machine."""

from dynreg.cli.call import Call


def info(call: Call) -> None:
    """Show versions, optional parts, machine and registry.

    It works without a registry and does not make one.

    Example: dynreg info
    """
    from dynreg.verbs.info import information

    if not call.registry.exists():
        call.emit(information(call.registry))
        return
    with call.open() as session:
        result = session.info()
    call.emit(result)
