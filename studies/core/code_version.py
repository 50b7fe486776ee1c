"""Which code made a result: a hash of every source that decides what a run yields."""

import hashlib
from functools import lru_cache
from pathlib import Path

PACKAGES = ("alloc", "mpc")
"""Packages all of whose sources count."""
STUDY_SOURCES = ("scenario/scenario.py", "scenario/rail_keys.py", "scenario/onboard_keys.py", "scenario/train_keys.py",
                 "scenario/units.py", "lines/railtoolkit.py", "lines/railtoolkit_keys.py", "lines/railtoolkit_train.py",
                 "core/job.py", "claims/measures.py", "ladder/measures.py")  # fmt: skip
"""Sources of this package that turn a scenario into a run; report, store and command line do not count."""


@lru_cache(maxsize=1)
def code_hash() -> str:
    """Hash of the sources behind a result; it changes with any of them, and with nothing else."""
    root = Path(__file__).parents[2]
    sources = [path for package in PACKAGES for path in sorted((root / package).rglob("*.py"))]
    sources += [root / "studies" / name for name in STUDY_SOURCES]
    digest = hashlib.sha256()
    for path in sources:
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def hash_with(*paths: str | Path) -> str:
    """Hash of `code_hash` and further sources: of a table that is more than rows of runs."""
    digest = hashlib.sha256(code_hash().encode())
    for path in paths:
        digest.update(Path(path).read_bytes())
    return digest.hexdigest()[:16]
