"""Messages of ROS 1 and 2: definitions as text, drawn and changed, and bytes that were serialised by them."""

import random
import struct
from functools import lru_cache

from fuzzer.formats.topic import Topic
from fuzzer.mutate import WHOLE, lines, raw

_PLAIN = (
    "float64",
    "float32",
    "int32",
    "uint8",
    "bool",
    "int64",
    "string",
    "byte",
    "char",
    "uint16",
    "wstring",
)
_SHAPES = ("", "", "", "[]", "[3]", "[<=4]", "[0]", "[65]", "[2147483647]")
_WORDS = (
    *_PLAIN, *_SHAPES, "time", "duration", "Header", "std_msgs/Header", "pkg/T", "pkg/msg/T", "pkg/A", "x",
    "# note", "int32 X=3", "string S=a", "float64 v 1.5", "=" * 80, "MSG: pkg/A", "MSG: pkg/T", "[4294967296]",
    "string<=3", "\t", "int32[4096]", "pkg/A[4096]", "pkg/A[]",
)  # fmt: skip
_HEADER = "=" * 80 + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
_TIME = "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_IDL = """\
module pkg { module msg {
  struct A { double y; sequence<double> ys; };
  struct T { double x; sequence<double, 4> xs; double fixed[3]; pkg::msg::A inner; string name; boolean on; };
}; };
"""
_IDL_WORDS = (
    "double", "float", "long", "unsigned long", "octet", "sequence<double>", "sequence<pkg::msg::T>", "[3]",
    "[4096]", "pkg::msg::T", "pkg::msg::A", "struct", "module", "const long C = 3;", "enum", "union", "typedef",
    ";", "{", "}", "<", ">", "@key", "#include", "//", "/*", "*/", "string<3>", "wstring",
    "sequence<sequence<double>>", "[2147483647]", '"',
)  # fmt: skip


def msg2_topic(rng: random.Random) -> Topic:
    """ROS 2: a definition in .msg form, messages in CDR."""
    definition, stamped = _definition(rng, _HEADER + _TIME)
    messages = tuple(_cdr(rng, k, stamped) for k in range(3))
    return Topic("/a", "pkg/msg/T", "ros2msg", definition.encode("utf-8", "replace"), "cdr", messages)


def msg1_topic(rng: random.Random) -> Topic:
    """ROS 1: the same with the header of ROS 1, messages without padding."""
    header = "=" * 80 + "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    definition, stamped = _definition(rng, header)
    messages = tuple(_ros1(rng, k, stamped) for k in range(3))
    return Topic("/a", "pkg/T", "ros1msg", definition.encode("utf-8", "replace"), "ros1", messages)


def idl_topic(rng: random.Random) -> Topic:
    """ROS 2: a definition in OMG IDL."""
    definition = _IDL
    if rng.random() < 0.7:
        definition = lines(rng, definition, _IDL_WORDS, rng.choice(("\n", " ")))
    if rng.random() < 0.3:
        definition = "=" * 80 + "\nIDL: pkg/msg/T\n" + definition
    messages = tuple(_cdr(rng, k, False) for k in range(3))
    return Topic("/a", "pkg/msg/T", "ros2idl", definition.encode("utf-8", "replace"), "cdr", messages)


def _definition(rng: random.Random, header: str) -> tuple[str, bool]:
    """A definition of type T, drawn from fields or a usual one changed; whether it begins with a header."""
    stamped = rng.random() < 0.5
    fields = ["std_msgs/Header header"] if stamped else []
    for k in range(rng.choice((1, 2, 4))):
        kind = "pkg/A" if rng.random() < 0.2 else rng.choice(_PLAIN)
        fields.append(
            f"{kind}{rng.choice(_SHAPES)} {rng.choice(('x', 'position', 'name', 'velocity'))}{k or ''}"
        )
    told = "\n".join(fields) + "\n" + (header if stamped else "")
    if "pkg/A" in told:
        inner = rng.choice(
            ("float64 y\n", "pkg/A[4096] y\n", "pkg/T t\n", "float64[4096] y\n", "pkg/B b\n", "")
        )
        told += "=" * 80 + f"\nMSG: pkg/A\n{inner}"
    return (lines(rng, told, _WORDS) if rng.random() < 0.4 else told), stamped


def _cdr(rng: random.Random, k: int, stamped: bool) -> bytes:
    head = (
        struct.pack("<4BiII4s", 0, 1, 0, 0, 1700000000, k * 1000, 2, b"a\0\0\0") if stamped else b"\0\1\0\0"
    )
    return _body(rng, head)


def _ros1(rng: random.Random, k: int, stamped: bool) -> bytes:
    return _body(rng, struct.pack("<IIIII1s", k, 1700000000, k * 1000, 1, 1, b"a") if stamped else b"")


def _body(rng: random.Random, head: bytes) -> bytes:
    """Doubles, or lengths with doubles behind them: much of it fits one definition or the other."""
    numbers = [rng.uniform(-3, 3) for _ in range(rng.choice((1, 4, 16, 80)))]
    count = len(numbers) if rng.random() < 0.7 else rng.choice(WHOLE) % 2**32
    sized = rng.random() < 0.5
    data = (
        head + (struct.pack("<II", count, 0) if sized else b"") + struct.pack(f"<{len(numbers)}d", *numbers)
    )
    return raw(rng, data) if rng.random() < 0.3 else data


@lru_cache(maxsize=64)
def digest(definition: str) -> bytes:
    """The md5sum by which ROS 1 knows the type of this definition; of one that cannot be parsed, zeros."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if len(definition) > 2000 or "4096" in definition or "2147483647" in definition:
        return b"0" * 32  # it would take as long as the reader under trial
    try:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(definition, "pkg/msg/T"))
        return store.generate_msgdef("pkg/msg/T", ros_version=1)[1].encode()
    except Exception:
        return b"0" * 32


def sound_topic() -> Topic:
    """Three messages of one number each, as they should be."""
    messages = tuple(struct.pack("<4Bd", 0, 1, 0, 0, k / 4) for k in range(3))
    return Topic("/a", "pkg/msg/T", "ros2msg", b"float64 x\n", "cdr", messages)
