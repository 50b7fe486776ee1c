"""One text for equal values: what hashes are made of. `repr` is for people, and leaves things out."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def canonical(value: Any) -> str:
    """Text of everything that `value` holds: records, sequences and mappings part by part, arrays entry by entry."""
    kind = type(value)
    if is_dataclass(value):
        named = [(item.name, getattr(value, item.name)) for item in fields(value)]
    elif isinstance(value, tuple) and hasattr(value, "_fields"):
        named = list(zip(value._fields, value, strict=True))
    elif kind is tuple:
        parts = [canonical(part) for part in value]
        return f"({parts[0]},)" if len(parts) == 1 else f"({', '.join(parts)})"
    elif kind is list:
        return f"[{', '.join(map(canonical, value))}]"
    elif kind is dict:
        return "{" + ", ".join(f"{canonical(k)}: {canonical(v)}" for k, v in value.items()) + "}"
    elif isinstance(value, np.ndarray):
        return f"array({value.tolist()!r}, dtype={value.dtype})"
    else:
        return repr(value)
    return f"{kind.__qualname__}({', '.join(f'{name}={canonical(part)}' for name, part in named)})"
