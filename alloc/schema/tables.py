"""Tables: one row per axle, car, unit, brake, patch; a column is declared once, with default, unit, meaning, source.

From a column follow the memory of compiled code, a variable of the recorded run, and an entry of the page of quantities.
Rows are read by name everywhere: `units[j].limit` in compiled and in plain code, `units.limit` in NumPy.
"""

import copyreg
import math
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields
from functools import cache
from operator import itemgetter
from typing import Any, ClassVar
from weakref import WeakSet

import numpy as np
from numba import from_dtype
from numpy.typing import NDArray

from alloc.compilation import jit
from alloc.schema.parameters import meanings
from alloc.schema.units import UNITS

INF, NAN, ONE = math.inf, math.nan, "1"
Rows = Any
"""An array of rows of a table. Its columns are attributes of it, and of each row."""


@dataclass(frozen=True)
class Column:
    """A quantity of a table. A whole number as `default` makes it integer, several numbers make it an array."""

    default: float | int | tuple[float, ...]
    unit: str
    """As CF writes it; "1": a pure number."""
    meaning: str
    recorded: bool = False
    """Whether a run's record has it; such a column is a variable of the recorded run, under its own name."""
    source: str = ""
    """Document and equation."""


class Table:
    """A kind of thing. Recorded columns stand first in a row, so a row's record is its first words.

    `dtype`: of a row; `recorded`: of its recorded columns alone. `row`, `recorded_row`, `type`: Numba's types of a row, of a
    recorded row, and of an array of rows. Raises `TypeError` for a column named like an attribute of NumPy's rows: plain
    Python would read the attribute in its place.
    """

    every: ClassVar[WeakSet["Table"]] = WeakSet()
    """All tables that there are."""

    def __init__(self, name: str, **columns: Column) -> None:
        self.every.add(self)
        for key in columns:
            if hasattr(np.void, key):
                raise TypeError(f"{name}: no column can be called {key}; rows have that attribute")
        self.name = name
        self.columns = dict(sorted(columns.items(), key=lambda item: not item[1].recorded))
        fields = tuple(
            (key, np.int64 if isinstance(item.default, int) else np.float64, np.shape(item.default))
            for key, item in self.columns.items()
        )
        recorded = tuple(item for item in fields if columns[item[0]].recorded)
        self.dtype, self._rows = _make_types(name, fields)
        self.recorded, self._record = _make_types(name, recorded)
        self.row, self.recorded_row = from_dtype(self.dtype), from_dtype(self.recorded)
        self.type = self.row[::1]

    def rows(self, n: int, **values: Any) -> Rows:
        """`n` rows with these values, the others as declared; raises `TypeError` for an unknown column."""
        if unknown := [key for key in values if key not in self.columns]:
            raise TypeError(f"{self.name}: no column {', '.join(unknown)}")
        rows: Any = np.empty(n, self.dtype).view(self._rows)
        for key, column in self.columns.items():
            rows[key] = values.get(key, column.default)
        return rows

    def of(self, records: Sequence[Any]) -> Rows:
        """A row for each record."""
        rows = self.rows(len(records))
        for row, record in zip(rows, records, strict=True):
            put_fields(row, record)
        return rows

    def record(self, ticks: int, n: int) -> Rows:
        """Room for what is recorded of `n` rows at every instant, (ticks, n)."""
        return np.zeros((ticks, n), self.recorded).view(self._record)

    def rows_in(self, memory: NDArray[np.float64]) -> Rows:
        """The rows that lie in some memory."""
        return memory.view(self.dtype).view(self._rows)


def _make_types(name: str, fields: tuple[Any, ...]) -> tuple[Any, Any]:
    """The type of a row as NumPy has it, and the type of arrays of them."""
    row = _make_type(np.void, f"{name} row", fields)
    return np.dtype((row, list(fields))), _make_type(np.ndarray, f"{name} rows", fields)


class _Made(type):
    """Type of a type that no module has under its name; pickle makes it anew."""

    made_of: tuple[Any, ...]


copyreg.pickle(_Made, lambda kind: (_make_type, kind.made_of))  # type: ignore[has-type]


@cache
def _make_type(base: type, name: str, fields: tuple[Any, ...]) -> type:
    """The type of rows (`base` void), or of arrays of them (`base` ndarray), with columns as attributes.

    NumPy's own records have attributes too: to read one takes ten times as long, and to set one that is no column is no
    error.
    """

    def attribute(key: str) -> property:
        def write(rows: Any, value: Any) -> None:
            rows[key] = value

        read = itemgetter(key)
        return property(read if base is np.void else lambda rows: read(np.asarray(rows)), write)

    kind = _Made(name, (base,), {"__slots__": ()} | {key: attribute(key) for key, *_ in fields})
    kind.made_of = base, name, fields
    return kind


def columns_of(kind: type, *names: str, prefix: str = "") -> dict[str, Column]:
    """Columns of the numbers and flags of a record, by the names of its fields behind `prefix`; what may be left out is 0.

    `names`: of the fields; none: of all that files may set.
    """
    texts, si = meanings(kind), {unit.symbol: unit.si for unit in UNITS}
    columns = {}
    for item in fields(kind):
        unit = item.metadata.get("unit", "1" if item.type is bool else None)
        if unit is None or (names and item.name not in names):
            continue
        value = 0.0 if item.default is MISSING or item.default is None else item.default
        meaning, _, _ = texts[item.name].text.partition(". ")
        number = int(value) if isinstance(value, bool) else value
        source = texts[item.name].source
        columns[prefix + item.name] = Column(number, si[unit], meaning.rstrip("."), source=source)
    return columns


def put_fields(row: Any, record: Any, prefix: str = "") -> None:
    """Write the fields of a record into the columns that have their names, behind `prefix`."""
    for item in fields(record):
        value = getattr(record, item.name)
        if (name := prefix + item.name) in row.dtype.names and value is not None:
            row[name] = value


def memory_words(rows: Rows) -> NDArray[np.int64]:
    """The memory of rows, row by row in words of 8 bytes; compiled code copies records with it."""
    view: NDArray[np.int64] = np.asarray(rows).view(np.int64)
    return view.reshape(*rows.shape, rows.dtype.itemsize // 8)


@jit
def look_up(tables, j, place):
    """Value of table `j` at a place between its points; beyond an end that of the end."""
    place = min(max(place, 0.0), tables.shape[1] - 1.000001)
    k = int(place)
    return tables[j, k] + (place - k) * (tables[j, k + 1] - tables[j, k])
