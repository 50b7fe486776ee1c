"""Packages that offer names of their modules without importing them: a module is imported when one of its names is."""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def names_of(package: str, **modules: str) -> Callable[[str], Any]:
    """A package's `__getattr__` (PEP 562): module of the package -> the names in it that the package offers."""
    homes = {name: module for module, names in modules.items() for name in names.split()}

    def find(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{homes[name]}"), name)

    return find
