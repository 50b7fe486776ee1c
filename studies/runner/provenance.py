"""What computed a result: version and commit of this project, Python and libraries, and the machine. It names no host."""

import os
import platform
import re
import subprocess
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[2]


@cache
def find_commit() -> str:
    """The commit of a clone, marked where what computes was edited since; empty where there is no clone or no git."""
    git = ["git", "-C", str(ROOT)]
    with suppress(OSError, subprocess.CalledProcessError):
        # an installed package may lie in the repository of something else
        if (ROOT / ".git").exists():
            commit = subprocess.check_output([*git, "rev-parse", "--short=12", "HEAD"], text=True)
            compared = [*git, "diff", "--quiet", "HEAD", "--", "alloc", "mpc", "studies"]
            return commit.strip() + (", edited" if subprocess.run(compared).returncode else "")
    return ""


@cache
def describe_origin() -> dict[str, str]:
    """What stored results carry: "commit", "machine", and versions by name."""
    from studies.runner.row_key import LIBRARIES  # which reads all sources

    model = platform.processor()
    with suppress(OSError):
        model = (re.findall(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text()) or [model])[
            0
        ]
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, {model}"
    versions = {name: version(name) for name in ("readhesion", *LIBRARIES)}
    python = platform.python_version()
    return {"commit": find_commit(), "machine": machine, "python": python, **versions}


def origin_line() -> str:
    """The same in one line, for tables."""
    return ", ".join(f"{name} {text}" for name, text in describe_origin().items() if text)
