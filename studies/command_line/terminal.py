"""What a person at a terminal sees: console and progress bar."""

from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    import pandas as pd

    from studies.command_line.options import Work

PLAIN_WIDTH = 170
"""Width of tables that do not go to a terminal."""


class _Terminal(Console):
    """A console whose reader may leave early, as `head` does."""

    def on_broken_pipe(self) -> None:
        """Let the command end by the error, see `studies.command_line.main.run`."""
        raise


def console() -> Console:
    """Where tables are printed: as wide as the terminal, or `PLAIN_WIDTH` where there is none."""
    found = _Terminal()
    return found if found.is_terminal else _Terminal(width=PLAIN_WIDTH)


def counted(table: "pd.DataFrame", what: str) -> str:
    """How many rows a table has, called `what`, and how many have another status than "ok"."""
    counts = Counter(table.get("status", ()))
    bad = [f", [red]{n} {status}[/red]" for status, n in counts.items() if status != "ok"]
    return "".join([f"{len(table)} {what}", *bad])


def of_shard(work: "Work") -> str:
    """Which share of the events was run, and what makes a whole of them; nothing where it is the whole."""
    return f" of shard {work.shard}; `readhesion merge` unites the shards" if work.shard else ""


class progress:
    """Progress bar on stderr; gives the function that is told of each finished row."""

    def __enter__(self) -> Callable[[str, int, int], None]:
        terminal = _Terminal(stderr=True)
        self.bar = Progress(
            TextColumn("[progress.description]{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=terminal,
            transient=True,
            disable=not terminal.is_terminal,
        )
        self.bar.start()
        self.task = self.bar.add_task("starting", total=None)

        def on_row(label: str, done: int, total: int) -> None:
            self.bar.update(self.task, description=label, completed=done, total=total)

        return on_row

    def __exit__(self, *_: object) -> None:
        self.bar.stop()
