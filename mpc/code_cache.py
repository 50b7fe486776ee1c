"""Where generated code lies: beside Numba's cache, safe against several processes at once.

A file's name carries a hash of all that decides its content, so a file that is undamaged is right. Files are written
aside and renamed: nobody reads half of one.
"""

import importlib.util
import marshal
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from alloc.private_folder import cache_part
from alloc.whole_file import sealed, set_aside_damaged, write_whole

_loaded: dict[str, ModuleType] = {}


def folder() -> Path:
    """Folder of the generated code; made if need be."""
    return cache_part("generated")


def create(path: Path, write: Callable[[Path], object]) -> None:
    """Make `path` by `write(file to fill)` and seal it, unless it is there undamaged.

    A `write` that raises leaves nothing behind.
    """

    def write_sealed(aside: Path) -> None:
        write(aside)
        aside.write_bytes(sealed(aside.read_bytes()))

    set_aside_damaged(path)
    if not path.exists():
        write_whole(path, write_sealed)


def load_module(name: str, text: str) -> ModuleType:
    """Run Python source `text` as the module `name`, from a file so that Numba's cache knows it; once per process."""
    if name not in _loaded:
        path, content = folder() / f"{name}.py", text.encode()
        set_aside_damaged(path, content)
        if not path.exists():
            write_whole(path, lambda aside: aside.write_bytes(content))
        # Python checks nothing of what it keeps in `__pycache__`, and to compile a model takes 30 ms.
        code = path.with_suffix(f".{sys.implementation.cache_tag}")
        create(
            code,
            lambda aside: aside.write_bytes(marshal.dumps(compile(content, str(path), "exec"))),
        )
        specification = importlib.util.spec_from_file_location(name, path)
        assert specification is not None
        module = importlib.util.module_from_spec(specification)
        sys.modules[name] = module  # Numba looks it up by name when it loads from its cache
        exec(marshal.loads(code.read_bytes()), vars(module))
        _loaded[name] = module
    return _loaded[name]
