"""NumPy's .npz files: an archive of arrays, of which bytes, headers or sizes are wrong."""

import io
import random
import struct
import zipfile

from fuzzer.formats.logs import read_and_use
from fuzzer.mutate import ODD_TEXT, raw, text
from fuzzer.target import Target

_KINDS = ("<f8", ">f4", "<i8", "|u1", "<U3", "|O", "<M8[ns]", "|V4", "<c16")


def make_npz(rng: random.Random) -> bytes:
    """An archive of a time and up to three arrays."""
    out = io.BytesIO()
    rows = rng.choice((1, 5, 5, 24))
    packed = rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2))
    with zipfile.ZipFile(out, "w", packed) as archive:
        put = lambda name, data: archive.writestr(zipfile.ZipInfo(name), data, packed)  # noqa: E731  of no date
        put("time.npy", _array(rng, "<f8", (rows,), True))
        for k in range(rng.randrange(4)):
            shape = rng.choice(((rows,), (rows, 2), (2, rows), (), (3,), (0,), (2**40, 2**40), (-1,)))
            name = rng.choice((f"q{k}", "kp", "time", rng.choice(ODD_TEXT)))
            name = name.encode("utf-8", "replace").decode().replace("\0", "0")
            put(f"{name}.npy", _array(rng, rng.choice(_KINDS), shape, rng.random() < 0.8))
    data = out.getvalue()
    return raw(rng, data) if rng.random() < 0.4 else data


def _array(rng: random.Random, kind: str, shape: tuple[int, ...], sound: bool) -> bytes:
    header = str({"descr": kind, "fortran_order": rng.random() < 0.3, "shape": shape})
    if not sound:
        header = text(rng, header)
    count = 1
    for n in shape:
        count *= min(abs(n), 24)
    numbers = struct.pack(f"<{count}d", *(k / 4 for k in range(count)))
    version = b"\x01\x00" if sound else rng.choice((b"\x01\x00", b"\x02\x00", b"\x09\x00"))
    length = struct.pack("<H" if version[0] == 1 else "<I", len(header.encode("utf-8", "replace")) + 1)
    head = b"\x93NUMPY" + version + length + header.encode("utf-8", "replace") + b"\n"
    return head + (raw(rng, numbers) if rng.random() < 0.2 else numbers)


TARGETS = (Target("npz", make_npz, lambda data: read_and_use(data, "run.npz")),)
