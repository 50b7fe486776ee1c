"""Files of recorders as channels: tables of text, parquet, MDF 3 and 4 (asammdf), TDMS (npTDMS), MATLAB's (SciPy, h5py).

Nothing is interpreted here but writing. The first lines of a text decide: the separator is the one that most lines have
equally often, the heading is the first line of that many fields, and a row of units below it is one without numbers.
"""

import codecs
import csv
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv
from pyarrow import parquet

from studies.files.limits import check_parquet, check_values, limits, too_large
from studies.files.study_error import StudyError

Floats = NDArray[np.float64]

COMPRESSED = {".gz": "gzip", ".bz2": "bz2", ".zst": "zstd", ".lz4": "lz4", ".xz": "xz", ".zip": "zip"}  # fmt: skip
"""Library's name of a compression by the ending of the file; a zip has one file."""
TEXT = (".csv", ".txt", ".tsv", ".asc", ".dat")
SEPARATORS = (";", "\t", ",", "|")
LOOKED_AT = 256 * 1024
"""Bytes of a text that decide how it is read."""
LOOKED_AT_ROWS = 400
"""Rows of them that decide separator and decimal sign."""
BLOCK = 4 * 1024 * 1024
"""Bytes of a text that are read at a time."""
LONGEST_LINE = BLOCK // 4
"""Bytes. A line without end would be as long as the file."""
TEXT_VALUE = 9
"""Numbers that take as much memory as a text of a few letters."""
MOST_SPOILT = 0.02
"""Share of rows with another number of fields above which a file is no table."""
NOTHING = [
    "", "NaN", "nan", "NAN", "NA", "N/A", "n/a", "#N/A", "null", "NULL", "None", "-", "--", "---", "INVALID", "invalid"
]  # fmt: skip
"""Texts for a missing value."""
PLAIN = re.compile(r"[+-]?\d*[.,]?\d+(?:[eE][+-]?\d+)?")
GROUP_SIGNS = re.compile(r"(?<=\d)['’\u00a0\u202f\u2009 ](?=\d{3}(?!\d))")
"""Signs between groups of three digits that are nothing else; a comma or a point may be the decimal sign."""
GROUPED = {sign: re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:{re.escape(sign)}\d{{3}})+") for sign in ",."}
NUMBER = {
    sign: re.compile(
        rf"([+-]?(?:\d*|[1-9]\d{{0,2}}(?:{re.escape(other)}\d{{3}})+))(?:{re.escape(sign)}(\d*))?(?:[eEdD]([+-]?\d+))?"
    )
    for sign, other in ((",", "."), (".", ","))
}
"""A number by its decimal sign, Fortran's exponents included."""
CLOCK_NAMES = ("time", "t", "timestamp", "zeit")
"""Fields of a MATLAB struct that are the clock of the others."""
VALUE_NAMES = ("data", "value", "values", "samples", "signals")
UNIT_NAMES = ("unit", "units")


# ------------------------------------------------------------------------------------------------------------- channels


@dataclass(frozen=True)
class RawChannel:
    """One channel of a file."""

    name: str
    unit: str
    """As the file states it, "" where it does not."""
    load: Callable[[], NDArray[Any]]
    """Its values: numbers, time stamps or texts."""
    clock: Floats | None = None
    """Its own instants [s]; None: those of the rows."""


@dataclass
class Recording:
    """A file of a log; a channel that is taken is gone, so that a long log is not held twice."""

    source: str
    channels: dict[str, RawChannel]
    notes: list[str] = field(default_factory=list)
    """What was done to read it."""

    @property
    def units(self) -> dict[str, str]:
        """Unit by name, "" where the file states none."""
        return {name: channel.unit for name, channel in self.channels.items()}

    def take(self, name: str) -> NDArray[Any]:
        """The values of a channel, and forget them."""
        return self.channels.pop(name).load()


def recording_of(
    table: pd.DataFrame, source: str, units: dict[str, str] | None = None
) -> Recording:
    """A table in memory as a recording."""
    columns = {str(name): table.iloc[:, k] for k, name in enumerate(table.columns)}
    return _by_column(columns, source, units or {}, [])


def _by_column(
    columns: Mapping[str, Any], source: str, units: dict[str, str], notes: list[str], decimal: str = "."
) -> Recording:  # fmt: skip
    """Columns of pandas or arrow as a recording; each is held by its channel alone."""
    loads = {name: lambda c=column: _values(c.to_numpy(), decimal) for name, column in columns.items()}  # fmt: skip
    channels = {n: RawChannel(n, units.get(n, ""), load) for n, load in loads.items()}
    return Recording(source, channels, notes)


def _values(values: NDArray[Any], decimal: str) -> NDArray[Any]:
    """Texts that are numbers in the file's own writing as such; words stay, and are named where the channel is used."""
    if values.dtype.kind != "O":
        return values
    found = numbers_of(values, decimal)
    if not found.words:
        return values if found.wrong is not None else found.values
    return np.where(np.isfinite(found.values), found.values.astype(object), values)


def is_text(path: Path) -> bool:
    """Whether a path is that of a table of text, compressed or not."""
    ending = path.suffix.lower()
    inner = path.with_suffix("") if ending in COMPRESSED else path
    return ending == ".zip" or inner.suffix.lower() in TEXT


def read_recording(path: Path) -> Recording:
    """Read a file of a log; raises `StudyError` naming the file where it cannot be read, and the package that is missing."""
    owner, ending = f"log {str(path)!r}", path.suffix.lower()
    read = _text_table if is_text(path) else READERS.get(ending)
    if read is None:
        raise StudyError(
            f"{owner}: ending {ending!r} must be .csv or .parquet, or one of {', '.join(sorted(ENDINGS))}; text may be "
            f"compressed ({', '.join(COMPRESSED)})"
        )
    if not path.is_file():
        raise StudyError(f"{owner} does not exist")
    try:
        return read(path, owner)
    except StudyError:
        raise
    except OSError as error:
        raise StudyError(f"{owner} cannot be read: {error.strerror or error}") from None
    except Exception as error:  # libraries of formats raise what they like
        reason = " ".join(str(error).split()) or type(error).__name__
        what = f"file of {ending[1:]}"
        if read in (_text_table, _parquet):
            what = "table of csv" if read is _text_table else "table of parquet"
        raise StudyError(f"{owner} is no {what}: {reason}") from None


def _library(name: str, package: str, path: Path, what: str = "") -> ModuleType:
    """A library of the extra `logs`; raises `StudyError` where it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        raise StudyError(
            f"log {str(path)!r}: reading {what or path.suffix} needs the package {package}; install it with "
            "`pip install -e '.[logs]'`"
        ) from None


# --------------------------------------------------------------------------------------------------------- tables of text


class Layout(NamedTuple):
    """How a text is read."""

    encoding: str
    separator: str
    decimal: str
    names: list[str]
    units: list[str]
    """As many as names, "" where there is none."""
    skipped: int
    """Lines before the first row of values."""

    def table(self, stream: Any, on_spoilt: Callable[[Any], str], kinds: dict[str, Any]) -> Any:
        """The library's table of a stream; `kinds` of columns that are known."""
        return arrow_csv.read_csv(
            stream,
            arrow_csv.ReadOptions(
                column_names=self.names, skip_rows=self.skipped, encoding=self.encoding, block_size=BLOCK
            ),
            arrow_csv.ParseOptions(delimiter=self.separator, invalid_row_handler=on_spoilt),
            arrow_csv.ConvertOptions(
                decimal_point=self.decimal, null_values=NOTHING, strings_can_be_null=True, column_types=kinds
            ),
        )  # fmt: skip


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


def _text_table(path: Path, owner: str) -> Recording:
    with _stream(path) as stream:
        head = bytes(stream.read(LOOKED_AT))
    layout = look_at(head, owner)
    lost = 0

    def on_spoilt(row: Any) -> str:
        nonlocal lost
        lost += max(len((row.text or "").splitlines()), 1)
        return "skip"

    def read(kinds: dict[str, Any]) -> Any:
        nonlocal lost
        lost = 0
        with _Watched(path, owner, len(layout.names)) as stream:
            return layout.table(stream, on_spoilt, kinds)

    end = head.rfind(b"\n") + 1 if len(head) == LOOKED_AT else len(head)
    if "16" in layout.encoding:
        end += (end - len(head)) % 2
    schema = layout.table(pa.BufferReader(head[:end]), lambda _: "skip", {}).schema
    # told what is a number, the library need not keep the text until all of it is read
    known = {one.name: pa.float64() for one in schema if _is_number(one.type)}
    try:
        table = read(known)
    except pa.ArrowInvalid:  # what the first lines say of a column does not hold for all of it
        table = read({})
    check_values(owner, sum(map(_weight, table.columns)))
    if lost > MOST_SPOILT * max(table.num_rows, 1) + 1:
        text = f"{lost} rows have another number of fields than the heading, or an open quote"
        raise StudyError(f"{owner} is no table of csv: {text}")
    notes = []
    if lost:
        notes.append(f"{lost} row{'s' if lost > 1 else ''} with another number of fields left out")
    if (layout.separator, layout.decimal) != (",", "."):
        shown = "tab" if layout.separator == "\t" else layout.separator
        notes.append(f"separator {shown!r}, decimal {layout.decimal!r}")
    columns = dict(zip(layout.names, table.columns, strict=True))
    units = dict(zip(layout.names, layout.units, strict=True))
    return _by_column(columns, str(path), units, notes, layout.decimal)


def _is_number(kind: Any) -> bool:
    return pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_null(kind)


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


def look_at(head: bytes, owner: str) -> Layout:
    """How a text that begins with `head` is read; raises `StudyError` with `owner` for what is no table."""
    encoding = encoding_of(head)
    lines = head.decode(encoding, errors="ignore").lstrip("\ufeff").splitlines()
    whole = len(head) < LOOKED_AT
    lines = lines if whole else lines[:-1]
    filled = [(k, line) for k, line in enumerate(lines) if line.strip() and line[0] not in "#%"]
    if len(filled) < 2 and not whole:
        raise StudyError(
            f"{owner} is no table of csv: one of its first lines has more than {LOOKED_AT // 2} bytes"
        )
    separator, width = _separator([line for _, line in filled])
    if len(filled) == 1 and width > 1:
        raise StudyError(f"{owner}: 0 rows; give some to be analysed")
    if len(filled) < 2:
        raise StudyError(f"{owner} is no table of csv: it has {len(filled)} lines")
    rows = [(k, [cell.strip() for cell in _fields(line, separator)]) for k, line in filled]
    heading = next(k for k, (_, row) in enumerate(rows) if len(row) == width)
    (at, names), below = rows[heading], rows[heading + 1 :]
    if all(PLAIN.fullmatch(name) for name in names):
        raise StudyError(f"{owner}: the first line has numbers; give every column a name")
    names[-1] = names[-1] or "unnamed"  # a separator at the end of every line
    for name, times in Counter(names).items():
        if times > 1:
            raise StudyError(f"{owner}: column {name!r} is there twice")
    units, skipped = [""] * width, at + 1
    if len(below) > 1 and _is_units(below[0][1], below[1][1]):
        units = [re.sub(r"^[\[({<]?\s*(.*?)\s*[\])}>]?$", r"\1", cell) for cell in below[0][1]]
        skipped = below[0][0] + 1
        below = below[1:]
    decimal = "."
    if separator != ",":
        every = max(len(below) // LOOKED_AT_ROWS, 1)
        full = [row for _, row in below[::every] if len(row) == width]
        decimal = decimal_of([[row[k] for row in full] for k in range(width)])
    return Layout(encoding, separator, decimal, names, (units + [""] * width)[:width], skipped)


def _fields(line: str, separator: str) -> list[str]:
    return next(csv.reader([line], delimiter=separator), [])


def _separator(lines: list[str]) -> tuple[str, int]:
    """The separator, and the number of fields that most lines have."""
    best, found = (0, 0), (",", 1)
    for separator in SEPARATORS:
        counts = Counter(len(_fields(line, separator)) for line in lines[:LOOKED_AT_ROWS])
        width, times = counts.most_common(1)[0] if counts else (1, 0)
        # decimal commas come in other numbers from line to line, or between other separators
        score = (times, width if separator != "," else 1)
        if width > 1 and score > best:
            best, found = score, (separator, width)
    return found


def _is_units(cells: list[str], after: list[str]) -> bool:
    """Whether a row has units and the one after it numbers."""
    return (
        any(cells)
        and not any(PLAIN.fullmatch(c) or re.match(r"\d{1,4}[-./:]\d", c) for c in cells)
        and any(PLAIN.fullmatch(cell) for cell in after)
    )


def encoding_of(head: bytes) -> str:
    """Encoding of a text that begins with `head`: UTF-8, UTF-16, Shift-JIS or Western European."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    odd, even = head[1::2].count(0), head[::2].count(0)
    if max(odd, even) > 0.3 * (len(head) // 2):  # Latin letters of two bytes, without a mark
        return "utf-16-le" if odd > even else "utf-16-be"
    for encoding in ("utf-8", "cp932", "cp1252"):
        try:
            text = codecs.getincrementaldecoder(encoding)().decode(head, final=False)
        except UnicodeDecodeError:
            continue
        # umlauts are Shift-JIS too, of rare characters: texts of Japanese have kana and the usual kanji, of first bytes
        # in which cp1252 has quotation marks and the like
        foreign = [c.encode("cp932") for c in text if c > "\x7f"] if encoding == "cp932" else []
        usual = sum(0x81 <= one[0] <= 0x9F for one in foreign)
        if encoding != "cp932" or 2 * usual >= len(foreign):
            return encoding
    return "latin-1"


# ------------------------------------------------------------------------------------------------------ numbers in texts


class Numbers(NamedTuple):
    """What a column of texts says."""

    values: Floats
    """nan where there is no number. (rows,)"""
    words: Counter[str]
    """Words in place of a number, and how often."""
    wrong: int | None
    """First row whose text has digits and is no number; None if there is none."""


def decimal_of(columns: Iterable[list[str]]) -> str:
    """The decimal sign of a file, by the cells of some rows, column by column.

    "12,345" is 12.345 or 12 345. Cells that can be read in one way alone decide. Without any, it is the latter if a column
    has it beside whole numbers below a thousand, or has two groups.
    """
    sure, group, unsure = Counter[str](), Counter[str](), Counter[str]()
    for cells in columns:
        whole = [abs(int(cell)) for cell in cells if re.fullmatch(r"[+-]?\d+", cell)]
        for sign in ",.":
            grouped = [cell for cell in cells if GROUPED[sign].fullmatch(cell)]
            twice = any(cell.count(sign) > 1 for cell in grouped)
            read = [cell for cell in cells if sign in cell and NUMBER[sign].fullmatch(cell)]
            sure[sign] += len(read) - sum(cell.count(sign) == 1 for cell in grouped)
            of = group if twice or (whole and max(whole) < 1000) else unsure
            of[sign] += len(grouped)
    for votes, first, other in ((sure, ",", "."), (group, ".", ","), (unsure, ",", ".")):
        if any(votes.values()):
            return first if votes[","] > votes["."] else other
    return "."


def numbers_of(texts: NDArray[Any], decimal: str = ".") -> Numbers:
    """Numbers of a column of texts, (rows,); `decimal` is the file's sign."""
    column = pd.Series(texts, dtype=object)
    # where the decimal sign is a comma, a point stands between groups: the library would take it for the sign
    point = column.astype(str).str.contains(".", regex=False) & (decimal != ".")
    values = pd.to_numeric(column.where(~point), errors="coerce").to_numpy(float).copy()
    words, wrong = Counter[str](), None
    for row in np.flatnonzero(np.isnan(values) & column.notna().to_numpy()).tolist():
        text = str(texts[row]).strip()
        found = NUMBER[decimal].fullmatch(GROUP_SIGNS.sub("", text))
        if found and any(c.isdigit() for c in text):
            whole, rest, power = (part or "" for part in found.groups())
            whole = whole.replace("," if decimal == "." else ".", "")
            values[row] = float(f"{whole}.{rest}e{power or 0}")
        elif not any(c.isdigit() for c in text) or "#" in text or text[:1].isalpha():
            words[text] += 1  # a heading, or what a computer prints for no value such as 1.#QNAN
        elif wrong is None:
            wrong = row
    return Numbers(values, words, wrong)


# --------------------------------------------------------------------------------------------------- files of recorders


def _parquet(path: Path, owner: str) -> Recording:
    schema = parquet.read_schema(path)
    nested = [one.name for one in schema if pa.types.is_nested(one.type)]
    plain = [name for name in schema.names if name not in nested]
    texts = [one.name for one in schema if _is_text(one.type)]
    # texts that repeat are held once until it is known how much they are written out
    with parquet.ParquetFile(path, read_dictionary=texts) as file:
        check_parquet(owner, file.metadata)
        table = file.read(plain)
    check_values(owner, sum(map(_weight, table.columns)))
    notes = [f"columns of lists left out: {', '.join(nested)}"] if nested else []
    units = {}
    for one in table.schema:
        stated = (one.metadata or {}).get(b"unit") or (one.metadata or {}).get(b"units") or b""
        # an index of instants may have any name
        units[one.name] = stated.decode("utf-8", "ignore") or (
            "s" if pa.types.is_temporal(one.type) else ""
        )
    return _by_column(dict(zip(table.column_names, table.columns, strict=True)), str(path), units, notes)  # fmt: skip


def _is_text(kind: Any) -> bool:
    kind = kind.value_type if pa.types.is_dictionary(kind) else kind
    of = (pa.types.is_string, pa.types.is_large_string, pa.types.is_binary, pa.types.is_large_binary)  # fmt: skip
    return any(one(kind) for one in of)


def _weight(column: Any) -> int:
    """Values of a column, each text as the numbers that take as much memory when it is written out."""
    if pa.types.is_dictionary(column.type) and _is_text(column.type):
        lengths = [pc.max(pc.binary_length(one.dictionary)).as_py() or 0 for one in column.chunks]
        return len(column) * (TEXT_VALUE + max(lengths, default=0) // 8)
    if _is_text(column.type):
        return len(column) * TEXT_VALUE + int(column.nbytes) // 8
    return len(column) * (1 if pa.types.is_primitive(column.type) else TEXT_VALUE)


class _Channel(NamedTuple):
    """A channel of a file with groups."""

    group: str
    name: str
    unit: str
    values: Any
    clock: Any = None
    start: Any = None
    """Instant from which `clock` counts; None: that of the file."""


def _mdf(path: Path, owner: str) -> Recording:
    library = _library("asammdf", "asammdf", path)
    found = []
    with library.MDF(path) as file:
        sizes = [(one.channel_group, len(one.channels)) for one in file.groups]
        check_values(owner, sum(g.cycles_nr * max(g.samples_byte_nr // 8, n) for g, n in sizes))
        for signal in file.iter_channels(skip_master=True):
            if signal.samples.ndim == 1 and signal.samples.dtype.kind in "iufb":
                group = file.groups[signal.group_index].channel_group
                name = str(getattr(group, "acq_name", "") or f"group {signal.group_index + 1}")
                unit = str(signal.unit or "")
                found.append(_Channel(name, signal.name, unit, signal.samples, signal.timestamps))
    return _grouped(path, found)


def _tdms(path: Path, owner: str) -> Recording:
    library = _library("nptdms", "npTDMS", path)
    found = []
    with open(path, "rb") as stored:
        groups = library.TdmsFile.open(stored).groups()
        every = [(group.name, one) for group in groups for one in group.channels() if len(one)]
        check_values(owner, sum(len(one) for _, one in every))
        for group, one in every:
            told = one.properties
            unit = str(told.get("unit_string") or told.get("unit") or "")
            own = float(told.get("wf_increment") or 0.0) > 0.0
            clock, values = one.time_track() if own else None, np.asarray(one[:])
            found.append(_Channel(group, one.name, unit, values, clock, told.get("wf_start_time")))
    return _grouped(path, found)


def _mat(path: Path, owner: str) -> Recording:
    """Variables of MATLAB: arrays, matrices with a column per channel, and structs of them, whose names are joined.

    A time in a struct is its clock, where other structs have their own.
    """
    with open(path, "rb") as file:
        head = file.read(1024)
    if b"MATLAB 7.3" in head[:128] or b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:520]):
        library = _library("h5py", "h5py", path, ".mat of version 7.3")
        with library.File(path) as stored:
            stored_values: list[int] = []
            stored.visititems(
                lambda _, one: stored_values.append(int(getattr(one, "size", 0) or 0))
            )
            check_values(owner, sum(stored_values))
            tree = _of_hdf(stored, stored)
    else:
        from scipy.io import loadmat

        check_matlab(path, owner)
        tree = loadmat(path, simplify_cells=True)
    found = [one for one in _of_structs("", tree) if one.values.dtype.kind in "iufbOU"]
    named = [one._replace(name=f"{one.group}.{one.name}".strip("."), group="") for one in found]
    clocks = {one.group: one.values for one in found if one.name.lower() in CLOCK_NAMES}
    if len(clocks) > 1:
        named = [new._replace(clock=clocks.get(one.group, [])) for one, new in zip(found, named, strict=True)
                 if one.name.lower() not in CLOCK_NAMES]  # fmt: skip
        used = [one for one in named if len(one.clock) == one.values.size]
    else:
        rows = Counter(one.values.size for one in named).most_common(1)
        used = [one for one in named if one.values.size == rows[0][0]]
    left = [one.name for one in named if one.values.size not in {own.values.size for own in used}]
    return _grouped(path, used, f"of another length, left out: {', '.join(left)}" if left else "")


def check_matlab(path: Path, owner: str) -> None:
    """Raise `StudyError` where a file of MATLAB's version 5 unfolds to more than is read."""
    from scipy.io import whosmat

    check_values(owner, sum(int(np.prod(shape)) for _, shape, _ in whosmat(path)))
    check_values(owner, sum(_unfolded(path)) / 8)


def _unfolded(path: Path) -> Iterator[int]:
    """Bytes of each packed variable of a file of version 5, by what stands before it."""
    content = path.read_bytes()
    order: Any = "big" if content[126:128] == b"MI" else "little"
    at = 128
    while at + 8 <= len(content):
        kind, size = (int.from_bytes(content[at + k : at + k + 4], order) for k in (0, 4))
        inner = zlib.decompressobj().decompress(content[at + 8 : at + 8 + size], 8) if kind == 15 else b""  # fmt: skip
        yield int.from_bytes(inner[4:8], order) if kind == 15 else size
        at += 8 + size


def _of_hdf(node: Any, file: Any) -> Any:
    """What h5py reads as the nested mappings and arrays that SciPy gives; its matrices are transposed."""
    if hasattr(node, "keys"):
        return {key: _of_hdf(node[key], file) for key in node if not key.startswith("#")}
    if node.attrs.get("MATLAB_empty") or "MATLAB_object_decode" in node.attrs:
        return np.zeros(0)
    values = np.asarray(node[()]).T
    if values.dtype == object:  # of references: cells, or structs in an array
        return [_of_hdf(file[one], file) for one in values.ravel(order="F")]
    if node.attrs.get("MATLAB_class") == b"char":
        return "".join(map(chr, values.ravel(order="F")))
    return values


def _of_structs(group: str, value: Any, name: str = "", unit: str = "") -> Iterator[_Channel]:
    """The arrays in structs, named by the fields on the way."""
    if isinstance(value, Mapping):
        inner = f"{group}.{name}".strip(".")
        told = {key.lower(): text for key, text in value.items() if isinstance(text, str)}
        unit = next((told[key] for key in UNIT_NAMES if key in told), "")
        for key, one in value.items():
            if not str(key).startswith("__"):
                yield from _of_structs(inner, one, "" if key.lower() in VALUE_NAMES else str(key), unit)  # fmt: skip
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        texts = list(value)
        if texts and all(isinstance(one, str) for one in texts):
            yield _Channel(group, name, unit, np.array(texts, dtype=object))
        else:
            for k, one in enumerate(texts, 1):
                yield from _of_structs(group, one, f"{name} {k}".strip(), unit)
    elif isinstance(value, np.ndarray) and value.size > 1 and value.squeeze().ndim == 1:
        yield _Channel(group, name, unit, value.squeeze())
    elif isinstance(value, np.ndarray) and value.size > 1 and value.ndim == 2:
        rows = value if value.shape[0] >= value.shape[1] else value.T
        for k, own in enumerate(rows.T, 1):
            yield _Channel(group, f"{name} {k}".strip(), unit, own)


def _grouped(path: Path, found: list[_Channel], note: str = "") -> Recording:
    """Channels of groups, on one clock: a name of several groups gets that of its group before it."""
    if not found:
        hint = "; MATLAB's tables and timeseries go in by struct()" if path.suffix == ".mat" else ""
        raise StudyError(f"log {str(path)!r} has no channels{hint}")
    starts = [np.datetime64(one.start) for one in found if one.start is not None]
    apart, notes = len(set(starts)) > 1, [note] if note else []
    if apart and len(starts) < len(found):
        apart = False
        notes.append(
            "some channels state when they begin, others do not: all are taken to begin together"
        )
    times = Counter(one.name for one in found)
    channels: dict[str, RawChannel] = {}
    for one in found:
        clock = None if one.clock is None else np.asarray(one.clock, dtype=float)
        if clock is not None and apart:
            clock = clock + (np.datetime64(one.start) - min(starts)) / np.timedelta64(1, "s")
        name = one.name if times[one.name] == 1 else f"{one.group} {one.name}"
        free, k = name, 2
        while free in channels:
            free, k = f"{name} ({k})", k + 1
        channels[free] = RawChannel(free, one.unit, lambda v=one.values: np.asarray(v), clock)  # type: ignore[misc]
    return Recording(str(path), channels, notes)


READERS: dict[str, Callable[[Path, str], Recording]] = {
    ".parquet": _parquet, ".pq": _parquet, ".mf4": _mdf, ".mdf": _mdf, ".dat4": _mdf, ".tdms": _tdms, ".mat": _mat,
}  # fmt: skip
ENDINGS = (*TEXT, *READERS)
