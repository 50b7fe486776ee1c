"""Tables of text as loggers write them: any of the usual separators, decimals, encodings and compressions.

The first lines decide: the separator is the one that most lines have equally often, the heading is the first line of that
many fields, and a row of units below it is one without numbers.
"""

import csv
import re
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from studies.files.limits import check_values, limits, too_large
from studies.files.study_error import StudyError
from studies.logs.growing_column import GrowingColumn
from studies.logs.number_texts import decimal_of, numbers_of
from studies.logs.raw_channels import RawChannel, Recording
from studies.logs.text_encoding import encoding_of

COMPRESSED = {
    ".gz": "gzip",
    ".bz2": "bz2",
    ".zst": "zstd",
    ".lz4": "lz4",
    ".xz": "xz",
    ".zip": "zip",
}
"""Library's name of a compression by the ending of the file; a zip has one file."""
TEXT = (".csv", ".txt", ".tsv", ".asc", ".dat")
SEPARATORS = (";", "\t", ",", "|")
LOOKED_AT = 256 * 1024
"""Bytes of a file that decide how it is read."""
LOOKED_AT_ROWS = 400
"""Rows of them that decide the decimal sign."""
BLOCK = 4 * 1024 * 1024
"""Bytes of a file that are read at a time."""
LONGEST_LINE = BLOCK // 4
"""Bytes. A line without end would be as long as the file."""
TEXT_VALUE = 9
"""Numbers that take as much memory as a text of a few letters."""
MOST_SPOILT_BYTES = 10**8
"""Bytes of rows with another number of fields that are kept to be counted."""
MOST_SPOILT = 0.02
"""Share of rows with another number of fields above which a file is no table."""
NOTHING = [
    "", "NaN", "nan", "NAN", "NA", "N/A", "n/a", "#N/A", "null", "NULL", "None", "-", "--", "---", "INVALID", "invalid"
]  # fmt: skip
"""Texts for a missing value."""
BROKEN = re.compile(r"[+-]?\d*[.,]?\d+(?:[eE][+-]?\d+)?")
NUMBERS = (pa.types.is_integer, pa.types.is_floating, pa.types.is_null)
"""Kinds of columns that are read as floats; those that are told so are read in half of the time."""
IN_BRACKETS = re.compile(r"^[\[({<]?\s*(.*?)\s*[\])}>]?$")


class Layout(NamedTuple):
    """How a file is read."""

    encoding: str
    separator: str
    decimal: str
    names: list[str]
    units: list[str]
    """As many as names, "" where there is none."""
    skipped: int
    """Lines before the first row of values."""
    line: float
    """Mean length of a line [bytes]."""

    def rows_in(self, path: Path) -> int:
        """About how many rows a file has, rather more; 0 where it is compressed."""
        if path.suffix.lower() in COMPRESSED:
            return 0
        about = int(1.1 * path.stat().st_size / self.line) + 1000
        return min(about, limits().values // len(self.names))

    def reading(self) -> Any:
        """The library's options for lines."""
        return arrow_csv.ReadOptions(
            column_names=self.names,
            skip_rows=self.skipped,
            encoding=self.encoding,
            block_size=BLOCK,
        )

    def converting(self, kinds: dict[str, Any]) -> Any:
        """The library's options for values; `kinds` of columns that are known."""
        return arrow_csv.ConvertOptions(
            decimal_point=self.decimal, null_values=NOTHING, strings_can_be_null=True, column_types=kinds
        )  # fmt: skip


def is_text(path: Path) -> bool:
    """Whether a path is that of a table of text, compressed or not."""
    return path.suffix.lower() == ".zip" or _inner(path).suffix.lower() in TEXT


def _inner(path: Path) -> Path:
    return path.with_suffix("") if path.suffix.lower() in COMPRESSED else path


class _Watched:
    """A stream of text for the library; raises `StudyError` where it becomes more than is read."""

    closed = False

    def __init__(self, path: Path, owner: str, width: int) -> None:
        self.stream, self.owner, self.width = _stream(path), owner, width
        self.bytes, self.lines, self.line = 0, 0, 0

    def __enter__(self) -> Any:
        return pa.PythonFile(self, mode="r")

    def __exit__(self, *_: object) -> None:
        self.stream.close()

    def read(self, size: int) -> bytes:
        """As much as there is, `size` bytes at most."""
        block: bytes = self.stream.read(size)
        end = max(block.rfind(b"\n"), block.rfind(b"\r"))
        self.bytes += len(block)
        self.lines += max(block.count(b"\n"), block.count(b"\r"))
        self.line = len(block) - end - 1 + (self.line if end < 0 else 0)
        if self.line > LONGEST_LINE:
            raise StudyError(f"{self.owner} has a line of more than {LONGEST_LINE} bytes")
        if self.bytes > limits().text_bytes:
            raise too_large(self.owner, "text_bytes", "bytes of text")
        check_values(self.owner, self.lines * self.width)
        return block


def read_text_table(path: Path) -> Recording:
    """Read a table of text; raises `StudyError` naming the file for what is none, or is larger than the limits."""
    text = f"log {str(path)!r}"
    try:
        with _stream(path) as stream:
            head = stream.read(LOOKED_AT)
        layout = look_at(bytes(head), text)
        spoilt: set[str] = set()

        kept = 0

        def leave_out(row: Any) -> str:
            nonlocal kept
            kept += len(row.text or "")
            spoilt.add(row.text or "")
            return "skip" if kept < MOST_SPOILT_BYTES else "error"

        parsing = arrow_csv.ParseOptions(delimiter=layout.separator, invalid_row_handler=leave_out)
        try:
            columns = _in_blocks(path, text, layout, parsing)
        except pa.ArrowInvalid:
            # what the first lines say of a column does not hold for all of it
            spoilt.clear()
            kept = 0
            with _Watched(path, text, len(layout.names)) as stream:
                table = arrow_csv.read_csv(stream, layout.reading(), parsing, layout.converting({}))
            check_values(text, _weight(table))
            columns = {n: GrowingColumn(0) for n in layout.names}
            for k, name in enumerate(layout.names):
                columns[name].append(table.column(k).to_numpy())
    except OSError as error:
        raise StudyError(f"{text} cannot be read: {error.strerror or error}") from None
    except (pa.ArrowException, UnicodeError, csv.Error, EOFError, ValueError) as error:
        if isinstance(error, StudyError):
            raise
        reason = " ".join(str(error).split())
        raise StudyError(f"{text} is no table of csv: {reason}") from None
    notes = []
    lost = sum(max(len(row.splitlines()), 1) for row in spoilt)
    if lost:
        if lost > MOST_SPOILT * max(len(columns[layout.names[0]]), 1) + 1:
            raise StudyError(
                f"{text} is no table of csv: {lost} rows have another number of fields than the heading, or an open quote"
            )
        notes.append(f"{lost} row{'s' if lost > 1 else ''} with another number of fields left out")
    usual = layout.separator == "," and layout.decimal == "."
    if not usual:
        shown = {"\t": "tab"}.get(layout.separator, layout.separator)
        notes.append(f"separator {shown!r}, decimal {layout.decimal!r}")
    units = dict(zip(layout.names, layout.units, strict=True))
    decimal = layout.decimal
    channels = {n: RawChannel(n, units[n], _loader(columns, n, decimal)) for n in layout.names}
    return Recording(str(path), channels, notes)


def _weight(table: Any) -> int:
    """Values of a table or a part of it, each text as the numbers that take as much memory."""
    texts = [column for column in table.columns if pa.types.is_string(column.type)]
    many: int = table.num_rows * (table.num_columns + (TEXT_VALUE - 1) * len(texts))
    return many + sum(column.nbytes for column in texts) // 8


def _in_blocks(path: Path, owner: str, layout: Layout, parsing: Any) -> dict[str, GrowingColumn]:
    """Values of the columns, block by block, so that text and numbers of a long log are not held at once."""
    with _Watched(path, owner, len(layout.names)) as stream:
        schema = arrow_csv.open_csv(stream, layout.reading(), parsing, layout.converting({})).schema
    kinds = {
        name: pa.float64()
        for name, kind in zip(schema.names, schema.types, strict=True)
        if any(is_one(kind) for is_one in NUMBERS)
    }
    # an epoch of whole numbers has more digits than a float, and keeps its kind
    first = schema.names[0]
    if first in kinds and pa.types.is_integer(schema.field(first).type):
        del kinds[first]
    columns = [GrowingColumn(layout.rows_in(path)) for _ in layout.names]
    weight = 0
    with _Watched(path, owner, len(layout.names)) as stream:
        for batch in arrow_csv.open_csv(
            stream, layout.reading(), parsing, layout.converting(kinds)
        ):
            weight += _weight(batch)
            check_values(owner, weight)
            for column, values in zip(columns, batch.columns, strict=True):
                column.append(values.to_numpy(zero_copy_only=False))
    pa.default_memory_pool().release_unused()
    return dict(zip(layout.names, columns, strict=True))


def _loader(columns: dict[str, GrowingColumn], name: str, decimal: str) -> Any:
    """What gives the values of a column, and forgets them; numbers in the file's own writing become numbers."""

    def load() -> NDArray[Any]:
        column = columns.pop(name)
        values = column.values[: column.count]
        if values.dtype.kind != "O":
            return values
        found = numbers_of(values, decimal)
        if not found.words:
            return values if found.wrong is not None else found.values
        known = np.isfinite(found.values)
        values[known] = found.values[known]  # words stay, and are named where the channel is used
        return values

    return load


def of_arrow(table: pa.Table, source: str, units: dict[str, str], notes: list[str]) -> Recording:
    """A table of the library as a recording, whose columns go one by one."""
    columns = {name: table.column(k) for k, name in enumerate(table.column_names)}

    def loader(name: str) -> Any:
        # one reference alone, so that a column that is taken frees its memory
        return lambda: columns.pop(name).to_numpy()

    channels = {n: RawChannel(n, units.get(n, ""), loader(n)) for n in table.column_names}
    return Recording(source, channels, notes)


def look_at(head: bytes, text: str) -> Layout:
    """How a file that begins with `head` is read; raises `StudyError` with `text` for what is no table."""
    encoding = encoding_of(head)
    content = head.decode(encoding, errors="ignore").lstrip("\ufeff")
    lines = content.splitlines()
    whole = len(head) < LOOKED_AT
    if not whole:
        lines = lines[:-1]
    filled = [(k, line) for k, line in enumerate(lines) if line.strip() and line[0] not in "#%"]
    if len(filled) < 2 and not whole:
        raise StudyError(
            f"{text} is no table of csv: one of its first lines has more than {LOOKED_AT // 2} bytes"
        )
    if len(filled) == 1 and _separator([filled[0][1]])[0] in filled[0][1]:
        raise StudyError(f"{text}: 0 rows; give some to be analysed")
    if len(filled) < 2:
        raise StudyError(f"{text} is no table of csv: it has {len(filled)} lines")
    separator, width = _separator([line for _, line in filled])
    rows = [(k, _fields(line, separator)) for k, line in filled]
    heading = next(k for k, (_, row) in enumerate(rows) if len(row) == width)
    at, names = rows[heading]
    names = [name.strip() for name in names]
    if all(BROKEN.fullmatch(name) for name in names):
        raise StudyError(f"{text}: the first line has numbers; give every column a name")
    if names and not names[-1]:
        names[-1] = "unnamed"  # a separator at the end of every line
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise StudyError(f"{text}: column {double[0]!r} is there twice")
    units, skipped = [""] * width, at + 1
    below = rows[heading + 1 :]
    if len(below) > 1 and _is_units(below[0][1], below[1][1]):
        units = [IN_BRACKETS.sub(r"\1", cell.strip()) for cell in below[0][1]]
        skipped = below[0][0] + 1
        below = below[1:]
    decimal = "."
    if separator != ",":
        every = max(len(below) // LOOKED_AT_ROWS, 1)
        full = [row for _, row in below[::every] if len(row) == width]
        decimal = decimal_of([[row[k] for row in full] for k in range(width)])
    line = len(head) / max(len(content.splitlines()), 1)
    return Layout(encoding, separator, decimal, names, units, skipped, line)


def _stream(path: Path) -> Any:
    ending = path.suffix.lower()
    if ending == ".xz":
        import lzma

        return pa.PythonFile(lzma.open(path, "rb"), mode="r")
    if ending == ".zip":
        return pa.PythonFile(_of_zip(path), mode="r")
    return pa.input_stream(str(path), compression=COMPRESSED.get(ending))


def _of_zip(path: Path) -> Any:
    """The one table of text in a zip; raises `StudyError` for none or several."""
    from zipfile import BadZipFile, ZipFile

    try:
        archive = ZipFile(path)
        names = [n for n in archive.namelist() if Path(n).suffix.lower() in TEXT]
        if len(names) == 1:
            return archive.open(names[0])
    except (BadZipFile, RuntimeError, NotImplementedError) as error:
        raise StudyError(f"log {str(path)!r} is no file of zip that can be read: {error}") from None
    raise StudyError(
        f"log {str(path)!r} has {len(names)} tables of text ({', '.join(TEXT)}); pack one log alone"
    )


def _fields(line: str, separator: str) -> list[str]:
    return next(csv.reader([line], delimiter=separator), [])


def _separator(lines: list[str]) -> tuple[str, int]:
    """The separator, and the number of fields that most lines have."""
    best, found = (0, 0), ("", 1)
    for separator in SEPARATORS:
        counts = Counter(len(_fields(line, separator)) for line in lines[:400])
        width, times = counts.most_common(1)[0]
        # decimal commas come in other numbers from line to line, or between other separators
        if width > 1 and (times, width if separator != "," else 1) > best:
            best, found = (times, width if separator != "," else 1), (separator, width)
    return found if found[0] else (",", 1)


def _is_units(row: list[str], after: list[str]) -> bool:
    """Whether a row has units and the one after it numbers."""
    cells = [cell.strip() for cell in row]
    return (
        any(cells)
        and not any(BROKEN.fullmatch(c) for c in cells)
        and not any(re.match(r"\d{1,4}[-./:]\d", c) for c in cells)
        and any(BROKEN.fullmatch(cell.strip()) for cell in after)
    )
