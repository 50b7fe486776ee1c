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
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Any, ClassVar, Generic, TypeVar

from alloc.old.display import table

Part = TypeVar("Part")


class UnknownName(KeyError):
    """No part has this name; the message has the nearest."""

    def __str__(self) -> str:
        """The message as it is: that of `KeyError` is in quotes."""
        return str(self.args[0])


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
        package: str = "",
        order: Sequence[str] = (),
    ) -> None:
        self.kind, self.group = kind, group
        self._error, self._package, self._order = error, package, order
        self._parts: dict[str, Part] = {}
        self._origins: dict[str, str] = {}
        self._waiting = bool(package)
        self._lock = threading.RLock()
        self.__module__ = _calling()

    def __repr__(self) -> str:
        return f"<Registry of {len(self)} parts, each a {self.kind}: {', '.join(self)}>"

    def _repr_html_(self) -> str:
        def meaning(part: Any) -> str:
            return str(getattr(part, "description", getattr(part, "meaning", "")))

        rows = [(name, meaning(part)) for name, part in self.items()]
        return table(f"{self.kind}: {len(rows)} names", rows)

    def __reduce__(self) -> str:
        """Another process takes its own registry, by its name in its module: parts are registered in each."""
        made = vars(sys.modules[self.__module__]).items()
        return next(name for name, one in made if one is self)

    def register(self, name: str, part: Part, origin: str | None = None) -> Part:
        """Add `part` under `name`; the module that registered a name may do so again, but no other module may.

        `origin`: the part's module; the default is the calling module.
        """
        origin = origin or _calling()
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
        try:
            return self[name]
        except UnknownName as error:
            raise self._error(str(error)) from None

    def origin(self, name: str) -> str:
        """Module that a part comes from."""
        self._fill()
        return self._installed[name].module if name in self._installed else self._origins[name]

    def origins(self) -> set[str]:
        """Modules that parts come from."""
        self._fill()
        return {*self._origins.values(), *(entry.module for entry in self._installed.values())}

    def shipped(self) -> list[str]:
        """Names of the parts that come with the project."""
        return [name for name in self if self._ships(self.origin(name))]

    def __getitem__(self, name: str) -> Part:
        self._fill()
        # parts that are loaded stay where they are, so that the order of names does not tell what was asked for
        if name in self._parts:
            return self._parts[name]
        if name in self._installed:
            return self._installed[name].load()
        asked, known = str(name).lower(), [*self._parts, *self._installed]
        begun = [one for one in known if one.startswith(asked)]
        near = begun or get_close_matches(asked, known, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(self)}"
        raise UnknownName(f"unknown {self.kind} {name!r}; {hint}")

    def __iter__(self) -> Iterator[str]:
        self._fill()
        first = [name for name in self._order if name in self._parts]
        shipped = [name for name in self._parts if self._ships(self._origins[name])]
        shipped.sort(key=self._origins.__getitem__)
        return iter(dict.fromkeys([*first, *shipped, *self._parts, *self._installed]))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def _ships(self, origin: str) -> bool:
        return bool(self._package) and origin.startswith(self._package)

    def _fill(self) -> None:
        """Import the modules of shipped parts; another thread waits for them, while this one may ask during the import."""
        if self._waiting and not self._lock._is_owned():  # type: ignore[attr-defined]
            with self._lock:
                package = import_module(self._package)
                for module in pkgutil.iter_modules(package.__path__):
                    import_module(f"{self._package}.{module.name}")
                self._waiting = False

    @cached_property
    def _installed(self) -> dict[str, EntryPoint]:
        return {entry.name: entry for entry in offered(self.group)}


_everything = cache(entry_points)  # it reads the metadata of all packages


def offered(group: str) -> EntryPoints:
    """What installed packages offer in a group of entry points."""
    return _everything().select(group=group)


def _calling() -> str:
    """Name of the module that calls the method that calls this."""
    return str(sys._getframe(2).f_globals.get("__name__", ""))


def names_of(package: str, **modules: str) -> Callable[[str], Any]:
    """A package's `__getattr__` (PEP 562): module of the package -> the names in it that the package offers.

    A module is imported when one of its names is asked for.
    """
    homes = {name: module for module, names in modules.items() for name in names.split()}

    def find(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{homes[name]}"), name)

    return find
