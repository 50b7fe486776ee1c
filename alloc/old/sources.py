"""What is kept between processes, whole and undamaged; and which sources decide a result, known by a hash of their syntax.

In: content under a name; names of modules. Out: the content as it was written; one hash, which rows of studies and
compiled kernels carry, so neither is taken for the work of other code.
"""

import ast
import hashlib
import json
import os
import re
import shutil
import stat
import sys
import tempfile
import time
import tomllib
import uuid
import warnings
from atexit import register
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import Any, NamedTuple

ASIDE = ".part"
"""In the name of a file that is being written."""


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Make or replace `path` by `write(file to fill)`: other processes see all of it or nothing.

    The file beside it has a name of its own, so writers do not meet; a `write` that raises leaves nothing behind. Raises
    `OSError` with the name of `path`.
    """
    with writing(path) as aside:
        write(aside)
        os.replace(aside, path)


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """A file beside `path` to be filled; it is gone afterwards. An `OSError`, as of a full disk, gets the name of `path`."""
    aside = path.with_name(f".{uuid.uuid4().hex}{ASIDE}{path.suffix}")
    try:
        yield aside
    except OSError as error:  # libraries do not say which file
        reason = os.strerror(error.errno) if error.errno else " ".join(str(error).split())
        raise OSError(error.errno, reason, str(path)) from error
    finally:
        aside.unlink(missing_ok=True)


# What is kept in one folder is run as code: compiled kernels, generated modules. So the folder is its user's alone, and
# every file ends with a digest of its content: machine code with one flipped bit is run, and may do anything.


VARIABLES = ("READHESION_CACHE", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
"""Environment variables that may say where compiled code is kept; the first that is set does."""
KEPT_DAYS = 30.0
"""What was not used for this many days is deleted when something is kept."""
_DIGEST = hashlib.sha256().digest_size


def keep(name: str, content: bytes) -> None:
    """Write `content` under `name` for this process and later ones."""
    _delete_unused()
    content += hashlib.sha256(content).digest()
    write_whole(cache_folder() / name, lambda aside: aside.write_bytes(content))


def _undamaged(found: bytes) -> bytes | None:
    """The content of a file that was kept; None where its digest is that of another."""
    content = found[:-_DIGEST]
    return content if found[-_DIGEST:] == hashlib.sha256(content).digest() else None


def kept(name: str) -> bytes | None:
    """Content that is kept under `name`; None where there is none. What is damaged is set aside, with a warning."""
    path = cache_folder() / name
    with suppress(OSError):  # another process may set it aside, or delete it
        content = _undamaged(path.read_bytes())
        if content is not None:
            os.utime(path)
            return content
        aside = path.with_name(f"damaged-{name}")
        os.replace(path, aside)
        said = f"{str(path)!r} is damaged and made again; what it was is now {aside.name!r}"
        warnings.warn(said, RuntimeWarning, stacklevel=2)
    return None


@lru_cache(maxsize=1)
def _delete_unused() -> None:
    oldest = time.time() - KEPT_DAYS * 86400.0
    for path in cache_folder().iterdir():
        with suppress(OSError):
            if path.stat().st_mtime < oldest:
                path.unlink()


class OpenToOthers(PermissionError):
    """Somebody else may have put code into a folder."""


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Where compiled and generated code is kept between processes.

    The user's cache folder; where that cannot be had safely, one in the temporary folder; else a new one for this process.
    """
    said = next((os.environ[name] for name in VARIABLES if os.environ.get(name)), None)
    base = Path(said) if said else Path.home() / ".cache"
    user = f"readhesion-{getattr(os, 'getuid', int)()}"
    for folder in (base / "readhesion", Path(tempfile.gettempdir()) / user):
        try:
            return private(folder / "code")
        except OpenToOthers as error:
            warnings.warn(f"{error}: it is not used, delete it", RuntimeWarning, stacklevel=2)
        except OSError:
            continue  # a read-only home must not stop a study
    own = tempfile.mkdtemp(prefix="readhesion-")
    os.environ[VARIABLES[0]] = own
    register(shutil.rmtree, own, ignore_errors=True)
    return private(Path(own) / "code")


def private(folder: Path) -> Path:
    """`folder`, created if necessary, for its user alone.

    Raises `OSError` where it cannot be written, and `OpenToOthers` where others may write to it or replace it, or where it
    contains a link or another user's file.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    if os.name == "posix":  # Windows keeps the cache in the user's profile
        around = folder.parent.stat().st_mode
        if around & stat.S_IWOTH and not around & stat.S_ISVTX:
            raise OpenToOthers(f"everybody may replace what is in {str(folder.parent)!r}")
        for path in (folder, *folder.iterdir()):
            with suppress(FileNotFoundError):  # another process deletes what it has written aside
                found = path.lstat()
                open_folder = stat.S_ISDIR(found.st_mode) and found.st_mode & 0o022
                if stat.S_ISLNK(found.st_mode) or found.st_uid != os.getuid() or open_folder:
                    raise OpenToOthers(f"{str(path)!r} is not this user's alone")
    with tempfile.TemporaryFile(dir=folder):
        pass
    return folder


# Which sources decide a result: found by following imports. Comments and docstrings do not count. What is found in a file
# is kept by the file's content: parsing is slow.


ROOT = Path(__file__).parents[2]
PACKAGES = ("alloc", "mpc", "studies")
"""Packages whose imports are followed; to them comes the package of each module that is asked for."""
DATA = (".toml", ".csv")
"""Endings of data files; one counts where its name, or its name without the ending, stands as a string in a source."""
LIBRARIES = ("numpy", "numba", "llvmlite", "casadi", "osqp", "daqp", "cvxpy")
"""Installed packages whose versions count."""
PLUGIN_PREFIX = "readhesion_plugin_"
"""Beginning of the names of modules that plug-in files become."""


class SourceFile(NamedTuple):
    """What a file says, as far as results depend on it."""

    digest: str
    imports: list[str]
    """Modules named in import statements, wherever these stand; relative ones begin with their dots."""
    later: list[str]
    """Modules imported for annotations alone, or when a part or a name is asked for: those of a `Registry` (``package.*``)
    and of a facade."""
    named: list[str]
    """Data files."""


@lru_cache(maxsize=1024)
def code_hash(*modules: str, later: bool = True) -> str:
    """Hash of the versions of the libraries and of all files in the `closure` of `modules`."""
    files = [
        (one.rpartition(os.sep)[2], _source(one).digest) for one in closure(*modules, later=later)
    ]
    return hashlib.sha256(f"{library_versions()} {sorted(files)}".encode()).hexdigest()[:16]


@lru_cache(maxsize=1)
def library_versions() -> dict[str, str]:
    """Versions of Python and of the libraries that results depend on."""
    return {"python": "{}.{}".format(*sys.version_info), **{one: version(one) for one in LIBRARIES}}


@lru_cache(maxsize=256)
def closure(*modules: str, later: bool = True) -> frozenset[str]:
    """Modules and data files that decide what `modules` do, themselves included.

    A module is named as Python does, or by its file. Without `later` only what it has to import counts.
    """
    packages = {*PACKAGES, *(name.partition(".")[0] for name in modules)}
    found: set[str] = set()
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        counts = os.sep in name or name.partition(".")[0] in packages
        counts |= name.startswith(PLUGIN_PREFIX)
        path = path_of(name) if counts and name not in found else None
        if path is None:
            continue
        found.add(name)
        source = _source(name)
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        for one in source.imports + (source.later if later else []):
            one = resolve_name(one, package) if one.startswith(".") else one
            within, several, _ = one.partition(".*")
            files = ROOT.joinpath(*within.split(".")).glob("*.py") if several else ()
            waiting += [f"{within}.{file.stem}" for file in files] if several else [one]
        waiting += [*source.named, *([] if os.sep in name else [name.rpartition(".")[0]])]
    return frozenset(found)


@lru_cache(maxsize=4096)
def path_of(module: str) -> Path | None:
    """File of a module; None if it has none that can be read as text."""
    if os.sep in module:
        return Path(module)
    top, *rest = module.split(".")
    if top in PACKAGES:
        path = ROOT / top / "__init__.py"
    else:
        found: Any = sys.modules.get(top) or find_spec(top)
        path = Path(getattr(found, "__file__", None) or getattr(found, "origin", None) or "")
    files = [path]
    if rest:  # of a plug-in, or a module of one file, it is a name
        base = path.parent.joinpath(*rest)
        files = [base.with_suffix(".py"), base / "__init__.py"] * (path.name == "__init__.py")
    return next((one for one in files if one.suffix in (".py", ".toml") and one.exists()), None)


@lru_cache(maxsize=4096)
def _source(name: str) -> SourceFile:
    path = path_of(name)
    assert path is not None
    content = path.read_bytes()
    name = f"source-{hashlib.sha256(_reader() + path.suffix.encode() + content).hexdigest()[:32]}"
    found = kept(name)
    if found is None:
        found = json.dumps(_read(content, path.suffix)).encode()
        keep(name, found)
    return SourceFile(*json.loads(found))


@lru_cache(maxsize=1)
def _reader() -> bytes:
    """What decides what is found in a file, beside the file."""
    files = " ".join(sorted(_data_files().values()))
    return f"{sys.version} {files}".encode() + Path(__file__).read_bytes()


@lru_cache(maxsize=1)
def _data_files() -> dict[str, str]:
    """File by name and by name without ending."""
    paths = [path for one in PACKAGES for path in sorted((ROOT / one).rglob("*"))]
    data = [path for path in paths if path.suffix in DATA]
    return {name: str(path) for path in data for name in (path.name, path.stem)}


class _Bare(ast.NodeTransformer):
    """Takes away strings that stand alone, which are docstrings."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        return None if isinstance(node.value, ast.Constant) else node


def _read(content: bytes, suffix: str) -> SourceFile:
    text, files = content.decode("utf-8-sig", errors="replace"), _data_files()
    imports: list[str] = []
    later: list[str] = []
    if suffix == ".py":
        tree = _Bare().visit(ast.parse(content))
        imports, later = _imports(list(ast.walk(tree)))
        text = ast.dump(tree)
    elif suffix == ".toml":
        with suppress(ValueError):  # a broken one counts as it stands
            text = repr(tomllib.loads(text))
    words = re.findall(r"value='([\w.-]+)'" if suffix == ".py" else r"'([\w.-]+)'", text)
    named = sorted({files[word] for word in words if word in files})
    return SourceFile(hashlib.sha256(text.encode()).hexdigest(), imports, later, named)


def _imports(nodes: list[ast.AST]) -> tuple[list[str], list[str]]:
    """`Source.imports` and `Source.later` of a file."""
    # what stands below TYPE_CHECKING: facades (`names_of`) import it when it is asked for
    branches = [
        one for one in nodes if isinstance(one, ast.If) and _word(one.test) == "TYPE_CHECKING"
    ]
    unneeded = {id(inner) for branch in branches for inner in ast.walk(branch)}
    # names that stand in annotations alone: no number depends on them; one that nobody uses is there for others
    stated = [getattr(node, part, None) for node in nodes for part in ("annotation", "returns")]
    inner = {id(node): _word(node) for one in stated if one for node in ast.walk(one)}
    of_types = set(inner.values()) - {_word(node) for node in nodes if id(node) not in inner}
    now: list[str] = []
    later: list[str] = []
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            module = "." * getattr(node, "level", 0) + (getattr(node, "module", "") or "")
            for one in node.names:
                dot = "." if module.strip(".") else ""
                for_types = id(node) in unneeded or (one.asname or one.name) in of_types
                (later if for_types else now).extend(
                    (module or one.name, f"{module}{dot}{one.name}")
                )
        elif isinstance(node, ast.Call) and _word(node.func) == "Registry":
            words = [_word(one) for one in (*node.args, *(key.value for key in node.keywords))]
            later += [f"{word}.*" for word in words if word.partition(".")[0] in PACKAGES]
    return list(dict.fromkeys(now)), list(dict.fromkeys(later))


def _word(node: ast.AST) -> str:
    """A name, or a string, which may be one: in `__all__`, or in an annotation that looks ahead."""
    return str(getattr(node, "id", "") or getattr(node, "value", ""))
