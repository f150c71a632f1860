"""Changes of bytes, of text and of trees of plain values; the formats put them together."""

import random
from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any

Rng = random.Random

WHOLE = (
    0,
    1,
    2,
    3,
    7,
    8,
    15,
    16,
    63,
    64,
    65,
    127,
    128,
    255,
    256,
    1000,
    4095,
    4096,
    65535,
    65536,
    10**6,
    2**24,
)
WHOLE += (2**26, 2**28, 2**30, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**53, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
ODD_WHOLE = (*WHOLE, *(-n for n in WHOLE[1:]), 2**64, 10**30, 10**308, 10**309, -(10**400))
ODD_REAL = (
    0.0,
    -0.0,
    1e-320,
    1e-12,
    1e12,
    1e18,
    1.7e308,
    -1.7e308,
    float("inf"),
    float("-inf"),
    float("nan"),
)
ODD_TEXT = (
    "", " ", "a", "time", "nan", "inf", "1e999", "true", "null", "0x10", "\x00", "\x1b[31mred\x1b[0m", "a\nb",
    "\r", "\u202e", "\x85", "\u2028", "\ud800", "é", "日本", "../x", "/etc/passwd", "{0.__class__}", "%s%n",
    "a" * 300, "[0]", "a[0]", "a/b", "a.b", ".", "..", "__class__", "1_000", "١٢",
)  # fmt: skip


def odd(rng: Rng, flat: bool = False) -> Any:
    """A plain value that hardly anyone expects; `flat`: none with others inside."""
    kind = rng.randrange(4 if flat else 8)
    if kind == 0:
        return rng.choice(ODD_WHOLE)
    if kind == 1:
        return rng.choice(ODD_REAL)
    if kind == 2:
        return rng.choice(ODD_TEXT)
    if kind == 3:
        return rng.choice((None, True, False, [], {}, [[]], [None], {"": None}))
    if kind == 4:
        return [odd(rng, flat=True) for _ in range(rng.choice((1, 2, 3, 65)))]
    if kind == 5:
        return {rng.choice(ODD_TEXT): odd(rng, flat=True) for _ in range(rng.randrange(4))}
    if kind == 6:
        return nested(rng.choice((3, 17, 64, 150)), rng.choice(("list", "dict")))
    return rng.uniform(-10, 10)


def nested(depth: int, kind: str) -> Any:
    """1.0 inside so many lists or objects."""
    value: Any = 1.0
    for _ in range(depth):
        value = [value] if kind == "list" else {"n": value}
    return value


def tree(rng: Rng, value: Any, times: int | None = None) -> Any:
    """A copy of a tree of dicts and lists with some of its nodes changed."""
    value = deepcopy(value)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6)) if times is None else times):
        value = _at_a_node(rng, value)
    return value


def _at_a_node(rng: Rng, value: Any) -> Any:
    if not isinstance(value, dict | list) or not value or rng.random() < 0.08:
        return _scalar(rng, value)
    key = rng.choice(list(value)) if isinstance(value, dict) else rng.randrange(len(value))
    if isinstance(value[key], dict | list) and value[key] and rng.random() < 0.75:
        value[key] = _at_a_node(rng, value[key])
        return value
    act = rng.randrange(7)
    if act == 0:
        del value[key]
    elif act == 1 and isinstance(value, dict):
        value[rng.choice(ODD_TEXT)] = value.pop(key)
    elif act == 2 and isinstance(value, dict):
        value[rng.choice(ODD_TEXT)] = odd(rng)
    elif act == 2:
        value.insert(key, odd(rng))
    elif act == 3 and isinstance(value, dict):
        value[key] = deepcopy(value[rng.choice(list(value))])
    elif act == 3:
        value.extend(deepcopy(value[key:]) * rng.choice((1, 2, 30)))
    else:
        value[key] = _scalar(rng, value[key])
    return value


def _scalar(rng: Rng, value: Any) -> Any:
    """Something in place of a value: often one of its own kind."""
    act = rng.randrange(4)
    if act == 0 or value is None:
        return odd(rng)
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return rng.choice(
            (
                value + 1,
                value - 1,
                -value,
                value * 1000,
                rng.choice(ODD_WHOLE),
                value / 7 if abs(value) < 2**63 else 0,
            )
        )
    if isinstance(value, float):
        return rng.choice((-value, value * 1e3, rng.choice(ODD_REAL), rng.uniform(-10, 10)))
    if isinstance(value, str):
        return text(rng, value)
    if isinstance(value, bytes):
        return raw(rng, value)
    return [value] if act == 1 else odd(rng)


def text(rng: Rng, value: str, words: Sequence[str] = ODD_TEXT) -> str:
    """Text with a piece taken out, put in, doubled, or exchanged for one of `words`."""
    at = rng.randrange(len(value) + 1)
    end = min(len(value), at + rng.choice((0, 1, 2, 5, 20)))
    act = rng.randrange(4)
    if act == 0:
        return value[:at] + value[end:]
    if act == 1:
        return value[:end] + value[at:]
    if act == 2:
        return value[:at] + str(rng.choice(words)) + value[end:]
    return (
        value[:at]
        + chr(rng.choice((0, 9, 10, 13, 27, 34, 39, 44, 91, 92, 93, 123, 125, 0xFEFF, 0x1F600)))
        + value[at:]
    )


def lines(rng: Rng, value: str, words: Sequence[str], mark: str = "\n") -> str:
    """Text of lines with some of them changed, moved, doubled or left out."""
    rows = value.split(mark)
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        at = rng.randrange(len(rows))
        act = rng.randrange(7)
        if act == 0 and len(rows) > 1:
            del rows[at]
        elif act == 1:
            rows[at:at] = [rows[at]] * rng.choice((1, 1, 2, 40))
        elif act == 2:
            rows.insert(rng.randrange(len(rows) + 1), rows.pop(at))
        else:
            rows[at] = text(rng, rows[at], words)
    return mark.join(rows)


def raw(rng: Rng, data: bytes, times: int | None = None) -> bytes:
    """Bytes with some of them flipped, taken out, put in, doubled or written over by an odd number."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4, 16)) if times is None else times):
        at = rng.randrange(len(out) + 1)
        rng.choice(_BYTES)(rng, out, at)
    return bytes(out)


def _flip(rng: Rng, out: bytearray, at: int) -> None:
    if at < len(out):
        out[at] ^= 1 << rng.randrange(8)


def _set(rng: Rng, out: bytearray, at: int) -> None:
    if at < len(out):
        out[at] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))


def _number(rng: Rng, out: bytearray, at: int) -> None:
    size = rng.choice((1, 2, 4, 8))
    number = rng.choice(WHOLE) % (1 << (8 * size))
    out[at : at + size] = number.to_bytes(size, rng.choice(("little", "big")))


def _drop(rng: Rng, out: bytearray, at: int) -> None:
    del out[at : at + rng.choice((1, 2, 4, 8, 64, 1000))]


def _cut(rng: Rng, out: bytearray, at: int) -> None:
    if rng.random() < 0.3:
        del out[at:]


def _double(rng: Rng, out: bytearray, at: int) -> None:
    length = rng.choice((1, 4, 8, 64, 1000))
    out[at:at] = out[at : at + length]


def _put(rng: Rng, out: bytearray, at: int) -> None:
    out[at:at] = rng.randbytes(rng.choice((1, 2, 4, 8, 64)))


def _move(rng: Rng, out: bytearray, at: int) -> None:
    other, length = rng.randrange(len(out) + 1), rng.choice((1, 4, 8, 64))
    out[at : at + length] = out[other : other + length]


_BYTES: tuple[Callable[[Rng, bytearray, int], None], ...]
_BYTES = (_flip, _flip, _set, _number, _number, _drop, _cut, _double, _put, _move)
