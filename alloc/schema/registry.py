"""Parts of one kind by name: rules, beliefs, controllers, curves, metrics, trains."""

import sys
import time
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from importlib import import_module
from typing import Any, ClassVar, Generic, TypeVar

from alloc.schema.errors import InputError

Part = TypeVar("Part")
OWN = ("alloc", "mpc")
"""Packages whose parts ship with the project."""


class UnknownPart(InputError, KeyError):
    """No part of a kind has this name."""

    __str__ = Exception.__str__  # a KeyError would quote its message


class Registry(Mapping[str, Part], Generic[Part]):
    """Name -> part of one `kind`, in the order in which they were registered.

    `modules` register parts at their ends; they are imported when a part is first asked for, so each is known wherever the
    registry is.
    """

    registered: ClassVar[dict[str, float]] = {}
    """Modules that have registered a part of any kind, with the time of the last one [s since 1970]."""
    every: ClassVar[list["Registry[Any]"]] = []
    """All registries."""

    def __init__(self, kind: str, *modules: str) -> None:
        self.kind = kind
        self.every.append(self)
        self._modules, self._left = modules, list(modules)
        self._home = _module_of_caller()
        self._registered: dict[str, Part] = {}
        self._origins: dict[str, str] = {}

    @property
    def _parts(self) -> dict[str, Part]:
        if self._left:
            while self._left:
                import_module(self._left.pop(0))
            places = {module: place for place, module in enumerate(self._modules)}
            names = sorted(
                self._registered, key=lambda name: places.get(self._origins[name], len(places))
            )
            self._registered = {name: self._registered[name] for name in names}
        return self._registered

    def register(self, name: Any, part: Any = None, origin: str | None = None) -> Part:
        """Add `part`: `register(part)` under the part's own name, `register(name, part)` under another.

        A module may register a name again, but not another module's. `origin`: the module that the part comes from. Raises
        `InputError` for a name that another module has.
        """
        if part is None:
            name, part = name.name, name
        origin = origin or _module_of_caller()
        if origin.split(".")[0] not in OWN:  # the names that ship are taken
            self._parts  # noqa: B018
        holder = self._origins.get(name, origin)
        if holder != origin:
            raise InputError(
                f"{self.kind} {name!r} exists already, from {holder}; choose another name"
            )
        self._registered[name], self._origins[name] = part, origin
        self.registered[origin] = time.time()
        added: Part = part
        return added

    def forget(self, origin: str) -> None:
        """Take out what comes from a module, before it is loaded again."""
        for name in [name for name, module in self._origins.items() if module == origin]:
            del self._registered[name], self._origins[name]

    def find(self, name: str) -> Part:
        """The part called `name`; raises `InputError` with the nearest name for one that does not exist."""
        if name in self._parts:
            return self._parts[name]
        near = get_close_matches(str(name).lower(), self._parts, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(self)}"
        raise UnknownPart(f"unknown {self.kind} {name!r}; {hint}")

    def origin(self, name: str) -> str:
        """Module that a part comes from."""
        self.find(name)
        return self._origins[name]

    def origins(self) -> set[str]:
        """Modules that parts come from."""
        return {self._origins[name] for name in self._parts}

    def shipped(self) -> list[str]:
        """Names of the parts that come with the project."""
        return [name for name in self._parts if self._origins[name].split(".")[0] in OWN]

    def __getitem__(self, name: str) -> Part:
        return self.find(name)

    def __contains__(self, name: object) -> bool:
        return name in self._parts

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def __repr__(self) -> str:
        return f"<{len(self)} parts, each a {self.kind}: {', '.join(self)}>"

    def __reduce__(self) -> Any:
        """Another process has its own registry, in the module that made it."""
        return _registry, (self._home, self.kind)


def find_part(registry: Registry[Any], part: Any, fits: bool) -> Any:
    """The part of this name, or `part` itself where it `fits`; raises `InputError` for what is neither."""
    if isinstance(part, str):
        return registry.find(part)
    if not fits:
        hint = f"give the name of a {registry.kind}, or the {registry.kind} itself"
        if isinstance(part, list | tuple):
            hint = "a run has one; `readhesion.compare` takes several"
        raise InputError(f"{registry.kind} = {part!r:.60}: {hint}")
    return part


def _module_of_caller() -> str:
    """Module that calls what calls this."""
    return str(sys._getframe(2).f_globals.get("__name__", ""))


def _registry(module: str, kind: str) -> Registry[Any]:
    import_module(module)
    return next(registry for registry in Registry.every if registry.kind == kind)
