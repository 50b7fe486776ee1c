"""Limits that every rule gives the units: JP5484215 Fig. 6 (a) high and (b) low adhesion."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from alloc.plant.rail import logarithmic_increments
from alloc.rules import RULES, Allocation, AllocationProblem, find_rule
from paper_figs.palette import DARK
from paper_figs.registry import figure
from paper_figs.style import NOTE, PAGE, Look, handle, new_panels, rule_colour

UNITS = 8
AXLES_PER_UNIT = 4
EXPECTED = 0.170
"""Planned coefficient of the readhesion paper's scenario (3.0 km/h/s)."""
HIGH, LOW = 0.160, 0.145
"""Coefficient found by the foremost unit: above and below the value at which the train can just meet the plan."""
SIZE = 3.2
"""Of the dots [points]."""
SAME = ("qp-robust", "greedy-literal", "greedy-tuned", "cooperative")
"""Rules that answer as others where they are only called: as `qp`, `greedy` and `exact`."""
SHOWN = tuple(name for name in RULES if name not in SAME)
"""Rules shown."""


def caps(coefficient: float) -> NDArray[np.float64]:
    """Caps (5) of 8 units of four axles with the increments (15), (UNITS,)."""
    per_axle = logarithmic_increments(UNITS * AXLES_PER_UNIT)
    increments = per_axle.reshape(UNITS, AXLES_PER_UNIT).mean(axis=1)
    return np.asarray(coefficient + increments - increments[0])


def problem(coefficient: float) -> AllocationProblem:
    """Problem of every rule where `coefficient` is found: true caps, limits in force at the plan."""
    cap = caps(coefficient)
    return AllocationProblem(
        cap=cap, expected=EXPECTED, delivered=np.minimum(cap, EXPECTED), truth=cap
    )


def allocate(rule: str, coefficient: float) -> Allocation:
    """What a rule answers to `problem`; a rule that acts step by step has made one step."""
    return find_rule(rule)(problem(coefficient))


@figure("allocation-bars", "limits of all rules for high and low adhesion (JP5484215 Fig. 6 a, b)")
def allocation_bars(rules: Sequence[str] = SHOWN) -> Figure:
    """One column per rule; upper row high adhesion, lower row low adhesion. A dot per unit on its stem from the cap.

    Filled dots are limits that the rail carries; open ones ask for more than that. Above each panel stand the mean limit
    ("told") and the mean of what limit and adhesion together allow ("used"), as shares of the plan.
    """
    drawn, axes = new_panels(PAGE, 3.7, 2, len(rules), sharex=True, sharey=True, squeeze=False)
    for row, coefficient in enumerate((HIGH, LOW)):
        for column, rule in enumerate(rules):
            _limits(axes[row, column], rule, coefficient)
    for (upper, lower), rule in zip(axes.T, rules, strict=True):
        upper.set_title(
            f"{rule}\n{upper.get_title()}", color=rule_colour(rule), loc="center", fontsize=NOTE
        )
        lower.set_xlabel("unit")
    axes[0, 0].set_ylabel("(a) high adhesion, case B\ncoefficient [–]")
    axes[1, 0].set_ylabel("(b) low adhesion, case A\ncoefficient [–]")
    dot = {"linestyle": "none", "marker": "o", "color": DARK, "markersize": SIZE}
    handles = [
        handle("plan", color="black", linestyle="--", linewidth=0.8),
        handle("cap", color="black", linewidth=0.8),
        handle("limit", **dot),
        handle("limit above the cap", **dot, markerfacecolor="white"),
    ]
    drawn.legend(handles=handles, loc="outside lower center", ncols=4)
    return drawn


def _limits(axes: Axes, rule: str, coefficient: float) -> None:
    units, asked = np.arange(1, UNITS + 1), problem(coefficient)
    answer = allocate(rule, coefficient)
    cap, colour = caps(coefficient), rule_colour(rule)
    axes.axhline(EXPECTED, color="black", linestyle="--", linewidth=0.8, zorder=1)
    axes.stairs(cap, np.arange(0.5, UNITS + 1.0), color="black", linewidth=0.8, baseline=None)
    axes.vlines(units, cap, answer.limit, color=colour, linewidth=0.9)
    look: Look = {
        "marker": "o",
        "markersize": SIZE,
        "linestyle": "none",
        "color": colour,
        "zorder": 3,
    }
    axes.plot(units, answer.limit, **look, gid=f"limit of {rule}")
    above = answer.limit > cap + 1e-9
    axes.plot(
        units[above],
        answer.limit[above],
        **look,
        markerfacecolor="white",
        gid=f"limit of {rule} above the cap",
    )
    told, used = (100.0 * x / EXPECTED for x in (answer.effort(asked), answer.usable(asked)))
    axes.set_title(f"told {told:.1f} %\nused {used:.1f} %", loc="center", fontsize=NOTE)
    axes.margins(y=0.05)
    axes.set_xlim(0.3, UNITS + 0.7)
    axes.set_xticks([1, 4, 8])
    axes.grid(visible=False, axis="x")
