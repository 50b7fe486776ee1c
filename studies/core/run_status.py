"""Whether a recorded run is one of the rule and the controller that it is named after."""

import json
from typing import Any

import xarray as xr

from alloc.recording import attributes_of

MOST_FAILURES = 0.05
"""Share of its calls, or of its steps over all units, in which a rule or a controller may fail in a run that counts.

Assumed: where it fails the exact level or cut-and-ramp answers for it, and beyond one in twenty the run is also theirs."""

DEGRADED = "degraded"
"""Status of a row whose run counts for neither: its numbers are kept, and enter no mean and no statement."""


def run_status(run: xr.Dataset) -> dict[str, Any]:
    """Status columns of a row: none while failures are few, else status and reason with the share that failed."""
    told = attributes_of(run)
    messages = json.loads(told["messages"])
    for part, calls, count, failed in (
        ("rule", "calls", told["rule_calls"], told["rule_failures"]),
        ("controller", "steps", told["controller_calls"], told["controller_failures"]),
    ):
        if failed > MOST_FAILURES * count:
            mine = {text: n for text, n in messages.items() if text.startswith(f"{part}: ")}
            reason = (
                f"the {part} failed in {failed / count:.1%} of {count} {calls}, {MOST_FAILURES:.0%} are allowed; "
                f"most often: {max(mine, key=mine.__getitem__).removeprefix(f'{part}: ')}"
            )
            return {"status": DEGRADED, "reason": reason}
    return {}
