"""Parts of one kind by name: those that ship, those of installed packages, and those registered at run time.

An installed package offers a part by an entry point: its group says the kind, its name is the part's, its object the part.
"""

import sys
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar

Part = TypeVar("Part")


class Registry(Mapping[str, Part], Generic[Part]):
    """Name -> part of one `kind`; names of installed packages count, and are imported when they are asked for.

    `group`: entry points that offer such parts. `error`: what is raised for a name that is unknown or taken.
    """

    def __init__(self, kind: str, group: str, error: type[Exception] = ValueError) -> None:
        self.kind, self.group, self._error = kind, group, error
        self._parts: dict[str, Part] = {}
        self._origins: dict[str, str] = {}

    def register(self, name: str, part: Part, origin: str | None = None) -> Part:
        """Add `part` under `name`; the module `origin` may register the name again, no other may.

        `origin` is by default the module that calls.
        """
        origin = origin or str(sys._getframe(1).f_globals.get("__name__", ""))
        taken = self.origin(name) if name in self else origin
        if taken != origin:
            raise self._error(
                f"{self.kind} {name!r} exists already, from {taken}; choose another name"
            )
        self._parts[name], self._origins[name] = part, origin
        return part

    def find(self, name: str) -> Part:
        """The part called `name`; raises the registry's error with the nearest name for one that does not exist."""
        if name not in self:
            near = get_close_matches(name, list(self), 1, 0.4)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise self._error(f"unknown {self.kind} {name!r}; {hint}Known: {', '.join(self)}")
        return self[name]

    def origin(self, name: str) -> str:
        """Module that a part comes from."""
        return self._installed[name].module if name in self._installed else self._origins[name]

    def __getitem__(self, name: str) -> Part:
        if name not in self._parts and name in self._installed:
            self._parts[name] = self._installed[name].load()
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*self._parts, *self._installed]))

    def __len__(self) -> int:
        return len(list(iter(self)))

    @cached_property
    def _installed(self) -> dict[str, EntryPoint]:
        return {entry.name: entry for entry in entry_points(group=self.group)}
