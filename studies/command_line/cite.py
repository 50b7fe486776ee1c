"""`readhesion cite`: the documents that a run rests on, and which of its values have a source."""

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from studies.command_line.terminal import console


def cite(
    scenario: str,
    *,
    rule: str = "greedy",
    controller: str = "cut-and-ramp",
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> None:
    """Print the documents that a run uses as BibTeX, and list which values are sourced or assumed.

    A document counts as used where the source of a part of the run names it: of the rule, the
    controller, the curve, the train, the scenario, and of what runs on board.

    Parameters
    ----------
    scenario
        Name of a shipped scenario or path of a TOML file.
    rule
        Allocation rule.
    controller
        Readhesion controller.
    as_json
        Print JSON instead of text.
    """
    from rich.markup import escape
    from rich.table import Table

    from studies.citation.run_parts import documents_of, values_of
    from studies.comparison.defaults import check_names
    from studies.scenario.loading import load_scenario

    chosen = load_scenario(scenario)
    check_names([rule], [controller])
    path = Path(scenario)
    own = path.read_text(encoding="utf-8").splitlines() if path.is_file() else None
    used, values = documents_of(chosen, rule, controller), values_of(chosen, own)
    if as_json:
        content = {
            "documents": [
                {"key": one.document.key, "used_by": one.parts, "bibtex": one.document.bibtex}
                for one in used
            ],
            "values": [one._asdict() for one in values],
        }
        print(json.dumps(content, indent=2))
        return
    for one in used:
        print(f"% {', '.join(one.parts)}\n{one.document.bibtex}\n")
    table = Table(title="[bold]values[/bold]", title_justify="left")
    for column in ("of", "value", "", "what is said of it"):
        table.add_column(column, overflow="fold")
    for value in values:
        table.add_row(*(escape(word) for word in value))
    console().print(table)
