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
    if not (
        ROOT / ".git"
    ).exists():  # an installed package may lie in the repository of something else
        return ""
    with suppress(OSError):
        git = ["git", "-C", str(ROOT)]
        head = subprocess.run(
            [*git, "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True
        )
        compared = [*git, "diff", "--quiet", "HEAD", "--", "alloc", "mpc", "studies"]
        edited = head.stdout and subprocess.run(compared, capture_output=True).returncode
        return head.stdout.strip() + (", edited" if edited else "")
    return ""


@cache
def describe_origin() -> dict[str, str]:
    """What stored results carry: versions by name, "commit", "machine"."""
    from studies.runner.row_key import LIBRARIES  # which reads all sources

    model = platform.processor()
    with suppress(OSError):
        names = re.findall(
            r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE
        )
        model = (*names, model)[0]
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, {model}"
    versions = {name: version(name) for name in ("readhesion", *LIBRARIES)}
    python = platform.python_version()
    return {"commit": find_commit(), "machine": machine, "python": python, **versions}


def origin_line() -> str:
    """The same in one line, for tables."""
    return ", ".join(f"{name} {text}" for name, text in describe_origin().items() if text)
