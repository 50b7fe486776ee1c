"""Parts of one kind by name: shipped ones, those of installed packages, and those registered at run time.

A part registers in the file that defines it. An installed package offers one by an entry point. The entry point's group is
the kind, its name is the part's name, and its object is the part. A package can offer names of its modules without
importing them (`names_of`).
"""

import pkgutil
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, ClassVar, Generic, TypeVar

from alloc.display import table

# Parts of one kind by name: shipped ones, those of installed packages, and those registered at run time.
#
# A part registers in the file that defines it. An installed package offers one by an entry point. The entry point's
# group is the kind, its name is the part's name, and its object is the part.


Part = TypeVar("Part")


class Registry(Mapping[str, Part], Generic[Part]):
    """Name -> part of one `kind`; modules that register parts are imported when a part is asked for.

    `group`: entry points that offer such parts. `error`: what is raised for a name that is unknown or taken. `package`: the
    package whose modules register the shipped parts. `order`: names that come first; others follow by module, then plug-ins.
    """

    registered: ClassVar[list[str]] = []
    """Modules that have registered a part of any kind, once for each."""

    def __init__(
        self,
        kind: str,
        group: str,
        error: type[Exception] = ValueError,
        package: str | None = None,
        order: Sequence[str] = (),
    ) -> None:
        self.kind, self.group = kind, group
        self._error, self._package, self._order = error, package, order
        self._parts: dict[str, Part] = {}
        self._origins: dict[str, str] = {}
        self._filled, self._filling = package is None, False
        self._lock = threading.RLock()
        self._home = str(sys._getframe(1).f_globals.get("__name__", ""))

    def __repr__(self) -> str:
        return f"<Registry of {len(self)} parts, each a {self.kind}: {', '.join(self)}>"

    def _repr_html_(self) -> str:
        meanings = ("description", "meaning")
        rows = [
            (name, next((str(getattr(part, one)) for one in meanings if hasattr(part, one)), ""))
            for name, part in self.items()
        ]
        return table(f"{self.kind}: {len(rows)} names", rows)

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process takes its own registry: parts are registered in each."""
        return _of_home, (self._home, self.kind)

    def register(self, name: str, part: Part, origin: str | None = None) -> Part:
        """Add `part` under `name`; the module that registered a name may do so again, but no other module may.

        `origin`: the part's module; the default is the calling module.
        """
        origin = origin or str(sys._getframe(1).f_globals.get("__name__", ""))
        if not self._ships(origin):
            self._fill()
        entry = self._installed.get(name)
        if self._origins.get(name, origin) != origin or (entry and entry.module != origin):
            taken = self._origins.get(name, "an installed package")
            raise self._error(
                f"{self.kind} {name!r} exists already, from {taken}; choose another name"
            )
        self._parts[name], self._origins[name] = part, origin
        self.registered.append(origin)
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
        self._fill()
        return self._installed[name].module if name in self._installed else self._origins[name]

    def shipped(self) -> list[str]:
        """Names of the parts that come with the project."""
        return [name for name in self if self._ships(self.origin(name))]

    def __getitem__(self, name: str) -> Part:
        self._fill()
        # parts that are loaded stay where they are, so that the order of names does not tell what was asked for
        return self._parts[name] if name in self._parts else self._installed[name].load()

    def __iter__(self) -> Iterator[str]:
        self._fill()
        return iter(dict.fromkeys([*sorted(self._parts, key=self._rank), *self._installed]))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def _ships(self, origin: str) -> bool:
        return self._package is not None and origin.startswith(self._package)

    def _rank(self, name: str) -> tuple[int, int | str]:
        if name in self._order:
            return 0, self._order.index(name)
        return (1, self._origins[name]) if self._ships(self._origins[name]) else (2, 0)

    def _fill(self) -> None:
        if self._filled:
            return
        # another thread waits for all parts; this one may ask while it imports them
        with self._lock:
            if self._filled or self._filling:
                return
            self._filling = True
            try:
                for module in pkgutil.iter_modules(import_module(str(self._package)).__path__):
                    import_module(f"{self._package}.{module.name}")
                self._filled = True
            finally:
                self._filling = False

    @cached_property
    def _installed(self) -> dict[str, EntryPoint]:
        return {entry.name: entry for entry in entry_points(group=self.group)}


def _of_home(home: str, kind: str) -> "Registry[Any]":
    """The registry of this kind that a module made."""
    made = vars(import_module(home)).values()
    return next(one for one in made if isinstance(one, Registry) and one.kind == kind)


# Packages that offer names of their modules without importing them: a module is imported when one of its names is.


def names_of(package: str, **modules: str) -> Callable[[str], Any]:
    """A package's `__getattr__` (PEP 562): module of the package -> the names in it that the package offers."""
    homes = {name: module for module, names in modules.items() for name in names.split()}

    def find(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{homes[name]}"), name)

    return find
