"""`readhesion list`: what there is to choose from."""

import json
from typing import Annotated

from cyclopts import Parameter

from studies.command_line.terminal import console


def list_names(*, as_json: Annotated[bool, Parameter("--json", negative=())] = False) -> None:
    """List scenarios, rules, controllers, train sets, sweeps, figures, metrics and columns of logs.

    Parameters
    ----------
    as_json
        Print JSON instead of tables.
    """
    from rich.markup import escape
    from rich.table import Table

    from studies.command_line.catalogue import catalogue

    content = catalogue()
    if as_json:
        print(json.dumps(content, indent=2))
        return
    screen = console()
    for kind, entries in content.items():
        table = Table(title=f"[bold]{kind}[/bold]", title_justify="left", show_header=False)
        table.add_column(no_wrap=True)
        table.add_column()
        for name, meaning in entries.items():
            table.add_row(escape(name), escape(meaning))
        screen.print(table)
