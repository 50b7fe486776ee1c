"""The record of what a controller keeps as static memory of C, and how it is filled at the start."""

from typing import Any

import numpy as np

from alloc.by_reference import ByReference
from mpc.export.c_kinds import Structure, TranslationError, number_text
from mpc.export.c_program import array_kind

WORD = 8
"""Bytes of a number, whatever it is: there are no gaps."""


class Memory:
    """Those arrays of the record `state` that functions use; `used`: their paths."""

    def __init__(self, state: Any, used: set[str]) -> None:
        self.arrays: dict[str, np.ndarray] = {}
        self._used, self._places = used, dict[int, str]()
        self._lines = self._struct("memory", state, "")
        self.structures = self._structures(state, "memory")

    @property
    def size(self) -> int:
        """Bytes."""
        words = (item.size * len(item.dtype.names or (0,)) for item in self.arrays.values())
        return WORD * sum(words)

    @property
    def starts(self) -> int:
        """Bytes of the constants from which arrays are filled."""
        return WORD * sum(item.size for item in self.arrays.values() if _is_uneven(item))

    def _struct(self, path: str, value: Any, indent: str) -> list[str]:
        lines = []
        for name, item in zip(value._fields, value, strict=True):
            item = item._value if isinstance(item, ByReference) else item
            inner = f"{path}.{name}"
            if isinstance(item, np.ndarray) and inner in self._used and item.size:
                self._take(inner, item)
                element = array_kind(item, type(value).__name__ + name.capitalize()).element.name
                size = " * ".join(map(str, item.shape))
                lines.append(f"{indent}  {element} {name}[{size}];")
            elif hasattr(item, "_fields"):
                part = self._struct(inner, item, indent + "  ")
                if part:
                    lines += [f"{indent}  struct {{", *part, f"{indent}  }} {name};"]
        return lines

    def _take(self, path: str, item: np.ndarray) -> None:
        at = item.__array_interface__["data"][0]
        other = self._places.setdefault(at, path)
        if other != path:
            raise TranslationError(f"{path} and {other} are one array: no translation to C")
        if not item.flags.c_contiguous:
            raise TranslationError(f"{path} is not contiguous: no translation to C")
        self.arrays[path] = item

    def _structures(self, value: Any, path: str) -> list[Structure]:
        found = []
        for name, item in zip(value._fields, value, strict=True):
            item = item._value if isinstance(item, ByReference) else item
            if (
                isinstance(item, np.ndarray)
                and item.dtype.names
                and f"{path}.{name}" in self.arrays
            ):
                kind: Any = array_kind(item, type(value).__name__ + name.capitalize()).element
                found.append(kind)
            elif hasattr(item, "_fields"):
                found += self._structures(item, f"{path}.{name}")
        return found

    def declaration(self) -> list[str]:
        """Lines that declare the memory."""
        return ["static struct {", *self._lines, "} memory;"]

    def filling(self) -> tuple[list[str], list[str]]:
        """Lines of constants, and lines of the function body that fills the memory for the start."""
        constants, lines = [], []
        for path, item in self.arrays.items():
            if item.dtype.names:
                for index in range(item.size):
                    one = item.reshape(-1)[index]
                    lines += [
                        f"  {path}[{index}].{name} = {number_text(one[name].item())};"
                        for name in item.dtype.names
                    ]
                continue
            flat = item.reshape(-1)
            of = "" if item.dtype == float else "_whole"
            plain = [number_text(_plain(value)) for value in flat.tolist()]
            if not _is_uneven(item):
                lines.append(f"  fill{of}({path}, {flat.size}, {plain[0]});")
                continue
            kind = "int64_t" if of else "double"
            name = "START_" + path.removeprefix("memory.").replace(".", "_")
            constants += [f"static const {kind} {name}[{flat.size}] = {{", *_wrapped(plain), "};"]
            lines.append(f"  copy{of}({path}, {flat.size}, {name});")
        return constants, lines


def _plain(value: Any) -> Any:
    return int(value) if isinstance(value, bool) else value


def _is_uneven(item: np.ndarray) -> bool:
    """Whether an array holds different numbers at the start."""
    if item.dtype.names:
        return False
    texts = {repr(value) for value in item.reshape(-1).tolist()}
    return len(texts) > 1


def _wrapped(texts: list[str], most: int = 96) -> list[str]:
    """Texts with commas, in lines."""
    lines = [" "]
    for text in texts:
        if len(lines[-1]) + len(text) > most:
            lines.append(" ")
        lines[-1] += f" {text},"
    return lines
