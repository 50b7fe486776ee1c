"""`python -m paper_figs NAME ...` draws figures by name, as `readhesion figures NAME ...` does.

A module of its own, since Python runs a package by it.
"""

import sys

from studies.command_line.main import run

if __name__ == "__main__":
    sys.exit(run(["figures", *sys.argv[1:]]))
