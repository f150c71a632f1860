"""Protobuf: descriptors of types that a file brings along (recursive, wide, of odd names), and messages of them."""

import random

from fuzzer.formats.topic import Topic
from fuzzer.mutate import ODD_TEXT, WHOLE, raw


def protobuf_topic(rng: random.Random) -> Topic:
    """A topic whose type is drawn: up to four types that may hold each other, and messages of many forms."""
    schema, names = descriptor(rng)
    if rng.random() < 0.15:
        schema = raw(rng, schema)
    messages = tuple(_message(rng, 0) for _ in range(rng.choice((1, 3))))
    return Topic("/a", f"fuzz.{rng.choice(names)}", "protobuf", schema, "protobuf", messages)


def descriptor(rng: random.Random) -> tuple[bytes, list[str]]:
    """A FileDescriptorSet and the names of its types."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet

    file = FileDescriptorProto(name="fuzz.proto", package="fuzz", syntax=rng.choice(("proto3", "proto2")))
    names = [f"T{i}" for i in range(rng.choice((1, 1, 2, 4)))]
    for name in names:
        kind = file.message_type.add(name=name)
        for number in range(1, rng.choice((2, 4, 6, 20))):
            field = kind.field.add(name=_name(rng, number), number=_number(rng, number))
            field.label = rng.choice((1, 1, 1, 3))
            field.type = rng.choice((1, 1, 2, 3, 4, 5, 6, 8, 9, 11, 11, 12, 13, 16, 17, 18))
            if field.type == FieldDescriptorProto.TYPE_MESSAGE:
                field.type_name = f".fuzz.{rng.choice(names)}"
    return FileDescriptorSet(file=[file]).SerializeToString(), names


def _name(rng: random.Random, number: int) -> str:
    usual = ("x", "header", "stamp", "sec", "nanosec", "name", "position", "seconds", "nanos")
    if rng.random() < 0.02:
        return rng.choice(ODD_TEXT).encode("ascii", "replace").decode()
    return f"{rng.choice(usual)}{number}" if rng.random() < 0.4 else f"f{number}"


def _number(rng: random.Random, number: int) -> int:
    return rng.choice(WHOLE[:16]) if rng.random() < 0.02 else number


def _message(rng: random.Random, depth: int) -> bytes:
    """A message on the wire: tags of small numbers, lengths that mostly hold."""
    out = b""
    for _ in range(rng.choice((0, 1, 2, 4, 8))):
        number, wire = rng.randrange(1, 7), rng.choice((0, 1, 2, 2, 5))
        out += varint(number << 3 | wire)
        if wire == 0:
            out += varint(rng.choice(WHOLE))
        elif wire == 2:
            inner = (
                _message(rng, depth + 1)
                if depth < 4 and rng.random() < 0.5
                else rng.randbytes(rng.choice((0, 8, 16)))
            )
            out += varint(len(inner) if rng.random() < 0.97 else rng.choice(WHOLE)) + inner
        else:
            out += rng.randbytes(8 if wire == 1 else 4)
    return out


def varint(number: int) -> bytes:
    """A whole number in groups of seven bits."""
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*out, number])
