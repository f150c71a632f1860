"""CSV files: one row a sample, one column a signal, read block by block."""

import codecs
import csv as text_csv
import re
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import Any, BinaryIO

import pyarrow as pa

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.batches import Columns
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.numbers import EMPTY
from dynreg.data.series import RawLog
from dynreg.errors import LogError

BLOCK = 32 << 20  # bytes that are parsed at once
_COMMENT = re.compile(rb"#[^\r\n]*[\r\n]+(?=[^-+.\d\r\n])")


def read(file: LogFile, options: ReadOptions) -> RawLog:
    """Read a CSV file: comma, semicolon (then perhaps with decimal commas) or tab; a header, comments anywhere.

    Text columns are kept as labels. Raises LogError for a file that is none or is damaged.
    """
    texts: tuple[str, ...] = ()
    while True:
        table = Columns(file.path, Budget(file.name), options)
        try:
            with file.open() as stream:
                _gather(stream, table, texts)
        except (pa.ArrowException, text_csv.Error, UnicodeDecodeError) as error:
            raise LogError(
                f"{file.name!r} cannot be read as a table: {error}",
                expected="a header line and equally long rows",
                do="export the log again",
            ) from error
        if not table.mixed or texts:
            return table.log({})
        texts = table.mixed  # numbers at first, text further on: once more, as text from the beginning


def _gather(stream: BinaryIO, table: Columns, texts: tuple[str, ...]) -> None:
    """Add all rows to the table; `texts` are columns that are text though they begin with numbers."""
    from pyarrow import csv

    delimiter = ","
    for number, block in enumerate(_blocks(stream, table.budget)):
        if number == 0:
            header, block = _header(block)
            delimiter = _delimiter(header)
            table.point = "," if delimiter == ";" and _has_decimal_commas(block) else "."
            table.named(next(text_csv.reader([header], delimiter=delimiter), []))
        if not block.strip(b"\r\n"):
            continue
        rows = csv.read_csv(
            BytesIO(block),
            # One thread and one block: where a block ends must not decide a column's type.
            read_options=csv.ReadOptions(
                use_threads=False, block_size=len(block) + 1, column_names=list(table.names)
            ),
            parse_options=csv.ParseOptions(delimiter=delimiter, invalid_row_handler=_handler(block)),
            convert_options=csv.ConvertOptions(
                null_values=list(EMPTY),
                decimal_point=table.point,
                include_columns=list(table.wanted),
                column_types={name: pa.string() for name in texts},
            ),
        )
        table.add(rows)


def _handler(block: bytes) -> Callable[[Any], str] | None:
    """What decides on rows of another length; pyarrow writes a traceback where it cannot give it the row as text."""
    try:
        return _skip_comment if b"#" in block and block.decode() else None
    except UnicodeDecodeError:
        return None


def _skip_comment(row: Any) -> str:
    """What pyarrow is to do with a row of another length than the header's."""
    return "skip" if row.text.lstrip().startswith("#") else "error"


def _has_decimal_commas(block: bytes) -> bool:
    """Whether numbers are written "0,5" in cells, and none "0.5"."""
    numbers = re.findall(rb"(?:^|;)[ \"]*[-+]?\d*([.,])\d", block, re.MULTILINE)
    return bool(numbers) and set(numbers) == {b","}


def _blocks(stream: BinaryIO, budget: Budget) -> Iterator[bytes]:
    """The file in whole lines, of UTF-16 as UTF-8."""
    if stream.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        stream.seek(0)
        stream = codecs.EncodedFile(stream, "utf-8", "utf-16")
    else:
        stream.seek(0)
    while block := stream.read(BLOCK):
        if not block.endswith(b"\n"):
            rest = stream.readline(budget.allowed("chunk_bytes"))
            if len(rest) == budget.allowed("chunk_bytes"):
                budget.refuse("chunk_bytes", len(rest))
            block += rest
        yield block


def _header(block: bytes) -> tuple[str, bytes]:
    """The first line that is not empty, and what follows; a header that is not UTF-8 is Latin-1, as old tools write."""
    block = block.removeprefix(b"\xef\xbb\xbf").lstrip(b"\r\n")
    while _COMMENT.match(
        block
    ):  # "# time,q" right above the numbers is a header, other such lines are comments
        block = block[_COMMENT.match(block).end() :].lstrip(b"\r\n")
    end = found.start() if (found := re.search(rb"[\r\n]", block)) else len(block)
    try:
        return block[:end].decode("utf-8"), block[end:]
    except UnicodeDecodeError:
        return block[:end].decode("latin-1"), block[end:]


def _delimiter(header: str) -> str:
    return max(",;\t", key=header.count)
