"""A damaged MCAP is read as far as it goes, and says how many messages are gone."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from dynreg.data.readers import read_log
from dynreg.data.readers.mcap_walk import inflate
from dynreg.errors import LogError

TOTAL = 2000


def write(path: Path, compression: CompressionType, **options: object) -> bytes:
    noise = np.random.default_rng(1).normal(size=TOTAL)  # hardly compressible, so that chunks have some bytes
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=20_000, compression=compression, **options)
        writer.start()
        schema = writer.register_schema("thing", "jsonschema", b"{}")
        channel = writer.register_channel("/arm", "json", schema)
        for k in range(TOTAL):
            message = json.dumps({"k": k, "noise": f"{noise[k]:+.17f}", "v": float(f"{noise[k]:+.9f}")})
            writer.add_message(channel, k * 10**7, message.encode(), 0)
        writer.finish()
    return path.read_bytes()


def chunks_of(path: Path) -> list[ChunkIndex]:
    with path.open("rb") as file:
        return make_reader(file).get_summary().chunk_indexes


def spoil_a_chunk(path: Path) -> None:
    """Zeros over 64 bytes inside the data of the middle chunk."""
    middle = chunks_of(path)[4]
    data = bytearray(path.read_bytes())
    at = middle.chunk_start_offset + middle.chunk_length // 2
    data[at : at + 64] = bytes(64)
    path.write_bytes(data)


def numbers(finding: object) -> list[int]:
    return [int(n) for n in re.findall(r"\d+", finding.message)]


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("share", [0.02, 0.5, 0.98])
def test_truncated_inside_a_chunk(compression: CompressionType, share: float, tmp_path: Path):
    data = write(tmp_path / "whole.mcap", compression)
    chunk = chunks_of(tmp_path / "whole.mcap")[3]
    path = tmp_path / "cut.mcap"
    path.write_bytes(data[: chunk.chunk_start_offset + int(share * chunk.chunk_length)])
    log = read_log(path)
    values = log.sources["/arm.k"].values
    np.testing.assert_array_equal(values, np.arange(len(values)))  # a prefix, nothing invented
    assert len(values) >= chunk.message_start_time // 10**7  # the chunks before it are all there
    (finding,) = log.findings
    assert (finding.check, numbers(finding)[0]) == ("lost", len(values))
    assert "cut.mcap, byte" in finding.where and "whatever followed" in finding.message
    # The cut chunk's own loss is reckoned from its size: it ends where the next chunk would have begun.
    assert abs(len(values) + numbers(finding)[1] - 1 - chunk.message_end_time // 10**7) <= 3
    assert log.metadata["messages_lost"] is None


def test_truncated_between_chunks_says_that_the_number_is_unknown(tmp_path: Path):
    data = write(tmp_path / "whole.mcap", CompressionType.ZSTD)
    chunks = chunks_of(tmp_path / "whole.mcap")
    (tmp_path / "cut.mcap").write_bytes(data[: chunks[3].chunk_start_offset])
    log = read_log(tmp_path / "cut.mcap")
    assert log.metadata["messages_read"] == chunks[3].message_start_time // 10**7
    assert "an unknown number lost" in log.findings[0].message


def test_reckoned_loss_of_the_cut_chunk_is_right(tmp_path: Path):
    data = write(tmp_path / "whole.mcap", CompressionType.NONE)
    # Cut inside the last chunk, whose end is where the data ends: the count is then known exactly.
    at = data.rindex(b'"k": 1950')
    (tmp_path / "cut.mcap").write_bytes(data[:at])
    read, lost = numbers(read_log(tmp_path / "cut.mcap").findings[0])[:2]
    assert read == 1950
    assert abs(lost - 50) <= 1


def test_metadata_beside_the_file_makes_the_count_exact(tmp_path: Path):
    data = write(tmp_path / "run.mcap", CompressionType.ZSTD)
    (tmp_path / "run.mcap").write_bytes(data[: len(data) // 2])
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n"
        f"  relative_file_paths: [run.mcap]\n  message_count: {TOTAL}\n"
    )
    for path in (tmp_path / "run.mcap", tmp_path):
        log = read_log(path)
        assert log.metadata["messages_read"] + log.metadata["messages_lost"] == TOTAL
        assert f"{log.metadata['messages_lost']} lost of {TOTAL}" in log.findings[0].message


@pytest.mark.parametrize("compression", list(CompressionType))
def test_damage_in_the_middle_loses_one_chunk_only(compression: CompressionType, tmp_path: Path):
    write(tmp_path / "hurt.mcap", compression)
    spoil_a_chunk(tmp_path / "hurt.mcap")
    log = read_log(tmp_path / "hurt.mcap")
    assert log.metadata["messages_read"] > TOTAL - 300
    assert log.metadata["messages_read"] + log.metadata["messages_lost"] == TOTAL
    assert log.sources["/arm.k"].values[-1] == TOTAL - 1
    assert log.findings[0].severity == "warning"


def test_indexes_count_the_loss_without_a_summary(tmp_path: Path):
    write(tmp_path / "hurt.mcap", CompressionType.ZSTD, use_statistics=False)
    spoil_a_chunk(tmp_path / "hurt.mcap")
    log = read_log(tmp_path / "hurt.mcap")
    assert log.metadata["messages_read"] + log.metadata["messages_lost"] == TOTAL


def test_cut_in_the_summary_loses_nothing(tmp_path: Path):
    data = write(tmp_path / "whole.mcap", CompressionType.ZSTD)
    (tmp_path / "cut.mcap").write_bytes(data[:-20])
    assert read_log(tmp_path / "cut.mcap").metadata["messages_read"] == TOTAL


def test_a_record_length_of_the_moon_is_not_believed(tmp_path: Path):
    data = write(tmp_path / "whole.mcap", CompressionType.NONE, use_chunking=False)
    at = data.index(b"\x05", 3 * len(data) // 10)
    broken = data[:at] + b"\x05" + (2**62).to_bytes(8, "little") + data[at + 9 :]
    (tmp_path / "moon.mcap").write_bytes(broken)
    log = read_log(tmp_path / "moon.mcap")
    assert 0 < log.metadata["messages_read"] < TOTAL
    assert log.findings[0].check == "lost"


def test_nothing_left(tmp_path: Path):
    data = write(tmp_path / "whole.mcap", CompressionType.ZSTD)
    (tmp_path / "cut.mcap").write_bytes(data[:60])
    with pytest.raises(LogError, match="mcap recover"):
        read_log(tmp_path / "cut.mcap")


def test_inflate_never_gives_more_than_stated():
    import zstandard

    bomb = zstandard.compress(bytes(50_000_000))
    assert inflate("zstd", bomb, 1000) == (bytes(1000), None)
    assert inflate("middle-out", b"abc", 3)[0] == b""
