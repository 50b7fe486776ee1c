"""Plug-ins: files that register parts of their own, given by `--plugin`, and loaded in every process of a study.

A Python file may register any parts; a TOML file is a train.
"""

import hashlib
import os
import sys
import traceback
from collections.abc import Iterable
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType

from alloc.plant.sets import SETS
from alloc.registry import Registry
from alloc.sources import PACKAGES, PLUGIN_PREFIX
from studies.files.study_error import StudyError
from studies.scenario.train_file import read_train_file

VARIABLE = "READHESION_PLUGINS"
"""Environment variable that contains the files, so that worker processes load them too."""


def use_plugins(files: Iterable[str | Path]) -> None:
    """Load plug-in files, here and in every process that is started from here; raises `StudyError` where one is faulty."""
    paths = [str(Path(file).resolve()) for file in files]
    before = os.environ.get(VARIABLE, "")
    os.environ[VARIABLE] = os.pathsep.join(dict.fromkeys([*_files(), *paths]))
    try:
        load_plugins()
    except StudyError:
        os.environ[VARIABLE] = before
        raise


def load_plugins() -> None:
    """Load the files of the environment that are not yet loaded."""
    for file in _files():
        if module_name(file) not in sys.modules:
            _load(file)


def plugin_modules() -> list[str]:
    """Names of the modules that the files of the environment become."""
    return [module_name(file) for file in _files()]


def plugin_files() -> list[str]:
    """The files of the environment as a person would name them: those below the present folder from there."""
    here = Path.cwd()
    paths = map(Path, _files())
    return [str(path.relative_to(here) if path.is_relative_to(here) else path) for path in paths]


def _files() -> list[str]:
    return [file for file in os.environ.get(VARIABLE, "").split(os.pathsep) if file]


def module_name(file: str) -> str:
    """Name of a plug-in file's module; files of the same name in two folders are two modules."""
    digest = hashlib.sha256(file.encode()).hexdigest()[:8]
    return f"{PLUGIN_PREFIX}{Path(file).stem.replace('-', '_')}_{digest}"


def _load(file: str) -> None:
    if not Path(file).is_file() or Path(file).suffix not in (".py", ".toml"):
        raise StudyError(
            f"plug-in {file!r} is no file; give the path of a Python file, or of a train as TOML"
        )
    name = module_name(file)
    module = ModuleType(name)
    module.__file__ = file
    sys.modules[name] = module
    before = len(Registry.registered)
    try:
        if file.endswith(".toml"):
            train = read_train_file(file)
            SETS.register(train.name, lambda: train, name)
            module.__doc__ = "Train of a file of one's own."
        else:
            source = Path(file).read_bytes()
            with redirect_stdout(sys.stderr):  # stdout is for results
                exec(compile(source, file, "exec"), vars(module))
        makers = {origin.partition(".")[0] for origin in Registry.registered[before:]}
        if makers <= {*PACKAGES, "paper_figs"}:
            raise StudyError("it registers nothing; docs/developing.md says how to")
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        reason = " ".join(str(error).split())
        for other in _files():
            reason = reason.replace(module_name(other), f"plug-in {other!r}")
        said = (
            ""
            if isinstance(error, StudyError)
            else f"{type(error).__name__}{line_in(file, error)}: "
        )
        raise StudyError(f"plug-in {file!r} cannot be loaded: {said}{reason}") from None


def line_in(file: str, error: BaseException) -> str:
    """The last line of `file` that an error came through, as " in line n"; empty where there is none."""
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    if isinstance(error, SyntaxError) and error.filename == file:
        return ""  # its message has the line
    return f" in line {lines[-1]}" if lines else ""
