"""Where generated code lies: beside Numba's cache, safe against several processes at once.

A file's name carries a hash of all that decides its content, so a file that exists is right. Files are written aside
and renamed: nobody reads half of one.
"""

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from alloc.private_folder import cache_part
from alloc.whole_file import write_whole

_loaded: dict[str, ModuleType] = {}


def folder() -> Path:
    """Folder of the generated code; made if need be."""
    return cache_part("generated")


def create(path: Path, write: Callable[[Path], object]) -> None:
    """Make `path` by `write(file to fill)`, unless it exists; a `write` that raises leaves nothing behind."""
    if not path.exists():
        write_whole(path, write)


def load_module(name: str, text: str) -> ModuleType:
    """Import Python source `text` as the module `name`, from a file so that Numba's cache knows it; once per process."""
    if name not in _loaded:
        path = folder() / f"{name}.py"
        create(path, lambda aside: aside.write_text(text, encoding="utf-8"))
        specification = importlib.util.spec_from_file_location(name, path)
        assert specification is not None
        assert specification.loader is not None
        module = importlib.util.module_from_spec(specification)
        sys.modules[name] = module  # Numba looks it up by name when it loads from its cache
        specification.loader.exec_module(module)
        _loaded[name] = module
    return _loaded[name]
