"""Thrift's compact protocol, as far as the footer of Parquet needs it: bytes to plain trees and back.

A struct is a list of [field number, type, value]; a list is [type, [items]]. Format:
https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md
"""

import random
from copy import deepcopy
from typing import Any

from fuzzer.mutate import WHOLE, raw

_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY, _LIST, _SET, _MAP, _STRUCT = range(1, 13)


def decode(data: bytes, at: int = 0) -> tuple[list, int]:
    """The struct that begins at `at`, and where it ends."""
    fields, number = [], 0
    while data[at]:
        kind, step = data[at] & 15, data[at] >> 4
        at += 1
        if step:
            number += step
        else:
            number, at = _signed(data, at)
        value, at = _value(data, at, kind)
        fields.append([number, kind, value])
    return fields, at + 1


def encode(fields: list) -> bytes:
    """Bytes of a struct; whatever no longer fits the form is left out."""
    out = b""
    for field in fields:
        if (
            isinstance(field, list)
            and len(field) == 3
            and isinstance(field[0], int)
            and field[1] in range(1, 13)
        ):
            out += bytes([field[1]]) + _zigzag(field[0]) + _encoded(field[1], field[2])
    return out + b"\0"


def changed(rng: random.Random, fields: list) -> list:
    """A copy with some values exchanged for others of their kind, or items of lists left out or doubled."""
    fields = deepcopy(fields)
    leaves, lists = [], []
    _walk(fields, leaves, lists)
    for _ in range(rng.choice((1, 1, 2, 4))):
        if lists and rng.random() < 0.25:
            items = rng.choice(lists)
            at = rng.randrange(len(items) + 1)
            items[at : at + 1] = rng.choice(([], items[at : at + 1] * 2, items[at : at + 1] * 300))
        elif leaves:
            holder, at = rng.choice(leaves)
            holder[at] = _other(rng, holder[at])
    return fields


def _walk(fields: list, leaves: list, lists: list) -> None:
    for field in fields:
        number, kind, value = field
        if kind == _STRUCT:
            _walk(value, leaves, lists)
        elif kind in (_LIST, _SET):
            lists.append(value[1])
            if value[0] == _STRUCT:
                for item in value[1]:
                    _walk(item, leaves, lists)
            else:
                leaves += [(value[1], i) for i in range(len(value[1]))]
        elif kind > _FALSE:
            leaves.append((field, 2))


def _other(rng: random.Random, value: Any) -> Any:
    if isinstance(value, bytes):
        return raw(rng, value, 1)
    return rng.choice((value + 1, value - 1, -value, rng.choice(WHOLE), rng.randrange(16)))


def _value(data: bytes, at: int, kind: int) -> tuple[Any, int]:
    if kind in (_TRUE, _FALSE):
        return kind == _TRUE, at
    if kind in (_BYTE, _I16, _I32, _I64):
        return (data[at], at + 1) if kind == _BYTE else _signed(data, at)
    if kind == _DOUBLE:
        return data[at : at + 8], at + 8
    if kind == _BINARY:
        size, at = _varint(data, at)
        return data[at : at + size], at + size
    if kind in (_LIST, _SET):
        inner, size = data[at] & 15, data[at] >> 4
        at += 1
        if size == 15:
            size, at = _varint(data, at)
        items = []
        for _ in range(size):
            item, at = _value(data, at, inner) if inner > 2 else (data[at], at + 1)
            items.append(item)
        return [inner, items], at
    if kind == _STRUCT:
        return decode(data, at)
    raise ValueError(f"kind {kind}")


def _encoded(kind: int, value: Any) -> bytes:
    if kind == _STRUCT and isinstance(value, list):
        return encode(value)
    if kind in (_LIST, _SET) and isinstance(value, list) and len(value) == 2 and isinstance(value[1], list):
        inner = value[0] if value[0] in range(1, 13) else _I32
        items = b"".join(bytes([1]) if inner <= 2 else _encoded(inner, item) for item in value[1])
        return bytes([15 << 4 | inner]) + _unsigned(len(value[1])) + items
    if kind == _BINARY and isinstance(value, bytes):
        return _unsigned(len(value)) + value
    if kind in (_BYTE, _I16, _I32, _I64):
        number = value if isinstance(value, int) else 0
        return bytes([number % 256]) if kind == _BYTE else _zigzag(number)
    return value if kind == _DOUBLE and isinstance(value, bytes) else b""


def _varint(data: bytes, at: int) -> tuple[int, int]:
    number = shift = 0
    while True:
        number |= (data[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if not data[at - 1] & 0x80:
            return number, at


def _signed(data: bytes, at: int) -> tuple[int, int]:
    number, at = _varint(data, at)
    return number >> 1 ^ -(number & 1), at


def _zigzag(number: int) -> bytes:
    return _unsigned((number << 1) ^ (number >> 63) if -(2**63) <= number < 2**63 else number)


def _unsigned(number: int) -> bytes:
    number %= 2**64
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*out, number])
