"""Plug-ins: Python files that register parts of a user's own, or a train as TOML, loaded in every process of a study."""

import hashlib
import importlib
import linecache
import sys
import time
from collections.abc import Iterable
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from alloc.evaluation.metrics import METRICS, Metric
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.plant.trains import TRAINS
from alloc.rules import RULES, AllocationProblem, Rule
from alloc.schema.errors import InputError, blamed_on
from alloc.schema.registry import Registry
from studies.runner.row_key import PASSED_OVER, files_beside, folder_hash

PACKAGES = {"alloc", "mpc", "studies", "paper_figs", "readhesion"}
"""Packages of the project."""
_loaded: dict[str, ModuleType] = {}
"""Module by file."""
_hashes: dict[str, str] = {}
"""Hash of a module's folder when it was loaded, by the module's name."""


def loaded_files() -> tuple[str, ...]:
    """Files that were loaded, in their order."""
    return tuple(_loaded)


def load_plugins(files: Iterable[str | Path]) -> list[ModuleType]:
    """Load files that are not yet loaded, or were edited; their modules. Raises `InputError` of one line with the file."""
    reload_plugins()
    paths = [str(Path(file).resolve()) for file in files]
    return [_loaded.get(path) or _load_file(path) for path in paths]


def _load_file(path: str) -> ModuleType:
    if not Path(path).is_file():
        raise InputError(f"plug-in {path!r} does not exist")
    if Path(path).suffix not in (".py", ".toml"):
        raise InputError(f"plug-in {path!r} is no Python file, and no train as TOML")
    # files of one name in two folders are two modules
    digest = hashlib.sha256(path.encode()).hexdigest()[:8]
    name = f"readhesion_plugin_{Path(path).stem.replace('-', '_')}_{digest}"
    module = sys.modules[name] = ModuleType(name)
    module.__file__, _hashes[name] = path, folder_hash(path)
    started = time.time()
    sys.path.insert(0, str(Path(path).parent))  # its helpers lie beside it
    try:
        # stdout is for results
        with redirect_stdout(sys.stderr), blamed_on(f"plug-in {path!r} cannot be loaded"):
            if path.endswith(".toml"):
                from studies.files.train_keys import read_train

                train = read_train(path).train
                TRAINS.register(train.name, lambda: train, name)
            else:
                exec(compile(Path(path).read_bytes(), path, "exec"), vars(module))
            names = (name for name, at in Registry.registered.items() if at >= started)
            if {name.split(".")[0] for name in names} <= PACKAGES and not hasattr(module, "STUDY"):
                raise InputError("it registers no part and has no STUDY")
    except InputError:
        del sys.modules[name]
        raise
    finally:
        sys.path.remove(str(Path(path).parent))
    _loaded[path] = module
    return module


def reload_plugins() -> None:
    """Load again each of the user's modules whose folder was edited since, and what it imports from there.

    So what runs is what the keys of rows say. Raises `InputError` for a module that cannot be loaded any more.
    """
    folder_hash.cache_clear()
    names = dict.fromkeys([*Registry.registered, *(module.__name__ for module in _loaded.values())])
    edited = {name: _file_of_user(name) for name in names if _is_edited(name)}
    for name, file in edited.items():
        for registry in Registry.every:
            registry.forget(name)
        for helper in set(sys.modules) - set(edited):
            path, folder = Path(_file_of_user(helper)), Path(file).parent
            if folder in path.parents and not PASSED_OVER & {*path.relative_to(folder).parts}:
                del sys.modules[helper]
    for name, file in edited.items():
        if _loaded.pop(file, None):
            _load_file(file)
            continue
        with blamed_on(f"{file!r} was edited and cannot be loaded"):
            importlib.reload(sys.modules[name])
        _hashes[name] = folder_hash(file)
    if edited:
        from studies.run_cell import event_of

        event_of.cache_clear()  # events hold curves
        linecache.checkcache()


def _file_of_user(name: str) -> str:
    """File of a module of the user's; nothing where it has none, or is the program or the project itself."""
    file = getattr(sys.modules.get(name), "__file__", None) or ""
    return "" if name == "__main__" or name.partition(".")[0] in PACKAGES else file


def _is_edited(name: str) -> bool:
    file = _file_of_user(name)
    if file and name not in _hashes:  # not loaded here, but imported
        newest = max(path.stat().st_mtime for path in files_beside(file))
        _hashes[name] = folder_hash(file) if newest < Registry.registered[name] else ""
    return bool(file) and _hashes[name] != folder_hash(file)


# a faulty part is refused before anything is run

TRIAL = ("wet-start", 0.2)
"""Event and duration [s] of a trial: a few control periods."""
TIMED, SLOW, ASKED = 10, 5e-3, 10
"""Calls of a rule that are timed; seconds of a call that are reported; calls in a second of a run, with every telegram."""
slow: dict[str, float] = {}
"""Seconds of a call of rules that take longer, by name."""


def try_own_parts(rules: Iterable[str], controllers: Iterable[str]) -> None:
    """Ask the user's own rules for a small answer, and rules, controllers and metrics for a short run.

    Raises `InputError` of one line for a part that is none, raises an error, or answers with what is no answer.
    """
    from alloc.run.simulation import simulate
    from studies.files.scenario_files import load_scenario

    kinds: Any = (
        (RULES, rules, Rule),
        (CONTROLLERS, controllers, Controller),
        (METRICS, METRICS, Metric),
    )
    for registry, names, kind in kinds:
        for name in {*names} & {*registry} - {*registry.shipped()}:
            part = registry[name]
            function = getattr(part, "control", getattr(part, "function", None))
            with redirect_stdout(sys.stderr), blamed_on(f"{registry.kind} {name!r}", function):
                if not isinstance(part, kind):
                    raise InputError(f"it is a {type(part).__name__}; register a {kind.__name__}")
                if kind is Rule:
                    _try_rule(name, part)
                event = load_scenario(TRIAL[0]).changed(duration_s=TRIAL[1]).event()
                rule = part if kind is Rule else "alone"
                run = simulate(event, rule, part if kind is Controller else "none")
                if kind is Controller and not np.isfinite(run["torque_command"]).all():
                    raise InputError("commands a torque that is no finite number")
                if kind is Metric:
                    float(part.function(run))


def _try_rule(name: str, rule: Rule) -> None:
    """Ask a rule for small answers, and say if it takes long."""
    rule(AllocationProblem([0.2], 0.16))  # of one unit, so that a fixed number is noticed
    rule(problem := AllocationProblem([0.1, 0.2, 0.25], 0.16))  # within reach: a solver is asked
    times: list[float] = []
    while len(times) < TIMED and sum(times) < TIMED * SLOW * 10:
        times.append(rule(problem).solve_time)
    if (seconds := float(np.median(times))) > SLOW:
        slow[name] = seconds
        spent = f"{1e3 * seconds:.0f} ms a call, about {ASKED} calls a second of a run"
        print(f"readhesion: rule {name!r} takes {spent}, 1500 of check", file=sys.stderr)
