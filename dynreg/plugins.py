"""What installed packages bring by entry points, beside what dynreg brings itself."""

from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any, TypeVar

from dynreg.errors import RobotError

T = TypeVar("T")
MEND = "mend it, or uninstall its package"


def with_plugins(
    packaged: Mapping[str, T], group: str, key: str, made: Callable[[Any], T | None], expected: str
) -> Mapping[str, T]:
    """A table and, after its own, the plugins of an entry point group, by their attribute `key`.

    made : a plugin from what its entry point names, None where that is no such thing; expected : says what is.
    Raises RobotError where a plugin cannot be made, whatever the reason, is none, or brings a key that is taken.
    """
    table = dict(packaged)
    for point in entry_points(group=group):
        try:
            brought = point.load()
            plugin = made(brought)
        except Exception as error:
            raise RobotError(
                f"plugin {point.value} cannot be loaded: {type(error).__name__}: {error}",
                expected=expected,
                do=MEND,
            ) from error
        if plugin is None:
            raise RobotError(f"plugin {point.value} is {brought!r}", expected=expected, do=MEND)
        name = getattr(plugin, key)
        if name in table:
            raise RobotError(
                f"plugin {point.value} is of {key} {name!r}", expected="one that is not taken", do="rename it"
            )
        table[name] = plugin
    return MappingProxyType(table)
