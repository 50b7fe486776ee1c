"""Folders for what is loaded as code: they belong to the user, and nobody else can write there.

A compiled kernel, a generated module or a library is executed when it is loaded. A folder of another user, one that others
may write to, or one that holds another user's file is therefore not used.
"""

import os
import shutil
import stat
import tempfile
import uuid
import warnings
from atexit import register
from functools import lru_cache
from pathlib import Path

VARIABLES = ("READHESION_CACHE", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
"""Environment variables that may say where compiled code is kept; the first that is set does."""


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Where compiled and generated code is kept between processes.

    The user's cache folder; where that cannot be had safely, one in the temporary folder; else a new one for this process.
    """
    said = next((os.environ[name] for name in VARIABLES if os.environ.get(name)), None)
    base = Path(said) if said else Path.home() / ".cache"
    for folder in (
        base / "readhesion",
        Path(tempfile.gettempdir()) / f"readhesion-{getattr(os, 'getuid', int)()}",
    ):
        try:
            return private(folder / "code")
        except OSError:
            continue  # a read-only home must not stop a study, nor may another user
    own = tempfile.mkdtemp(prefix="readhesion-")
    os.environ[VARIABLES[0]] = own
    register(shutil.rmtree, own, ignore_errors=True)
    return private(Path(own) / "code")


@lru_cache(maxsize=1024)
def cache_part(name: str) -> Path:
    """Folder `name` in the cache folder; one that is not the user's alone is set aside with a warning."""
    folder = cache_folder() / name
    try:
        return private(folder)
    except PermissionError as error:
        aside = folder.with_name(f"refused-{uuid.uuid4().hex}")
        warnings.warn(f"{error}; it is now {aside.name!r}, delete it", RuntimeWarning, stacklevel=2)
        folder.rename(aside)
        return private(folder)


def private(folder: Path) -> Path:
    """`folder`, created if necessary, for its user alone.

    Raises `OSError` where it cannot be written, others may write to it or replace it, or it contains another user's files.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    around = folder.parent.stat().st_mode
    if os.name == "posix" and around & stat.S_IWOTH and not around & stat.S_ISVTX:
        raise PermissionError(f"everybody may replace what is in {str(folder.parent)!r}")
    for path in (folder, *(path for path in folder.iterdir() if not path.is_dir())):
        check_owner(path)
    with tempfile.TemporaryFile(dir=folder):
        pass
    return folder


def check_owner(path: Path) -> None:
    """Raise `PermissionError` if `path` is a link, another user's, or a folder that others may write to."""
    if os.name != "posix":
        return  # Windows keeps the cache in the user's profile
    found = path.lstat()
    open_folder = stat.S_ISDIR(found.st_mode) and found.st_mode & 0o022
    if stat.S_ISLNK(found.st_mode) or found.st_uid != os.getuid() or open_folder:
        raise PermissionError(f"{str(path)!r} is not this user's alone")
