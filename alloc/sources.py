"""Which sources decide a result, known by a hash of their syntax; and the private folder for what is kept of them.

In: names of modules. Out: one hash, which rows of studies and compiled kernels carry. What is loaded as code lies in a
folder of the user's own; its files are written whole or not at all.
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
import tomllib
import uuid
import warnings
from atexit import register
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import NamedTuple

# Files that other processes see whole or not at all, and that are not used once they are damaged.


ASIDE = ".part"
"""In the name of a file that is being written."""
SEAL = 32
"""Bytes of the digest behind what `sealed` has sealed."""


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


def sealed(content: bytes) -> bytes:
    """`content` and its digest; pickle, marshal and loaders of libraries ignore what stands behind the end."""
    return content + hashlib.sha256(content).digest()


def set_aside_damaged(path: Path, content: bytes | None = None) -> None:
    """Rename `path`, with a warning, if it is not as it was written: `content`, or whatever was sealed."""
    with suppress(FileNotFoundError):  # as another process may set it aside too
        found = path.read_bytes()
        digest = hashlib.sha256(memoryview(found)[:-SEAL]).digest()
        if found.endswith(digest) if content is None else found == content:
            return
        aside = path.with_name(f"damaged-{path.name}")
        os.replace(path, aside)
        warnings.warn(
            f"{str(path)!r} is damaged and made again; what it was is now {aside.name!r}",
            RuntimeWarning,
            stacklevel=2,
        )


# Folders for what is loaded as code: they belong to the user, and nobody else can write there.
#
# A compiled kernel, a generated module or a library is executed when it is loaded. A folder of another user, one that
# others may write to, or one that holds another user's file is therefore not used.


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


# Which sources decide a result: found by following imports, known by a hash of their syntax.
#
# Rows of studies and compiled kernels carry this hash, so neither can be taken for the work of other code. Comments and
# docstrings do not count. What is found in a file is kept beside the compiled code, by the file's content: parsing is
# slow.


ROOT = Path(__file__).parents[1]
PACKAGES = ("alloc", "mpc", "studies")
"""Packages whose imports are followed; to them comes the package of each module that is asked for."""
DATA = (".toml", ".csv")
"""Endings of data files; one counts where its name, or its name without the ending, stands as a string in a source."""
LIBRARIES = ("numpy", "numba", "casadi", "osqp", "cvxpy")
"""Installed packages whose versions count."""
PLUGIN_PREFIX = "readhesion_plugin_"
"""Beginning of the names of modules that plug-in files become."""


class Source(NamedTuple):
    """What a file says, as far as results depend on it."""

    digest: str
    imports: list[str]
    """Modules named in import statements, wherever these stand, and the packages around them."""
    later: list[str]
    """Modules imported for annotations alone, or when a part or a name is asked for: those of a `Registry` (``package.*``)
    and of a facade."""
    named: list[str]
    """Data files."""


@lru_cache(maxsize=256)
def code_hash(*modules: str) -> str:
    """`syntax_hash` of `modules` together with the versions of the libraries."""
    text = f"{library_versions()} {syntax_hash(*modules)}"
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@lru_cache(maxsize=256)
def syntax_hash(*modules: str, later: bool = True) -> str:
    """Hash of all files in the `closure` of `modules`."""
    digest = hashlib.sha256()
    for name in sorted(closure(*modules, later=later)):
        digest.update(f"{name.rpartition(os.sep)[2]} {_source(name).digest}\n".encode())
    return digest.hexdigest()


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
        if name in found or not _counts(name, packages):
            continue
        found.add(name)
        source = _source(name)
        waiting += [_absolute(one, name) for one in source.imports] + source.named
        if later:
            waiting += [one for each in source.later for one in _modules_of(_absolute(each, name))]
    return frozenset(found)


def _absolute(module: str, importer: str) -> str:
    path = path_of(importer)
    if not module.startswith(".") or path is None:
        return module
    package = importer if path.name == "__init__.py" else importer.rpartition(".")[0]
    return resolve_name(module, package)


def _counts(name: str, packages: set[str]) -> bool:
    of_project = os.sep in name or name.partition(".")[0] in packages
    return (of_project or name.startswith(PLUGIN_PREFIX)) and path_of(name) is not None


@lru_cache(maxsize=4096)
def path_of(module: str) -> Path | None:
    """File of a module; None if it has none that can be read as text."""
    if os.sep in module:
        return Path(module)
    top, _, rest = module.partition(".")
    if top in PACKAGES:
        base = ROOT / top
    else:
        loaded = sys.modules.get(top)
        specification = None if loaded else find_spec(top)
        file = getattr(loaded, "__file__", None) or getattr(specification, "origin", None)
        if file is None or Path(file).suffix not in (".py", ".toml"):
            return None
        if Path(file).name != "__init__.py":  # a plug-in, or a module of one file
            return None if rest else Path(file)
        base = Path(file).parent
    base = base.joinpath(*rest.split(".")) if rest else base
    files = (base.with_suffix(".py"), base / "__init__.py")
    return next((path for path in files if path.exists()), None)


def _modules_of(name: str) -> list[str]:
    package, several, _ = name.partition(".*")
    if not several:
        return [name]
    folder = ROOT.joinpath(*package.split("."))
    return [f"{package}.{path.stem}" for path in folder.glob("*.py")]


@lru_cache(maxsize=4096)
def _source(name: str) -> Source:
    path = path_of(name)
    assert path is not None
    content = path.read_bytes()
    key = hashlib.sha256(_reader() + path.suffix.encode() + content).hexdigest()
    known = _Memo.entries()
    if key not in known:
        known[key] = _read(content, path.suffix)
        _Memo.changed = True
    return Source(*known[key])


@lru_cache(maxsize=1)
def _reader() -> bytes:
    """What decides what is found in a file, beside the file."""
    files = " ".join(sorted(_data_files().values()))
    return f"{sys.version} {files}".encode() + Path(__file__).read_bytes()


class _Memo:
    """What was found in files, by their content: of this process, and of those before it."""

    found: dict[str, Source] | None = None
    changed = False
    SIZE = 4096

    @classmethod
    def path(cls) -> Path:
        return cache_folder() / "sources"

    @classmethod
    def entries(cls) -> dict[str, Source]:
        if cls.found is None:
            try:
                set_aside_damaged(cls.path())
                stored = json.loads(cls.path().read_bytes()[:-SEAL])
                cls.found = {key: Source(*entry) for key, entry in stored.items()}
            except (OSError, ValueError, TypeError, AttributeError):
                cls.found = {}  # it is only slower then
        return cls.found

    @classmethod
    def keep(cls) -> None:
        if cls.changed and cls.found is not None:
            newest = dict(list(cls.found.items())[-cls.SIZE :])
            content = sealed(json.dumps(newest).encode())
            write_whole(cls.path(), lambda path: path.write_bytes(content))


register(_Memo.keep)


@lru_cache(maxsize=1)
def _data_files() -> dict[str, str]:
    """File by name and by name without ending."""
    found: dict[str, str] = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*")):
            if path.suffix in DATA:
                found |= {path.name: str(path), path.stem: str(path)}
    return found


def _read(content: bytes, suffix: str) -> Source:
    if suffix == ".py":
        return _read_python(ast.parse(content))
    words: list[str] = []
    if suffix == ".toml":
        with suppress(ValueError):  # a broken one counts as it stands
            content = repr(tomllib.loads(content.decode("utf-8-sig"))).encode()
        words = re.findall(r"'([\w.-]+)'", content.decode(errors="replace"))
    return Source(hashlib.sha256(content).hexdigest(), [], [], _named(words))


def _named(words: Iterable[str]) -> list[str]:
    files = _data_files()
    return sorted({files[word] for word in words if word in files})


def _read_python(tree: ast.Module) -> Source:
    nodes = list(ast.walk(tree))
    lazy = [node for node in nodes if isinstance(node, ast.If) and _for_types(node)]
    unneeded = {id(inner) for node in lazy for inner in ast.walk(node)}
    stated = _only_annotating(nodes)
    imports: list[str] = []
    later: list[str] = []
    strings: list[str] = []
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            for one in node.names:
                of_types = id(node) in unneeded or (one.asname or one.name) in stated
                (later if of_types else imports).extend(_imported(node, one.name))
        body = getattr(node, "body", None)
        if isinstance(body, list):  # strings that stand alone are docstrings
            node.body = [item for item in body if not _stands_alone(item)]  # type: ignore[attr-defined]
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            strings.append(node.value)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Registry":
            values = [*node.args, *(keyword.value for keyword in node.keywords)]
            words = [str(value.value) for value in values if isinstance(value, ast.Constant)]
            later += [f"{word}.*" for word in words if word.partition(".")[0] in PACKAGES]
    digest = hashlib.sha256(ast.dump(tree).encode()).hexdigest()
    return Source(digest, list(dict.fromkeys(imports)), list(dict.fromkeys(later)), _named(strings))


def _only_annotating(nodes: list[ast.AST]) -> set[str]:
    """Names that stand in annotations alone: no number depends on them. One that nobody uses is there for others."""
    stated = [getattr(node, part, None) for node in nodes for part in ("annotation", "returns")]
    inner = [node for one in stated if one is not None for node in ast.walk(one)]
    within = {id(node) for node in inner}
    used = {_name(node) for node in nodes if id(node) not in within}
    return {_name(node) for node in inner} - used


def _name(node: ast.AST) -> str:
    """A name, or a string, which may be one: in `__all__`, or in an annotation that looks ahead."""
    return str(getattr(node, "id", "") or getattr(node, "value", ""))


def _for_types(node: ast.If) -> bool:
    """Whether a branch is for type checkers; facades (`names_of`) import what stands there when it is asked for."""
    return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def _stands_alone(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _imported(node: ast.Import | ast.ImportFrom, name: str) -> list[str]:
    """Modules that the import of `name` loads, and the packages around them; relative ones begin with their dots."""
    names = [name]
    if isinstance(node, ast.ImportFrom):
        module = "." * node.level + (node.module or "")
        dot = "" if module.endswith(".") else "."
        names = [module, f"{module}{dot}{name}"]
        if node.level:
            return names
    parts = [one.split(".") for one in names]
    return [".".join(part[:k]) for part in parts for k in range(1, len(part) + 1)]
