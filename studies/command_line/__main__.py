"""Entry point of the command `readhesion`: it listens to signals before it imports anything, which takes a second."""

import io
import sys

from studies.core.interruption import ends, listen


def main() -> None:
    """Run the command and exit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal may know plain letters only
    listen()
    sys.exit(ends(_run))


def _run() -> int:
    from studies.command_line.main import run

    return run()


if __name__ == "__main__":
    main()
