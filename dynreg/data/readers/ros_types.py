"""Decoders of ROS messages, built from the definition that the log itself carries."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from dynreg.data.readers.budget import Budget

Decode = Callable[[memoryview], Any]

_IDL_SEPARATOR = "=" * 80 + "\n"
_UNROLLED = 1000  # parts of arrays of fixed length in one type: the library writes lines of code for each
_BASE, _NAME, _ARRAY = (
    1,
    2,
    3,
)  # rosbags.interfaces.Nodetype: a number or text, a type, an array of fixed length
_STANDARD = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")


def ros_decoder(
    name: str, definition: str | None, schema_encoding: str, message_encoding: str, budget: Budget
) -> Decode | None:
    """A decoder for one message type, or None where the pair of encodings is not ROS.

    `schema_encoding` is ros1msg, ros2msg or ros2idl; `message_encoding` ros1 or cdr; without a `definition` the type is
    one of ROS 2 Humble. Raises rosbags' TypesysError for a definition that cannot be parsed, ValueError for one whose
    messages have no end. The decoder raises LogError for a message that is more than `budget` allows.
    """
    if message_encoding not in ("ros1", "cdr") or schema_encoding not in ("ros1msg", "ros2msg", "ros2idl"):
        return None
    from rosbags.typesys import Stores, get_typestore
    from rosbags.typesys.msg import normalize_msgtype

    budget.spend("types")
    name = normalize_msgtype(name)
    humble = get_typestore(Stores.ROS2_HUMBLE)
    store = get_typestore(Stores.EMPTY) if definition is not None else humble
    if definition is not None:
        budget.check("settings_bytes", len(definition))
        types = _types(name, definition, schema_encoding)
        # Some writers leave out the definitions of time stamps, which every ROS 2 installation has.
        for stamp in _STANDARD:
            types.setdefault(stamp, humble.fielddefs[stamp])
        known: dict[str, _Extent | None] = {}
        for kind in types:
            _extent(kind, types, known)
        store.register(types)
    smallest = _extent(name, store.fielddefs, {}).item
    decode = store.deserialize_ros1 if message_encoding == "ros1" else store.deserialize_cdr

    def checked(data: memoryview) -> Any:
        if smallest is not None:
            budget.check("items", len(data) // smallest)
        return decode(data, name)

    return checked


def _types(name: str, definition: str, encoding: str) -> dict[str, Any]:
    """The types of a definition, by name, as rosbags has them."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if encoding != "ros2idl":
        return dict(get_types_from_msg(definition, name))
    if not definition.startswith(f"{_IDL_SEPARATOR}IDL: "):
        return dict(get_types_from_idl(definition))
    types: dict[str, Any] = {}
    for part in definition.split(_IDL_SEPARATOR)[1:]:
        types.update(get_types_from_idl(part.split("\n", 1)[1]))
    return types


@dataclass(frozen=True)
class _Extent:
    """Of a type: the least bytes of a value, and of an item of the lists of types or text in it (None: it has none)."""

    bytes: int
    item: int | None


def _extent(name: str, types: Mapping[str, Any], known: dict[str, _Extent | None]) -> _Extent:
    """Of a type; ValueError where it holds itself, its arrays are too long, or items of its lists take no bytes."""
    if name in known:
        if (extent := known[name]) is None:
            raise ValueError(f"type {name!r} holds itself")
        return extent
    known[name] = None
    if (
        sum(kind[1][1] for _, kind in types[name][1] if kind[0] == _ARRAY and not _is_plain(kind[1][0]))
        > _UNROLLED
    ):
        raise ValueError(f"type {name!r} has arrays of more than {_UNROLLED} parts")
    parts = [_field(kind, types, known) for _, kind in types[name][1]]
    items = [part.item for part in parts if part.item is not None]
    known[name] = extent = _Extent(sum(part.bytes for part in parts), min(items) if items else None)
    return extent


def _field(kind: Any, types: Mapping[str, Any], known: dict[str, _Extent | None]) -> _Extent:
    node, about = kind
    if node == _NAME:
        return _extent(about, types, known)
    if node == _BASE:
        bits = "".join(filter(str.isdigit, about[0]))  # of float64, 64; bool, byte and char take a byte
        return _Extent(4 if about[0] == "string" else int(bits or 8) // 8, None)
    inner, count = about
    one = _field(inner, types, known)
    least = count * one.bytes if node == _ARRAY else 4  # of a list, its length
    if _is_plain(inner):
        return _Extent(least, None)
    if one.bytes == 0:
        raise ValueError("a list has items of no bytes, of which there is no end")
    return _Extent(least, min(one.bytes, one.item or one.bytes))


def _is_plain(kind: Any) -> bool:
    """Numbers, which are read as one array."""
    return kind[0] == _BASE and kind[1][0] != "string"
