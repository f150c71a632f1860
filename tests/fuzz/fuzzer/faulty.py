"""An encoder of binary fields that now and then writes something else than it was told."""

import random
import struct

from fuzzer.mutate import ODD_TEXT, WHOLE, raw


class Faulty:
    """Numbers, texts and blocks as bytes; each field is wrong with the probability `rate`."""

    def __init__(self, rng: random.Random, rate: float, order: str = "<"):
        self.rng = rng
        self.rate = rate
        self.order = order

    def slips(self, times: float = 1.0) -> bool:
        """Whether this field is to be wrong."""
        return self.rng.random() < self.rate * times

    def whole(self, kind: str, value: int) -> bytes:
        """A whole number of a kind of `struct`: B, H, I, Q."""
        bits = 8 * struct.calcsize(self.order + kind)
        if self.slips():
            value = self.rng.choice(
                (self.rng.choice(WHOLE), value + 1, value - 1, self.rng.getrandbits(bits))
            )
        return (value % (1 << bits)).to_bytes(bits // 8, "little" if self.order == "<" else "big")

    def block(self, kind: str, data: bytes) -> bytes:
        """Bytes behind their length."""
        if self.slips(0.5):
            data = raw(self.rng, data)
        return self.whole(kind, len(data)) + data

    def text(self, value: str, kind: str = "I") -> bytes:
        """Text in UTF-8 behind its length."""
        if self.slips():
            value = self.rng.choice(ODD_TEXT)
        return self.block(kind, value.encode("utf-8", "surrogatepass"))


def rate_of(rng: random.Random) -> float:
    """How often the fields of one input are wrong: mostly seldom, so that what follows them is reached."""
    return rng.choice((0.0, 0.003, 0.01, 0.03, 0.1))
