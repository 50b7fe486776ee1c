"""Parts of one kind by name: rules, controllers, curves, metrics, trains."""

import sys
import time
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Any, ClassVar, Generic, TypeVar

from alloc.schema.errors import InputError

Part = TypeVar("Part")
OWN = ("alloc", "mpc")
"""Packages whose parts ship with the project."""


class Registry(Mapping[str, Part], Generic[Part]):
    """Name -> part of one `kind`, in the order in which they were registered."""

    registered: ClassVar[dict[str, float]] = {}
    """Modules that have registered a part of any kind, with the time of the last one [s since 1970]."""
    every: ClassVar[list["Registry[Any]"]] = []
    """All registries."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.every.append(self)
        self._parts: dict[str, Part] = {}
        self._origins: dict[str, str] = {}

    def register(self, name: str, part: Part, origin: str | None = None) -> Part:
        """Add `part`; a module may register a name of its own again, but not another's. `origin`: the part's module.

        Raises `InputError` for a name that another module has.
        """
        origin = origin or str(sys._getframe(1).f_globals.get("__name__", ""))
        taken = self._origins.get(name, origin)
        if taken != origin:
            raise InputError(
                f"{self.kind} {name!r} exists already, from {taken}; choose another name"
            )
        self._parts[name], self._origins[name] = part, origin
        self.registered[origin] = time.time()
        return part

    def forget(self, origin: str) -> None:
        """Take out what comes from a module, before it is loaded again."""
        for name in [name for name, module in self._origins.items() if module == origin]:
            del self._parts[name], self._origins[name]

    def find(self, name: str) -> Part:
        """The part called `name`; raises `InputError` with the nearest name for one that does not exist."""
        if name in self._parts:
            return self._parts[name]
        near = get_close_matches(str(name).lower(), self._parts, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(self)}"
        raise InputError(f"unknown {self.kind} {name!r}; {hint}")

    def origin(self, name: str) -> str:
        """Module that a part comes from."""
        return self._origins[name]

    def origins(self) -> set[str]:
        """Modules that parts come from."""
        return set(self._origins.values())

    def shipped(self) -> list[str]:
        """Names of the parts that come with the project."""
        return [name for name, origin in self._origins.items() if origin.split(".")[0] in OWN]

    def __getitem__(self, name: str) -> Part:
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def __repr__(self) -> str:
        return f"<{len(self)} parts, each a {self.kind}: {', '.join(self)}>"

    def __reduce__(self) -> Any:
        """Another process has its own registry, found in the module that made it."""
        for module in list(sys.modules.values()):
            for name, one in vars(module).items() if module else ():
                if one is self and module.__name__.split(".")[0] in OWN:
                    return getattr, (module, name)
        return super().__reduce__()
