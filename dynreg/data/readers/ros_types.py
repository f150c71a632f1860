"""Decoders of ROS messages, built from the definition that the log itself carries."""

from collections.abc import Callable
from typing import Any

Decode = Callable[[bytes], Any]

_MAX_SEQUENCE = 1 << 26  # a corrupt length must not ask for the machine's memory
_IDL_SEPARATOR = "=" * 80 + "\n"


def ros_decoder(name: str, definition: str, schema_encoding: str, message_encoding: str) -> Decode | None:
    """A decoder for one message type, or None where the pair of encodings is not ROS.

    `schema_encoding` is ros1msg, ros2msg or ros2idl; `message_encoding` ros1 or cdr.
    Raises rosbags' TypesysError for a definition that cannot be parsed.
    """
    if message_encoding not in ("ros1", "cdr") or schema_encoding not in ("ros1msg", "ros2msg", "ros2idl"):
        return None
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    from rosbags.typesys.msg import normalize_msgtype

    name = normalize_msgtype(name)
    types: dict[str, Any] = {}
    if schema_encoding != "ros2idl":
        types.update(get_types_from_msg(definition, name))
    elif not definition.startswith(f"{_IDL_SEPARATOR}IDL: "):
        types.update(get_types_from_idl(definition))
    else:
        for part in definition.split(_IDL_SEPARATOR)[1:]:
            types.update(get_types_from_idl(part.split("\n", 1)[1]))
    store = get_typestore(Stores.EMPTY)
    store.max_sequence_length = _MAX_SEQUENCE
    known = get_typestore(Stores.ROS2_HUMBLE).fielddefs
    # Some writers leave out the definitions of time stamps, which every ROS 2 installation has.
    for stamp in ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"):
        types.setdefault(stamp, known[stamp])
    store.register(types)
    if message_encoding == "ros1":
        return lambda data: store.deserialize_ros1(data, name)
    return lambda data: store.deserialize_cdr(data, name)
