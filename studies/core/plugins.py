"""Plug-ins: Python files that register parts of their own, given by `--plugin`, and known to every process of a study."""

import hashlib
import importlib.util
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from studies.core.code_version import PLUGIN_PREFIX
from studies.core.study_error import StudyError

VARIABLE = "READHESION_PLUGINS"
"""Environment variable that holds the files, so that worker processes load them too."""


def use_plugins(files: Iterable[str | Path]) -> None:
    """Load plug-in files, here and in every process that is started from here; raises `StudyError` where one is faulty."""
    paths = [str(Path(file).resolve()) for file in files]
    known = [path for path in os.environ.get(VARIABLE, "").split(os.pathsep) if path]
    os.environ[VARIABLE] = os.pathsep.join(dict.fromkeys([*known, *paths]))
    load_plugins()


def load_plugins() -> None:
    """Load the files of the environment that are not loaded yet."""
    for file in os.environ.get(VARIABLE, "").split(os.pathsep):
        if file and module_name(file) not in sys.modules:
            _load(file)


def module_name(file: str) -> str:
    """Name of the module that a plug-in file becomes; files of one name in two folders are two modules."""
    digest = hashlib.sha256(file.encode()).hexdigest()[:8]
    return f"{PLUGIN_PREFIX}{Path(file).stem.replace('-', '_')}_{digest}"


def _load(file: str) -> None:
    name = module_name(file)
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None or not Path(file).is_file():
        raise StudyError(
            f"plug-in {file!r} is no Python file; give the path of one, such as rule.py"
        )
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        reason = " ".join(str(error).split())
        raise StudyError(
            f"plug-in {file!r} cannot be loaded: {type(error).__name__}: {reason}"
        ) from None
