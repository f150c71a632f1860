"""Names of channels and commands: "<joint>/<quantity>", as in "arm/position" or "base/yaw"."""


def parts_of(name: str) -> tuple[str, str]:
    """The joint, or base, and the quantity of a name; the quantity is "" where there is no "/"."""
    joint, _, quantity = name.partition("/")
    return joint, quantity


def joint_of(name: str) -> str:
    """The joint or body of a channel or a command: "arm" of "arm/position"."""
    return parts_of(name)[0]


def quantity_of(name: str) -> str:
    """What a channel measures or a command sets: "position" of "arm/position"."""
    return parts_of(name)[1]
