"""`readhesion check`: the conformance kit on a rule, a readhesion controller or an adhesion curve."""

import json
from typing import Annotated

from cyclopts import Parameter

from studies.command_line.terminal import console


def check(
    name: str,
    *,
    promise: str | None = None,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> int:
    """Ask a rule, a controller or an adhesion curve whether it keeps the laws of its kind; exit code 1 where it does not.

    Parameters
    ----------
    name
        Name of the part, one of a plug-in too.
    promise
        What is asked of a rule: exact, reference or heuristic [default: what it promises].
    as_json
        Print JSON instead of a table.
    """
    from rich.markup import escape
    from rich.table import Table

    from alloc.plant.adhesion import CURVES
    from alloc.rules.rule import PROMISES, Rule
    from alloc.rules.testing import measured, verdict
    from alloc.testing import laws_of_part
    from studies.core.own_parts import registry_of
    from studies.files.study_error import StudyError

    registry = registry_of(name)
    part = registry[name]() if registry is CURVES else registry[name]
    if promise is not None:
        if not isinstance(part, Rule) or promise not in PROMISES:
            raise StudyError(f"--promise {promise}: give one of {', '.join(PROMISES)}, of a rule")
        part = part.promising(promise)
    found = [verdict(law, part) for law in laws_of_part(part)]
    broken = [one for one in found if one.fault]
    if as_json:
        rows = [
            {"law": one.law.name, "meaning": one.law.meaning, "kept": not one.fault, "worst": str(one.worst),
             "fault": one.fault, "counterexample": one.counterexample}
            for one in found
        ]  # fmt: skip
        print(json.dumps({"name": name, "kind": registry.kind, "laws": rows}, indent=2))
        return int(bool(broken))
    screen = console()
    table = Table(title=f"{registry.kind} {name}", title_justify="left")
    for heading in ("law", "kept", "worst", "meaning"):
        table.add_column(heading)
    for one in found:
        kept = "no" if one.fault else "yes"
        table.add_row(one.law.name, kept, f"{one.worst:.2g}", escape(one.law.meaning))
    screen.print(table)
    for one in broken:
        screen.print(f"[bold]{one.law.name}[/bold]: {escape(one.fault)}; worst {one.worst:.3g}")
        screen.print(f"  counterexample: {escape(one.counterexample)}", soft_wrap=True)
    if isinstance(part, Rule) and not broken:
        beside = measured(part)
        screen.print(
            f"8 units on slippery rail: gap to the exact level {100 * beside.gap:.2f} % of the plan, that of the reference "
            f"rule {100 * beside.reference_gap:.2f} %; over-delivery {100 * beside.over_delivery:.2f} %; "
            f"{1e6 * beside.time:.0f} µs a call"
        )
    return int(bool(broken))
