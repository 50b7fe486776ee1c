"""What holds for the whole suite."""

import gc
import os
import resource
import subprocess
import sys

import pytest

# before NumPy is imported, as for the command: threads of BLAS wait for each other, and the cores are for processes
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


COMPILE = """
from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from studies.runner.shared_code import prepare_code
prepare_code([*RULES], [*CONTROLLERS])
"""


def pytest_configure(config):
    """One process compiles what all then load; and what they load is kept, so they look for garbage rarely."""
    from studies import RARELY

    gc.set_threshold(*RARELY)
    if getattr(config.option, "numprocesses", 0) and not hasattr(config, "workerinput"):
        subprocess.run([sys.executable, "-c", COMPILE], cwd=config.rootpath, check=True)


MOST_MEMORY = 3.5e9
"""What a process of the tests may take at its worst [bytes]."""


@pytest.fixture(scope="session", autouse=True)
def memory():
    """A test that takes gigabytes stops a small machine, and those who work on it."""
    yield
    unit = 1 if sys.platform == "darwin" else 1024
    taken = unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert taken < MOST_MEMORY, f"this process of the tests took {taken / 1e9:.1f} GB"


@pytest.fixture(autouse=True)
def own_parts():
    """What a test registers, or loads as a plug-in, is gone after it: no test sees the parts of another."""
    from alloc.schema.registry import Registry
    from studies.runner import plugins

    tables = (Registry.registered, plugins._loaded, plugins._hashes, plugins.slow)
    before = [dict(table) for table in tables]
    yield
    for origin, instant in Registry.registered.items():
        if origin.partition(".")[0] in plugins.PACKAGES:  # loaded late, and to stay
            before[0][origin] = instant
        elif origin not in before[0]:
            for registry in Registry.every:
                registry.forget(origin)
    for table, rows in zip(tables, before, strict=True):
        table.clear()
        table.update(rows)


def pytest_collection_modifyitems(items):
    """The slow ones first, so that no process is left with one when the others are done."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
